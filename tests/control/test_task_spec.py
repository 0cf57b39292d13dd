"""Task texts are read, written back, and refused with the known words."""

import itertools

import pytest

from dovetail.control.task_spec import FORCE, FREE, HOLD, MODES, POSE, TaskSpec
from dovetail.errors import ConfigError


def test_axes_are_in_twist_order():
    task = TaskSpec.parse("XYZ:force A:pose BC:hold")
    assert task.modes == (FORCE, FORCE, FORCE, HOLD, HOLD, POSE)
    assert task.axes(POSE) == (5,)


def test_an_axis_not_named_is_free():
    assert TaskSpec.parse("Z:force").modes == (FREE, FREE, FORCE, FREE, FREE, FREE)


def test_every_task_reads_back_as_itself():
    for modes in itertools.product(range(len(MODES)), repeat=6):
        task = TaskSpec(modes)
        assert TaskSpec.parse(str(task)) == task


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("XQ:force", "unknown task axis 'Q'.*known axes: X Y Z A B C"),
        ("X:push", "unknown mode 'push'.*free, force, pose, hold"),
        ("XY:force X:hold", "axis X is named twice"),
        ("XYZ", "not of the form AXES:mode"),
        (":force", "not of the form AXES:mode"),
        ("", "names no axis"),
        ("x:force", "unknown task axis 'x'"),
    ],
)
def test_a_wrong_task_is_refused(text, words):
    with pytest.raises(ConfigError, match=words):
        TaskSpec.parse(text)


def test_wrong_mode_numbers_are_refused():
    with pytest.raises(ConfigError, match="axis Z has mode 7"):
        TaskSpec((0, 0, 7, 0, 0, 0))
    with pytest.raises(ConfigError, match="needs 6 modes"):
        TaskSpec((0, 1))
