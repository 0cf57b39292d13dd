"""Pages of other places in a real browser, and the two addresses of this one."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from extras import need

from .conftest import from_benchmarks, resume

need("viser")
driven = from_benchmarks("cockpit_browser")
client = from_benchmarks("cockpit_client")
button, press, wait_for = driven.button, driven.press, driven.wait_for
ESCAPE = "\ue00c"
OPEN = """
const [url, version, done] = arguments;
const socket = new WebSocket(url, version);
socket.onopen = () => done('open');
socket.onerror = () => done('refused');
"""
FRAME = """
const [url, done] = arguments, frame = document.createElement('iframe');
frame.onload = () => {
  try { done(frame.contentDocument ? 'shown' : 'refused'); }
  catch (error) { done('refused'); }
};
frame.src = url;
document.body.append(frame);
"""


class Blank(BaseHTTPRequestHandler):
    """A page with nothing in it."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><body>another page</body>")

    def log_message(self, *_):
        pass


@pytest.fixture
def other_port():
    """Port of another server of this machine, the page of which is open."""
    other = ThreadingHTTPServer(("127.0.0.1", 0), Blank)
    thread = threading.Thread(target=other.serve_forever, daemon=True)
    thread.start()
    yield other.server_port
    other.shutdown()
    other.server_close()


@pytest.fixture
def back(browser, cockpit):
    """Show the page again afterwards."""
    session, server = cockpit
    yield session, server
    browser.get(server.address)
    wait_for(lambda: button(browser, "STOP") and server.viser.get_clients())
    if session.is_stopped:
        resume(session)


def opened(browser, url):
    browser.set_script_timeout(20)
    return browser.execute_async_script(OPEN, url, client.VERSION[0])


PLACES = {
    "another port": "http://127.0.0.1:{other}/",
    "another name of this machine": "http://localhost:{other}/",
    "an address that has no origin": "data:text/html,<body>a page</body>",
    "a name that was rebound": "http://" + driven.REBOUND + ":{other}/",
}


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_another_page_does_not_connect_though_it_knew_the_token(
    browser, back, other_port, place
):
    _, server = back
    browser.get(place.format(other=other_port))
    wait_for(lambda: browser.execute_script("return document.body.innerText"))
    for host in ("127.0.0.1", "localhost", driven.REBOUND):
        for token in ("", f"/{server.gate.drive_token}"):
            url = f"ws://{host}:{server.port}{token}"
            assert opened(browser, url) == "refused", url


def test_the_page_under_a_rebound_name_is_not_shown(browser, back):
    _, server = back
    path = f":{server.port}/{server.gate.drive_token}/"
    browser.get(f"http://{driven.REBOUND}{path}")
    assert "opened as http://127.0.0.1" in browser.page_source
    assert opened(browser, f"ws://{driven.REBOUND}{path}") == "refused"
    assert opened(browser, f"ws://127.0.0.1{path}") == "refused"


def test_no_other_page_shows_this_one_inside(browser, back, other_port):
    _, server = back
    browser.get(f"http://127.0.0.1:{other_port}/")
    wait_for(lambda: "another" in browser.page_source)
    browser.set_script_timeout(20)
    own = f"http://127.0.0.1:{other_port}/"
    assert browser.execute_async_script(FRAME, own) == "shown"
    assert browser.execute_async_script(FRAME, server.address) == "refused"


def test_without_the_token_a_person_is_told_where_the_address_is(browser, back):
    _, server = back
    browser.get(f"http://127.0.0.1:{server.port}/")
    text = browser.execute_script("return document.body.innerText")
    assert "whole address" in text
    assert "printed" in text
    assert len(text.splitlines()) == 1


def test_the_watchers_page_shows_everything_stops_and_does_not_start(browser, back):
    session, server = back
    browser.get(server.watch_address)
    wait_for(lambda: button(browser, "STOP") and server.viser.get_clients())
    if session.is_stopped:
        resume(session)
    press(browser, "g")
    wait_for(lambda: "You are watching" in browser.page_source)
    assert "cannot drive" in browser.page_source
    assert session.status.mode == "held"
    session.start()
    wait_for(lambda: session.status.mode == "running")
    button(browser, "STOP").click()
    wait_for(lambda: session.is_stopped and session.core.arm.is_held)
    resume(session)
    session.start()
    wait_for(lambda: session.status.mode == "running")
    press(browser, ESCAPE)
    wait_for(lambda: session.is_stopped and session.core.arm.is_held)


def test_the_address_works_through_another_port_and_name(browser, back):
    """As behind `ssh -L`: bytes are passed on, and the browser says another host."""
    _, server = back
    with from_benchmarks("cockpit_browser").passed_on(server.port) as port:
        browser.get(f"http://localhost:{port}/{server.gate.drive_token}/")
        wait_for(lambda: button(browser, "STOP") and server.viser.get_clients())
        browser.get("about:blank")
