"""A pickle is read for its numbers, and whatever it would call is not called."""

import contextlib
import os
import pickle

import numpy as np
import pytest

from dovetail.errors import PolicyError
from dovetail.learn.inert_pickle import Inert, attributes, find_array, read_inert


class Called:
    """Pickles to a call of whatever it is given."""

    def __init__(self, *reduced):
        self.reduced = reduced

    def __reduce__(self):
        return self.reduced


@pytest.mark.parametrize("protocol", range(6))
def test_nothing_in_a_pickle_is_called(tmp_path, protocol):
    mark, other = tmp_path / "called", tmp_path / "executed"
    evil = [
        Called(os.mkdir, (str(mark),)),
        {"deep": (Called(exec, (f"open({str(other)!r}, 'w')",)),)},
    ]
    content = pickle.dumps(evil, protocol=protocol)
    found = read_inert(content)
    assert not list(tmp_path.iterdir())
    assert isinstance(found[0], Inert)
    assert found[0].args == (str(mark),)
    pickle.loads(content)  # which does call it
    assert mark.exists()
    assert other.exists()


@pytest.mark.parametrize("kind", ["f2", "f4", "f8"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("protocol", [3, 4, 5])
def test_arrays_come_out_whole(kind, order, protocol, rng):
    array = np.asarray(rng.normal(size=(3, 5)), dtype=kind, order=order)
    found = find_array(read_inert(pickle.dumps(array, protocol=protocol)))
    np.testing.assert_array_equal(found, array)


@pytest.mark.parametrize("array", [np.array(["a"]), np.array([None]), np.arange(3)])
def test_only_floats_are_taken_for_arrays(array):
    assert find_array(read_inert(pickle.dumps(array))) is None


def test_attributes_are_those_of_the_object():
    found = read_inert(pickle.dumps(pytest.approx(1.5)))
    assert attributes(found)["expected"] == 1.5
    assert attributes({"a": 1}) == {"a": 1}
    assert attributes(3.0) == {}


@pytest.mark.parametrize(
    "content",
    [b"", b"\x80", b"not a pickle", pickle.dumps([1, 2, 3])[:-3], b"(" * 10 + b"."],
)
def test_what_is_no_pickle_is_one_message(content):
    with pytest.raises(PolicyError, match="cannot be read"):
        read_inert(content)


def test_a_damaged_array_is_said():
    record = read_inert(pickle.dumps(np.zeros((2, 2)), protocol=3))
    version, shape, kind, is_fortran, raw = record.state
    record.state = (version, shape, kind, is_fortran, raw[:-1])
    with pytest.raises(PolicyError, match="an array is damaged"):
        find_array(record)


def test_random_bytes_end_in_data_or_in_one_error(rng):
    whole = pickle.dumps({"a": [np.zeros(3), Called(os.getcwd, ())]})
    for _ in range(500):
        content = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            content[place] = rng.integers(0, 256)
        with contextlib.suppress(PolicyError):
            find_array(read_inert(bytes(content)))
