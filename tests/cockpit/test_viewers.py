"""What viewers send to the page's socket: two drivers, somebody who leaves, garbage."""

import asyncio
import time

import numpy as np
import pytest

from extras import need

from .conftest import from_benchmarks, resume, wait_until

need("viser")
client = from_benchmarks("cockpit_client")
Client = client.Client


def test_the_second_viewer_only_watches_until_the_first_has_left(served):
    session, _, server = served
    one, two = Client(server.address), Client(server.address)
    up = session.snapshot.tool.position + np.array([0.0, 0.0, 0.05])
    down = session.snapshot.tool.position - np.array([0.0, 0.0, 0.05])
    one.drag("/pull", up)
    wait_until(lambda: session.snapshot.pull[2] > 1.0)
    two.drag("/pull", down)
    two.let_go("/pull")
    two.send(client.CAMERA)
    end = session.snapshot.stamp + 0.4
    wait_until(lambda: session.snapshot.stamp > end)
    assert session.snapshot.pull[2] > 1.0
    one.close()
    wait_until(lambda: session.disturbance.pull_to is None)
    wait_until(lambda: not session.snapshot.pull.any())
    assert session.status.mode == "stopped"
    resume(session)
    two.drag("/pull", down)
    wait_until(lambda: session.snapshot.pull[2] < -1.0)
    two.close()


def test_the_driver_is_not_counted_among_those_who_watch(served):
    _, page, server = served
    one, two = Client(server.address), Client(server.address)
    one.key("Reset")
    wait_until(lambda: page.driver_lock.driver is not None)
    said = f"viewer {page.driver_lock.driver} drives &middot; 1 watches"
    wait_until(lambda: said in page.panel._status.content)
    one.close()
    two.close()


def test_of_two_drivers_only_the_first_leads_and_a_page_that_closes_leads_no_more(
    served,
):
    session, page, server = served
    one, two = Client(server.address), Client(server.address)
    begin = session.snapshot.tool.position
    one.drag("/lead", begin + np.array([0.0, 0.05, 0.0]))
    time.sleep(0.2)
    assert not session.teleoperator.is_leading  # it is not switched on
    page.panel.leads.show(True)
    one.drag("/lead", begin + np.array([0.0, 0.05, 0.0]))
    wait_until(lambda: session.snapshot.tool.position[1] > begin[1] + 0.01)
    two.drag("/lead", begin - np.array([0.0, 0.05, 0.0]))
    two.let_go("/lead")
    end = session.snapshot.stamp + 0.5
    wait_until(lambda: session.snapshot.stamp > end)
    assert session.snapshot.tool.position[1] > begin[1] + 0.02
    assert session.status.mode == "led"
    one.close()
    wait_until(lambda: session.status.mode == "stopped" and session.core.arm.is_held)
    resume(session)
    two.drag("/lead", begin)
    wait_until(lambda: session.teleoperator.is_leading)
    two.close()
    wait_until(lambda: not session.teleoperator.is_leading)
    assert session.violations == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e308, -1e308])
@pytest.mark.parametrize("name", ["/pull", "/drag", "/lead"])
def test_what_no_mouse_can_do_moves_nothing_out_of_its_limits(served, name, bad):
    session, page, server = served
    page.panel.leads.show(True)
    fixture = session.snapshot.fixture.position
    viewer = Client(server.address)
    viewer.drag(name, [bad, 0.0, bad])
    end = session.snapshot.stamp + 0.4
    wait_until(lambda: session.snapshot.stamp > end)
    viewer.close()
    np.testing.assert_array_equal(session.snapshot.fixture.position, fixture)
    assert session.violations == 0
    wait_until(lambda: session.status.mode == "stopped")  # it has left


def test_garbage_neither_slows_the_arm_nor_moves_it(served):
    session, page, server = served
    flood = from_benchmarks("cockpit_garbage").flood
    begin = session.snapshot
    asyncio.run(flood(server.address, 1000))
    frames = page.frames
    wait_until(lambda: page.frames > frames + 2)
    assert session.snapshot.stamp > begin.stamp
    assert session.violations == 0
    assert session.status.mode in ("held", "stopped")
