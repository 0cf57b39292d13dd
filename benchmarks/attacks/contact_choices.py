"""What the adversary in contact may choose: twin, task, policy, pushes, faults.

A try is a vector of numbers in [0, 1]: random draws fill it, a search moves in it. The
first `NUM_KINDS` of them choose between kinds (task, policy, ...), the others are
continuous. Armature lies within 0.05 and 0.4 kg m2; the shipped twins' within 0.07 and
0.3.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from dovetail.envs.registered import find_cell
from dovetail.identify.parameters import nominal_model
from dovetail.plants.twin import Twin, load_twin
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.settings import names_in
from dovetail.tasks.peg_in_hole.task import PegInHole

Array = NDArray[np.float64]

TASKS = ("free", "slide", "press", "jam", "spring")
POLICIES = ("bang", "held", "seek", "wave", "shipped")
PLANES = ("surface", "surface", "surface", "off", "everywhere")
INERTIAS = ("drake", "drake", "lbr", "pybullet")
"""The published sets; the others than drake are themselves mass errors, so that the
proven range has drake alone."""
NUM_KINDS = 8
SIZE = 70
"""Length of the vector."""


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """How far the twin may be from the model."""

    delay: float
    """Largest delay [s]."""
    mass: float
    """Largest error of a link's mass, as a share [1]."""
    payload: float
    """Largest unknown payload [kg]."""
    inertias: tuple[str, ...]
    """Published inertia sets."""


RANGES = {
    "proven": Ranges(delay=0.010, mass=0.2, payload=1.0, inertias=("drake",)),
    "full": Ranges(delay=0.015, mass=0.3, payload=2.0, inertias=INERTIAS),
}


@dataclass(frozen=True, kw_only=True)
class Choices:
    """One try; units as in `Twin`."""

    task: str
    policy: str
    near: str
    """Where the Target's near plane is: at the surface, off or everywhere."""
    is_press_limited: bool
    """f* into the surface is at most 1.5 m/s2, as in peg in hole."""
    is_tared: bool
    """The weight that nobody compensates is taken off f*, exactly."""
    is_random_start: bool
    """Tasks free and spring: any posture, not one of the task's starts."""
    inertia: str
    spring_ratio: float
    """Damping ratio of the spring, with 5 kg [1]."""
    mass_scale: tuple[float, ...]
    payload: float
    gravity_residual: tuple[float, ...]
    damping: tuple[float, ...]
    coulomb: tuple[float, ...]
    armature: tuple[float, ...]
    delay: float
    contact_time: float
    contact_friction: float
    clearance: float
    torque_noise: float
    position_noise: float
    velocity_noise: float
    spring: float
    """[N/m]"""
    spring_pull: tuple[float, ...]
    """Force of the spring at the start [N], world axes."""
    depth: float
    """Task jam: of the peg in the hole [m]."""
    tilt: tuple[float, ...]
    """Task jam: share of the largest tilt about x and y that fits [1]."""
    twist: tuple[float, ...]
    """Rotation that is held over that at the start, about x and y [rad]."""
    f_star: float
    """Largest f* [m/s2]."""
    direction: tuple[float, ...]
    """Policy wave: share of f* along x, y, z [1]."""
    frequency: float
    """Policy wave: of f* [Hz]."""
    theta: float
    """Largest rotation about the vertical [rad]."""
    push: float
    """[N]"""
    push_time: float
    """Between two pushes [s]."""
    fault_rate: float
    """Share of cycles in which a burst of lost, repeated or late ones begins [1]."""
    change_rate: float
    """Reconfigurations [1/s]."""
    drift: float
    """Speed that the Target says the surface has, which stands [m/s]."""
    drift_way: tuple[float, ...]
    """Its direction, world axes, of any length above 0."""

    def plain(self) -> dict[str, object]:
        """Return the choices as JSON, four digits."""
        return {name: _short(value) for name, value in asdict(self).items()}

    def twin(self, robot: str = DEFAULT_ROBOT) -> Twin:
        """Return the twin of a robot by name; its payload is in link 7.

        A robot that lacks the inertia set has its own.
        """
        cell = find_cell(robot=robot)
        base = replace(nominal_model(), inertia=self.inertia).on(cell.robot)
        mass = float(cell.loaded_robot(base.inertia).links.mass[6])
        scale = list(self.mass_scale)
        scale[6] += self.payload / mass
        names = {f.name for f in fields(self)} & set(names_in(Twin))
        same = {name: getattr(self, name) for name in names - {"inertia"}}
        return replace(
            base,
            description="random twin of the adversary in contact",
            **(same | {"mass_scale": tuple(scale)}),
            command_delay=self.delay,
            clearance_offset=self.clearance - PegInHole().clearance,
        )


