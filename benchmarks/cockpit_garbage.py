"""What a hostile client sends to the socket of the cockpit's page.

The tests of the page use it, too.
"""

import asyncio
import random
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import viser


async def flood(server: "viser.ViserServer", count: int) -> int:
    """Send so many, connecting again where that is needed; return how often."""
    import msgspec
    import viser
    from websockets.asyncio.client import connect
    from websockets.exceptions import ConnectionClosed
    from websockets.typing import Subprotocol

    rng = random.Random(2)
    url = f"ws://{server.get_host()}:{server.get_port()}"
    version = [Subprotocol(f"viser-v{viser.__version__}")]
    sent = closed = 0
    while sent < count:
        async with connect(url, subprotocols=version, max_size=None) as socket:
            reader = asyncio.create_task(_swallow(socket))
            with suppress(ConnectionClosed):
                while sent < count:
                    sent += 1
                    if rng.random() < 0.01:
                        await socket.send(rng.randbytes(rng.randrange(200)))
                    else:
                        await socket.send(msgspec.msgpack.encode(_nonsense(rng)))
            closed += sent < count
            reader.cancel()
    return closed


async def _swallow(socket: Any) -> None:
    async for _ in socket:
        pass


def _nonsense(rng: random.Random) -> dict[str, Any]:
    """Return a message of a known kind with values that no page sends."""
    numbers = (float("nan"), float("inf"), -1e308, 0.0, 1.0, 1e9)
    place = [rng.choice(numbers) for _ in range(3)]
    turn = [rng.choice(numbers) for _ in range(4)]
    name = rng.choice(("/pull", "/drag", "/cell", "", "../x"))
    kinds: tuple[dict[str, Any], ...] = (
        {"type": "TransformControlsDragStartMessage", "name": name, "owner": ""},
        {
            "type": "TransformControlsUpdateMessage",
            **{"name": name, "wxyz": turn, "position": place, "owner": ""},
        },
        {"type": "TransformControlsDragEndMessage", "name": name, "owner": ""},
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": place}},
        {"type": "CommandTriggerMessage", "uuid": str(rng.random())},
    )
    return rng.choice(kinds)
