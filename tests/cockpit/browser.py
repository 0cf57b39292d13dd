"""A real browser without a screen or a GPU, and how to find things in its page."""

import shutil
import time

import numpy as np
import pytest

from dovetail.poses import Pose, matrix_from_quat
from extras import need

WIDTH, HEIGHT = 1280, 720
SWITCHES = (
    *("headless=new", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run"),
    *("disable-background-networking", "disable-component-update", "disable-sync"),
    *("use-angle=swiftshader", "enable-unsafe-swiftshader", "hide-scrollbars"),
)


def open_browser():
    """Return a driven Chromium; skip where there is none."""
    need("viser")
    need("selenium")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip(
            "needs Chromium and its driver (Debian: apt install chromium "
            "chromium-driver)"
        )
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for switch in (*SWITCHES, f"window-size={WIDTH},{HEIGHT}"):
        options.add_argument(f"--{switch}")
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    size = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    return browser


def wait_for(what, timeout=30.0):
    """Return what a function gives as soon as that is something."""
    end = time.monotonic() + timeout
    while not (found := what()):
        assert time.monotonic() < end, "it did not come about in time"
        time.sleep(0.02)
    return found


def button(browser, text):
    """Return the visible button with a text, or None."""
    return browser.execute_script(
        "return [...document.querySelectorAll('button')].find("
        "b => b.innerText.trim().startsWith(arguments[0]) && b.offsetParent)",
        text,
    )


def press(browser, key):
    """Press a key anywhere on the page."""
    from selenium.webdriver import ActionChains

    ActionChains(browser).send_keys(key).perform()


def picture(browser):
    """Return the scene as drawn now, shape (height, width, 3)."""
    import io

    from PIL import Image

    png = browser.get_screenshot_as_png()
    rect = canvas(browser)
    left, top = round(rect["x"]), round(rect["y"])
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)
    # Not the corner where the browser's own notes are.
    return image[top + 160 : top + round(rect["height"]), left + 290 : left + 690]


def canvas(browser):
    """Return where the scene is in the window [pixels]: x, y, width, height."""
    return browser.execute_script(
        "return document.querySelector('canvas[data-engine]')"
        ".getBoundingClientRect().toJSON()"
    )


def on_screen(browser, server, point):
    """Return where a point [m] of the world is in the window [pixels]."""
    (client,) = server.get_clients().values()
    rect, camera = canvas(browser), client.camera
    pose = Pose(camera.position, camera.wxyz)
    x, y, z = matrix_from_quat(pose.quat_wxyz).T @ (point - pose.position)
    scale = 0.5 * rect["height"] / np.tan(0.5 * camera.fov)
    middle = rect["x"] + 0.5 * rect["width"], rect["y"] + 0.5 * rect["height"]
    return middle[0] + scale * x / z, middle[1] + scale * y / z


class Mouse:
    """Moves, presses and lets go, at places of the window [pixels]."""

    def __init__(self, browser):
        self._browser = browser

    def _send(self, kind, place):
        x, y = map(float, place)
        event = {"type": kind, "x": x, "y": y, "button": "left", "buttons": 1}
        self._browser.execute_cdp_cmd(
            "Input.dispatchMouseEvent", {**event, "clickCount": 1}
        )

    def move(self, place):
        self._browser.execute_cdp_cmd(
            "Input.dispatchMouseEvent",
            {"type": "mouseMoved", "x": float(place[0]), "y": float(place[1])},
        )

    def grab(self, place):
        self.move(place)
        time.sleep(0.3)  # until the browser knows what is below
        self._send("mousePressed", place)

    def drag(self, place):
        self._send("mouseMoved", place)

    def let_go(self, place):
        self._send("mouseReleased", place)
