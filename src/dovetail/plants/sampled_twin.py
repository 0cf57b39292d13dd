"""Twins drawn at random: how robots may differ from their model, from stated ranges."""

import numpy as np

from dovetail.plants.plant import Engine
from dovetail.plants.twin import Twin
from dovetail.robots.iiwa14 import INERTIA_SETS
from dovetail.settings import in_count
from dovetail.types import Array

SEED_MAX = 2**63 - 1
RANGES: dict[str, tuple[float, float]] = {
    "mass_scale": (0.85, 1.2),
    "gravity_residual": (-0.6, 0.6),
    "damping": (0.25, 1.1),
    "coulomb": (0.1, 1.4),
    "armature": (0.08, 0.3),
    "command_delay": (0.0, 0.01),
    "torque_noise": (0.0, 0.3),
    "position_noise": (0.0, 3e-5),
    "velocity_noise": (1e-3, 5e-3),
    "contact_friction": (0.1, 0.8),
    "contact_time": (0.008, 0.025),
    "clearance_offset": (-2e-4, 5e-5),
}
"""Lowest and highest value of each number, in the units of `Twin`, uniform between. Dry
friction and armature are those of A1; the ratio of the other joints is that of the
gears. Horizontal gravity residuals are half as large as vertical ones."""
_LIKE_A1 = np.array([1.0, 1.0, 0.83, 0.83, 0.5, 0.3, 0.2])
"""Dry friction of each joint over that of A1, as in the shipped twins."""
_ROTOR_LIKE_A1 = np.array([1.0, 1.0, 0.8, 0.8, 0.5, 0.45, 0.45])
_SPREAD = (0.8, 1.25)
"""Factor by which one joint differs from that ratio."""


def sample_twin(seed: int, engine: Engine = "mujoco") -> Twin:
    """Draw a twin of an LBR iiwa 14.

    Twins of one seed differ in their engine alone.

    Args:
        seed: 0 or more; one seed is always the same twin.
        engine: Physics engine.

    Raises:
        ConfigError: The seed is out of range.
    """
    in_count("seed", seed, 0, SEED_MAX, "(2^63 - 1)")
    random = np.random.default_rng([seed, 0x7A17])

    def drawn(name: str, count: int = 1) -> Array:
        return random.uniform(*RANGES[name], count)

    def joints(name: str, ratio: Array) -> tuple[float, ...]:
        return _rounded(drawn(name) * ratio * random.uniform(*_SPREAD, 7))

    def one(name: str) -> float:
        return _rounded(drawn(name))[0]

    inertia = str(random.choice(sorted(INERTIA_SETS)))
    gravity = drawn("gravity_residual", 3) * [0.5, 0.5, 1.0]
    x, y, z = _rounded(gravity)
    return Twin(
        description=f"sampled with seed {seed}",
        engine=engine,
        seed=seed,
        inertia=inertia,
        mass_scale=_rounded(drawn("mass_scale", 7)),
        gravity_residual=(x, y, z),
        damping=_rounded(drawn("damping", 7)),
        coulomb=joints("coulomb", _LIKE_A1),
        armature=joints("armature", _ROTOR_LIKE_A1),
        command_delay=one("command_delay"),
        torque_noise=one("torque_noise"),
        position_noise=one("position_noise"),
        velocity_noise=one("velocity_noise"),
        contact_friction=one("contact_friction"),
        contact_time=one("contact_time"),
        clearance_offset=one("clearance_offset"),
    )


def _rounded(values: Array) -> tuple[float, ...]:
    """Return numbers as a file has them, with four digits."""
    return tuple(float(f"{value:.4g}") for value in values)
