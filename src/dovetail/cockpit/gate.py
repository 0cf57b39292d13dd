"""Access control of a page: tokens, and a filter of the messages to viser.

A page's address has a random token in its path, so that no other page, user or program
knows it. A second token gives an address that sees everything and may only stop. The
token is in the path and not in a cookie: browsers send cookies to every port of a host.

viser 1.1 takes any client, sets any attribute that a client names, keeps uploads, and
opens a tunnel to a public server when a client asks for it. It has no option against
that. It calls `websockets.asyncio.server.serve`, whose public parameters can do it all:
`process_request` sees each request, `create_connection` each message. `serving` hands
them over while viser starts, and `require_closed` tries afterwards whether the gate is
shut, so that another version of viser fails here and not in front of an arm.
"""

import contextvars
import hmac
import http
import re
import secrets
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NoReturn

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidHandshake, InvalidStatus
from websockets.http11 import Request, Response
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from dovetail.cockpit.messages import (
    CameraMoved,
    ControlUsed,
    DragBegun,
    DragEnded,
    Dragged,
    KeyPressed,
    Message,
    can_have,
    read_message,
    write_message,
)
from dovetail.cockpit.page_log import LOG
from dovetail.cockpit.software_rendering import ENTRY_PAGE
from dovetail.errors import DovetailError, install_command

_OWN_HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
"""Host of a request that a browser sends here: a loopback name. The port is another
one behind a tunnel of ssh. A page that rebinds its name to 127.0.0.1 sends its name."""
MESSAGE_MAX = 8 * 1024
"""Longest message of a client [bytes]; a page's longest is a twentieth of it."""
BYTES = (24e3, 32e3)
"""Bytes that a client may send, per second and at once; a page sends 13,000 at most."""
MESSAGES = (100.0, 300.0)
"""Messages that a client may send, per second and at once; a page sends 50 at most."""
VIEWERS_MAX = 8
"""Connections that may be open at once with each of the two addresses. One more that
wants to drive is refused; one that watches takes the place of the longest silent."""
TRIED_FOR = 5.0
"""Longest wait of `require_closed` until the gate sees a message [s]."""
_ENTERING_MAX = 100  # connections whose request has not come yet
_OPEN_TIMEOUT = 5.0  # [s] for a request to come
_SELDOM = 10.0  # [s] between two lines about what was refused
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_CONNECTION: contextvars.ContextVar["Visitor"] = contextvars.ContextVar("connection")
_PATCHING = threading.Lock()

Asked = Callable[[ServerConnection, Request], Response | None]
Handler = Callable[[ServerConnection], Awaitable[None]]


class GateError(DovetailError, RuntimeError):
    """The installed viser or websockets does not let the gate be shut."""


class TokenBucket:
    """A budget that fills at a rate up to a largest amount."""

    def __init__(self, rate: float, most: float) -> None:
        """Begin full; `rate` is per second."""
        self._rate, self._most = rate, most
        self._left, self._last = most, time.monotonic()

    def take(self, amount: float) -> bool:
        """Take an amount; False if less than that is left."""
        now = time.monotonic()
        filled = self._left + self._rate * (now - self._last)
        self._left, self._last = min(self._most, filled) - amount, now
        return self._left >= 0.0


