"""The delay of the arm that is recorded, measured as the doctor measures it."""

from typing import NamedTuple

from dovetail.arms.local_arm import LocalArm
from dovetail.envs.contact_env import ContactEnv
from dovetail.feel.declared_delay import JudgedDelay, judge_delay
from dovetail.feel.feeling import feel_arm
from dovetail.feel.gains import quiet, simulated_step
from dovetail.poses import Pose
from dovetail.types import Vec7


class MeasuredDelay(NamedTuple):
    """Measured delay of the arm that is recorded."""

    facts: dict[str, float]
    """Measured, its standard deviation, and declared [s]; `recording.json` keeps it."""
    judged: JudgedDelay
    """The same in words."""


def measure_delay(env: ContactEnv, q: Vec7, fixture: Pose) -> MeasuredDelay:
    """Push every joint a little at a start.

    A simulated arm of this process is felt with gains that bear any delay. Another one
    has a motion of its own for each controller, and is felt with the gains that the
    recording runs with.

    Args:
        env: Its arm is moved.
        q: A start in free air [rad].
        fixture: Where the fixture is.

    Raises:
        ArmError: The arm was stopped, or too many cycles were lost.
    """
    arm, facts = env.arm, env.arm.facts
    declared = float(facts.limits.delay)
    if isinstance(arm, LocalArm):
        osc, limits = quiet(facts.osc, facts.limits)
        arm = LocalArm(arm.plant, facts.robot, osc, limits, facts.task, facts.period)
    arm.reset(q, fixture)
    step = simulated_step(facts.period) if env.places_fixture else 0.0
    feeling = feel_arm(arm, q, facts.limits.armature, integration_step=step)
    delay = feeling.delay
    told = {"measured": delay.delay, "spread": delay.spread, "declared": declared}
    return MeasuredDelay(told, judge_delay(feeling, declared))
