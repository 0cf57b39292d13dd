"""Settings of the C++ watchdog: conditions that stop an arm on the network."""

from typing import TYPE_CHECKING, Annotated

from dovetail.settings import Range, settings

if TYPE_CHECKING:
    from dovetail import _core

_INF = float("inf")


@settings()
class WatchdogConfig:
    """Causes of a hold or a controlled stop; infinity switches a cause off."""

    target_timeout: Annotated[float, Range(0.005, _INF, "s")] = 0.15
    """Without a new Target for this long: damped hold until the next one [s]. Not in
    lockstep, where time stands still while the learner thinks."""
    position_margin: Annotated[float, Range(1e-4, _INF, "rad")] = 0.02
    """Measured position beyond a joint limit that stops [rad]."""
    speed_margin: Annotated[float, Range(1e-3, _INF, "1")] = 0.15
    """Measured speed beyond the joint's limit that stops, as a share of it [1]."""
    torque_error: Annotated[float, Range(1e-3, _INF, "1")] = 0.3
    """Measured from commanded torque that stops, as a share of the motor's [1]."""
    external_torque: Annotated[float, Range(1e-3, _INF, "1")] = 0.6
    """External torque that stops, as a share of the motor's [1]."""
    confirm: Annotated[float, Range(1e-6, 10.0, "s")] = 0.01
    """Time for which speed or external torque must be too large [s]."""
    confirm_tracking: Annotated[float, Range(1e-6, 10.0, "s")] = 0.1
    """Time for which torque must differ from the commanded one [s]."""
    rest_speed: Annotated[float, Range(1e-4, 1.0, "rad/s")] = 0.02
    """Speed of every joint below which a braking arm is held where it is [rad/s]."""

    def params(self) -> "_core.WatchdogParams":
        """Copy into the C++ parameter struct."""
        from dovetail import _core

        params = _core.WatchdogParams()
        for name, value in vars(self).items():
            setattr(params, name, value)
        return params