class Visitor(ServerConnection):
    """A connection to the page."""

    def __init__(self, gate: "Gate", *args: Any, **more: Any) -> None:
        """Begin without rights; `Gate.ask` gives them."""
        super().__init__(*args, **more)
        self._gate = gate
        self._bytes, self._messages = TokenBucket(*BYTES), TokenBucket(*MESSAGES)
        self.may_drive = False
        """True if it came by the address that may drive."""
        self.heard = time.monotonic()
        """Time of its newest message, or of its connection before the first."""
        self.number: int | None = None
        """viser's number of it; None until viser knows it."""

    def connection_made(self, transport: Any) -> None:
        """Count it among those whose request has not come yet."""
        super().connection_made(transport)
        self._gate.enter(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self._gate.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take bytes; a client that sends too many is cut before they are parsed."""
        if self._bytes.take(len(data)):
            super().data_received(data)
        else:
            self.cut()

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that may reach viser, as bytes."""
        while True:
            raw = await super().recv(decode)
            self.heard = time.monotonic()
            if not self._messages.take(1.0):
                self.cut()
                continue  # the next call raises that it is closed
            message = self._gate.admit(self, raw)
            if message is not None:
                return message

    def cut(self) -> None:
        """Close without waiting for the client."""
        self._gate.note("a client sent more than a page does and was cut")
        self.transport.abort()


class Gate:
    """Knows the tokens and the rights of each.

    Before `guard` and `take` only camera motions pass.
    """

    def __init__(self, subprotocol: str) -> None:
        """Draw two tokens.

        Args:
            subprotocol: Name by which a page of this viser opens its socket.
        """
        self.subprotocol = subprotocol
        self.drive_token = secrets.token_urlsafe(24)
        """Token of the address that may drive."""
        self.watch_token = secrets.token_urlsafe(24)
        """Token of the address that sees everything and may stop."""
        self.refused = 0
        """Messages that did not reach viser."""
        self._entering: dict[Visitor, None] = {}
        self._inside: set[Visitor] = set()
        self._stop_words: set[str] = set()
        self._gui: Any = None
        self._gizmos: frozenset[str] = frozenset()
        self._may_drive: Callable[[int], bool] = lambda _: False
        self._tell: Callable[[int, bool], None] = lambda *_: None
        self._stop: Callable[[], None] = lambda: None
        self._pressed, self._is_closed = threading.Event(), False
        self._noted = time.monotonic()  # what `require_closed` tries is not logged
        threading.Thread(target=self._wait_for_stop, name="stop", daemon=True).start()

    # -- what a page says ------------------------------------------------------------

    def guard(self, server: Any) -> None:
        """Take the viser server whose controls are guarded."""
        self._gui = server.gui
        if self._controls or self._commands:
            raise GateError("a new page of viser has controls already")
        server.on_client_connect(self._name)

    def take(
        self,
        *,
        may_drive: Callable[[int], bool],
        tell: Callable[[int, bool], None] = lambda *_: None,
        stop: Callable[[], None] = lambda: None,
        gizmos: tuple[str, ...] = (),
    ) -> None:
        """Connect a page.

        Args:
            may_drive: Returns whether a viewer, by viser's number, may act now.
            tell: Called with the number of a viewer whose action was refused, and
                whether its address may drive.
            stop: Called for each STOP, in a thread of its own.
            gizmos: Names of the gizmos that may be dragged.
        """
        self._may_drive, self._tell, self._stop = may_drive, tell, stop
        self._gizmos = frozenset(gizmos)

    def add_stops(self, *handles: Any) -> None:
        """Let controls and commands stop, for good and for every viewer.

        Also after they were removed: a browser may still show an older page.
        """
        known = {**self._controls, **self._commands}
        found = {uuid for uuid, handle in known.items() if handle in handles}
        if len(found) != len(handles):
            raise GateError("viser does not know a control that it has just added")
        self._stop_words |= found

    # viser 1.1 has no public way from the name that a client sends to the control, so
    # its two tables are read here and nowhere else. `guard` fails where they are gone.

    @property
    def _controls(self) -> dict[str, Any]:
        return self._gui._gui_input_handle_from_uuid

    @property
    def _commands(self) -> dict[str, Any]:
        return self._gui._command_handle_from_uuid

    async def _name(self, client: Any) -> None:
        _CONNECTION.get().number = client.client_id

    def press_stop(self) -> None:
        """Stop, in a thread that does nothing else."""
        self._pressed.set()

    def _wait_for_stop(self) -> None:
        while True:
            self._pressed.wait()
            self._pressed.clear()
            if self._is_closed:
                return
            try:
                self._stop()
            except Exception:
                LOG.exception("page: a stop failed")

    def close(self) -> None:
        """End the thread of the stops."""
        self._is_closed = True
        self._pressed.set()

    # -- connections; in the server's thread -------------------------------------------

    def enter(self, visitor: Visitor) -> None:
        """Count a connection without a request; of too many the oldest is closed."""
        self._entering[visitor] = None
        if len(self._entering) > _ENTERING_MAX:
            oldest = next(iter(self._entering))
            del self._entering[oldest]
            oldest.transport.abort()

    def leave(self, visitor: Visitor) -> None:
        """Forget a connection."""
        self._entering.pop(visitor, None)
        self._inside.discard(visitor)

    def ask(self, of_viser: Asked, visitor: ServerConnection, request: Request) -> Any:
        """Answer a request: None opens a web socket, everything else is a page."""
        assert isinstance(visitor, Visitor)
        self._entering.pop(visitor, None)
        problem = _wrong_place(request) or self._wrong_token(visitor, request)
        if problem:
            return visitor.respond(http.HTTPStatus.FORBIDDEN, f"{problem}\n")
        if "Upgrade" in request.headers:
            asked = ",".join(request.headers.get_all("Sec-WebSocket-Protocol"))
            if self.subprotocol not in (name.strip() for name in asked.split(",")):
                other = "this page is of another version of viser: load it anew\n"
                return visitor.respond(http.HTTPStatus.BAD_REQUEST, other)
            same = [v for v in self._inside if v.may_drive == visitor.may_drive]
            if len(same) >= VIEWERS_MAX and visitor.may_drive:
                busy = f"{VIEWERS_MAX} viewers have opened this address already\n"
                return visitor.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, busy)
            if len(same) >= VIEWERS_MAX:  # one more must be able to stop
                silent = min(same, key=lambda one: one.heard)
                self.leave(silent)
                silent.transport.abort()
            self._inside.add(visitor)
            return of_viser(visitor, Request("/", request.headers))
        if "?" in request.path:
            response = of_viser(visitor, Request("/", request.headers))
            assert response is not None
        else:
            response = visitor.respond(http.HTTPStatus.OK, ENTRY_PAGE)
            del response.headers["Content-Type"]
            response.headers["Content-Type"] = "text/html; charset=utf-8"
        response.headers.update(_HEADERS)
        return response

    def _wrong_token(self, visitor: Visitor, request: Request) -> str:
        path = request.path.partition("?")[0].strip("/").encode(errors="replace")
        visitor.may_drive = hmac.compare_digest(path, self.drive_token.encode())
        may_watch = hmac.compare_digest(path, self.watch_token.encode())
        if visitor.may_drive or may_watch:
            return ""
        return (
            "This page needs its whole address, with the token at its end. dovetail "
            "has printed it where it was started."
        )

    def admit(self, visitor: Visitor, raw: object) -> bytes | None:
        """Return the message for viser; None drops it."""
        message = read_message(raw)
        is_used = isinstance(message, ControlUsed | KeyPressed)
        if is_used and message.uuid in self._stop_words:
            self.press_stop()
            return None
        if message is not None and self._may(visitor, message):
            return write_message(message)
        self.refused += 1
        self.note("a client sent what no page sends, or what only the driver may")
        return None

    def _may(self, visitor: Visitor, message: Message) -> bool:
        """Return whether this visitor may send the message now."""
        if isinstance(message, CameraMoved):
            return True
        if not self._is_possible(message) or visitor.number is None:
            return False
        if visitor.may_drive and self._may_drive(visitor.number):
            return True
        if not isinstance(message, Dragged | DragEnded):
            self._tell(visitor.number, visitor.may_drive)
        return False

    def _is_possible(self, message: Message) -> bool:
        """Return whether the page has such a control, and the control such a value."""
        if isinstance(message, ControlUsed):
            control = self._controls.get(message.uuid)
            return can_have(control, message.updates.value)
        if isinstance(message, KeyPressed):
            command = self._commands.get(message.uuid)
            return command is not None and not command.disabled
        if isinstance(message, DragBegun | Dragged | DragEnded):
            return message.name in self._gizmos
        return False

    def note(self, what: str) -> None:
        """Log a refusal, at most every 10 s: a flood must not fill the terminal."""
        now = time.monotonic()
        if now - self._noted >= _SELDOM:
            self._noted = now
            LOG.warning("page: %s (%d messages dropped so far)", what, self.refused)


