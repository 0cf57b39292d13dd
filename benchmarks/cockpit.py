"""The cockpit with a real browser: how fast, how late, and whether it bears anything.

Opens the page of the shipped policy on a twin in a headless Chromium without a GPU, and
prints

* simulated over wall time, and the pictures per second that the browser draws, while
  the policy runs; with ``--browsers 3`` two others watch;
* the time from a mouse's move to the force on the arm: from the moment the browser is
  told of the move to the end of the first slice that was simulated with the new force;
* with ``--clicks N``, what is left after N random clicks, drags, keys, reloads and
  closed pages; with ``--garbage N``, after N random messages to the page's socket;
* with ``--picture FILE``, a screenshot.

The load of the machine is printed beside: the browser draws by the processor.
"""

import argparse
import asyncio
import os
import random
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from cockpit_browser import (
    HEIGHT,
    WIDTH,
    Mouse,
    button,
    missing,
    on_screen,
    open_browser,
    press,
    wait_for,
)
from cockpit_garbage import flood

from dovetail.cockpit.choice import Choice
from dovetail.cockpit.page import Page
from dovetail.cockpit.server import PageServer, open_server
from dovetail.cockpit.session import Session

UP = np.array([0.0, 0.0, 1.0])
FRAMES = """
const done = arguments[arguments.length - 1], end = performance.now() + arguments[0];
let n = 0;
function frame(now) { n++; now > end ? done(n) : requestAnimationFrame(frame); }
requestAnimationFrame(frame);
"""
CLICK = """
[...document.querySelectorAll('button')].find(
  b => b.innerText.trim().startsWith(arguments[0]))?.click()
"""
ESCAPE = "\ue00c"
KEYS = "gpnrwasd" + ESCAPE
BUTTONS = ("Start", "Pause", "Step", "Reset", "1/4", "x 2", "STOP", "Resume")
SWITCHES = ("Cover the camera", "Search while covered", "Pull the arm", "Path")


@contextmanager
def cockpit(twin: str) -> Iterator[tuple[Session, PageServer, Any, str]]:
    """Open session, server and browser, and close them."""
    with tempfile.TemporaryDirectory() as folder:
        server = open_server(0)
        choice = Choice(policy="peg_square", place=f"twin:{twin}")
        session = Session(choice, logs=Path(folder))
        page = Page(server, session)
        browser = open_browser()
        url = server.address
        try:
            show(browser, server, url)
            yield session, server, browser, url
        finally:
            browser.quit()
            page.close()
            session.close()
            server.stop()


def show(browser: Any, server: PageServer, url: str) -> None:
    """Open the page, and wait until it is there."""
    browser.get(url)
    wait_for(lambda: button(browser, "STOP") and server.viser.get_clients(), 60.0)


@contextmanager
def watched(server: PageServer, url: str, others: int) -> Iterator[None]:
    """Have more browsers open, in which people only watch."""
    with ExitStack() as stack:
        for count in range(2, 2 + others):
            other = open_browser()
            stack.callback(other.quit)
            other.get(url)
            wait_for(lambda count=count: len(server.viser.get_clients()) >= count, 60.0)
        yield


def measure_rates(session: Session, browser: Any, seconds: float) -> None:
    """Print real-time factor and picture rate while the policy runs, every 2 s."""
    browser.set_script_timeout(60)
    factors, pictures = [], []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        session.reset()
        wait_for(lambda: snapshot(session).stamp < 2.5)  # the tare takes 2.2 s of it
        session.start()
        wait_for(lambda: session.status.mode == "running")
        wall, stamp = time.monotonic(), snapshot(session).stamp
        shown = browser.execute_async_script(FRAMES, 2000)
        passed = time.monotonic() - wall
        factors.append((snapshot(session).stamp - stamp) / passed)
        pictures.append(shown / passed)
    session.reset()
    print(
        f"simulated over wall time {statistics.median(factors):.3f} "
        f"(worst of {len(factors)} parts {min(factors):.3f})"
    )
    print(
        f"pictures per second {statistics.median(pictures):.1f} "
        f"(worst {min(pictures):.1f})"
    )


def take_picture(session: Session, browser: Any, file: Path) -> None:
    """Write a screenshot of the page as the part goes in, a person pulling at it."""
    browser.execute_script(
        "document.querySelector('.mantine-Notification-closeButton')?.click()"
    )
    session.reset()
    wait_for(lambda: snapshot(session).stamp < 2.5)
    session.start()
    wait_for(lambda: snapshot(session).depth > 0.004)
    session.pull(snapshot(session).tool.position + np.array([0.0, 0.06, 0.02]))
    time.sleep(0.8)
    session.pause()
    time.sleep(1.5)
    browser.save_screenshot(str(file))
    session.pull(None)
    session.pause(False)
    print(f"written: {file}")


def snapshot(session: Session) -> Any:
    """Return the newest slice; a simulated arm has one."""
    assert session.snapshot is not None
    return session.snapshot


