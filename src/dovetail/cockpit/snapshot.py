"""Snapshots of the cell: made by the control loop, shown by the page."""

import threading
from collections import deque
from dataclasses import dataclass

import numpy as np

from dovetail.arms.arm import ArmFacts, ArmState
from dovetail.envs.contact_env import ContactEnv
from dovetail.errors import TrackerError
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose
from dovetail.types import Array, Vec3, Vec7

USED = ("joint range", "joint speed", "torque", "walls")
"""Limits whose used share is shown."""
COLUMNS = ("time", "force", "pull", "reward", "work", *USED)
"""Columns of the plots: time since the reset [s], sizes of contact force and pull [N],
reward of the last policy step [1], computing time of a slice [ms], limits used [%]."""
_TAU = [COLUMN[f"tau{i}"] for i in range(1, 8)]
_KEPT = 1200  # slices of the trace: 12 s
_APART = 0.002  # [m] between two points of the path, about


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """State of the cell after one slice of the control loop."""

    stamp: float
    """Time of the episode [s]."""
    q: Vec7
    """Joint angles [rad]."""
    parts: Array
    """Positions of the parts' joints [rad, m]; empty where they are not known."""
    tool: Pose
    """TCP, world axes."""
    fixture: Pose
    """True pose of the fixture."""
    believed: Pose
    """Believed pose of the fixture."""
    near: tuple[Vec3, float]
    """Believed plane up to which contact is near: normal, and place along it [m]."""
    force: Vec3
    """Contact force on the tool [N], world axes: the estimated one where the arm
    measures none; not-a-number where neither is known."""
    pull: Vec3
    """Force of the user's pull [N], world axes."""
    used: tuple[float, ...]
    """Used share of each limit in `USED` [%]."""
    reward: float
    """Reward of the last policy step [1]."""
    depth: float
    """Insertion depth after the last policy step [m], by the fixture's true pose."""
    work: float
    """Computing time of the slice [s]; a simulation in real time has 10 ms for it."""


@dataclass(frozen=True, kw_only=True)
class LoopStatus:
    """Status of the control loop."""

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
    demonstrations: str = ""
    """Number of demonstrations, and whether one runs, in words; empty for none."""


class Trace:
    """The last 12 s of slices; one thread adds to it, others read."""

    def __init__(self) -> None:
        """Begin empty."""
        self._rows: deque[tuple[float, ...]] = deque(maxlen=_KEPT)
        self._places: deque[Vec3] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()

    def clear(self) -> None:
        """Forget everything: an episode begins."""
        with self._lock:
            self._rows.clear()
            self._places.clear()

    def add(self, snapshot: Snapshot) -> None:
        """Add a slice."""
        row = (
            snapshot.stamp,
            float(np.linalg.norm(snapshot.force)),
            float(np.linalg.norm(snapshot.pull)),
            snapshot.reward,
            1e3 * snapshot.work,
            *snapshot.used,
        )
        with self._lock:
            self._rows.append(row)
            self._places.append(snapshot.tool.position)

    def rows(self) -> Array:
        """Return `COLUMNS` of the slices, the oldest first, shape (slices, columns)."""
        with self._lock:
            rows = list(self._rows)
        return np.array(rows).reshape(-1, len(COLUMNS))

    def path(self) -> Array:
        """Return the path of the TCP [m], shape (points, 3)."""
        with self._lock:
            path = list(self._places)
        places = np.array(path).reshape(-1, 3)
        cells = np.round(places / _APART)
        has_moved = np.ones(len(places), dtype=bool)
        has_moved[1:] = (np.diff(cells, axis=0) != 0.0).any(axis=1)
        return places[has_moved]


def take_snapshot(
    core: ContactEnv,
    state: ArmState,
    *,
    fixture: Pose,
    pull: Vec3,
    reward: float,
    depth: float,
    work: float,
) -> Snapshot:
    """Return the snapshot of a slice.

    Args:
        core: The environment.
        state: State of the arm after the slice.
        fixture: True pose of the fixture.
        pull: Force of the user's pull [N], world axes.
        reward: Reward of the last policy step.
        depth: Insertion depth after it [m].
        work: Computing time of the slice [s].
    """
    try:
        believed = core.tracker.estimate().pose
    except TrackerError:  # a camera on the arm that has not looked yet
        believed = fixture
    goal = core.task.goal(believed)
    is_measured = np.isfinite(state.contact_force).all()
    return Snapshot(
        stamp=state.stamp,
        q=state.q,
        parts=state.parts,
        tool=Pose(state.tool.position, state.tool.quat_wxyz),
        fixture=fixture,
        believed=believed,
        near=(goal.normal, goal.surface + core.config.near_distance),
        force=state.contact_force if is_measured else state.wrench[:3],
        pull=pull,
        used=_used_limits(state, core.arm.facts),
        reward=reward,
        depth=depth,
        work=work,
    )


def _used_limits(state: ArmState, facts: ArmFacts) -> tuple[float, ...]:
    """Return the used share of each of `USED` [%]; 100 is the limit."""
    limits = facts.limits
    tau: Array = np.abs(state.log[:, _TAU]).max(axis=0, initial=0.0)
    shares = (
        _centred(state.q, limits.q_min, limits.q_max),
        np.abs(state.dq) / limits.dq_max,
        tau / limits.tau_max,
        _centred(state.tool.position, limits.x_min, limits.x_max),
    )
    return tuple(100.0 * float(share.max()) for share in shares)


def _centred(value: Array, low: Array, high: Array) -> Array:
    """Return 0 in the middle of a range and 1 at either end."""
    return np.abs(2.0 * value - low - high) / (high - low)
