"""Checks that an arm suits its task, and that the fixture is in its workspace."""

import math
from collections.abc import Sequence

import numpy as np

from dovetail.arms.arm import Arm
from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError, ReachError, TrackerError
from dovetail.poses import Pose, matrix_from_quat
from dovetail.tasks.region import Region
from dovetail.tasks.task import Task
from dovetail.trackers.tracker import Estimate
from dovetail.workcell.workcell import Workcell

_SIGMAS = 2.0
_HEIGHT = 0.020
"""Largest difference in height of a fixture from its given place [m]: it leaves room
for a hand measurement, and no part is that flat."""
_TILT = 0.15
"""Largest tilt of a fixture against its given normal [rad]."""
_DRAWS = 50
"""Fixtures that are drawn to see whether an arm can work where a training draws."""
_LEVEL = 1e-9  # of a normal's z, which is 1 where the tool points straight down
_ADVICE = (
    "is the board on another part, bent, or the camera moved? put the board round the "
    "opening, calibrate again, or say where the fixture is"
)


def require_inside(task: Task, cell: Workcell, arm: Arm, fixture: Pose) -> None:
    """Refuse a fixture where the arm's limits keep the tool from a place of the task.

    Args:
        task: Its places and slack.
        cell: Its walls and reach.
        arm: The arm, with its limits.
        fixture: The fixture's pose.

    Raises:
        ConfigError: Names the axis, by how much it lies outside, and what is allowed;
            or the joints that keep the tool from being turned to it.
    """
    cell.require_reachable(fixture)
    low, high = cell.walls
    margin = margin_of(task, arm)
    for place, point in task.places(fixture).items():
        for i, name in enumerate("xyz"):
            excess = max(low[i] - point[i], point[i] - high[i]) + margin
            if excess > 0.0:
                raise ConfigError(
                    f"the {cell.fixture.name}'s {place} has {name} = {point[i]:.4f} m, "
                    f"which is {excess:.4f} m outside the workspace; allowed: "
                    f"{low[i] + margin:g} to {high[i] - margin:g} m; move the "
                    f"{cell.fixture.name}{_margin_advice(margin)}"
                )
    _require_turnable(task, cell, arm, fixture)


def require_drawn(task: Task, cell: Workcell, arm: Arm) -> None:
    """Refuse an arm that cannot work at every fixture that a training would draw.

    It is tried at the trial poses, at the region's corners, and at some that are drawn.

    Args:
        task: Draws them.
        cell: The arm with its tool, and the region of fixtures, if it has one.
        arm: The arm, with its limits.

    Raises:
        ConfigError: Names the arm, the fixture, and how much it lacks.
    """
    poses = [place.pose() for place in task.trial_poses_in(cell)]
    given, usual = Region.of(cell), task.trial_region
    if (region := given or usual) is not None:
        poses += region.corners(task.trial_poses[0].facing)
    rng = np.random.default_rng(0)
    for _ in range(_DRAWS):
        drawn = task.draw_in(rng, given) if given else task.draw_fixture(rng)
        poses.append(drawn)
    for pose in poses:
        try:
            require_inside(task, cell, arm, pose)
        except ConfigError as error:
            raise ConfigError(
                f"{cell.robot.name} cannot work at every fixture of this task: "
                f"{error}; a cell file says where they stand: --cell FILE with "
                "fixture_low, fixture_high and fixture_yaw (docs/your-own-cell.md)",
                name="robot",
                value=cell.robot.name,
            ) from error


def _require_turnable(task: Task, cell: Workcell, arm: Arm, fixture: Pose) -> None:
    """Refuse a fixture to which the tool cannot be turned.

    Straight down the robot's reach says it all; a tilted or level tool may need more
    of a joint than there is.

    Raises:
        ConfigError: Names the joints that are at their limits.
    """
    goal, robot = task.goal(fixture), arm.facts.robot
    if goal.normal[2] > 1.0 - _LEVEL:
        return
    try:
        robot.inverse_kinematics(
            Pose(goal.position, goal.quat_wxyz), robot.posture(task.posture)
        )
    except ReachError as error:
        name, limits = cell.fixture.name, robot.limits
        held = " and ".join(
            f"A{i + 1} ({limits.q_min[i]:.2f} to {limits.q_max[i]:.2f} rad)"
            for i in error.joints
        )
        why = f"at the limit of joint {held}" if held else "with every joint"
        tilt = math.acos(float(np.clip(goal.normal[2], -1.0, 1.0)))
        raise ConfigError(
            f"the {name} at {np.round(fixture.position, 4).tolist()} m opens "
            f"{tilt:.3f} rad away from the vertical, and {why} the tool is still "
            f"{1e3 * error.position_error:.1f} mm and {error.rotation_error:.3f} rad "
            f"from its goal; turn the {name} less, or move it"
        ) from error


def margin_of(task: Task, arm: Arm) -> float:
    """Return the least distance of a task's places from the walls [m]."""
    return max(0.005, arm.facts.limits.delta_x - task.slack())


