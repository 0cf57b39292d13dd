"""The delay of the arm that is recorded, measured as the doctor measures it."""

from typing import NamedTuple

from dovetail.arms.local_arm import LocalArm
from dovetail.doctor.check import Check
from dovetail.doctor.diagnosis import diagnose_arm
from dovetail.doctor.excitation import excitation_gains, simulated_step
from dovetail.doctor.loop_delay import check_delay
from dovetail.envs.contact_env import ContactEnv
from dovetail.poses import Pose
from dovetail.types import Vec7


class MeasuredDelay(NamedTuple):
    """Measured delay of the arm that is recorded."""

    facts: dict[str, float]
    """Measured, its standard deviation, and declared [s]; `recording.json` keeps it."""
    check: Check
    """Comparison with the declared delay, in words."""


def measure_delay(env: ContactEnv, q: Vec7, fixture: Pose) -> MeasuredDelay:
    """Push every joint a little at a start.

    A simulated arm of this process is measured with gains that bear any delay. Another
    one has a motion of its own for each controller, and is measured with the gains of
    the recording.

    Args:
        env: Its arm is moved.
        q: A start in free air [rad].
        fixture: Pose of the fixture.

    Raises:
        ArmError: The arm was stopped, or too many cycles were lost.
    """
    arm, facts = env.arm, env.arm.facts
    declared = float(facts.limits.delay)
    if isinstance(arm, LocalArm):
        osc, limits = excitation_gains(facts.osc, facts.limits)
        arm = LocalArm(arm.plant, facts.robot, osc, limits, facts.task, facts.period)
    arm.reset(q, fixture)
    step = simulated_step(facts.period) if env.places_fixture else 0.0
    found = diagnose_arm(arm, q, integration_step=step)
    delay = found.delay
    told = {"measured": delay.delay, "spread": delay.spread, "declared": declared}
    return MeasuredDelay(told, check_delay(delay, found.turned, declared))
