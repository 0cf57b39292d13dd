"""What a hostile client sends to the socket of the cockpit's page.

The tests of the page use it, too.
"""

import asyncio
import random
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import msgspec
from cockpit_client import CAMERA, VERSION, socket_address
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake


async def flood(
    address: str, count: int, controls: Sequence[str] = (), stops: Sequence[str] = ()
) -> int:
    """Send so many, connecting again where that is needed; return how often.

    Args:
        address: Of the page.
        count: Messages.
        controls: Identifiers of controls that are attacked.
        stops: Those of STOP: attributes of it are attacked, and it is not pressed.
    """
    rng = random.Random(2)
    sent = closed = 0
    while sent < count:
        with suppress(ConnectionClosed, InvalidHandshake, OSError):
            url = socket_address(address)
            async with connect(url, subprotocols=VERSION, max_size=None) as socket:
                reader = asyncio.create_task(swallow(socket))
                await socket.send(msgspec.msgpack.encode(CAMERA))
                try:
                    while sent < count:
                        await socket.send(_garbage(rng, controls, stops))
                        sent += 1
                finally:
                    reader.cancel()
        closed += sent < count
    return closed


async def swallow(socket: Any) -> None:
    """Read what comes, and forget it."""
    with suppress(ConnectionClosed):
        async for _ in socket:
            pass


def _garbage(
    rng: random.Random, controls: Sequence[str], stops: Sequence[str]
) -> bytes:
    if rng.random() < 0.01:
        return rng.randbytes(rng.randrange(200))
    return msgspec.msgpack.encode(_nonsense(rng, controls, stops))


def _nonsense(
    rng: random.Random, controls: Sequence[str], stops: Sequence[str]
) -> dict[str, Any]:
    """Return a message of a known kind with values that no page sends."""
    numbers = (float("nan"), float("inf"), -1e308, 0.0, 1.0, 1e9)
    place = [rng.choice(numbers) for _ in range(3)]
    turn = [rng.choice(numbers) for _ in range(4)]
    name = rng.choice(("/pull", "/drag", "/cell", "", "../x"))
    uuid = rng.choice((*controls, *stops, "x"))
    value = {"removed": True} if uuid in stops else {"value": "Start"}
    change: tuple[dict[str, Any], ...] = (
        value,
        {"removed": True},
        {"value": place},
        {"disabled": True},
        {"visible": False},
        {"update_cb": []},
        {"uuid": "x", "props": None},
    )
    file = {"transfer_uuid": "x", "source_component_uuid": uuid}
    kinds: tuple[dict[str, Any], ...] = (
        {"type": "TransformControlsDragStartMessage", "name": name, "owner": ""},
        {
            "type": "TransformControlsUpdateMessage",
            **{"name": name, "wxyz": turn, "position": place, "owner": ""},
        },
        {"type": "TransformControlsDragEndMessage", "name": name, "owner": ""},
        {"type": "GuiUpdateMessage", "uuid": uuid, "updates": rng.choice(change)},
        {"type": "CommandTriggerMessage", "uuid": str(rng.random())},
        {"type": "ShareUrlRequest"},
        {
            "type": "FileTransferStartUpload",
            **{"filename": "a", "mime_type": "b", "part_count": 9, "size_bytes": 9},
            **file,
        },
        {
            "type": "FileTransferPart",
            **{"part_index": 0, "content": bytes(1000)},
            **file,
        },
        {"type": "SceneNodeUpdateMessage", "name": name, "updates": {"removed": True}},
    )
    return rng.choice(kinds)
