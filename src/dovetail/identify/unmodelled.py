"""Effects of an arm that a fit leaves out: how far each usually moves the tool.

A fit gives their motion to its own parameters. They are unknowns too: with the spread
that they have before any log they belong into the uncertainty of what was fitted.
"""

from collections.abc import Iterator

import numpy as np

from dovetail.identify.parameters import ParameterSet
from dovetail.identify.replay import LogReplay
from dovetail.plants.twin import Twin
from dovetail.robots.links import InertiaSet
from dovetail.types import Array

CENTRE_SPREAD = 0.015
"""Standard deviation of a link's centre of mass along each axis [m]; those that are
published for the iiwa 14 differ by up to 23 mm."""
INERTIA_SPREAD = 1.0
"""Standard deviation of a link's inertia about its centre, as a share [1]; the
published ones differ by a factor of up to 4.3 at the same mass."""


def unmodelled_motion(
    replay: LogReplay, parameters: ParameterSet, vector: Array
) -> tuple[Array, ...]:
    """Return the motion that one standard deviation of each effect makes.

    The effects are the parameters of the extended set that were not fitted, centres of
    mass and inertias. Where one value was fitted for all joints, they are each joint's
    distance from the joints' mean.

    Args:
        replay: The log, and the engine that plays it.
        parameters: What was fitted.
        vector: The fitted values.

    Returns:
        One array of shape (3 * cycles, effects) [m] per sequence, as the Jacobian.
    """
    model = parameters.to_model(vector, replay.engine)
    here = np.concatenate(replay.run(model))
    columns = [
        *_of_parameters(replay, parameters, model, here),
        *_of_links(replay, model, here),
    ]
    ends = 3 * np.cumsum([len(p) for p in replay.recording.positions()])
    return tuple(np.split(np.column_stack(columns), ends[:-1]))


def _of_parameters(
    replay: LogReplay, parameters: ParameterSet, model: Twin, here: Array
) -> Iterator[Array]:
    """Yield the motion of each parameter that was not fitted, by half its spread."""
    whole = ParameterSet.parse("extended").of_robot(replay.recording.cell.robot)
    values = whole.values_in(model)
    shared: dict[str, list[Array]] = {}
    for index, p in enumerate(whole.parameters):
        if p.name in parameters.names:
            continue
        step = 0.5 * p.spread
        if values[index] + step > p.high:
            step = -step
        changed = values.copy()
        changed[index] += step
        moved = replay.run(whole.to_model(changed, replay.engine))
        column = (np.concatenate(moved) - here).ravel() * (p.spread / step)
        stem = p.name.rpartition("_")[0]
        name = stem if stem in parameters.names else p.name
        shared.setdefault(name, []).append(column)
    for columns in shared.values():
        mean = np.mean(columns, axis=0) if len(columns) > 1 else 0.0
        yield from (column - mean for column in columns)


def _of_links(replay: LogReplay, model: Twin, here: Array) -> Iterator[Array]:
    """Yield the motion of each link's centre of mass and inertia."""
    links = replay.recording.cell.robot.links
    own = InertiaSet(links.mass, links.com, links.inertia)
    for link in range(len(own.mass)):
        for axis in range(3):
            com = own.com.copy()
            com[link, axis] += CENTRE_SPREAD
            moved = replay.run(model, own._replace(com=com))
            yield (np.concatenate(moved) - here).ravel()
        inertia = own.inertia.copy()
        inertia[link] *= 1.0 + INERTIA_SPREAD
        moved = replay.run(model, own._replace(inertia=inertia))
        yield (np.concatenate(moved) - here).ravel()