class Watch:
    """Notes when the force of the pull changes."""

    def __init__(self, session: Session) -> None:
        """Begin to watch, in a thread."""
        self._session = session
        self.seen: list[tuple[float, float]] = []
        self._is_ended = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        last = None
        while not self._is_ended.wait(0.0005):
            now = self._session.snapshot
            if now is not last and now is not None:
                self.seen.append((time.monotonic(), float(now.pull[2])))
                last = now

    def close(self) -> None:
        """Watch no more."""
        self._is_ended.set()
        self._thread.join()


def measure_delay(
    session: Session, server: PageServer, browser: Any, moves: int
) -> None:
    """Print how long a mouse's move takes to be a force on the arm."""
    session.reset()
    time.sleep(1.0)
    tip = snapshot(session).tool.position
    mouse, watch = Mouse(browser), Watch(session)
    low, high = (on_screen(browser, server, tip + h * UP) for h in (0.085, 0.115))
    begin = on_screen(browser, server, tip + 0.07 * UP)
    mouse.grab(begin)
    mouse.drag(low)
    wait_for(lambda: snapshot(session).pull[2] > 1.0)
    delays = []
    for i in range(moves):
        time.sleep(0.3)
        before = snapshot(session).pull[2]
        said = time.monotonic()
        mouse.drag(high if i % 2 == 0 else low)
        wait_for(lambda before=before: abs(snapshot(session).pull[2] - before) > 2.0)
        time.sleep(0.02)
        delays.append(
            next(t for t, force in watch.seen if t > said and abs(force - before) > 2.0)
            - said
        )
    mouse.let_go(low)
    watch.close()
    late = sorted(1e3 * delay for delay in delays)
    print(
        f"from mouse to force: median {statistics.median(late):.0f} ms, p95 "
        f"{late[min(len(late) - 1, int(0.95 * len(late)))]:.0f} ms, of {len(late)}"
    )


def click_about(
    session: Session, server: PageServer, browser: Any, url: str, clicks: int
) -> None:
    """Do random things to the page, and say what is left of it."""
    session.resume()
    rng = random.Random(1)
    mouse = Mouse(browser)
    for _ in range(clicks):
        kind = rng.random()
        place = rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT)
        if kind < 0.35:
            browser.execute_script(CLICK, rng.choice((*BUTTONS, *SWITCHES)))
        elif kind < 0.55:
            press(browser, rng.choice(KEYS))
        elif kind < 0.75:
            mouse.grab(place)
            mouse.let_go(place)
        elif kind < 0.97:
            tip = snapshot(session).tool.position
            with suppress(ValueError, ZeroDivisionError):
                place = on_screen(browser, server, tip + 0.07 * UP)
            mouse.grab(place)
            mouse.drag((rng.uniform(300, 950), rng.uniform(0, HEIGHT)))
            mouse.let_go(place)
        elif kind < 0.99:
            browser.refresh()
        else:
            browser.get("about:blank")
            show(browser, server, url)
    browser.get("about:blank")
    wait_for(lambda: not server.viser.get_clients())
    print(f"{clicks} random clicks, drags, keys, reloads: {verdict(session)}")


def verdict(session: Session) -> str:
    """Say whether the arm is held, stands still, and was always inside its limits."""
    session.stop()
    session.pause(False)
    session.pace.speed = 1.0
    wait_for(lambda: session.status.mode in ("held", "stopped"))
    time.sleep(1.0)
    begin = snapshot(session)
    time.sleep(0.5)
    end = snapshot(session)
    moved = 1e3 * float(np.linalg.norm(end.tool.position - begin.tool.position))
    alive = "goes on" if end.stamp > begin.stamp else "stands still"
    return (
        f"arm {session.status.mode}, moved {moved:.3f} mm in 0.5 s, time {alive}, "
        f"{session.violations} cycles outside limits"
    )


def send_garbage(session: Session, server: PageServer, count: int) -> None:
    """Send random messages to the page's socket, well formed ones among them."""
    begin, stamp = time.monotonic(), snapshot(session).stamp
    closed = asyncio.run(flood(server.address, count))
    passed = time.monotonic() - begin
    rate = (snapshot(session).stamp - stamp) / passed
    print(
        f"{count} garbage messages in {passed:.1f} s, {closed} connections were "
        f"closed, simulated over wall time meanwhile {rate:.3f}: {verdict(session)}"
    )


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twin", default="medium")
    parser.add_argument("--browsers", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--moves", type=int, default=40)
    parser.add_argument("--clicks", type=int, default=0)
    parser.add_argument("--garbage", type=int, default=0)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    if why := missing():
        print(f"nothing is measured under any load: {why}")
        return
    with cockpit(asked.twin) as (session, server, browser, url):
        print(f"load before {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        if asked.picture:
            take_picture(session, browser, asked.picture)
        if asked.seconds:
            with watched(server, url, asked.browsers - 1):
                measure_rates(session, browser, asked.seconds)
        if asked.moves:
            measure_delay(session, server, browser, asked.moves)
        if asked.garbage:
            send_garbage(session, server, asked.garbage)
        if asked.clicks:
            click_about(session, server, browser, url, asked.clicks)
        print(f"load after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