def _wrong_place(request: Request) -> str:
    """Return why a request is not from a page of this server; empty if it may be."""
    hosts = request.headers.get_all("Host")
    if len(hosts) != 1 or not _OWN_HOST.fullmatch(hosts[0].lower()):
        return "This page is opened as http://127.0.0.1:PORT/ or localhost only."
    host = hosts[0].lower()
    origins = [origin.lower() for origin in request.headers.get_all("Origin")]
    if origins not in ([], [f"http://{host}"], [f"https://{host}"]):
        return "Another page has sent this request. It may not."
    return ""


@contextmanager
def serving(gate: Gate) -> Iterator[None]:
    """Put a gate before the servers that viser starts in this block."""
    module: Any = websockets.asyncio.server
    original = module.serve

    def serve(handler: Handler, *args: Any, **more: Any) -> Any:
        if not handler.__module__.startswith("viser."):
            return original(handler, *args, **more)

        async def handle(connection: ServerConnection) -> None:
            assert isinstance(connection, Visitor)
            _CONNECTION.set(connection)  # its tasks inherit it, and `Gate._name` asks
            await handler(connection)

        of_viser = more.pop("process_request")
        more |= {
            "process_request": partial(gate.ask, of_viser),
            "create_connection": partial(Visitor, gate),
            "max_size": MESSAGE_MAX,
            "open_timeout": _OPEN_TIMEOUT,
        }
        return original(handle, *args, **more)

    with _PATCHING:
        module.serve = serve
        try:
            yield
        finally:
            module.serve = original


