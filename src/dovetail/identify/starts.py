"""Starts of the scripted motions: in free air, off the walls and the fixture."""

from typing import NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.task import Task, axis_of
from dovetail.types import Vec3, Vec7
from dovetail.workcell.workcell import Workcell

FREE_AIR = 0.08
"""Distance of the nearest start from the fixture [m]; motions go 0.05 m towards it."""
BEHIND = 0.15
"""Least distance of the nearest start from the wall behind the fixture [m]."""
BEFORE = 0.08
"""Least distance of the nearest start from the wall that the fixture faces [m]."""
THICKNESS = 0.04
"""Extent of the starts along the fixture's z [m]."""
ASIDE = (0.12, 0.11, 0.11)
"""Distance of the starts from the walls beside [m], along x y z, and not more than the
next share of what is between the walls."""
ASIDE_SHARE = 0.3
ELBOW = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
"""Joints that turn the elbow about the line from shoulder to wrist [1]."""


class StartBox(NamedTuple):
    """Box of the TCP's starts, world axes [m]."""

    low: Vec3
    high: Vec3


def start_box(cell: Workcell, fixture: Pose, *, may_touch: bool = False) -> StartBox:
    """Return where the starts are: before the fixture, along its z, within the walls.

    Args:
        cell: Its walls and fixture.
        fixture: Where the fixture is.
        may_touch: The motions may touch the fixture.

    Raises:
        ConfigError: The walls leave too little free air before the fixture.
    """
    out = axis_of(fixture)
    along = int(np.abs(out).argmax())
    sign = 1.0 if out[along] > 0.0 else -1.0
    low, high = (np.array(side, dtype=float) for side in cell.walls)
    aside = np.minimum(ASIDE, ASIDE_SHARE * (high - low))
    box_low, box_high = (low + aside).round(6), (high - aside).round(6)
    behind, wall = (low, high) if sign > 0.0 else (high, low)
    proud = max(0.0, round(float(cell.fixture.corners[:, 2].max()), 6))
    face = sign * float(fixture.position[along]) + proud
    nearest = round(sign * float(behind[along]) + BEHIND, 6)
    begin = max(nearest, face + FREE_AIR)
    if begin > round(sign * float(wall[along]) - BEFORE, 6):
        if not may_touch:
            where = ("xyz"[along], sign, face, proud)
            raise ConfigError(_too_near(cell, *where, wall[along]))
        begin = nearest
    ends = sorted((sign * begin, sign * (begin + THICKNESS)))
    box_low[along], box_high[along] = ends
    return StartBox(box_low, box_high)


def _too_near(
    cell: Workcell, axis: str, sign: float, face: float, proud: float, wall: float
) -> str:
    """Say that a fixture is too near the wall, and where it may be."""
    most = wall - sign * (FREE_AIR + BEFORE + proud)
    name = cell.fixture.name
    return (
        f"the {name} ends at {axis} = {sign * face:g} m: the motions need "
        f"{FREE_AIR:g} m of free air before it, and the wall is at {axis} = {wall:g} "
        f"m; put it at {axis} = {most:g} m or {'lower' if sign > 0.0 else 'higher'}, "
        "or give --allow-contact"
    )


def plan_starts(
    task: Task, robot: Robot, seed: int, count: int, place: FixturePose, box: StartBox
) -> list[Vec7]:
    """Return a start for each sequence: the tool as at the goal, in free air [rad].

    Tool position, rotation about the vertical and elbow differ from one to the next,
    so that gravity acts on the joints from different sides.

    Args:
        task: Its goal says how the tool points.
        robot: The arm, tool included.
        seed: Seed of the recording.
        count: Number of starts.
        place: Where the fixture is.
        box: Where the TCP starts.

    Raises:
        ConfigError: The arm does not reach a start.
    """
    starts = []
    for number in range(count):
        rng = np.random.default_rng([seed, number, 1])
        position = rng.uniform(*box)
        turn = place.theta + rng.uniform(-0.15, 0.15)
        goal = task.goal(place._replace(theta=turn).pose())
        swivel = rng.uniform(-1.0, 1.0)
        q_seed = robot.posture(task.posture) + swivel * ELBOW
        if task.posture == "down":  # joint 7 turns the tool about the vertical
            q_seed[6] = -turn
        pose = Pose(position, goal.quat_wxyz)
        starts.append(robot.inverse_kinematics(pose, q_seed))
    return starts
