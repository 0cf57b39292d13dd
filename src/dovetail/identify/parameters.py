"""Parameters that an identification may change in the simulation, and their ranges."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from dovetail.errors import ConfigError, did_you_mean
from dovetail.plants.find import find_engine
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import Twin
from dovetail.robots.motors import Motors
from dovetail.settings import ranges_of
from dovetail.types import Array

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot


@dataclass(frozen=True)
class Parameter:
    """One number that the fit may change."""

    name: str
    """Name, as a fit's report and `--parameters` call it."""
    unit: str
    low: float
    high: float
    """Bounds of the search."""
    start: float
    """Value at which the search begins: the nominal model's."""
    spread: float
    """Standard deviation of an arm's value about `start`, before any log."""


DELAY_RANGE = (0.0, 0.1)
"""Allowed command delay of a model [s]."""
_NOMINAL = DynamicsConfig()
_JOINTS = range(1, 8)


def _scalar_and_joints(
    name: str, unit: str, low: float, high: float, start: float, spread: float
) -> list[Parameter]:
    """Return one parameter for all joints, and one for each."""
    names = [name, *(f"{name}_{i}" for i in _JOINTS)]
    return [Parameter(n, unit, low, high, start, spread) for n in names]


KNOWN: dict[str, Parameter] = {
    p.name: p
    for p in (
        *(Parameter(f"gravity_{axis}", "m/s2", -2.0, 2.0, 0.0, 0.5) for axis in "xyz"),
        *_scalar_and_joints("mass_scale", "1", 0.4, 1.6, 1.0, 0.25),
        *_scalar_and_joints("damping", "Nms/rad", 0.0, 4.0, 0.5, 0.5),
        *_scalar_and_joints("coulomb", "Nm", 0.0, 4.0, 0.0, 1.0),
        *_scalar_and_joints("armature", "kg m2", 0.005, 0.6, 0.1, 0.1),
        Parameter("command_delay", "s", 0.0, 0.03, 0.0, 0.01),
    )
}
"""Every parameter by name. `gravity_*` is the true gravity minus the compensated one,
world axes; a name without a number is one value for all seven joints or links."""


def _joints(name: str) -> tuple[str, ...]:
    return tuple(f"{name}_{i}" for i in _JOINTS)


GROUPS: dict[str, tuple[str, ...]] = {
    "gravity": ("gravity_x", "gravity_y", "gravity_z"),
    "mass_scale_per_link": _joints("mass_scale"),
    "damping_per_joint": _joints("damping"),
    "coulomb_per_joint": _joints("coulomb"),
    "armature_per_joint": _joints("armature"),
}
"""Names that stand for several parameters."""

SETS: dict[str, tuple[str, ...]] = {
    "paper": ("gravity", "mass_scale", "damping"),
    "extended": (
        *("gravity", "mass_scale_per_link", "damping_per_joint"),
        *("coulomb_per_joint", "armature_per_joint", "command_delay"),
    ),
}
"""The paper's set, and the one with what its authors left out."""


