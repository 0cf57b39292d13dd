"""Checks of an arm's noise, delay, springs and missed load.

The sentences of the doctor about what `dovetail.feel` measures.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.control.proven import unproven
from dovetail.doctor import Check
from dovetail.feel.declared_delay import judge_delay
from dovetail.feel.declared_gravity import allowed_gravity_error
from dovetail.feel.feeling import Feeling
from dovetail.feel.missed_load import MissedLoad, explain_by_load
from dovetail.feel.resting import Resting
from dovetail.feel.torque_balance import JointFit
from dovetail.robots.robot import Robot
from dovetail.types import JOINTS, Array, Vec3, Vec7

SPRING_MIN = 10.0
"""Stiffness that counts as one of the cabinet's [Nm/rad]."""
FIXED_MIN = 100.0
"""The same to a fixed position, where friction is mistaken for some [Nm/rad]."""
EXPLAINED = 0.9
"""Share of a gravity error from which a load may be its cause, and is named [1]."""
CERTAIN = 0.995
"""The same from which it is its cause, also inside the declared range [1]: links that
are all too heavy look like a load, but of random arms inside that range at most 2 in
100 so exactly like one of more than 1 kg."""
FRICTION, FRICTION_MAX = 0.5, 6.0
"""Viscous friction of a joint that is taken for its own, and the most that may be its
own, dry friction mistaken for some included [Nms/rad]."""
SENT_RATE = 2.0 * np.pi * 20.0
"""Of the filter between measured and sent position [1/s]; `ServoParams`."""
EXACT = 0.15
"""Share within which a stiffness is said to be known [1]."""
NOTHING = 0.3
"""Gravity error of every joint below which none is explained [Nm]."""
LIGHTEST, FARTHEST = 0.05, 0.5
"""Least mass [kg] and farthest centre of mass [m] of a load that is believed."""
_SPREADS, _SURE = 5.0, 3.0
_UNEXPLAINED = (
    "check the mounting's inclination, and identify the arm (dovetail identify); the "
    "limits are unproven for it, with a tare, too"
)


def check_rest(
    resting: Resting, name: str = "rest", torque_max: float = np.inf
) -> Check:
    """Say how quiet the arm was while it was held.

    Args:
        resting: What was measured.
        name: The check's.
        torque_max: Noise of a joint's torque that is allowed [Nm RMS]; the controller
            that feels an arm is not the one that tasks run with.
    """
    joint = JOINTS[resting.joint]
    loudest = float(resting.torque[resting.joint])
    detail = describe_rest(resting)
    if resting.is_oscillating:
        return Check(
            name,
            "broken",
            f"{detail}: {joint} oscillates at {resting.frequency:.0f} Hz with "
            f"{loudest:.1f} Nm RMS, {resting.growth:.1f} times as much at the end as "
            "at first. The loop is later than its controller bears, or a gain is too "
            "high: do not run this arm with these settings",
        )
    if loudest > torque_max:
        return Check(
            name,
            "broken",
            f"{detail}: {joint} has {loudest:.1f} Nm, allowed are {torque_max:g}: the "
            "encoder's noise reaches the torque: run it at a longer period, or with a "
            "slower estimate (a longer declared delay)",
        )
    return Check(name, "ok", detail)


def describe_rest(resting: Resting) -> str:
    """Return the noise of torque and position in words."""
    return (
        f"torque {_sizes(resting.torque)} Nm RMS, position "
        f"{1e3 * float(resting.motion.max()):.3f} mrad RMS"
    )


def check_delay(feeling: Feeling, declared: dict[str, float]) -> Check:
    """Compare the measured delay with the declared one."""
    said = judge_delay(feeling, declared["delay"])
    return Check("delay", "ok" if said.is_within else "broken", said.text)


def check_spring(
    fits: tuple[JointFit, ...], feeling: Feeling, inertia: Array, period: float
) -> Check:
    """Say whether the cabinet's impedance is on, by how it takes being leaned on.

    Args:
        fits: Torque balances of the joints while they were leaned on.
        feeling: What they were before, pushed farther.
        inertia: The model's inertia with rotors [kg m2], shape (7, 7).
        period: Control period [s].
    """
    name = "cabinet's spring"
    spring = np.array([fit.sent_spring for fit in fits])
    spread = np.array([fit.spread_of("sent_spring") for fit in fits])
    detail = f"{_list(spring, 0)} Nm/rad"
    is_felt = (spring > SPRING_MIN) & (spring > _SPREADS * spread)
    if not is_felt.any():
        return Check(name, "ok", f"none: {detail}")
    lag = 1.0 / SENT_RATE + feeling.delay.delay + 0.5 * period  # of a sent position
    damping = np.array([fit.damping for fit in feeling.fits]) - spring * lag
    critical = 2.0 * np.sqrt(np.maximum(spring, 0.0) * inertia.diagonal())

    def ratio(friction: float) -> float:
        """Weigh a joint by its critical damping: the heavy ones tell most."""
        return float((damping - friction) @ critical / (critical @ critical))

    said = "no damping is seen"
    if ratio(FRICTION_MAX) > 0.0:
        said = (
            f"it adds damping, too, a ratio of about {ratio(FRICTION):.1f}: set it to "
            "0 in the control mode of the Java application"
        )
    return Check(
        name,
        "broken",
        f"{detail}: the cabinet adds stiffness of {_stiffness(spring, spread, is_felt)}"
        f"{_where(is_felt)}: set it to 0; {said}",
    )


