"""Settings of the controller: the operational-space law and every limit.

Values are those that benchmarks/adversary.py shows to hold (docs/safety.md); each is
checked once, here, so that the control cycle never has to.
"""

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from dovetail.control.available import (
    REFERENCE,
    as_key,
    available_acceleration,
    available_at_tool,
    available_jerk,
)
from dovetail.control.law import (
    AxisGains,
    ClampConfig,
    IntegralConfig,
    JointGains,
    NullSpaceGains,
    TaskInertiaConfig,
)
from dovetail.control.limits import (
    BOUNDS,
    SCHEMES,
    ApproachLimits,
    DeclaredErrors,
    DisturbanceConfig,
    JointLimits,
    PredictionConfig,
    SaturationConfig,
    ToolLimits,
)
from dovetail.control.proven import DECLARED
from dovetail.errors import ConfigError, UnprovenWarning
from dovetail.settings import settings, values_of

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot

PERIOD_MIN, PERIOD_MAX = 1e-4, 5e-3
"""Range of control periods [s] for which limits were shown to hold."""

_PERIODS = (1e-3, 2e-3, 2.5e-3, 5e-3)
_INTERVAL = (5e-3, 8e-3, 25e-3 / 3, 10e-3)  # kappa * period [s]
_INTERVAL_DELAYS, _INTERVAL_PERIODS = 3.0, 4.5
"""Time in which limits act, over the delay and over the period."""
_RATE_RATIO = 0.75  # of the estimate: a loop with a delay is unstable from 1.57 on
_RATE_MAX = 60.0  # 1/s
_RATE_SHARE = (
    0.99  # of the change of torque that an arm takes: it counts in its own way
)
_PUSHED = 1.0
"""Speed that a limit which falls towards a position limit still allows at ours [rad/s]:
about what a push of 30 N adds beside it before the arm has braked."""
_DELTA_Q = (2e-3, 3e-3, 5e-3, 5e-3)  # rad, exact model
_DELTA_V = (0.01, 0.02, 0.05, 0.05)
_DELTA_Q_HARDWARE = (30e-3, 30e-3, 45e-3, 50e-3)  # rad; all that is declared at once
_DELTA_V_HARDWARE = (0.50,) * 4  # for a push that turns round
_DELTA_V_MOST = 0.75  # however much is declared, a quarter of the speed is left
_DELTA_X = (
    12e-3,
    12e-3,
    12e-3,
    12e-3,
)  # m; evolved attacks go 11 mm past: docs/safety.md
_DELTA_X_HARDWARE = (15e-3, 15e-3, 20e-3, 20e-3)


def check_period(period: float) -> float:
    """Return the period [s], or raise ConfigError if limits are not proven there."""
    if not PERIOD_MIN <= period <= PERIOD_MAX:
        raise ConfigError(
            f"control period is {period} s; allowed: {PERIOD_MIN} to {PERIOD_MAX} s, "
            "the range in which the limits were shown to hold"
        )
    return float(period)


@settings(eq=False)
class OscConfig(
    AxisGains,
    ClampConfig,
    IntegralConfig,
    NullSpaceGains,
    TaskInertiaConfig,
    JointGains,
):
    """The operational-space law (Khatib 1987), axes in twist order X Y Z C B A."""

    use_jdot: bool = False
    """Subtract dJ dq from f*; off as in the paper."""
    use_coriolis: bool = False
    """Add the Coriolis torque to the command; off as in the paper."""

    @classmethod
    def for_period(cls, period: float, **overrides: Any) -> Self:
        """Return the law for a control period [s]. Its defaults serve each period."""
        check_period(period)
        return cls(**overrides)

    def params(self) -> "_core.OscParams":
        """Copy into the C++ parameter struct."""
        from dovetail import _core

        params = _core.OscParams()
        for name, value in values_of(self).items():
            setattr(params, name, value)
        return params


