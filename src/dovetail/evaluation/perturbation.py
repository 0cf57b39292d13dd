"""Perturbed trials: a covered camera, pushes, a fixture that moves, low starts."""

import math
from typing import Annotated, Any, Literal, NamedTuple

import gymnasium as gym
import numpy as np

from dovetail.arms.arm import require_simulated
from dovetail.arms.arm_address import ArmAddress
from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.registered import make, make_task
from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_inside
from dovetail.errors import ConfigError
from dovetail.poses import Pose
from dovetail.settings import Range, settings, values_of
from dovetail.tasks.fixture_pose import UPRIGHT
from dovetail.trackers.covered import Covered
from dovetail.types import Vec3

TRAVEL = 0.05
"""Distance that a moving fixture goes out before it comes back [m]."""
PUSH_TIME = (0.2, 0.5)
"""Range of a push's duration [s], uniform."""
PUSH_GAP = (0.3, 1.0)
"""Range of the time between two pushes, and before the first [s], uniform."""
Search = Literal["none", "corner"]
"""Scripted search that acts in place of the policy; none is the policy."""

_STREAM = 0x5E7BAC
"""Keeps these draws apart from those of start and noise, which have the same seed."""


@settings()
class Perturbation:
    """Disturbances of the arm and the fixture during the tries."""

    fixture_shift: Annotated[float, Range(0.0, 0.05, "m")] = 0.0
    """Cover the camera: the fixture is this far from where it was seen [m], 0 to 0.05.
    The direction is random and horizontal."""
    push: Annotated[float, Range(0.0, 100.0, "N")] = 0.0
    """Push the tool at random times with up to this force [N], 0 to 100. The directions
    are random, too."""
    fixture_speed: Annotated[float, Range(0.0, 0.1, "m/s")] = 0.0
    """Move the fixture during the tries at this speed [m/s], 0 to 0.1. It goes out and
    back, and the camera follows."""
    start: Literal["random", "below"] = "random"
    """Start of the tool: random, or below the block's surface, beside it."""
    search: Search = "none"
    """corner: the scripted corner search acts in place of the policy. It feels for the
    opening with a corner of the tilted part."""

    @property
    def is_any(self) -> bool:
        """True if anything is perturbed."""
        return values_of(self) != values_of(Perturbation())

    def describe(self) -> list[str]:
        """Return what is done in words, for a title; empty for nothing."""
        words = []
        if self.fixture_shift:
            shift = f"{1e3 * self.fixture_shift:g} mm"
            words.append(f"camera covered and fixture moved by {shift}")
        if self.search != "none":
            words.append(f"scripted {self.search} search in place of the policy")
        if self.push:
            words.append(f"pushes of up to {self.push:g} N")
        if self.fixture_speed:
            words.append(f"fixture moving at {1e3 * self.fixture_speed:g} mm/s")
        if self.start == "below":
            words.append("starts below the surface")
        return words

    def require_possible(self, arm: ArmAddress) -> None:
        """Refuse what cannot be done to an arm.

        Raises:
            ConfigError: Names the option and what would make it possible.
        """
        for name, size in (("push", self.push), ("fixture-speed", self.fixture_speed)):
            if size and not arm.can_be_disturbed:
                raise ConfigError(
                    f"--{name} needs a simulation at this end: --plant, --twin, or "
                    "fri:// with the control port of a simulated cabinet "
                    "(control=HOST:PORT). It is not offered over gRPC; a real arm is "
                    "pushed by hand"
                )


class Push(NamedTuple):
    """One push on the TCP."""

    step: int
    """Policy step at whose beginning it starts."""
    force: Vec3
    """Force [N], world axes."""
    duration: float
    """[s]"""

    def describe(self) -> dict[str, Any]:
        """Return the push for a report."""
        return {
            "start [s]": round(self.step * POLICY_PERIOD, 3),
            "duration [s]": round(self.duration, 3),
            "force [N]": self.force.round(2).tolist(),
        }


def draw_pushes(rng: np.random.Generator, largest: float, episode: float) -> list[Push]:
    """Draw the pushes of an episode: direction on the sphere, size up to `largest`.

    Args:
        rng: Random numbers.
        largest: Largest force [N]; sizes are uniform from 0 to it.
        episode: Length of the episode [s].
    """
    pushes = []
    time = rng.uniform(*PUSH_GAP)
    while time < episode:
        direction = rng.normal(size=3)
        force = rng.uniform(0.0, largest) * direction / np.linalg.norm(direction)
        duration = float(rng.uniform(*PUSH_TIME))
        pushes.append(Push(round(time / POLICY_PERIOD), force, duration))
        time += duration + rng.uniform(*PUSH_GAP)
    return pushes