def _stiffness(spring: Array, spread: Array, is_felt: NDArray[np.bool_]) -> str:
    """Return the stiffness of the joints that feel one, or what it is at least."""
    about = float(np.median(spring[is_felt]))
    doubt = float(np.median(spread[is_felt])) / np.sqrt(np.count_nonzero(is_felt))
    sure = about - _SURE * doubt
    if sure > (1.0 - EXACT) * about:
        return f"about {_round(about):g} Nm/rad"
    return (
        f"at least {_round(sure):g} Nm/rad (dry friction, or answers that came late, "
        f"leave {_round(about - sure):g} Nm/rad open)"
    )


def check_fixed_spring(feeling: Feeling) -> Check | None:
    """Say whether something pulls joints back to where they were; None where not."""
    spring = np.array([fit.stiffness for fit in feeling.fits])
    spread = np.array([fit.spread_of("stiffness") for fit in feeling.fits])
    is_felt = (spring > FIXED_MIN) & (spring > _SPREADS * spread)
    if not is_felt.any():
        return None
    return Check(
        "spring",
        "broken",
        f"{_list(spring, 0)} Nm/rad: something pulls the arm back to where it stands "
        f"with about {_round(float(np.median(spring[is_felt]))):g} Nm/rad"
        f"{_where(is_felt)}: the cabinet's impedance (set its stiffness to 0), or a "
        "contact",
    )


def check_gravity_error(
    robot: Robot, q: Vec7, feeling: Feeling, declared: dict[str, float]
) -> Check:
    """Say what gravity compensation misses, and which load data would mend it."""
    error = np.array([fit.offset for fit in feeling.fits])
    spread = np.array([fit.spread_of("offset") for fit in feeling.fits])
    load = explain_by_load(robot, q, error, spread)
    detail = f"{_list(error)} Nm missed"
    if np.abs(error).max() > NOTHING:
        detail += f"; {_load_text(robot, load)}"
    allowed = allowed_gravity_error(robot, q, declared)
    worst = int(np.argmax(np.abs(error) / allowed))
    is_outside = abs(error[worst]) > allowed[worst]
    is_load = _is_plausible(robot, load)
    problems = unproven(payload_error=abs(load.mass), declared=declared)
    if problems and is_load and (is_outside or load.explained > CERTAIN):
        return Check("gravity error", "broken", f"{detail}: {problems[0]}")
    if is_outside:
        return Check(
            "gravity error",
            "broken",
            f"{detail}: at {JOINTS[worst]} that is {abs(error[worst]):.1f} Nm; inside "
            f"the declared range it is 0 to {allowed[worst]:.1f} Nm: "
            + ("correct the load data" if is_load else _UNEXPLAINED),
        )
    return Check("gravity error", "ok", detail)


def _load_text(robot: Robot, load: MissedLoad) -> str:
    """Name the load that explains a gravity error, if there is one."""
    if not _is_plausible(robot, load):
        return (
            "no load at the flange explains it: the masses of the arm's own links "
            "differ, or gravity's direction (the mounting's inclination). A tare takes "
            "it off before each try"
        )
    (mass, com), (whole, where) = _declared_load(robot), _total_load(robot, load)
    return (
        f"a load of {whole:.2f} kg at {_list(1e3 * where, 0)} mm from the flange would "
        f"explain {100 * load.explained:.0f} % of it, in place of {mass:.2f} kg at "
        f"{_list(1e3 * com, 0)} mm (one pose does not tell where it is along gravity)"
    )


def _is_plausible(robot: Robot, load: MissedLoad) -> bool:
    """Return True if a flange may carry the load and it explains most of the error."""
    whole, where = _total_load(robot, load)
    is_near = bool(np.linalg.norm(where) < FARTHEST)
    return load.explained > EXPLAINED and whole > LIGHTEST and is_near


def _declared_load(robot: Robot) -> tuple[float, Vec3]:
    payload = robot.payload
    return (0.0, np.zeros(3)) if payload is None else (payload.mass, payload.com)


def _total_load(robot: Robot, load: MissedLoad) -> tuple[float, Vec3]:
    return load.total(*_declared_load(robot))


def _where(is_felt: NDArray[np.bool_]) -> str:
    """Name the joints, where it is not all of them."""
    if is_felt.all():
        return ""
    names = [name for name, felt in zip(JOINTS, is_felt, strict=True) if felt]
    return f" at {', '.join(names)}"


def _round(value: float) -> float:
    """Return two digits, as no more is known."""
    return float(f"{value:.2g}")


def _sizes(values: Array) -> str:
    return " ".join(f"{value:.2f}" for value in values)


def _list(values: Any, digits: int = 1) -> str:
    return " ".join(f"{value:+.{digits}f}" for value in values)
