"""Dynamics randomisation: other masses, damping, gravity and friction every episode.

It is the baseline that the paper argues against; the paper names what is drawn, the
ranges are ours.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np

from dovetail.arms.local_arm import LocalArm
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig

_STREAM = 0xD15C0
"""Keeps these draws apart from those of start and fixture, which have the same seed."""


@dataclass(frozen=True, kw_only=True)
class DynamicsRandomisation:
    """Ranges about the simulated model; every draw is independent."""

    gravity: float = 0.5
    """Half range added to the gravity residual, uniform, each of x y z [m/s2]: 5 % of
    gravity, beside the 0.05 to 0.6 m/s2 of the shipped twins."""
    mass: tuple[float, float] = (0.8, 1.2)
    """Range of the factor on each link's mass and inertia, uniform [1]."""
    damping: tuple[float, float] = (0.5, 2.0)
    """Range of the factor on each joint's viscous friction, log-uniform [1]."""
    friction: tuple[float, float] = (0.1, 0.6)
    """Range of the contacts' sliding friction coefficient, uniform [1]."""

    def __post_init__(self) -> None:
        """Refuse a range that is empty or that no arm has, by name."""
        if not 0.0 <= self.gravity <= 10.0:
            raise ConfigError(
                f"random gravity is {self.gravity:g} m/s2; allowed: 0 to 10 m/s2"
            )
        for name, least, most in (
            ("mass", 0.1, 10.0),
            ("damping", 0.01, 100.0),
            ("friction", 0.0, 5.0),
        ):
            low, high = (float(end) for end in vars(self)[name])
            object.__setattr__(self, name, (low, high))
            if not least <= low <= high <= most:
                raise ConfigError(
                    f"random {name} is {low:g} to {high:g}; give two rising numbers "
                    f"from {least:g} to {most:g}"
                )

    def require_fit(self, base: DynamicsConfig) -> None:
        """Refuse ranges that lead out of what an arm may have, before any draw.

        Raises:
            ConfigError: Names the number, its value and its range.
        """
        for i, sign in enumerate((-1.0, 1.0)):
            residual = np.add(base.gravity_residual, sign * self.gravity)
            replace(
                base,
                gravity_residual=tuple(residual),
                mass_scale=tuple(np.multiply(base.mass_scale, self.mass[i])),
                damping=tuple(np.multiply(base.damping, self.damping[i])),
            )

    def sample(self, rng: np.random.Generator, base: DynamicsConfig) -> DynamicsConfig:
        """Draw the dynamics of one episode about `base`."""
        low, high = map(math.log, self.damping)
        damping = np.exp(rng.uniform(low, high, 7))
        residual = rng.uniform(-self.gravity, self.gravity, 3)
        return replace(
            base,
            gravity_residual=tuple(residual + base.gravity_residual),
            mass_scale=tuple(rng.uniform(*self.mass, 7) * base.mass_scale),
            damping=tuple(damping * base.damping),
            contact_friction=float(rng.uniform(*self.friction)),
        )


class RandomDynamics(gymnasium.Wrapper):
    """Draws new dynamics at every reset.

    The draws have a random stream of their own from the reset's seed, so that start and
    fixture of a seed are the same with and without it.
    """

    def __init__(self, env: gymnasium.Env, ranges: DynamicsRandomisation) -> None:
        """Take the environment, whose plant's dynamics become the middle.

        Raises:
            ConfigError: The arm is not simulated in this process, or a range leads out
                of what an arm may have.
        """
        super().__init__(env)
        core = require_contact_env(env)
        arm = core.arm
        if not isinstance(arm, LocalArm):
            raise ConfigError(
                "dynamics can be drawn for an arm that is simulated in this process "
                "only; give a plant, and a model where there is one"
            )
        self.ranges = ranges
        self.plant = arm.plant
        self.base = arm.plant.dynamics
        self._rng = np.random.default_rng()
        ranges.require_fit(self.base)
        core.expect_weight()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Draw the dynamics, then start an episode."""
        if seed is not None:
            self._rng = np.random.default_rng([_STREAM, seed])
        self.plant.configure(self.ranges.sample(self._rng, self.base))
        return self.env.reset(seed=seed, options=options)