def distance_out(time: float, speed: float) -> float:
    """Return how far a fixture that goes out and back by TRAVEL is at a time [m]."""
    way = math.fmod(speed * time, 2.0 * TRAVEL)
    return min(way, 2.0 * TRAVEL - way)


class Perturbed(gym.Wrapper):
    """Perturbs the episodes of an environment, each by its reset's seed."""

    def __init__(self, env: gym.Env, perturbation: Perturbation) -> None:
        """Take the environment; with a `fixture_shift` its tracker is a Covered."""
        super().__init__(env)
        self.perturbation = perturbation
        self.core = require_contact_env(env)
        self._covered = self.core.tracker
        self._rng = np.random.default_rng()
        self._pushes: list[Push] = []
        self._direction: Vec3 = np.zeros(3)
        self._step = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Draw what will be done, then start an episode; `info` tells it."""
        if seed is not None:
            self._rng = np.random.default_rng([_STREAM, seed])
        asked, rng = self.perturbation, self._rng
        told: dict[str, Any] = {}
        if asked.fixture_shift:
            assert isinstance(self._covered, Covered)  # make_perturbed sees to it
            self._covered.shift = shift = asked.fixture_shift * _horizontal(rng)
            told["fixture_shift [m]"] = shift.tolist()
        observation, info = self.env.reset(seed=seed, options=options)
        if asked.fixture_speed:
            self._direction = self._free_direction()
            told["fixture_velocity [m/s]"] = (
                asked.fixture_speed * self._direction
            ).tolist()
        self._pushes = []
        if asked.push:
            episode = self.core.max_steps * POLICY_PERIOD
            self._pushes = draw_pushes(rng, asked.push, episode)
            told["pushes"] = [push.describe() for push in self._pushes]
        self._step = 0
        return observation, {**info, "perturbation": told}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Perturb, and follow the action for 50 ms."""
        if self.perturbation.fixture_speed:
            begin, end = (
                distance_out(step * POLICY_PERIOD, self.perturbation.fixture_speed)
                for step in (self._step, self._step + 1)
            )
            self.core.slide_fixture((end - begin) / POLICY_PERIOD * self._direction)
        while self._pushes and self._pushes[0].step <= self._step:
            push = self._pushes.pop(0)
            require_simulated(self.core.arm).push(push.force, push.duration)
        self._step += 1
        return self.env.step(action)

    def _free_direction(self) -> Vec3:
        """Draw a horizontal direction whose whole way lies in the workspace.

        Raises:
            ConfigError: There is none among 32.
        """
        core, fixture = self.core, self.core.fixture
        for last in [False] * 31 + [True]:
            direction = _horizontal(self._rng)
            end = Pose(fixture.position + TRAVEL * direction, fixture.quat_wxyz)
            try:
                require_inside(core.task, core.cell, core.arm, end)
            except ConfigError:
                if last:
                    raise
            else:
                return direction
        raise AssertionError("unreachable")


def _horizontal(rng: np.random.Generator) -> Vec3:
    angle = rng.uniform(-math.pi, math.pi)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def make_perturbed(
    env_id: str, perturbation: Perturbation, options: dict[str, Any]
) -> gym.Env:
    """Build an environment and what perturbs it.

    Args:
        env_id: Gymnasium id.
        perturbation: What is done; nothing gives the plain environment.
        options: Keyword arguments of the environment.

    Raises:
        ConfigError: This cannot be done in this environment.
    """
    if not perturbation.is_any:
        return make(env_id, **options)
    task = make_task(env_id, options)
    is_upright = task.trial_poses[0].facing == UPRIGHT
    if not is_upright and (perturbation.fixture_shift or perturbation.start == "below"):
        raise ConfigError(
            f"--fixture-shift and --start below are for a fixture that opens upwards; "
            f"that of {env_id} does not: leave them out"
        )
    more: dict[str, Any] = {}
    if perturbation.fixture_shift:
        more["tracker"] = Covered()
    if perturbation.start == "below":
        more |= task.low_starts()
        if not more:
            raise ConfigError(
                f"{env_id} has no starts below a surface: no --start below"
            )
    return Perturbed(make(env_id, **{**options, **more}), perturbation)
