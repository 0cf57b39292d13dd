"""The pages in a real browser: what a person presses, drags and sees."""

import numpy as np

from dovetail.cockpit.recorded import Recorded
from dovetail.cockpit.replay_page import ReplayPage
from dovetail.cockpit.server import open_server
from dovetail.poses import matrix_from_quat

from .conftest import from_benchmarks, resume

driven = from_benchmarks("cockpit_browser")
button, on_screen, picture = driven.button, driven.on_screen, driven.picture
press, wait_for = driven.press, driven.wait_for
ESCAPE = "\ue00c"


def is_drawn(seen):
    """Whether a picture is more than its background."""
    return seen.std(axis=(0, 1)).max() > 20.0


def differ(one, other):
    """Share of the pixels that changed."""
    return float((np.abs(one - other).max(axis=2) > 12).mean())


def test_stop_comes_first_and_the_scene_is_not_empty(browser, cockpit):
    texts = browser.execute_script(
        "return [...document.querySelectorAll('button')]"
        ".filter(b => b.offsetParent).map(b => b.innerText.trim()).filter(t => t)"
    )
    assert texts[0].startswith("STOP")
    wait_for(lambda: is_drawn(picture(browser)))
    orange = picture(browser)
    is_arm = (orange[:, :, 0] > 150) & (orange[:, :, 2] < 110)
    assert is_arm.mean() > 0.05


def test_no_number_beside_a_plot_is_cut_off(browser, cockpit):
    tops = browser.execute_script(
        "return Object.values(window.__viserTestpoints.uplots)"
        ".map(p => p.chart.bbox.top / devicePixelRatio)"
    )
    assert len(tops) == 4
    assert min(tops) >= 6.0  # half the height of a number


def test_keys_start_pause_step_and_stop(browser, cockpit):
    session, _ = cockpit
    before = picture(browser)
    press(browser, "g")
    wait_for(lambda: session.status.mode == "running" or session.status.success)
    wait_for(lambda: differ(before, picture(browser)) > 0.01)
    press(browser, "p")
    wait_for(lambda: session.status.mode == "paused")
    stamp = session.snapshot.stamp
    press(browser, "n")
    wait_for(lambda: session.snapshot.stamp > stamp + 0.04)
    press(browser, ESCAPE)
    wait_for(lambda: session.core.arm.is_held)
    button(browser, "Pause").click()
    wait_for(lambda: not session.is_paused)
    resume_by(browser, session)
    assert session.status.mode == "held"
    assert session.core.arm.is_held


def resume_by(browser, session):
    """Press Resume, which is there as long as a stop holds, and only then."""

    def press_resume():
        shown = button(browser, "Resume")
        if shown is not None:
            shown.click()
        return not session.is_stopped

    wait_for(press_resume)
    wait_for(lambda: button(browser, "Resume") is None)


def drag_up(browser, server, tip, above):
    """Drag a gizmo's arrow, which is this far above the tip [m]; it is still held."""
    mouse = driven.Mouse(browser)
    up = np.array([0.0, 0.0, 1.0])
    begin = on_screen(browser, server, tip + above * up)
    end = on_screen(browser, server, tip + 0.13 * up)
    mouse.grab(begin)
    for share in np.linspace(0.2, 1.0, 5):
        mouse.drag(np.array(begin) + share * (np.array(end) - begin))
    return mouse, end


def test_the_arm_is_pulled_by_its_gizmo_until_that_is_let_go(browser, cockpit):
    session, server = cockpit
    button(browser, "Reset").click()
    wait_for(lambda: session.snapshot.stamp < 1.0)
    tip = session.snapshot.tool.position
    mouse, end = drag_up(browser, server, tip, 0.07)
    wait_for(lambda: session.snapshot.pull[2] > 5.0)
    wait_for(lambda: session.snapshot.tool.position[2] > tip[2] + 0.0005)
    mouse.let_go(end)
    wait_for(lambda: session.disturbance.pull_to is None)


def test_a_demonstration_is_led_by_the_gizmo_and_kept(browser, cockpit):
    session, server = cockpit
    button(browser, "Lead the tool").click()
    button(browser, "Begin").click()
    wait_for(lambda: session.logger.is_demonstration)
    wait_for(lambda: session.snapshot.stamp > 0.3)
    tip = session.snapshot.tool.position
    mouse, end = drag_up(browser, server, tip, 0.09)
    wait_for(lambda: session.status.mode == "led")
    wait_for(lambda: session.snapshot.tool.position[2] > tip[2] + 0.01)
    mouse.let_go(end)
    wait_for(lambda: not session.teleoperator.is_leading)
    button(browser, "Keep").click()
    wait_for(lambda: "kept, unfinished" in session.status.note)
    wait_for(lambda: "1 demonstration" in browser.page_source)
    button(browser, "Lead the tool").click()


def test_the_fixture_is_dragged_while_the_camera_is_covered(browser, cockpit):
    session, server = cockpit
    begin = session.snapshot.fixture.position
    button(browser, "Cover the camera").click()
    wait_for(lambda: session.is_covered)
    mouse = driven.Mouse(browser)
    turn = matrix_from_quat(session.snapshot.fixture.quat_wxyz)
    here = on_screen(browser, server, begin + 0.11 * turn[:, 0])
    there = on_screen(browser, server, begin + 0.13 * turn[:, 0])
    mouse.grab(here)
    for share in np.linspace(0.2, 1.0, 5):
        mouse.drag(np.array(here) + share * (np.array(there) - here))
    mouse.let_go(there)
    wait_for(lambda: session.snapshot.fixture.position[0] > begin[0] + 0.005)
    np.testing.assert_array_equal(session.snapshot.believed.position, begin)


def test_who_leaves_the_page_leaves_the_arm_held_and_what_was_done_is_played_back(
    browser, cockpit
):
    session, _ = cockpit
    button(browser, "Cover the camera").click()
    press(browser, "g")
    wait_for(lambda: session.status.mode == "running")
    begin = session.snapshot.stamp
    wait_for(lambda: session.snapshot.stamp > begin + 0.5)
    browser.get("about:blank")
    wait_for(lambda: session.status.mode == "stopped")
    assert session.core.arm.is_held
    resume(session)
    session.reset()
    wait_for(lambda: session.snapshot.stamp < 0.5)
    session.logger.flush()
    recorded = Recorded.load(session.logger.files[-1])
    server = open_server(0)
    page = ReplayPage(server, (recorded,))
    try:
        browser.get(server.address)
        wait_for(lambda: button(browser, "Play") and server.viser.get_clients())
        wait_for(lambda: is_drawn(picture(browser)))
        before = picture(browser)
        button(browser, "Play").click()
        wait_for(lambda: page.now > 0.3)
        wait_for(lambda: differ(before, picture(browser)) > 0.003)
        assert recorded.name in browser.execute_script("return document.body.innerText")
    finally:
        page.close()
        server.stop()