def require_plausible(
    task: Task, cell: Workcell, told: Pose, estimate: Estimate
) -> None:
    """Refuse a fixture that is seen where it cannot stand.

    A board on another part has the right markers. It is recognised by its height, its
    tilt, and the places where the tool would have to go. An estimate without a
    covariance was not seen, and is not judged.

    Args:
        task: Its places.
        cell: Its fixture and walls.
        told: Where the fixture is said to be: its height and its normal are taken.
        estimate: What was seen; twice its deviations are allowed on top.

    Raises:
        TrackerError: Names what is off, its value, what is allowed and what to do.
    """
    if estimate.covariance is None:
        return
    pose, doubt = estimate.pose, _SIGMAS * np.sqrt(np.diag(estimate.covariance))
    what = f"the {cell.fixture.name} is seen"
    height, reach = float(pose.position[2]), _HEIGHT + float(doubt[2])
    if abs(height - told.position[2]) > reach:
        low, high = told.position[2] - reach, told.position[2] + reach
        raise TrackerError(
            f"{what} at z = {height:.4f} m; allowed: {low:.4f} to {high:.4f} m, round "
            f"where it is said to be; {_ADVICE}"
        )
    normal, own = (matrix_from_quat(p.quat_wxyz)[:, 2] for p in (pose, told))
    tilt, most = (
        math.acos(float(np.clip(normal @ own, -1.0, 1.0))),
        _TILT + float(doubt[3:].max()),
    )
    if tilt > most:
        raise TrackerError(
            f"{what} tilted by {tilt:.3f} rad; allowed: up to {most:.3f} rad; {_ADVICE}"
        )
    low, high = (np.array(wall) for wall in cell.walls)
    for place, point in task.places(pose).items():
        outside = np.maximum(low - point, point - high) - doubt[:3]
        i = int(outside.argmax())
        if outside[i] > 0.0:
            raise TrackerError(
                f"{what} where its {place} has {'xyz'[i]} = {point[i]:.4f} m, outside "
                f"the workspace; allowed: {low[i]:g} to {high[i]:g} m; {_ADVICE}"
            )


def require_placed(
    task: Task, cell: Workcell, arm: Arm, *, is_fixed: bool | None = None
) -> None:
    """Refuse to draw a fixture's pose where nothing can put it there.

    Args:
        task: What is done.
        cell: Its fixture.
        arm: The arm.
        is_fixed: Whether every fixture that is drawn is the same; None asks the task.

    Raises:
        ConfigError: The arm cannot move the fixture.
    """
    is_fixed = task.has_fixed_fixture() if is_fixed is None else is_fixed
    if not (arm.facts.traits.places_fixture or is_fixed):
        raise ConfigError(
            f"the arm cannot move the {cell.fixture.name}: say where it is, with "
            "--fixed-goal --fixture X Y Z YAW [m, rad] or "
            "reset(options={'fixture': Pose})"
        )


def require_axes(arm: Arm, axes: TaskSpec) -> None:
    """Refuse an arm that was built for other axes.

    Raises:
        ConfigError: Names both.
    """
    own = arm.facts.task
    if own != axes:
        raise ConfigError(
            f"the arm's task is '{own}', the environment's is '{axes}'; give both the "
            "same"
        )


def shown_columns(own: Sequence[str], without: Sequence[str]) -> tuple[str, ...]:
    """Return the column groups of a task that a policy sees.

    Args:
        own: Those of the task.
        without: Those that are left out.

    Raises:
        ConfigError: The task does not have one that is left out.
    """
    if unknown := [name for name in without if name not in own]:
        raise ConfigError(
            f"without = {', '.join(unknown)}: the task shows no such columns; it shows "
            f"{', '.join(own)}",
            name="without",
        )
    return tuple(name for name in own if name not in without)


def require_columns(arm: Arm, columns: Sequence[str]) -> None:
    """Refuse columns of the observation that the arm does not measure.

    Raises:
        ConfigError: The force of contact, on an arm that has none, or the wrench, where
            its estimate is off.
    """
    if "wrench" in columns and arm.facts.limits.estimate_rate == 0.0:
        raise ConfigError(
            "the task's column 'wrench' is what the disturbance estimate says, and the "
            "limits' estimate_rate is 0 1/s, which is off: give it above 0, as 60"
        )
    if "force" in columns and not arm.facts.traits.measures_contact:
        raise ConfigError(
            "the task's column 'force' is the force of contact, which this arm does "
            "not measure: train and run without it"
        )
    if "parts" in columns and not arm.facts.traits.is_simulated:
        raise ConfigError(
            "the column group 'parts' is where the joints of parts are, which only a "
            "simulation of this process knows: train and run without it"
        )


def _margin_advice(margin: float) -> str:
    """Say what narrows the margin [m] that hardware needs at long periods."""
    if margin < 0.01:
        return ""
    return (
        f", or narrow the limits' margin of {1e3 * margin:g} mm: a control period of 1 "
        "or 2 ms, or margins=model in the address of a simulated arm behind fri:// or "
        "grpc://"
    )
