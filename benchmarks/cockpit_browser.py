"""A real browser without a screen or a GPU, and how to find things in its page.

The tests of the pages use it, too.
"""

import io
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from dovetail.poses import Pose, matrix_from_quat

if TYPE_CHECKING:
    from dovetail.cockpit.server import PageServer

WIDTH, HEIGHT = 1280, 720
REBOUND = "rebound.example"
"""A name that the browser takes for this machine's, as after DNS rebinding."""
SWITCHES = (
    *("headless=new", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run"),
    *("disable-background-networking", "disable-component-update", "disable-sync"),
    *("use-angle=swiftshader", "enable-unsafe-swiftshader", "hide-scrollbars"),
    f"host-resolver-rules=MAP {REBOUND} 127.0.0.1",
    "disable-features=BackForwardCache",  # it keeps the socket of a page that was left
)


def missing() -> str:
    """Say what is not installed and how to get it; empty where nothing misses."""
    if shutil.which("chromium") and shutil.which("chromedriver"):
        return ""
    return "needs Chromium and its driver (Debian: apt install chromium-driver)"


def open_browser() -> Any:
    """Return a driven Chromium; it ends with this process, also if that is killed."""
    from selenium import webdriver

    class Service(webdriver.ChromeService):
        def command_line_args(self) -> list[str]:
            return [__file__, *super().command_line_args()]

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for switch in (*SWITCHES, f"window-size={WIDTH},{HEIGHT}"):
        options.add_argument(f"--{switch}")
    browser = webdriver.Chrome(options=options, service=Service(sys.executable))
    set_size(browser, WIDTH, HEIGHT)
    return browser


def set_size(browser: Any, width: int, height: int) -> None:
    """Give the page's window a size [pixels]."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def wait_for(what: Callable[[], Any], timeout: float = 30.0) -> Any:
    """Return what a function gives as soon as that is something."""
    end = time.monotonic() + timeout
    while not (found := what()):
        assert time.monotonic() < end, "it did not come about in time"
        time.sleep(0.02)
    return found


def button(browser: Any, text: str) -> Any:
    """Return the visible button whose text begins so, or None."""
    return browser.execute_script(
        "return [...document.querySelectorAll('button')].find("
        "b => b.innerText.trim().startsWith(arguments[0]) && b.offsetParent)",
        text,
    )


def press(browser: Any, key: str) -> None:
    """Press a key anywhere on the page."""
    from selenium.webdriver import ActionChains

    ActionChains(browser).send_keys(key).perform()


def picture(browser: Any) -> np.ndarray:
    """Return the scene as drawn now, shape (height, width, 3).

    Without the corner in which the browser's own notes are.
    """
    rect = canvas(browser)
    left, top = round(rect["x"]), round(rect["y"])
    png = io.BytesIO(browser.get_screenshot_as_png())
    image = np.asarray(Image.open(png).convert("RGB"), dtype=int)
    return image[top + 160 : top + round(rect["height"]), left + 290 : left + 690]


def canvas(browser: Any) -> dict[str, float]:
    """Return where the scene is in the window [pixels]: x, y, width, height."""
    return browser.execute_script(
        "return document.querySelector('canvas[data-engine]')"
        ".getBoundingClientRect().toJSON()"
    )


def on_screen(
    browser: Any, server: "PageServer", point: np.ndarray
) -> tuple[float, float]:
    """Return where a point [m] of the world is in the window [pixels]."""
    (client,) = server.viser.get_clients().values()
    rect, camera = canvas(browser), client.camera
    pose = Pose(camera.position, camera.wxyz)
    x, y, z = matrix_from_quat(pose.quat_wxyz).T @ (point - pose.position)
    scale = 0.5 * rect["height"] / np.tan(0.5 * camera.fov)
    middle = rect["x"] + 0.5 * rect["width"], rect["y"] + 0.5 * rect["height"]
    return float(middle[0] + scale * x / z), float(middle[1] + scale * y / z)


class Mouse:
    """Moves, presses and lets go, at places of the window [pixels]."""

    def __init__(self, browser: Any) -> None:
        """Take the browser."""
        self._browser = browser

    def move(self, place: Sequence[float]) -> None:
        """Move with no button pressed."""
        self._send("mouseMoved", place, {})

    def grab(self, place: Sequence[float]) -> None:
        """Press the button."""
        self.move(place)
        time.sleep(0.3)  # until the browser knows what is below
        self._send("mousePressed", place, _LEFT)

    def drag(self, place: Sequence[float]) -> None:
        """Move with the button pressed."""
        self._send("mouseMoved", place, _LEFT)

    def let_go(self, place: Sequence[float]) -> None:
        """Release the button."""
        self._send("mouseReleased", place, _LEFT)

    def _send(self, kind: str, place: Sequence[float], more: dict[str, Any]) -> None:
        event = {"type": kind, "x": float(place[0]), "y": float(place[1]), **more}
        self._browser.execute_cdp_cmd("Input.dispatchMouseEvent", event)


@contextmanager
def passed_on(port: int) -> Iterator[int]:
    """Give another port whose bytes get to this one, as a tunnel of ssh does."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        threading.Thread(target=_accept, args=(listening, port), daemon=True).start()
        yield listening.getsockname()[1]


def _accept(listening: socket.socket, port: int) -> None:
    with suppress(OSError):  # until it is closed
        while True:
            here, _ = listening.accept()
            there = socket.create_connection(("127.0.0.1", port))
            for one, other in ((here, there), (there, here)):
                threading.Thread(target=_pass, args=(one, other), daemon=True).start()


def _pass(one: socket.socket, other: socket.socket) -> None:
    with suppress(OSError), one, other:
        while data := one.recv(65536):
            other.sendall(data)


def _run_driver(words: Sequence[str]) -> None:
    """Run chromedriver until the process that started this one closes the input.

    It does so by its death, too. The driver is then asked to end, and ends its browser.
    """
    driver = subprocess.Popen(["chromedriver", *words], stdin=subprocess.DEVNULL)
    threading.Thread(target=lambda: os._exit(driver.wait()), daemon=True).start()
    sys.stdin.read()
    port = next(word for word in words if word.startswith("--port=")).partition("=")[2]
    with suppress(OSError):
        urllib.request.urlopen(
            f"http://127.0.0.1:{port}/shutdown", timeout=10.0
        ).close()
    time.sleep(10.0)
    driver.kill()


_LEFT = {"button": "left", "buttons": 1, "clickCount": 1}

if __name__ == "__main__":
    _run_driver(sys.argv[1:])