@dataclass(frozen=True)
class ParameterSet:
    """The parameters of one identification, in order."""

    parameters: tuple[Parameter, ...]
    motors: Motors = field(default_factory=Motors, compare=False)
    """Of the controller's model: friction and rotors that are not identified."""

    def __post_init__(self) -> None:
        """Refuse an empty set, a parameter that is there twice, or bad bounds."""
        if not self.parameters:
            raise ConfigError(
                f"no parameters to identify; give one of {', '.join(SETS)}, or a list "
                f"of {_known()}"
            )
        names = self.names
        for name in names:
            stem = name.rstrip("0123456789").rstrip("_")
            if names.count(name) > 1 or (stem != name and stem in names):
                raise ConfigError(
                    f"parameter {name} is there twice, alone or as part of a group; "
                    "name it once"
                )
        for p in self.parameters:
            if not p.low <= p.start <= p.high or p.low >= p.high:
                raise ConfigError(
                    f"parameter {p.name} starts at {p.start:g} {p.unit}, which its "
                    f"bounds {p.low:g} to {p.high:g} {p.unit} exclude; widen them"
                )
            low, high = _allowed(p.name)
            for value in (p.low, p.high):
                if not low <= value <= high:
                    raise ConfigError(
                        f"parameter {p.name} ends at {value:g} {p.unit}, allowed is "
                        f"{low:g} to {high:g} {p.unit}"
                    )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read a set: `paper`, `extended`, or names divided by commas.

        Bounds and start of a name may follow it: `gravity_z=-1:1` (bounds) or
        `mass_scale=0.8:1.2:1.05` (bounds and start).

        Raises:
            ConfigError: An unknown name (lists the known ones), bounds that are no
                numbers or exclude the start, or a parameter twice.
        """
        parameters: list[Parameter] = []
        for word in filter(None, (w.strip() for w in text.split(","))):
            name, _, bounds = word.partition("=")
            names = _expand(name)
            parameters += [_bounded(KNOWN[n], bounds) for n in names]
        return cls(tuple(parameters))

    def of_robot(self, robot: "Robot") -> Self:
        """Return the set that begins at the friction and rotors of a robot's model.

        A start of one's own stays. Bounds reach to twice the robot's value.

        Args:
            robot: The controller's model.
        """
        motors = robot.motors
        return replace(
            self,
            parameters=tuple(_started(p, motors) for p in self.parameters),
            motors=motors,
        )

    def nominal(self, engine: str = "mujoco") -> Twin:
        """Return the controller's own model as a twin without noise."""
        return replace(nominal_model(engine), **self.motors.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of the vector."""
        return tuple(p.name for p in self.parameters)

    @property
    def low(self) -> Array:
        """Lower bounds, shape (number of parameters,)."""
        return np.array([p.low for p in self.parameters])

    @property
    def high(self) -> Array:
        """Upper bounds, shape (number of parameters,)."""
        return np.array([p.high for p in self.parameters])

    @property
    def start(self) -> Array:
        """Values at which the search begins, shape (number of parameters,)."""
        return np.array([p.start for p in self.parameters])

    @property
    def spread(self) -> Array:
        """Standard deviations about the start, shape (number of parameters,)."""
        return np.array([p.spread for p in self.parameters])

    def values_in(self, model: Twin) -> Array:
        """Return the values that a model has, shape (number of parameters,)."""
        x, y, z = model.gravity_residual
        gravity = {"gravity_x": x, "gravity_y": y, "gravity_z": z}
        fields: dict[str, Any] = vars(model) | gravity
        values = []
        for name in self.names:
            stem, _, joint = name.rpartition("_")
            value = fields[stem][int(joint) - 1] if joint.isdigit() else fields[name]
            values.append(np.mean(value))
        return np.array(values)

    def to_model(self, vector: Array, engine: str = "mujoco") -> Twin:
        """Return the simulation with these values and without noise.

        Args:
            vector: One value for each parameter, in its unit.
            engine: Physics engine that the model names.

        Raises:
            ConfigError: Not one finite value for each parameter.
        """
        values = np.asarray(vector, dtype=float)
        if values.shape != (len(self.parameters),) or not np.isfinite(values).all():
            raise ConfigError(
                f"the vector is {values.tolist()}; it needs {len(self.parameters)} "
                f"finite numbers: {', '.join(self.names)}"
            )
        model = self.nominal(engine)
        changed: dict[str, list[float]] = {}
        for p, value in zip(self.parameters, values.tolist(), strict=True):
            _put(changed, model, p.name, value)
        delay = changed.pop("command_delay", [model.command_delay])[0]
        arrays: dict[str, Any] = {name: tuple(v) for name, v in changed.items()}
        return replace(model, command_delay=delay, **arrays)


def nominal_model(engine: str = "mujoco") -> Twin:
    """Return the iiwa's own model as a twin without noise."""
    d = _NOMINAL
    return Twin(
        description="the controller's model",
        engine=find_engine(engine),
        seed=0,
        inertia=d.inertia,
        mass_scale=d.mass_scale,
        gravity_residual=d.gravity_residual,
        damping=d.damping,
        coulomb=d.coulomb,
        armature=d.armature,
        command_delay=0.0,
        torque_noise=0.0,
        position_noise=0.0,
        velocity_noise=0.0,
        contact_friction=d.contact_friction,
        contact_time=d.contact_time,
        clearance_offset=0.0,
    )


def _allowed(name: str) -> tuple[float, float]:
    """Return the range that a model may have a parameter in."""
    if name == "command_delay":
        return DELAY_RANGE
    stem = "gravity_residual" if name.startswith("gravity") else name.rstrip("_1234567")
    allowed = ranges_of(DynamicsConfig)[stem]
    return allowed.low, allowed.high


def _put(changed: dict[str, list[float]], model: Twin, name: str, value: float) -> None:
    """Write one parameter into the fields of the model that change."""
    if name == "command_delay":
        changed[name] = [value]
        return
    stem, _, part = name.rpartition("_")
    if stem == "gravity":
        residual = changed.setdefault("gravity_residual", list(model.gravity_residual))
        residual["xyz".index(part)] = value
    elif part.isdigit():
        changed.setdefault(stem, list(vars(model)[stem]))[int(part) - 1] = value
    else:
        changed[name] = [value] * 7


def _started(parameter: Parameter, motors: Motors) -> Parameter:
    """Return a parameter of the joints with the start that the motors are."""
    stem, _, joint = parameter.name.partition("_")
    usual = KNOWN[parameter.name]
    if stem not in motors.values() or parameter.start != usual.start:
        return parameter
    values = vars(motors)[stem]
    start = float(values[int(joint) - 1] if joint else values.mean())
    low, high = parameter.low, parameter.high
    if (low, high) == (usual.low, usual.high):
        low, high = min(low, start), max(high, min(2.0 * start, _allowed(stem)[1]))
    start, spread = min(max(start, low), high), max(parameter.spread, 0.5 * start)
    return replace(parameter, low=low, high=high, start=start, spread=spread)


def _expand(name: str) -> list[str]:
    """Return the parameters that a name stands for."""
    if name in SETS:
        return [n for part in SETS[name] for n in _expand(part)]
    if name in GROUPS:
        return list(GROUPS[name])
    if name in KNOWN:
        return [name]
    meant = did_you_mean(name, [*SETS, *GROUPS, *KNOWN])
    raise ConfigError(f"parameter {name!r} is unknown{meant}; known: {_known()}")


def _bounded(parameter: Parameter, text: str) -> Parameter:
    """Return a parameter with the bounds, and perhaps the start, of LOW:HIGH:START."""
    if not text:
        return parameter
    try:
        numbers = [float(word) for word in text.split(":")]
        low, high, start = (*numbers, parameter.start)[:3]
    except ValueError:
        numbers = []
        low = high = start = np.nan
    if len(numbers) not in (2, 3) or not np.isfinite([low, high, start]).all():
        raise ConfigError(
            f"parameter {parameter.name} has the bounds {text!r}; give LOW:HIGH or "
            f"LOW:HIGH:START in {parameter.unit}, such as {parameter.low:g}:"
            f"{parameter.high:g}"
        )
    return replace(parameter, low=low, high=high, start=start)


def _known() -> str:
    scalars = [n for n in KNOWN if not n[-1].isdigit()]
    return ", ".join([*SETS, *GROUPS, *scalars, "and a joint's own, such as damping_3"])