def require_closed(gate: Gate, port: int) -> None:
    """Try the gate from outside.

    Raises:
        GateError: It lets in a client that must be refused, or does not answer.
    """
    here = f"ws://127.0.0.1:{port}"
    right = f"{here}/{gate.drive_token}"
    for url, origin in (
        (here, None),
        (f"{here}/{gate.watch_token[:-1]}", f"http://127.0.0.1:{port}"),
        (right, "http://127.0.0.1:1"),
        (right, "null"),
    ):
        _require_refusal(url, origin, gate.subprotocol)
    version = [Subprotocol(gate.subprotocol)]
    refused = gate.refused
    with connect(right, subprotocols=version, compression=None) as socket:
        socket.send(b"\x81\xa4type\xb2ShareUrlDisconnect")
        end = time.monotonic() + TRIED_FOR
        while gate.refused == refused:
            if time.monotonic() > end:
                _fail("it does not see the messages of a client")
            time.sleep(0.001)
    gate.refused = refused


def _require_refusal(url: str, origin: str | None, subprotocol: str) -> None:
    version = [Subprotocol(subprotocol)]
    headers = {} if origin is None else {"Origin": origin}
    try:
        with connect(url, subprotocols=version, additional_headers=headers):
            pass
    except InvalidStatus as error:
        if error.response.status_code == http.HTTPStatus.FORBIDDEN:
            return
        _fail(f"it answers {error.response.status_code} where it must refuse")
    except (InvalidHandshake, OSError) as error:
        _fail(f"it does not answer: {error}")
    _fail("it lets in a client that must be refused")


def _fail(why: str) -> NoReturn:
    raise GateError(
        f"the page's gate does not work: {why}. Another version of viser or websockets "
        f"may be the cause: {install_command('view')}"
    )
