"""Sessions on the ideal plant: four times as fast as real time, or in a browser."""

import importlib
import sys
import time
from pathlib import Path

import pytest

from dovetail.cockpit.choice import Choice
from dovetail.cockpit.pace import SPEED_MAX
from dovetail.cockpit.page import Page
from dovetail.cockpit.server import open_server
from dovetail.cockpit.session import Session
from extras import need

BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")
PLAIN = {"tare": False}


def from_benchmarks(name):
    """Return a module that a benchmark uses, too."""
    sys.path.insert(0, BENCHMARKS)
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(BENCHMARKS)


def wait_until(is_so, timeout=10.0):
    """Wait for what another thread brings about."""
    end = time.monotonic() + timeout
    while not is_so():
        assert time.monotonic() < end, "it did not come about in time"
        time.sleep(0.002)


def resume(session):
    """End a stop as soon as that is possible."""

    def is_free():
        session.resume()
        return not session.is_stopped

    wait_until(is_free)


@pytest.fixture
def make_session(tmp_path: Path):
    made = []

    def make(policy="peg_square", place="mujoco", settings=PLAIN, **more):
        choice = Choice(policy=policy, place=place, settings=settings)
        session = Session(choice, **{"logs": tmp_path / "logs", **more})
        session.pace.speed = SPEED_MAX
        made.append(session)
        return session

    yield make
    for session in made:
        session.close()


@pytest.fixture
def session(make_session):
    return make_session()


@pytest.fixture
def served(make_session):
    """A session, its page and its server, without a browser."""
    need("viser")
    server = open_server(0)
    session = make_session()
    page = Page(server, session)
    yield session, page, server
    page.close()
    server.stop()


@pytest.fixture(scope="module")
def browser():
    need("viser")
    need("selenium")
    driven = from_benchmarks("cockpit_browser")
    if why := driven.missing():
        pytest.skip(why)
    browser = driven.open_browser()
    yield browser
    browser.quit()


@pytest.fixture(scope="module")
def cockpit(browser, tmp_path_factory):
    """A session, its page and its server, open in the browser."""
    logs = tmp_path_factory.mktemp("logs")
    choice = Choice(policy="peg_square", settings={"tare": False})
    server = open_server(0)
    session = Session(choice, logs=logs)
    page = Page(server, session)
    browser.get(server.address)
    driven = from_benchmarks("cockpit_browser")
    driven.wait_for(
        lambda: driven.button(browser, "STOP") and server.viser.get_clients()
    )
    yield session, server
    browser.get("about:blank")
    page.close()
    session.close()
    server.stop()
