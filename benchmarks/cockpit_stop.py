"""STOP in the cockpit's page while hostile clients attack beside it.

One hostile client has the address that drives: it holds the driver's lock, presses
Resume and Start as fast as a page may, and sends garbage in between, such as attributes
of the STOP button. Another has the address that watches, and only garbage. A third has
no token and knocks. Each runs in a process of its own. A viewer presses STOP again and
again. Printed is how many stops held the arm, for at least `HELD` seconds whatever was
pressed, and how long they took.
"""

import argparse
import asyncio
import json
import os
import statistics
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import msgspec
import numpy as np
from cockpit_client import CAMERA, VERSION, Client, socket_address, wait_for
from cockpit_garbage import flood, swallow
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

import dovetail.cockpit.session
from dovetail.cockpit.choice import Choice
from dovetail.cockpit.page import Page
from dovetail.cockpit.server import PageServer, open_server
from dovetail.cockpit.session import RESUME_AFTER, Session
from dovetail.cockpit.snapshot import Snapshot

Words = Sequence[str]
STOP, ESCAPE = "STOP  (Esc)", "Stop: hold the arm"
HELD = 0.3
"""How long each stop is watched [s]: a hostile driver may resume after a second."""
MOVED_MAX = 0.02
"""How far the tool may go on while it is watched: it brakes [m]."""
PATIENCE = 20.0
"""A stop that has not held the arm after this time [s] has failed."""


def attack(address: str, controls: Words, stops: Words, keys: Words) -> None:
    """Send garbage until the process that started this one has ended."""
    parent = os.getppid()
    while os.getppid() == parent:
        with suppress(OSError, TimeoutError):
            asyncio.run(_attack(address, controls, stops, keys))


async def _attack(address: str, controls: Words, stops: Words, keys: Words) -> None:
    async with asyncio.timeout(60.0):
        await asyncio.gather(_flood(address, controls, stops), _press(address, keys))


async def _flood(address: str, controls: Words, stops: Words) -> None:
    while True:
        await flood(address, 500, controls, stops)
        await asyncio.sleep(0.01)


async def _press(address: str, keys: Words) -> None:
    """Press the keys, and read what comes, as a page does."""
    while keys:
        with suppress(ConnectionClosed, InvalidHandshake, OSError):
            url = socket_address(address)
            async with connect(url, subprotocols=VERSION, max_size=None) as socket:
                reader = asyncio.create_task(swallow(socket))
                await socket.send(msgspec.msgpack.encode(CAMERA))
                try:
                    while True:
                        for message in (m for key in keys for m in _pressed(key)):
                            await socket.send(msgspec.msgpack.encode(message))
                            await asyncio.sleep(0.02)
                finally:
                    reader.cancel()
        await asyncio.sleep(0.1)


def _pressed(key: str) -> tuple[dict[str, Any], ...]:
    """Return what presses it: it may be a button, or a key of the keyboard."""
    return (
        {"type": "CommandTriggerMessage", "uuid": key},
        {"type": "GuiUpdateMessage", "uuid": key, "updates": {"value": True}},
    )


@contextmanager
def attacked(server: PageServer) -> Iterator[None]:
    """Let three processes attack the page."""
    reader = Client(server.watch_address)
    words = reader.controls
    reader.close()
    stops = [words.pop(STOP), words.pop(ESCAPE)]
    attacks = {
        server.address: [words["Resume"], words["Start"]],
        server.watch_address: [],
        f"http://127.0.0.1:{server.port}/": [],
    }
    started = []
    try:
        for address, keys in attacks.items():
            told = json.dumps([address, list(words.values()), stops, keys])
            words_of_line = [sys.executable, __file__, "--attack", told]
            started.append(subprocess.Popen(words_of_line))
        before = server.gate.refused
        wait_for(lambda: server.gate.refused > before + 50, 60.0)
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


