"""Let a camera on the flange see the fixture, before the arm goes to its start."""

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.control.period import POLICY_PERIOD
from dovetail.errors import TrackerError
from dovetail.poses import Pose
from dovetail.tasks.task import Task
from dovetail.trackers.tracker import Tracker, is_on_arm
from dovetail.types import Vec7
from dovetail.workcell.workcell import Walls

LOOKOUT = 0.18
"""Height of the tool over the fixture from which is looked [m]; less where the arm's
highest wall is lower."""
_SETTLE = 0.3
"""Time at rest before a picture counts [s]."""
_PATIENCE = 3.0
"""Longest wait for such a picture [s]."""


def look_from_above(
    tracker: Tracker, arm: Arm, task: Task, fixture: Pose, walls: Walls
) -> None:
    """Go to above the fixture and look, where the tracker's camera is on the arm.

    From the start the tool may hide the board, or the camera be too near. A real arm
    goes there as to a start, slowly. Where nothing is seen the tracker says so later.

    Args:
        tracker: It was reset; if it is not on the arm, nothing happens.
        arm: It goes to above the fixture, and is reset to its start afterwards.
        task: Which way the tool is turned.
        fixture: Where it is said to be, to some centimetres.
        walls: Lower and upper walls of the TCP [m].

    Raises:
        TrackerError: There are no pictures; the arm is stopped.
        ArmError: The arm does not arrive.
    """
    if not is_on_arm(tracker):
        return
    q = pre_grasp_view(arm, task, fixture, walls)
    arm.reset(q, fixture)
    target = _core.Target(joint_mode=True, q_d=q)
    try:
        for _ in range(round(_PATIENCE / POLICY_PERIOD)):
            state = arm.step(target, POLICY_PERIOD)
            tracker.update(fixture, state)
            if _has_seen(tracker, state):
                break
        tracker.rewind(fixture)
    except Exception:
        arm.stop()
        raise


def pre_grasp_view(arm: Arm, task: Task, fixture: Pose, walls: Walls) -> Vec7:
    """Return the configuration [rad] from which is looked."""
    facts, goal = arm.facts, task.goal(fixture)
    low, high = (np.array(wall) for wall in walls)
    margin = 2.0 * facts.limits.delta_x
    above = fixture.position + LOOKOUT * goal.normal
    position = np.clip(above, low + margin, high - margin)
    return facts.robot.inverse_kinematics(
        Pose(position, goal.quat_wxyz), facts.robot.posture(task.posture)
    )


def _has_seen(tracker: Tracker, state: ArmState) -> bool:
    """Say whether the newest picture with the fixture is of the arm at rest."""
    try:
        return state.stamp - tracker.estimate().age >= _SETTLE
    except TrackerError:
        return False
