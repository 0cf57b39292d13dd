"""A viewer of the cockpit's page without a browser: it sends and reads what one does.

The tests of the pages use it, too.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

VERSION = [Subprotocol(f"viser-v{viser.__version__}")]
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    **{"position": (1.0, 0.0, 1.0), "fov": 0.7, "near": 0.01, "far": 100.0},
    **{"image_height": 720, "image_width": 1280},
    **{"look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0)},
}


def socket_address(address: str) -> str:
    """Return where the page of an address has its web socket."""
    return address.replace("http://", "ws://").rstrip("/")


class Client:
    """A page that somebody has open, as far as the server can tell."""

    def __init__(self, address: str, **more: Any) -> None:
        """Open it; `more` is for the connection."""
        self._encode = msgspec.msgpack.encode
        self.controls: dict[str, str] = {}
        """Identifier of each control and command, by its label."""
        self.kinds: set[str] = set()
        """Kinds of messages that came."""
        self.notes: list[str] = []
        """Notifications that were shown."""
        url = socket_address(address)
        self._socket = connect(
            url, subprotocols=VERSION, compression=None, max_size=None, **more
        )
        self._is_shown = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self.send(CAMERA)
        assert self._is_shown.wait(20.0), "the page was not shown in time"
        for _ in range(3):  # until the server knows it by its camera
            assert self._socket.ping().wait(20.0)

    def _read(self) -> None:
        with suppress(ConnectionClosed):
            for raw in self._socket:
                assert isinstance(raw, bytes)
                for message in _messages(raw):
                    self._take(message)

    def _take(self, message: Mapping[str, Any]) -> None:
        self.kinds.add(message["type"])
        label = message.get("props", {}).get("label")
        if message["type"] == "ReplayDoneMessage":
            self._is_shown.set()
        elif message["type"].startswith("Notification"):
            self.notes.append(message["props"]["title"])
        elif label is not None and "uuid" in message:
            self.controls[label] = message["uuid"]

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a message."""
        self._socket.send(self._encode(message))

    def send_bytes(self, raw: bytes) -> None:
        """Send what may be no message."""
        self._socket.send(raw)

    def set(self, label: str, **updates: Any) -> None:
        """Set attributes of a control."""
        uuid = self.controls[label]
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates})

    def press(self, label: str) -> None:
        """Press a button."""
        self.set(label, value=True)

    def key(self, label: str) -> None:
        """Press the key of a command."""
        self.send({"type": "CommandTriggerMessage", "uuid": self.controls[label]})

    def drag(self, name: str, position: Sequence[float]) -> None:
        """Grab a gizmo and move it to a place [m]."""
        here = {"name": name, "owner": ""}
        self.send({"type": "TransformControlsDragStartMessage", **here})
        place = {"position": tuple(map(float, position)), "wxyz": (1.0, 0.0, 0.0, 0.0)}
        self.send({"type": "TransformControlsUpdateMessage", **here, **place})

    def let_go(self, name: str) -> None:
        """Let a gizmo go."""
        kind = "TransformControlsDragEndMessage"
        self.send({"type": kind, "name": name, "owner": ""})

    @property
    def is_closed(self) -> bool:
        """Whether the server has ended the connection."""
        return not self._thread.is_alive()

    def close(self) -> None:
        """Leave the page."""
        self._socket.close()


def _messages(raw: bytes) -> Sequence[Mapping[str, Any]]:
    """Return the messages of a frame: sizes, packed words, then arrays."""
    size, packed = (int.from_bytes(raw[at : at + 8], "little") for at in (0, 8))
    words = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], size)
    return msgspec.msgpack.decode(words)["messages"]


def wait_for(what: Callable[[], Any], timeout: float = 10.0) -> Any:
    """Return what a function gives as soon as that is something."""
    end = time.monotonic() + timeout
    while not (found := what()):
        assert time.monotonic() < end, "it did not come about in time"
        time.sleep(0.0005)
    return found
