"""The lease alone: one holder, and every way in which a lease ends."""

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
    book.acquire("one", "here")
    with pytest.raises(ArmError, match="held by one at here for 0 s"):
        book.acquire("two", "there")


def test_only_the_secret_opens(book):
    with pytest.raises(ArmError, match="acquire it first"):
        book.require("")
    holder = book.acquire("one", "here")
    assert book.require(holder.lease) is holder
    for wrong in ("", "x", "ü", holder.lease[:-1]):
        with pytest.raises(ArmError, match="does not hold the arm's lease"):
            book.require(wrong)


def test_a_lease_ends_once(book, ended):
    holder = book.acquire("one", "here")
    book.end(holder, "first")
    book.end(holder, "second")
    assert ended == [("one", "first")]


def test_the_arm_is_held_when_a_lease_has_ended(book, ended):
    holder = book.acquire("one", "here")
    book.end(holder, "gone")
    assert ended == [("one", "gone")]
    with pytest.raises(ArmError, match=r"has ended \(gone\)"):
        book.require(holder.lease)
    book.acquire("two", "there")
