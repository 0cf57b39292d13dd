"""The motion of a replay as a linear function of its parameters, near a fit."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from dovetail.errors import ConfigError
from dovetail.identify.parameters import Parameter, ParameterSet
from dovetail.identify.replay import LogReplay
from dovetail.plants.plant import DynamicsConfig, physics_steps
from dovetail.types import Array

_STEP = 5e-3
"""Half width of a central difference, as a part of the parameter's range: small beside
the curvature, large beside the corners that limits and dry friction make."""


Progress: TypeAlias = Callable[
    [Sequence[tuple[int, Parameter]]], Iterable[tuple[int, Parameter]]
]
"""Passes on numbered parameters one by one, and may show how far it is."""


@dataclass(frozen=True, kw_only=True)
class Linearisation:
    """Position error and its derivative, one array per sequence."""

    vector: Array
    """Values at which it was taken, each in its unit, shape (k,)."""
    residuals: tuple[Array, ...]
    """Simulated minus measured TCP position [m], shape (3 * cycles,), x y z in turn."""
    jacobians: tuple[Array, ...]
    """Its derivative [m per unit], shape (3 * cycles, k)."""
    unmodelled: tuple[Array, ...] = ()
    """Motion of one standard deviation of each effect that was not fitted [m], shape
    (3 * cycles, effects); empty is none."""


def linearise(
    replay: LogReplay,
    parameters: ParameterSet,
    vector: Array,
    progress: Progress = tuple,
) -> Linearisation:
    """Take the residual and its Jacobian by central differences.

    The half width is half a percent of the range, and one physics step for the command
    delay, which bends at whole steps. At a bound the difference is one-sided.

    Args:
        replay: The log, and the engine that plays it.
        parameters: What was fitted.
        vector: The fitted values, in the order of `parameters`.
        progress: Wraps the parameters on their way through the loop, for a bar.

    Raises:
        ConfigError: The vector is not one finite value per parameter, or out of bounds.
        PlantError: The simulation diverged.
    """
    vector = np.asarray(vector, dtype=float)
    simulated = replay.run(parameters.to_model(vector))
    outside = (vector < parameters.low) | (vector > parameters.high)
    if outside.any():
        p = parameters.parameters[int(np.argmax(outside))]
        raise ConfigError(
            f"parameter {p.name} is {vector[int(np.argmax(outside))]:g} {p.unit}, its "
            f"bounds are {p.low:g} to {p.high:g} {p.unit}; fit it again with wider ones"
        )
    columns = []
    for index, parameter in progress(list(enumerate(parameters.parameters))):
        half = half_width(parameter, replay.recording.period)
        ends = []
        for sign in (-1.0, 1.0):
            moved = vector.copy()
            moved[index] += sign * half
            moved[index] = np.clip(moved[index], parameter.low, parameter.high)
            ends.append((moved[index], replay.run(parameters.to_model(moved))))
        (low, before), (high, after) = ends
        columns.append(
            [(b - a).ravel() / (high - low) for a, b in zip(before, after, strict=True)]
        )
    measured = replay.recording.positions()
    return Linearisation(
        vector=vector,
        residuals=tuple(
            (s - m).ravel() for s, m in zip(simulated, measured, strict=True)
        ),
        jacobians=tuple(np.column_stack(c) for c in zip(*columns, strict=True)),
    )


def half_width(parameter: Parameter, period: float) -> float:
    """Return by how much a parameter is moved to each side, in its unit.

    Args:
        parameter: The parameter, with its range.
        period: Control period of the log [s].
    """
    span = parameter.high - parameter.low
    if parameter.name != "command_delay":
        return _STEP * span
    return period / physics_steps(period, DynamicsConfig().physics_dt)
