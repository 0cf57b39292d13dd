"""Wrong positions in single messages of a cabinet end no motion."""

import itertools

import numpy as np
import pytest

from dovetail.plants.plant import COLUMN, FLAG_MASK

from .test_fri_changes import ACTIVE, doctor
from .test_fri_session import HOLE, START, make_arm, push

MOST_TORQUE = 20.0  # Nm, of one cycle
SIZES = (0.004, 0.08, 0.1, 0.5)  # rad
SPACE = 20  # messages from one to the next
LENGTH = {0.001: 50, 0.002: 25, 0.005: 10}  # messages of a step of 50 ms
TAU = slice(COLUMN["tau1"], COLUMN["tau7"] + 1)


class Spikes:
    """Wrong positions, `count` in a row, in turn on every joint and to both sides."""

    def __init__(self, sizes, count=1):
        errors = itertools.product(sizes, range(7), (-1.0, 1.0))
        self.errors = [sign * size * np.eye(7)[joint] for size, joint, sign in errors]
        self.count = count
        self.seen = -60
        """Messages of the motion since the first one that may be wrong."""

    def __call__(self, message):
        if int(message.state) != ACTIVE:
            return
        spike, place = divmod(self.seen, SPACE)
        if 0 <= spike < len(self.errors) and place < self.count:
            message.q_measured = message.q_measured + self.errors[spike]
        self.seen += 1

    @property
    def is_over(self):
        return self.seen > SPACE * len(self.errors)


def run(period, sizes, count=1):
    """Move on through spikes; return the log of all cycles."""
    arm = make_arm(period=period, reset="place")
    spikes = Spikes(sizes, count)
    doctor(arm.cabinet, spikes)
    try:
        arm.reset(START, HOLE)
        logs = []
        for action in itertools.count():
            if spikes.is_over:
                break
            angle = 0.4 * action
            logs.append(arm.step(push(1.5 * np.cos(angle), 1.5 * np.sin(angle))).log)
        assert arm.statistics()["counts"]["motions"] == 1
        assert arm.cabinet.request({"do": "status"})["stop_reason"] == ""
        return np.concatenate(logs), arm.monitoring()
    finally:
        arm.close()


@pytest.mark.parametrize("period", LENGTH)
def test_one_wrong_position_ends_no_motion_and_is_worth_a_bounded_torque(period):
    log, state = run(period, SIZES)
    steps = np.abs(np.diff(log[:, TAU], axis=0)).max(axis=1)
    assert steps.max() <= MOST_TORQUE
    assert 3 * 14 <= state.implausible <= 4 * 14
    implausible = log[:, COLUMN["flags"]].astype(np.int64) & FLAG_MASK["implausible"]
    assert np.count_nonzero(implausible) >= 3 * 14


@pytest.mark.parametrize("period", LENGTH)
def test_two_large_wrong_positions_in_a_row_end_none_either(period):
    log, state = run(period, (0.045, 0.3), count=2)
    steps = np.abs(np.diff(log[:, TAU], axis=0)).max(axis=1)
    assert steps.max() <= MOST_TORQUE
    assert state.implausible >= 2 * 2 * 14
