"""The lease alone: one holder, and every way in which a lease ends."""

import threading
import time

import pytest

from dovetail.errors import ArmError
from dovetail.rpc.lease import LeaseBook


@pytest.fixture
def ended():
    return []


@pytest.fixture
def book(ended):
    book = LeaseBook(lambda holder, reason: ended.append((holder.name, reason)))
    yield book
    book.close()


def test_one_client_at_a_time(book):
    book.acquire("one", "here", 10.0)
    with pytest.raises(ArmError, match="held by one at here for 0 s"):
        book.acquire("two", "there", 10.0)


def test_only_the_secret_opens(book):
    with pytest.raises(ArmError, match="acquire it first"):
        book.require("")
    holder = book.acquire("one", "here", 10.0)
    assert book.require(holder.lease) is holder
    for wrong in ("", "x", "ü", holder.lease[:-1]):
        with pytest.raises(ArmError, match="does not hold the arm's lease"):
            book.require(wrong)


def test_a_silent_holder_loses_the_lease_and_is_told_so(book, ended):
    holder = book.acquire("one", "here", 0.2)
    deadline = time.monotonic() + 20.0
    while book.holder is not None and time.monotonic() < deadline:
        time.sleep(0.02)
    assert ended == [("one", r"nothing was heard of it for 0.2 s")]
    other = book.acquire("two", "there", 10.0)
    with pytest.raises(ArmError, match=r"nothing was heard.*now two at there holds"):
        book.require(holder.lease)
    assert book.holder is other


def test_a_holder_that_is_heard_of_keeps_the_lease(book, ended):
    holder = book.acquire("one", "here", 2.0)
    end = time.monotonic() + 2.5
    while time.monotonic() < end:
        book.require(holder.lease)
        time.sleep(0.05)
    assert ended == []


def test_a_holder_is_not_silent_while_it_is_served(book, ended):
    holder = book.acquire("one", "here", 0.2)
    with book.use(holder.lease):
        time.sleep(1.0)
        assert ended == []


def test_a_lease_ends_once(book, ended):
    holder = book.acquire("one", "here", 10.0)
    book.end(holder, "first")
    book.end(holder, "second")
    assert ended == [("one", "first")]


def test_nobody_gets_the_lease_before_the_arm_is_held(ended):
    held = threading.Event()

    def hold(holder, reason):
        time.sleep(0.3)
        held.set()

    book = LeaseBook(hold)
    holder = book.acquire("one", "here", 10.0)
    thread = threading.Thread(target=book.end, args=(holder, "gone"))
    thread.start()
    while book.holder is not None:
        time.sleep(0.001)
    book.acquire("two", "there", 10.0)
    assert held.is_set()
    thread.join()
    book.close()


def test_one_stream_per_lease(book):
    holder = book.acquire("one", "here", 10.0)
    book.bind(holder.lease, int)
    with pytest.raises(ArmError, match="stream of one at here is open already"):
        book.bind(holder.lease, int)


def test_the_stream_of_a_lease_ends_with_it_after_the_arm_is_held(book, ended):
    holder = book.acquire("one", "here", 0.2)
    gone = threading.Event()
    book.bind(holder.lease, lambda: ended.append("stream") or gone.set())
    assert gone.wait(20.0)
    assert ended == [("one", "nothing was heard of it for 0.2 s"), "stream"]
