"""STOP is in view and Escape stops, whatever a person scrolled or clicked before."""

import time

import pytest

from .conftest import from_benchmarks

driven = from_benchmarks("cockpit_browser")
ESCAPE, CONTROL, SHIFT = "\ue00c", "\ue009", "\ue008"
SIZES = {"wide": (driven.WIDTH, driven.HEIGHT), "narrow": (420, 800)}


@pytest.fixture(params=SIZES)
def sized(request, browser, cockpit):
    """The page in a window of a size, with everything unfolded."""
    driven.set_size(browser, *SIZES[request.param])
    driven.wait_for(lambda: driven.button(browser, "STOP"))
    unfold(browser)
    yield browser
    driven.set_size(browser, *SIZES["wide"])
    driven.wait_for(lambda: driven.button(browser, "STOP"))


def unfold(browser):
    """Open the folders that are closed."""
    for name, inside in (("What runs", "Tare"), ("Show", "Walls")):
        if driven.button(browser, inside) is None:
            xpath = f"//*[normalize-space(text())='{name}']"
            folder = browser.find_element("xpath", xpath)
            browser.execute_script("arguments[0].click()", folder)
            driven.wait_for(lambda inside=inside: driven.button(browser, inside))


def is_on_top(browser, element):
    """Whether an element's middle is in the window, with nothing before it."""
    return browser.execute_script(
        "const r = arguments[0].getBoundingClientRect();"
        "const e = document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2);"
        "return e !== null && arguments[0].contains(e)",
        element,
    )


def is_scrolled_to(browser, element):
    """Scroll to an element, which a folder that still opens may move away again."""
    browser.execute_script("arguments[0].scrollIntoView()", element)
    return is_on_top(browser, element)


def test_stop_stays_in_view_while_the_panels_are_scrolled(sized):
    last = driven.button(sized, "Forces")
    assert is_on_top(sized, driven.button(sized, "STOP"))
    assert not is_on_top(sized, last)
    driven.wait_for(lambda: is_scrolled_to(sized, last))
    assert is_on_top(sized, driven.button(sized, "STOP"))
    assert is_on_top(sized, driven.button(sized, "Start"))


def test_escape_stops_whatever_was_clicked_before(browser, cockpit, monkeypatch):
    from selenium.common.exceptions import WebDriverException

    session, _ = cockpit
    stops = []
    monkeypatch.setattr(session, "stop", lambda: stops.append(True))
    unfold(browser)
    clicked = {}
    for control in 2 * browser.find_elements("css selector", "button, input"):
        try:
            kind = control.tag_name
            if control in clicked and control.text:
                continue
            control.click()  # one opens the browser's own settings, and closes them
        except WebDriverException:  # not shown now
            continue
        clicked[control] = kind
        before = len(stops)
        driven.press(browser, ESCAPE)
        driven.wait_for(lambda before=before: len(stops) > before, timeout=5.0)
    kinds = list(clicked.values())
    assert kinds.count("input") >= 8
    assert kinds.count("button") >= 24


def show_hint(browser):
    """Rest the mouse on viser's icon of the commands, and give it the focus."""
    from selenium.webdriver import ActionChains

    icon = browser.execute_script(
        "const icons = [...document.querySelectorAll('.mantine-ActionIcon-root')];"
        "return icons.find((icon) => icon.querySelector('.tabler-icon-list-search'))"
    )
    ActionChains(browser).move_to_element(icon).perform()
    driven.wait_for(lambda: is_shown(browser, "[role=tooltip]"))
    browser.execute_script("arguments[0].focus()", icon)


def open_palette(browser):
    """Open viser's list of commands, and search in it."""
    from selenium.webdriver import ActionChains

    keys = ActionChains(browser)
    keys.key_down(CONTROL).send_keys("k").key_up(CONTROL).perform()
    driven.wait_for(lambda: is_shown(browser, ".mantine-Spotlight-search"))
    driven.press(browser, "res")


def hold_shift(browser):
    """Press Shift, and keep it."""
    from selenium.webdriver import ActionChains

    ActionChains(browser).key_down(SHIFT).perform()


def is_shown(browser, selector):
    """Whether the page has such an element in view."""
    return browser.execute_script(
        "return document.querySelector(arguments[0])?.checkVisibility()", selector
    )


@pytest.mark.parametrize("before", [show_hint, open_palette, hold_shift])
def test_each_escape_is_one_stop_whatever_takes_keys_before(
    before, browser, cockpit, monkeypatch
):
    from selenium.webdriver import ActionChains

    session, _ = cockpit
    stops = []
    monkeypatch.setattr(session, "stop", lambda: stops.append(True))
    before(browser)
    try:
        for presses in (1, 2, 3):
            driven.press(browser, ESCAPE)
            driven.wait_for(lambda presses=presses: len(stops) >= presses, timeout=5.0)
    finally:
        ActionChains(browser).key_up(SHIFT).perform()
    time.sleep(0.3)  # a second stop would be there by now
    assert len(stops) == 3
