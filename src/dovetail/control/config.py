"""Settings of the controller: the operational-space law and every limit.

Values are those that benchmarks/adversary.py shows to hold (docs/safety.md); each is
checked once, here, so that the control cycle never has to.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np

from dovetail.control.available import REFERENCE, available_acceleration
from dovetail.control.proven import DECLARED
from dovetail.control.ranges import Range, check_ranges, in_range
from dovetail.control.task_spec import AXES
from dovetail.errors import ConfigError
from dovetail.types import JOINTS, Array, Vec3, Vec6, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot

SCHEMES = ("qp", "paper")
BOUNDS = ("viability", "paper-corrected", "paper-printed")

PERIOD_MIN, PERIOD_MAX = 1e-4, 5e-3
"""Range of control periods [s] for which limits were shown to hold."""

_TASK_AXES, _XYZ = tuple(AXES), ("X", "Y", "Z")
_PERIODS = (1e-3, 2e-3, 5e-3)
_INTERVAL = (5e-3, 8e-3, 10e-3)  # kappa * period [s], kappa 5 / 4 / 2
_DECLARED_RANGES = {
    "delay": Range(0.0, 0.05, "s"),
    "mass_error": Range(0.0, 0.5, "1"),
    "payload_error": Range(0.0, 5.0, "kg"),
}
_INTERVAL_RATIO = 3.5  # time in which limits act, over delay and period
_RATE_RATIO = 0.75  # of the estimate: a loop with a delay is unstable from 1.57 on
_RATE_MAX = 60.0  # 1/s
_DELTA_Q = (2e-3, 3e-3, 5e-3)  # rad, exact model
_DELTA_V = (0.01, 0.02, 0.05)
_DELTA_Q_HARDWARE = (30e-3, 30e-3, 45e-3)  # rad; all that is declared at once
_DELTA_V_HARDWARE = (0.30, 0.30, 0.35)
_DELTA_X = (5e-3, 5e-3, 10e-3)  # m; docs/safety.md
_DELTA_X_HARDWARE = (15e-3, 15e-3, 20e-3)
_K_ROTATION = (200.0, 200.0, 200.0)  # 1/s2


def _all(count: int, value: float) -> Callable[[], Array]:
    return lambda: np.full(count, value)


def check_period(period: float) -> float:
    """Return the period [s], or raise ConfigError if limits are not proven there."""
    if not PERIOD_MIN <= period <= PERIOD_MAX:
        raise ConfigError(
            f"control period is {period} s; allowed: {PERIOD_MIN} to {PERIOD_MAX} s, "
            "the range in which the limits were shown to hold"
        )
    return float(period)


@dataclass(frozen=True, kw_only=True, eq=False)
class OscConfig:
    """The operational-space law (Khatib 1987), axes in twist order X Y Z C B A."""

    stiffness: Annotated[Vec6, Range(0.0, 1e4, "1/s2", _TASK_AXES)] = field(
        default_factory=_all(6, 400.0)
    )
    """Stiffness K of pose and hold axes [1/s2], unit mass; less at long periods."""
    damping_ratio: Annotated[Vec6, Range(0.0, 10.0, "1", _TASK_AXES)] = field(
        default_factory=_all(6, 1.0)
    )
    """Damping ratio zeta of pose and hold axes [1]; D = 2 zeta sqrt(K)."""
    force_damping: Annotated[Vec6, Range(0.0, 200.0, "1/s", _TASK_AXES)] = field(
        default_factory=_all(6, 0.0)
    )
    """Damping of force axes [1/s]; 0 is the paper: f* accelerates to the limits."""
    error_clamp_rotation: Annotated[float, Range(1e-3, np.pi, "rad")] = 0.25
    """Largest rotation error used [rad], so that a jump of theta is no torque step."""
    turn_speed: Annotated[float, Range(1e-2, 1e4, "rad/s")] = 1.0
    """Speed at which the desired rotation turns to one that jumps [rad/s], beside the
    Target's own: a jump saturates joints, which then lack what holds the other axes."""
    error_clamp_position: Annotated[float, Range(1e-4, 2.0, "m")] = 0.1
    """Largest position error used [m]."""
    f_clamp_linear: Annotated[float, Range(1e-3, 1e3, "m/s2")] = 30.0
    """Largest f* on a translation axis [m/s2]."""
    f_clamp_angular: Annotated[float, Range(1e-3, 1e4, "rad/s2")] = 200.0
    """Largest f* on a rotation axis [rad/s2]."""
    k_null: Annotated[float, Range(0.0, 100.0, "1/s")] = 10.0
    """Null-space damping k [1/s]; it can only take energy out."""
    posture_stiffness: Annotated[float, Range(0.0, 1e3, "1/s2")] = 50.0
    """Null-space stiffness towards the configuration where the task began [1/s2]:
    without it the elbow falls where gravity compensation is wrong."""
    length_scale: Annotated[float, Range(1e-2, 10.0, "m/rad")] = 0.15
    """Length L that weighs rotation rows in the task inertia [m/rad]."""
    s0: Annotated[float, Range(1e-6, 10.0, "1/kg")] = 0.005
    """Task inertia eigenvalue below which a direction fades out [1/kg]. With rotor
    inertia in the model the tool-down home pose has 0.0145: 0.02 would fade there."""
    joint_stiffness: Annotated[float, Range(0.0, 1e4, "1/s2")] = 100.0
    """Stiffness K of joint targets [1/s2], each joint alone; 0.2 s to settle."""
    joint_damping_ratio: Annotated[float, Range(0.0, 10.0, "1")] = 1.0
    """Damping ratio zeta of joint targets [1]; D = 2 zeta sqrt(K)."""
    use_jdot: bool = False
    """Subtract dJ dq from f*; off as in the paper."""
    use_coriolis: bool = False
    """Add the Coriolis torque to the command; off as in the paper."""

    def __post_init__(self) -> None:
        check_ranges(self)

    @classmethod
    def for_period(cls, period: float, **overrides: Any) -> Self:
        """Return the law for a control period [s]: softer rotations at 5 ms."""
        k = float(np.interp(check_period(period), _PERIODS, _K_ROTATION))
        settings: dict[str, Any] = {"stiffness": [400.0] * 3 + [k] * 3}
        return cls(**(settings | overrides))

    def params(self) -> "_core.OscParams":
        """Copy into the C++ parameter struct."""
        from dovetail import _core

        params = _core.OscParams()
        for f in fields(self):
            setattr(params, f.name, vars(self)[f.name])
        return params


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitConfig:
    """Every limit of the motion; each one is enforced in C++ and has a flag."""

    q_min: Annotated[Vec7, Range(-10.0, 10.0, "rad", JOINTS)]
    """Lower joint limits [rad]."""
    q_max: Annotated[Vec7, Range(-10.0, 10.0, "rad", JOINTS)]
    """Upper joint limits [rad]."""
    dq_max: Annotated[Vec7, Range(1e-3, 20.0, "rad/s", JOINTS)]
    """Joint speed limits [rad/s]."""
    tau_max: Annotated[Vec7, Range(1e-2, 1e4, "Nm", JOINTS)]
    """Motor torque limits [Nm], gravity included."""
    ddq_max: Annotated[Vec7, Range(1e-2, 1e3, "rad/s2", JOINTS)]
    """Joint acceleration A that the motors can always give [rad/s2]."""
    eta: Annotated[float, Range(0.05, 1.0, "1")] = 0.6
    """Share of ddq_max planned for braking [1]; the rest covers model error."""
    kappa: Annotated[float, Range(1.0, 50.0, "1")] = 5.0
    """Interval of the bounds over the period [1]; larger chatters less."""
    delta_q: Annotated[float, Range(0.0, 0.5, "rad")] = 0.002
    """Margin before a joint limit [rad]."""
    delta_v: Annotated[float, Range(0.0, 0.9, "1")] = 0.01
    """Margin below the joint speed limit, as a share of it [1]."""
    walls: bool = True
    """Whether Cartesian limits on the TCP are enforced, near_speed and
    near_press included."""
    x_min: Annotated[Vec3, Range(-10.0, 10.0, "m", _XYZ)]
    """Lower walls of the TCP in the world [m]."""
    x_max: Annotated[Vec3, Range(-10.0, 10.0, "m", _XYZ)]
    """Upper walls of the TCP in the world [m]."""
    dx_max: Annotated[Vec3, Range(1e-3, 10.0, "m/s", _XYZ)] = field(
        default_factory=_all(3, 0.5)
    )
    """TCP speed limit per axis [m/s]."""
    near_speed: Annotated[float, Range(1e-4, 10.0, "m/s")] = 0.5
    """TCP speed limit per axis below a Target's near plane [m/s]: contact at this
    speed is what the tool must bear. It holds for force, pose and hold axes with walls
    on; not on a free axis, nor for a joint target."""
    near_press: Annotated[float, Range(1e-3, 1e3, "m/s2")] = 1e3
    """Largest f* there against the plane's normal, a Target's tare not counted [m/s2]:
    times the effective mass, about 10 kg, it is the force of standing on a rim. It
    acts from 2 mm above the plane on, more and more, and whole below it."""
    ddx_max: Annotated[Vec3, Range(1e-2, 1e3, "m/s2", _XYZ)] = field(
        default_factory=_all(3, 5.0)
    )
    """TCP acceleration limit per axis [m/s2]."""
    eta_wall: Annotated[float, Range(0.05, 1.0, "1")] = 0.5
    """Share of ddx_max planned for braking before a wall [1]."""
    delta_x: Annotated[float, Range(0.0, 0.2, "m")] = 0.005
    """Margin before a wall [m]."""
    s0_wall: Annotated[float, Range(1e-9, 10.0, "1/kg")] = 1e-3
    """Wall mobility below which SCS fades a wall out [1/kg]."""
    rho: Annotated[float, Range(1.0, 1e9, "1")] = 1e6
    """Weight of the wall slack in the QP [1]: walls yield to joints only, but once the
    last line has ended the motion to what holds the tool."""
    delay: Annotated[float, _DECLARED_RANGES["delay"]] = 0.0
    """Largest delay between a measurement and the torque it leads to, the control
    period not counted [s]: margins, intervals and rates are made for it."""
    mass_error: Annotated[float, _DECLARED_RANGES["mass_error"]] = 0.0
    """Largest error of a link's mass, as a share [1]; margins are made for it."""
    payload_error: Annotated[float, _DECLARED_RANGES["payload_error"]] = 0.0
    """Largest error of the payload's mass [kg]; margins are made for it."""
    estimate_rate: Annotated[float, Range(0.0, 1e3, "1/s")] = 60.0
    """Bandwidth of the disturbance estimate [1/s]; 0 is off. A loop with a delay bears
    about 0.9 over delay and period."""
    passive: bool = True
    """Limiters only brake against what the estimate says. Off, a contact is a feedback
    that grows; it can be off to show that."""
    brake_rate: Annotated[float, Range(0.0, 1e3, "1/s")] = 60.0
    """Rate of that braking [1/s]."""
    last_line: bool = True
    """End a motion that no Target explains: an oscillation, a limiter that drives, a
    joint beyond its speed limit. Off only to show what it ends."""
    authority: Annotated[float, Range(1.0, 100.0, "1")] = 4.0
    """Most braking beyond a limit, over ddq_max and ddx_max [1]."""
    damping: Annotated[Vec7, Range(0.0, 100.0, "Nms/rad", JOINTS)] = field(
        default_factory=_all(7, 0.0)
    )
    """Joint damping that the prediction assumes [Nms/rad]."""
    armature: Annotated[Vec7, Range(0.0, 100.0, "kg m2", JOINTS)] = field(
        default_factory=_all(7, 0.0)
    )
    """Rotor inertia that the prediction assumes [kg m2]."""
    mid_interval: bool = True
    """Evaluate the model half a period ahead; five times less prediction error."""
    exact_sjs: bool = False
    """Paper scheme: continue SJS with an active set to the QP's answer."""
    scheme: str = "qp"
    """Saturation scheme: qp (default) or paper (SCS then SJS, corrected)."""
    bounds: str = "viability"
    """Bound formula: viability (default), paper-corrected or paper-printed."""

    def __post_init__(self) -> None:
        check_ranges(self)
        pairs = (
            ("q", JOINTS, "rad", 2 * self.delta_q),
            ("x", _XYZ, "m", 2 * self.delta_x),
        )
        for name, labels, unit, room in pairs:
            low, high = vars(self)[f"{name}_min"], vars(self)[f"{name}_max"]
            for i, label in enumerate(labels):
                if high[i] - low[i] <= room:
                    raise ConfigError(
                        f"{name}_min[{label}] is {low[i]:g} {unit} and "
                        f"{name}_max[{label}] is {high[i]:g} {unit}: the range must be "
                        f"wider than {room:g} {unit}"
                    )
        for name, known in (("scheme", SCHEMES), ("bounds", BOUNDS)):
            if (word := vars(self)[name]) not in known:
                raise ConfigError(f"unknown {name} {word!r}; known: {', '.join(known)}")

    @classmethod
    def for_period(
        cls, robot: "Robot", period: float, *, hardware: bool = True, **overrides: Any
    ) -> Self:
        """Return the limits of a robot at a control period, as measured to hold.

        Between tabulated periods the margins of the longer one are used. Damping and
        armature default to the robot's.

        Args:
            robot: Its limits, and its payload for ddq_max.
            period: Control period [s], 0.1 to 5 ms.
            hardware: An arm with what `proven.DECLARED` says in delay and errors, and
                pushes of 30 N; without, one that is exactly as its model.
            **overrides: Any field, for example x_min and x_max. A delay or an error
                that is declared here changes the margins.

        Raises:
            ConfigError: Period out of range, or the payload leaves too little torque.
        """
        check_period(period)
        row = int(np.searchsorted(_PERIODS, period * (1 - 1e-9)))
        interval = max(5 * period if row == 0 else 0.0, 2 * period)
        if row:
            interval = float(np.interp(period, _PERIODS, _INTERVAL))
        given = {
            name: overrides.get(name, value if hardware else 0.0)
            for name, value in DECLARED.items()
        }
        declared: dict[str, float] = {
            name: in_range(name, given[name], _DECLARED_RANGES[name])
            for name in DECLARED
        }
        lag = declared["delay"] + period
        rate = min(_RATE_MAX, _RATE_RATIO / lag)
        share = max(declared[name] / value for name, value in DECLARED.items())
        if share > 0.0:
            interval = max(interval, _INTERVAL_RATIO * lag)

        def margin(exact: tuple[float, ...], all_wrong: tuple[float, ...]) -> float:
            return exact[row] + min(share, 2.0) * (all_wrong[row] - exact[row])

        settings: dict[str, Any] = {
            **declared,
            "estimate_rate": rate,
            "brake_rate": rate,
            "q_min": robot.limits.q_min,
            "q_max": robot.limits.q_max,
            "dq_max": robot.limits.dq_max,
            "tau_max": robot.limits.tau_max,
            "x_min": [0.40, -0.20, 0.02],
            "x_max": [0.80, 0.20, 0.40],
            "kappa": interval / period,
            "delta_q": margin(_DELTA_Q, _DELTA_Q_HARDWARE),
            "delta_v": margin(_DELTA_V, _DELTA_V_HARDWARE),
            "delta_x": margin(_DELTA_X, _DELTA_X_HARDWARE),
            "damping": robot.motors.damping,
            "armature": robot.motors.armature,
        } | overrides
        if "ddq_max" in settings:
            return cls(**settings)
        checked = cls(ddq_max=REFERENCE, **settings)
        ddq_max = available_acceleration(
            robot, checked.tau_max, checked.damping, checked.armature
        )
        return replace(checked, ddq_max=ddq_max)

    def params(self) -> "_core.LimitParams":
        """Copy into the C++ parameter struct."""
        from dovetail import _core

        params = _core.LimitParams()
        for f in fields(self):
            if f.name not in ("scheme", "bounds", *DECLARED):
                setattr(params, f.name, vars(self)[f.name])
        params.scheme = _core.Scheme(SCHEMES.index(self.scheme))
        params.bounds = _core.BoundsKind(BOUNDS.index(self.bounds))
        return params