@settings(eq=False)
class LimitConfig(
    JointLimits,
    ToolLimits,
    ApproachLimits,
    DeclaredErrors,
    DisturbanceConfig,
    PredictionConfig,
    SaturationConfig,
):
    """Every limit of the motion; each one is enforced in C++ and has a flag."""

    @classmethod
    def for_period(
        cls, robot: "Robot", period: float, *, hardware: bool = True, **overrides: Any
    ) -> Self:
        """Return the limits of a robot at a control period, as measured to hold.

        Between tabulated periods the margins of the longer one are used. Damping and
        armature default to the robot's. What is declared beyond `proven.DECLARED` is
        warned of (`UnprovenWarning`); margins grow with it, up to twice the table's.

        Args:
            robot: Its limits, and its payload for ddq_max.
            period: Control period [s], 0.1 to 5 ms.
            hardware: An arm with up to `proven.DECLARED` in delay and errors, and
                pushes of 30 N; without, one that is exactly as its model.
            **overrides: Any field, for example x_min and x_max. An arm with a declared
                delay or error is not exact: it gets at least the table's margins, as
                no smaller ones were attacked.

        Raises:
            ConfigError: Period out of range.
            TorqueError: Too little torque is left to brake; see its `cause`.
        """
        check_period(period)
        row = int(np.searchsorted(_PERIODS, period * (1 - 1e-9)))
        interval = max(5 * period if row == 0 else 0.0, 2 * period)
        if row:
            interval = float(np.interp(period, _PERIODS, _INTERVAL))
        table = DECLARED if hardware else dict.fromkeys(DECLARED, 0.0)
        declared = DeclaredErrors(**{n: overrides.get(n, table[n]) for n in table})
        lag, share = period, 0.0
        if hardware or any(vars(declared).values()):
            for text in declared.beyond_proven():
                warnings.warn(text, UnprovenWarning, stacklevel=2)
            delay = max(declared.delay, DECLARED["delay"])
            lag += delay
            ratios = (vars(declared)[n] / most for n, most in DECLARED.items())
            share = min(max(1.0, *ratios), 2.0)
            acts = _INTERVAL_DELAYS * delay + _INTERVAL_PERIODS * period
            interval = max(interval, acts)
        rate = min(_RATE_MAX, _RATE_RATIO / lag)

        def margin(exact: tuple[float, ...], all_wrong: tuple[float, ...]) -> float:
            return exact[row] + share * (all_wrong[row] - exact[row])

        settings: dict[str, Any] = {
            **vars(declared),
            "estimate_rate": rate,
            "brake_rate": rate,
            "q_min": robot.limits.q_min + robot.limits.room_at(_PUSHED),
            "q_max": robot.limits.q_max - robot.limits.room_at(_PUSHED),
            "dq_max": robot.limits.dq_max,
            "tau_max": robot.limits.tau_max,
            "taper_brake": robot.limits.taper_brake,
            "taper_offset": robot.limits.taper_offset,
            "dtau_max": _RATE_SHARE * robot.limits.dtau_max,
            "x_min": [0.40, -0.20, 0.02],
            "x_max": [0.80, 0.20, 0.40],
            "kappa": interval / period,
            "delta_q": margin(_DELTA_Q, _DELTA_Q_HARDWARE),
            "delta_v": min(margin(_DELTA_V, _DELTA_V_HARDWARE), _DELTA_V_MOST),
            "delta_x": margin(_DELTA_X, _DELTA_X_HARDWARE),
            "damping": robot.motors.damping,
            "armature": robot.motors.armature,
        } | overrides
        limits = cls(**{**settings, "ddq_max": overrides.get("ddq_max", REFERENCE)})
        if "ddq_max" not in overrides:
            ddq_max = available_acceleration(
                robot, limits.tau_max, limits.damping, limits.armature
            )
            limits = replace(limits, ddq_max=ddq_max)
        weak: dict[str, Any] = _of_a_weak_arm(robot, limits) | overrides
        return replace(limits, **weak)

    def params(self) -> "_core.LimitParams":
        """Copy into the C++ parameter struct."""
        from dovetail import _core

        params = _core.LimitParams()
        for name, value in values_of(self).items():
            if name not in ("scheme", "bounds", *DECLARED):
                setattr(params, name, value)
        params.scheme = _core.Scheme(SCHEMES.index(self.scheme))
        params.bounds = _core.BoundsKind(BOUNDS.index(self.bounds))
        return params


def _of_a_weak_arm(robot: "Robot", limits: LimitConfig) -> dict[str, Any]:
    """Return limits of an arm that is weaker than usual, or whose torques are slow."""
    given = limits.armature, limits.ddq_max, limits.dtau_max
    found: dict[str, Any] = {}
    if (limits.ddq_max < REFERENCE).any():
        most, jerk = available_at_tool(robot, *map(as_key, given))
        found |= {"ddx_max": np.minimum(limits.ddx_max, most), "jerk_wall": jerk}
    if np.isfinite(limits.dtau_max).any():
        found["jerk_max"] = available_jerk(robot, *given)
    return found
