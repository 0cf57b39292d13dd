"""State of the cell at one moment: made by the control loop, shown by the page."""

from dataclasses import dataclass

import numpy as np

from dovetail.arms.arm import ArmFacts, ArmState
from dovetail.envs.contact_env import ContactEnv
from dovetail.errors import TrackerError
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose
from dovetail.types import Array, Vec3, Vec7

_TAU = [COLUMN[f"tau{i}"] for i in range(1, 8)]
USED = ("joint range", "joint speed", "torque", "walls")
"""Limits whose used share is shown."""


@dataclass(frozen=True, kw_only=True)
class SeenFixture:
    """True and believed pose of the fixture."""

    true: Pose
    """True pose of the fixture."""
    seen: Pose
    """Believed pose of the fixture."""
    near: tuple[Vec3, float]
    """Believed plane up to which contact is near: normal, and place along it [m]."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """Forces on the arm, and the used share of its limits."""

    force: Vec3
    """Contact force on the tool [N], world axes: the estimated one where the arm
    measures none; not-a-number where neither is known."""
    pull: Vec3
    """Force of the hand's spring [N], world axes."""
    used: tuple[float, ...]
    """Used share of each limit in `USED` [%]."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One slice of the control loop."""

    stamp: float
    """Time of the episode [s]."""
    q: Vec7
    """Joint angles [rad]."""
    tool: Pose
    """TCP, world axes."""
    fixture: SeenFixture
    """True and believed pose of the fixture."""
    load: Load
    """Forces on the arm, and the used share of its limits."""
    reward: float = 0.0
    """Of the last policy step."""
    depth: float = 0.0
    """Insertion depth [m], by the fixture's true pose."""
    work: float = 0.0
    """Computing time of the slice [s]; a simulation in real time has 10 ms for it."""


@dataclass(frozen=True, kw_only=True)
class Status:
    """Status of the loop."""

    mode: str
    """held, running, led, paused, stopped, resetting or building."""
    is_stopped: bool = False
    """True while a STOP holds, until `resume`."""
    note: str = ""
    """Note to the user; empty if there is none."""
    rate: float = 1.0
    """Simulated over wall time, over the speed asked for [1]."""
    success: bool = False
    """True once the task was done in this episode."""
    showing: str = ""
    """Number of demonstrations, and whether one runs, in words; empty for none."""


def moment_of(
    state: ArmState, core: ContactEnv, fixture: Pose, pull: Vec3, work: float
) -> Moment:
    """Return a slice as the page shows it.

    Args:
        state: What the arm said.
        core: The environment.
        fixture: Where the fixture truly is.
        pull: Force of the hand's spring [N].
        work: What the slice took to compute [s].
    """
    try:
        seen = core.tracker.estimate().pose
    except TrackerError:  # a camera on the arm, on its way to look: where it is said
        seen = fixture
    goal = core.task.goal(seen)
    return Moment(
        stamp=state.stamp,
        q=state.q,
        tool=Pose(state.tool.position, state.tool.quat_wxyz),
        fixture=SeenFixture(
            true=fixture,
            seen=seen,
            near=(goal.normal, goal.surface + core.config.near_distance),
        ),
        load=Load(
            force=known_force(state),
            pull=pull,
            used=used_limits(state, core.arm.facts),
        ),
        work=work,
    )


def known_force(state: ArmState) -> Vec3:
    """Return the contact force on the tool [N], measured or else estimated."""
    is_measured = np.isfinite(state.contact_force).all()
    return state.contact_force if is_measured else state.wrench[:3]


def used_limits(state: ArmState, facts: ArmFacts) -> tuple[float, ...]:
    """Return how much of each of `USED` a slice used [%]; 100 is the limit.

    Args:
        state: What the arm said; of its log the largest torques.
        facts: The arm's limits.
    """
    tool = facts.limits
    tau: Array = np.abs(state.log[:, _TAU]).max(axis=0, initial=0.0)
    shares = (
        _centred(state.q, facts.limits.q_min, facts.limits.q_max),
        np.abs(state.dq) / facts.limits.dq_max,
        tau / facts.limits.tau_max,
        _centred(state.tool.position, tool.x_min, tool.x_max),
    )
    return tuple(100.0 * float(share.max()) for share in shares)


def _centred(value: Array, low: Array, high: Array) -> Array:
    """Return 0 in the middle of a range and 1 at either end."""
    return np.abs(2.0 * value - low - high) / (high - low)
