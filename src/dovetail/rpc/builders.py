"""Builders of a service's arm: over a plant in this process, or anew each time."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from dovetail.arms.arm import Arm
from dovetail.arms.local_arm import LocalArm
from dovetail.control.limits import DeclaredErrors
from dovetail.control.proven import DECLARED, describe
from dovetail.control.settings import ControllerSettings
from dovetail.durations import format_ms
from dovetail.errors import ConfigError
from dovetail.options import option_words
from dovetail.plants.plant import Plant

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot
    from dovetail.workcell.workcell import Workcell

NOTHING = DeclaredErrors(**dict.fromkeys(DECLARED, 0.0))
"""Errors that a learner has to declare where nothing is known of the arm."""


def require_offered(
    name: str,
    period: float | None,
    declared: DeclaredErrors,
    settings: ControllerSettings,
) -> None:
    """Refuse a learner that asks for another period, or declares less than is known.

    Args:
        name: Address of the arm.
        period: What is offered [s]; None is any.
        declared: Least that the learner's limits have to be made for.
        settings: What the learner asks for.

    Raises:
        ConfigError: Names both, and what the learner has to add.
    """
    if period not in (None, settings.period):
        raise ConfigError(
            f"the arm at {name} is commanded every {1e3 * period:g} ms, the learner "
            f"asks for {1e3 * settings.period:g} ms: add "
            f"period={format_ms(period)} to the learner's address, "
            "grpc://HOST:PORT?period=..."
        )
    own = settings.limits.declared_errors()
    for key, least in declared.declared_errors().items():
        if own[key] < least * (1.0 - 1e-9):
            word, given = option_words(key, least)
            raise ConfigError(
                f"{key} of the arm at {name} is up to {describe(key, least)}, as who "
                f"serves it says; the learner's limits declare "
                f"{describe(key, own[key])}: give the learner {word} {given}, or in "
                f"Python {key}={least:g}, and no margins=model"
            )


class LocalBuilder:
    """A new controller for each learner's settings, over the same simulation."""

    is_real_time = False
    places_fixture = True

    def __init__(
        self,
        name: str,
        plant: Plant,
        period: float | None = None,
        declared: DeclaredErrors = NOTHING,
    ) -> None:
        """Own a plant.

        Args:
            name: Address of the arm.
            plant: Where the torques go; closed with the builder.
            period: The only control period that is offered [s]; None is any.
            declared: Least that a learner's limits have to be made for.
        """
        self._period, self._declared = period, declared
        self.name = name
        self.cell: Workcell | None = plant.cell
        self.robot: Robot = plant.robot
        self._plant = plant

    def build(self, settings: ControllerSettings) -> Arm:
        """Return an arm with these settings."""
        require_offered(self.name, self._period, self._declared, settings)
        return LocalArm(
            self._plant,
            self.robot,
            settings.osc,
            settings.limits,
            settings.task,
            settings.period,
        )

    def close(self) -> None:
        """Close the plant."""
        self._plant.close()


class RebuiltArm:
    """An arm that is closed and made anew for each learner's settings.

    For arms that own a port or a device: the one before lets it go first.
    """

    def __init__(
        self,
        name: str,
        cell: "Workcell",
        make: Callable[[ControllerSettings], Arm],
        *,
        is_real_time: bool,
        places_fixture: bool,
    ) -> None:
        """Own the arm that `make` returns.

        Args:
            name: Address of the arm.
            cell: What stands there, as the user says it is.
            make: Makes the arm.
            is_real_time: Whether the arm moves on while the learner thinks.
            places_fixture: Whether it can put the fixture where a reset says.
        """
        self.name = name
        self.cell: Workcell | None = cell
        self.robot: Robot = cell.loaded_robot()
        self.is_real_time = is_real_time
        self.places_fixture = places_fixture
        self._make = make
        self._arm: Arm | None = None

    def build(self, settings: ControllerSettings) -> Arm:
        """Close the arm before and return a new one."""
        self.close()
        self._arm = self._make(settings)
        return self._arm

    def close(self) -> None:
        """Close the arm."""
        arm, self._arm = self._arm, None
        if arm is not None:
            arm.close()
