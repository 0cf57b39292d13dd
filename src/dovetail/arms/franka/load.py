"""Load at a Franka's flange: the cell's, the arm's own, and what its torques show.

What the cell has beyond the end effector of Desk is set on the arm. The arm's mass and
that of its torques may differ from the cell's by the declared error of the payload. A
difference beyond it is refused before the arm is moved, as its gravity compensation
would lift the arm, or drop it.
"""

from typing import TypeAlias

import numpy as np

from dovetail.arms.franka.at_rest import Rest
from dovetail.control.proven import DECLARED
from dovetail.errors import ArmError, ConfigError
from dovetail.robots.inertia import merge_bodies, require_inertia
from dovetail.robots.missed_load import (
    EXPLAINED,
    FARTHEST,
    LIGHTEST,
    declared_load,
    explain_by_load,
)
from dovetail.robots.robot import Payload, Robot
from dovetail.types import Mat33, Vec3, Vec7

Load: TypeAlias = tuple[float, Vec3, Mat33]
"""Mass [kg], centre of mass [m] and inertia about it [kg m2], in the flange frame."""
ROUNDING = 0.01
"""Mass that is nothing [kg]: those in Desk have two digits."""

_REMEDY = (
    "give the true tool in the cell file (tool, tool_mass, and the part), choose the "
    "end effector that is mounted in Desk, leave load=no out of the address, and let "
    "nothing touch the arm"
)


class LoadError(ArmError):
    """The arm does not carry what the cell says.

    Attributes:
        cell: Mass at the flange by the cell [kg].
        arm: Mass that the arm compensates [kg].
        found: Mass that its torques show [kg]; None where they were not looked at.
        allowed: Largest difference from the cell's [kg].
        hand: Mass of Desk's end effector where it alone is more than the cell's [kg],
            or None.
    """

    def __init__(
        self,
        cell: float,
        arm: float,
        found: float | None,
        allowed: float,
        hand: float | None = None,
    ) -> None:
        shows = "" if found is None else f", and its torques show {found:.2f} kg"
        said = (
            f"the arm compensates {arm:.2f} kg{shows}; allowed are {allowed:g} kg more "
            "or less than the cell's"
        )
        if hand is not None:
            said = f"and the end effector in Desk alone has {hand:.2f} kg"
        super().__init__(
            f"the load is wrong: by the cell the flange carries {cell:.2f} kg, {said}: "
            f"{_REMEDY}",
            "wrong_load",
        )
        self.cell, self.arm, self.found, self.allowed = cell, arm, found, allowed
        self.hand = hand


def allowed_error(payload_error: float) -> float:
    """Return the error of the payload that is allowed [kg], at least the table's.

    Args:
        payload_error: The declared one, which is 0 for an arm as its model [kg].
    """
    return max(payload_error, DECLARED["payload_error"])


def load_beyond(payload: Payload, hand: Load) -> Load:
    """Return what the flange carries beyond Desk's end effector.

    Nothing where that one is the heavier; `require_light_hand` refuses it.

    Args:
        payload: All that the flange carries.
        hand: Desk's end effector.
    """
    mass, com, inertia = hand
    whole = payload.mass, payload.com, payload.inertia
    mass, com, inertia = merge_bodies(whole, (-mass, com, -np.asarray(inertia)))
    if mass < ROUNDING:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    try:
        require_inertia(inertia, "the load")
    except ConfigError:  # Desk's is not a part of this tool: the rest is no body's
        inertia = np.zeros((3, 3))
    return mass, com, inertia


def require_light_hand(robot: Robot, rest: Rest) -> None:
    """Refuse an end effector of Desk that is heavier than all that the cell has.

    Args:
        robot: The controller's model, tool included.
        rest: The arm, at rest.

    Raises:
        LoadError: It is: no load that is set on top makes the sum right.
    """
    cell = declared_load(robot)[0]
    if rest.hand - cell >= ROUNDING:
        raise LoadError(cell, rest.mass, None, ROUNDING, rest.hand)


def require_known_load(robot: Robot, rest: Rest, payload_error: float) -> None:
    """Refuse an arm that compensates another load than the cell's.

    Args:
        robot: The controller's model, tool included.
        rest: The arm, at rest.
        payload_error: Declared error [kg].

    Raises:
        LoadError: It does.
    """
    cell, allowed = declared_load(robot)[0], allowed_error(payload_error)
    if abs(rest.mass - cell) > allowed:
        raise LoadError(cell, rest.mass, None, allowed)


def require_true_load(
    robot: Robot, rest: Rest, missed: Vec7, payload_error: float
) -> None:
    """Refuse an arm whose torques at rest show another load than the cell's.

    Args:
        robot: The controller's model, tool included.
        rest: The arm, at rest.
        missed: Torque beyond what the arm compensates [Nm].
        payload_error: Declared error [kg].

    Raises:
        LoadError: They do.
    """
    cell, allowed = declared_load(robot)[0], allowed_error(payload_error)
    mass, is_load = measure_load(robot, rest, missed)
    if is_load and abs(mass - cell) > allowed:
        raise LoadError(cell, rest.mass, mass, allowed)


def measure_load(robot: Robot, rest: Rest, missed: Vec7) -> tuple[float, bool]:
    """Return the mass that torques show [kg], and whether a load explains them.

    Args:
        robot: The controller's model, tool included.
        rest: The arm, at rest.
        missed: Torque beyond what the arm compensates [Nm].
    """
    load = explain_by_load(robot, rest.q, missed, np.ones(7))
    mass, com = load.total(rest.mass, rest.com)
    # Without its tool an arm carries nothing, which has no centre.
    is_near = mass < LIGHTEST or bool(np.linalg.norm(com) < FARTHEST)
    return max(0.0, mass), load.explained > EXPLAINED and is_near
