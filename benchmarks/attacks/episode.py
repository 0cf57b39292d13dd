"""One episode of an attack on the limits: its numbers, how it is run, and its file.

Two seconds at 20 Hz from rest on the exact rigid arm, without contact: f* and theta of
each action, where the arm starts, and which messages of the arm's state arrive late,
twice, not at all or wrong.
"""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail import _bench, _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.observer import observer_gain
from dovetail.envs.registered import find_cell
from dovetail.poses import quat_about_z, quat_multiply
from dovetail.robots.robot import Robot

ACTION = 0.05  # s
CHECK = 1e-3  # s between two looks at the plant
DAMPING, ARMATURE = 0.5, 0.1  # Nms/rad, kg m2, of the plant
START_ROOM = 0.02  # m from the walls
JOINT_ROOM = 0.05  # rad from the joints' limits
LOST = -1  # age of a state that does not arrive

COLUMNS = tuple(name for name, _ in _bench.attack_columns())
"""Of a trace, one row per cycle: true state, torque, and excess over the limits."""

Array = NDArray[np.float64]
Wrong = tuple[int, int, float]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What is attacked, and how."""

    period: float = 1e-3
    f_star: float = 30.0
    task: str = "XYZ:force A:pose BC:hold"
    force_damping: float = 0.0
    hardware: bool = False
    observed: bool = False
    limits: dict[str, float] = field(default_factory=dict)
    """Fields of LimitConfig that are not the shipped ones, such as delta_x."""


@dataclass
class Episode:
    """Everything an adversary chooses in one episode."""

    q: Array
    """Start, at rest [rad]."""
    f_star: Array
    """Per action [m/s2], shape (n, 3)."""
    theta: Array
    """Per action, turn about the vertical from the start [rad]."""
    age: list[int]
    """Per cycle: how many cycles old the state is, or LOST."""
    wrong: list[Wrong] = field(default_factory=list)
    """Cycle, element (0 to 6: q, 7 to 13: dq), and error added to it [rad, rad/s]."""


class Attacked:
    """A controller and its arm, ready to be attacked again and again."""

    def __init__(self, settings: Settings) -> None:
        """Build both from the shipped settings for the period."""
        self.settings = settings
        period = settings.period
        self.robot: Robot = find_cell().loaded_robot()
        self.chain = self.robot.chain()
        self.limits = LimitConfig.for_period(
            self.robot, period, hardware=settings.hardware, **settings.limits
        )
        osc = OscConfig.for_period(period, force_damping=settings.force_damping)
        self.controller = make_controller(
            self.robot, osc, self.limits, settings.task, period
        )
        self.plant = _core.RigidPlant(
            self.chain, damping=np.full(7, DAMPING), armature=np.full(7, ARMATURE)
        )
        self.cycles_per_action = round(ACTION / period)
        self.observer_gain = observer_gain(period) if settings.observed else 0.0
        self.looks = max(1, round(period / CHECK))

    def room(self, q: Array) -> float:
        """Return how far inside a start's allowed region q is, negative outside."""
        limits = self.limits
        turn = np.minimum(q - limits.q_min, limits.q_max - q).min() - JOINT_ROOM
        if not limits.walls:
            return float(turn)
        p = self.chain.pose(q)[0]
        way = np.minimum(p - limits.x_min, limits.x_max - p).min() - START_ROOM
        return float(min(turn, way))

    def start(self, rng: np.random.Generator) -> Array:
        """Return a random posture inside joint limits and walls [rad]."""
        while True:
            q = rng.uniform(self.limits.q_min, self.limits.q_max)
            if self.room(q) > 0.0:
                return q

    def run(self, episode: Episode, *, trace: bool = False) -> tuple[dict, Array]:
        """Run one episode; see `_bench.run_attack`."""
        pose = self.robot.tool_pose(episode.q)
        self.controller.reset(episode.q, pose.position, pose.quat_wxyz)
        self.plant.reset(episode.q, np.zeros(7))
        f_star = np.hstack([episode.f_star, np.zeros_like(episode.f_star)])
        quats = [
            quat_multiply(quat_about_z(angle), pose.quat_wxyz)
            for angle in episode.theta
        ]
        return _bench.run_attack(
            self.controller,
            self.plant,
            f_star,
            np.array(quats),
            self.cycles_per_action,
            episode.age,
            episode.wrong,
            self.observer_gain,
            self.looks,
            trace,
        )


def save_episode(
    path: Path, settings: Settings, episode: Episode, worst: dict[str, Any]
) -> None:
    """Write an episode, with what it reached, so that it can be run again."""
    content = {
        "settings": asdict(settings),
        "worst": worst,
        "q": episode.q.tolist(),
        "f_star": episode.f_star.tolist(),
        "theta": episode.theta.tolist(),
        "age": [[k, age] for k, age in enumerate(episode.age) if age],
        "cycles": len(episode.age),
        "wrong": [[k, i, repr(float(error))] for k, i, error in episode.wrong],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = path.with_suffix(".part")
    whole.write_text(json.dumps(content))
    whole.replace(path)


def load_episode(path: Path, **changes: Any) -> tuple[Settings, Episode, dict]:
    """Read what `save_episode` wrote; `changes` are other settings to run it with."""
    content = json.loads(path.read_text())
    settings = replace(Settings(**content["settings"]), **changes)
    age = [0] * content["cycles"]
    for k, value in content["age"]:
        age[k] = value
    episode = Episode(
        q=np.array(content["q"]),
        f_star=np.array(content["f_star"]),
        theta=np.array(content["theta"]),
        age=age,
        wrong=[(k, i, float(error)) for k, i, error in content["wrong"]],
    )
    return settings, episode, content["worst"]