class Watch:
    """Notes when STOP gets to the session, and whether the arm was held by it."""

    def __init__(self, session: Session) -> None:
        """Begin to watch."""
        self._stop = session.stop
        self._session = session
        self.stops: list[tuple[float, bool]] = []
        """When each of the page came [s], and whether the arm was held then."""
        session.stop = self._note  # pyright: ignore[reportAttributeAccessIssue]

    def _note(self, *, is_pressed: bool = True) -> None:
        called = time.monotonic()
        self._stop(is_pressed=is_pressed)
        if threading.current_thread().name == "stop":  # and not that of who has left
            self.stops.append((called, is_held(self._session)))


def stop_under_attack(
    session: Session, server: PageServer, count: int
) -> list[float | str]:
    """Press STOP so often; return how long each took [s], or what went wrong.

    Args:
        session: Runs the arm.
        server: Of its page.
        count: Tries.
    """
    viewer = Client(server.watch_address)
    watch, tries = Watch(session), []
    try:
        with attacked(server):
            while len(tries) < count:
                result = _stop_once(session, watch, lambda: viewer.press(STOP))
                if result is not None:
                    tries.append(result)
        return tries
    finally:
        viewer.close()


def _stop_once(
    session: Session, watch: Watch, press: Callable[[], None]
) -> float | str | None:
    """Stop once; None where this thread was asleep for too long to judge."""
    _start(session)
    noted = len(watch.stops)
    begin = time.monotonic()
    press()
    while len(watch.stops) == noted:
        if time.monotonic() - begin > PATIENCE:
            return "STOP did not come to the session"
        time.sleep(0.0005)
    called, was_held = watch.stops[-1]
    if not was_held:
        return "the arm was not held"
    before = snapshot(session)
    while time.monotonic() < called + HELD:
        if not is_held(session):
            is_late = time.monotonic() > called + RESUME_AFTER
            return None if is_late else "the arm was held no more"
        time.sleep(0.002)
    now = snapshot(session)
    moved = np.linalg.norm(now.tool.position - before.tool.position)
    is_reset = now.stamp < before.stamp  # in a simulation that ends at once
    return "it moved" if moved > MOVED_MAX and not is_reset else called - begin


def _start(session: Session) -> None:
    """Let the policy run, without the second after the last stop."""

    def is_running() -> bool:
        dovetail.cockpit.session.RESUME_AFTER = 0.0
        session.resume()
        dovetail.cockpit.session.RESUME_AFTER = RESUME_AFTER
        session.start()
        return session.status.mode == "running"

    wait_for(is_running, 60.0)


def is_held(session: Session) -> bool:
    """Say whether a stop holds the arm."""
    arm: Any = session.core.arm
    return session.is_stopped and arm.is_held


def snapshot(session: Session) -> Snapshot:
    """Return the newest slice; a simulated arm has one."""
    assert session.snapshot is not None
    return session.snapshot


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=1000)
    parser.add_argument("--twin", default="medium")
    parser.add_argument("--attack", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.attack:
        attack(*json.loads(asked.attack))
    server = open_server(0)
    session = Session(Choice(policy="peg_square", place=f"twin:{asked.twin}"))
    page = Page(server, session)
    print(f"load before {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    try:
        took = stop_under_attack(session, server, asked.tries)
    finally:
        page.close()
        session.close()
        server.stop()
    held = sorted(1e3 * t for t in took if isinstance(t, float))
    print(f"STOP held the arm in {len(held)} of {len(took)} tries")
    for problem, count in Counter(t for t in took if isinstance(t, str)).items():
        print(f"  {count} times {problem}")
    if held:
        print(
            f"until the session holds it: median {statistics.median(held):.1f} ms, p95 "
            f"{held[int(0.95 * (len(held) - 1))]:.1f} ms, longest {held[-1]:.1f} ms"
        )
    print(f"{server.gate.refused} hostile messages were dropped")
    print(f"load after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
