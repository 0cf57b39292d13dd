"""What the page shows of one moment: made by the control loop, read by everyone."""

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
"""Limits of which is shown how much is used."""


@dataclass(frozen=True, kw_only=True)
class SeenFixture:
    """Where the fixture is, and what is believed of it."""

    true: Pose
    """Where the fixture truly is."""
    seen: Pose
    """Where it is believed."""
    near: tuple[Vec3, float]
    """Normal, and where along it contact is near [m], as is believed."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """What acts on the arm, and how near it is to its limits."""

    force: Vec3
    """Contact force on the tool [N], world axes: the estimated one where the arm
    measures none; not-a-number where neither is known."""
    pull: Vec3
    """Force of the hand's spring [N], world axes."""
    used: tuple[float, ...]
    """How much of each of `USED` is used [%]."""


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
    """Where the fixture is, and what is believed of it."""
    load: Load
    """What acts on the arm."""
    reward: float = 0.0
    """Of the last policy step."""
    depth: float = 0.0
    """How far in the tool is [m], by the fixture's true pose."""
    work: float = 0.0
    """What the slice took to compute [s]: of a simulation, 10 ms are there for it."""


@dataclass(frozen=True, kw_only=True)
class Status:
    """What the loop is doing."""

    mode: str
    """held, running, led, paused, stopped, resetting or building."""
    is_stopped: bool = False
    """Whether a STOP holds, until somebody resumes."""
    note: str = ""
    """What a person should know of it."""
    rate: float = 1.0
    """Simulated over wall time, over the speed asked for [1]."""
    success: bool = False
    """Whether the task was done in this episode."""
    showing: str = ""
    """What of demonstrations there is to say; empty where there are none."""


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
            near=(goal.normal, goal.surface + core.config.approach.near_distance),
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
    joints, tool = facts.limits.joints, facts.limits.tool
    tau: Array = np.abs(state.log[:, _TAU]).max(axis=0, initial=0.0)
    shares = (
        _centred(state.q, joints.q_min, joints.q_max),
        np.abs(state.dq) / joints.dq_max,
        tau / joints.tau_max,
        _centred(state.tool.position, tool.x_min, tool.x_max),
    )
    return tuple(100.0 * float(share.max()) for share in shares)


def _centred(value: Array, low: Array, high: Array) -> Array:
    """Return 0 in the middle of a range and 1 at either end."""
    return np.abs(2.0 * value - low - high) / (high - low)