class _Reader:
    """Takes one number of the vector after the other."""

    def __init__(self, vector: Array) -> None:
        # What was found before the last choices were there had them at 0.
        self._numbers = np.pad(vector, (0, SIZE - len(vector))).tolist()
        self._next = 0

    def share(self) -> float:
        self._next += 1
        return self._numbers[self._next - 1]

    def among(self, kinds: Sequence[str]) -> str:
        return kinds[min(int(self.share() * len(kinds)), len(kinds) - 1)]

    def is_below(self, share: float) -> bool:
        return self.share() < share

    def between(self, low: float, high: float) -> float:
        return low + (high - low) * self.share()

    def log(self, low: float, high: float) -> float:
        return low * (high / low) ** self.share()

    def vector(self, low: float, high: float, count: int) -> tuple[float, ...]:
        return tuple(self.between(low, high) for _ in range(count))


def choose(vector: Array, within: Ranges) -> Choices:
    """Read a try from `SIZE` numbers in [0, 1].

    Args:
        vector: The numbers, shape (SIZE,).
        within: How far the twin may be from the model.
    """
    hard = load_twin("hard")
    at = _Reader(vector)
    kinds = {
        "task": at.among(TASKS),
        "policy": at.among(POLICIES),
        "near": at.among(PLANES),
        "is_press_limited": at.is_below(0.5),
        "is_tared": at.is_below(0.5),
        "is_random_start": at.is_below(0.5),
        "inertia": at.among(within.inertias),
        "spring_ratio": 0.05 if at.is_below(0.5) else 0.5,
    }
    return Choices(
        **kinds,  # type: ignore[arg-type]
        mass_scale=at.vector(1.0 - within.mass, 1.0 + within.mass, 7),
        payload=at.between(0.0, within.payload),
        gravity_residual=at.vector(-1.0, 1.0, 3),
        damping=tuple(at.between(0.0, 3.0) * d for d in hard.damping),
        coulomb=tuple(at.between(0.0, 3.0) * c for c in hard.coulomb),
        armature=tuple(at.log(0.05, 0.4) for _ in range(7)),
        delay=at.between(0.0, within.delay),
        contact_time=at.log(0.002, 0.020),
        contact_friction=at.between(0.1, 0.6),
        clearance=at.between(0.0, 0.001),
        torque_noise=at.between(0.0, 3.0) * hard.torque_noise,
        position_noise=at.between(0.0, 3.0) * hard.position_noise,
        velocity_noise=at.between(0.0, 3.0) * hard.velocity_noise,
        spring=at.log(1e3, 1e5),
        spring_pull=at.vector(-20.0, 20.0, 3),
        depth=at.between(0.003, 0.025),
        tilt=at.vector(-1.0, 1.0, 2),
        twist=at.vector(-0.05, 0.05, 2),
        f_star=at.log(0.5, 10.0),
        direction=at.vector(-1.0, 1.0, 3),
        frequency=at.log(0.3, 10.0),
        theta=at.log(0.1, math.pi),
        push=30.0 * max(0.0, at.between(-1.0, 1.0)),
        push_time=at.log(0.05, 1.0),
        fault_rate=0.02 * max(0.0, at.between(-1.0, 1.0)),
        change_rate=2.0 * max(0.0, at.between(-1.0, 1.0)),
        drift=0.1 * max(0.0, at.between(-1.0, 1.0)),
        drift_way=at.vector(-1.0, 1.0, 3),
    )


def _short(value: object) -> object:
    if isinstance(value, tuple):
        return [_short(v) for v in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value
