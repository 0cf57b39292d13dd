"""A task with a part that moves: pull a drawer open by the hole in its handle."""

import argparse
import math
from dataclasses import dataclass
from typing import ClassVar

import gymnasium as gym
import numpy as np

from dovetail import (
    TOOL_DOWN,
    ArmState,
    Detent,
    FixturePose,
    Goal,
    Joint,
    Moving,
    Part,
    Pose,
    Primitive,
    Progress,
    Task,
    Tool,
    Vec3,
    quat_about_z,
    quat_multiply,
    register_task,
    wsg50,
)

BAR_RADIUS, BAR_LENGTH, BAR_MASS = 0.005, 0.060, 0.03  # m, m, kg
HALF, THICK = 0.060, 0.010  # m, half side and thickness of the handle's plate
DEEP, IN = 0.008, 0.004  # m below its surface: the goal, and what cannot be elsewhere
TRAVEL, OPEN = 0.050, 0.040  # m, to the stop, and what counts as open
X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class OpenDrawer(Task):
    """Put a bar into the hole of a drawer's handle, then pull the drawer open."""

    axes: str = "XYZ:force ABC:hold"
    clearance: float = 0.002
    """Gap between the bar and the handle's hole on each side [m]."""

    done_word: ClassVar[str] = "opened"
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("near", 0.56, -0.04, 0.10, -0.2),
        FixturePose("middle", 0.60, 0.04, 0.12, 0.1),
        FixturePose("far", 0.64, 0.0, 0.11, 0.2),
    )

    def held(self) -> Part:
        """Return the bar; the middle of its lower end is the TCP."""
        size, middle = (BAR_RADIUS, BAR_LENGTH / 2), -BAR_LENGTH / 2 * Z
        return Part("bar", (Primitive("bar", "cylinder", size, middle, mass=BAR_MASS),))

    def tool(self) -> Tool:
        """Return a gripper that holds the bar."""
        return wsg50(opening=2 * BAR_RADIUS, reach=BAR_LENGTH)

    def fixture(self, widened: float) -> Part:
        """Return the drawer; its frame is over the hole, and it opens towards -x."""
        hole = BAR_RADIUS + self.clearance + widened
        side, middle, z = (HALF - hole) / 2, (HALF + hole) / 2, THICK / 2
        plate = [
            Primitive(name, "box", (*size, z), np.array([*at, -z]), mass=0.1)
            for name, size, at in (
                ("front", (side, HALF), (-middle, 0.0)),
                ("back", (side, HALF), (middle, 0.0)),
                ("left", (hole, side), (0.0, middle)),
                ("right", (hole, side), (0.0, -middle)),
            )
        ]
        joint = Joint(
            name="drawer", kind="slide", axis=-X, range=(0.0, TRAVEL), friction=2.0,
            damping=5.0, detents=(Detent(0.0, 3.0, 0.004),),
        )  # fmt: skip
        chest = Primitive("chest", "box", (HALF, HALF, 0.005), -0.065 * Z)
        return Part("drawer", (chest,), (Moving(joint, tuple(plate)),))

    def heights(self) -> tuple[float, ...]:
        """Return where the bar's end goes, over the handle [m]."""
        return 0.0, -DEEP

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw where the drawer stands, and where it opens to."""
        x, y, z, yaw = rng.uniform((0.55, -0.05, 0.09, -0.3), (0.65, 0.05, 0.13, 0.3))
        return Pose(np.array([x, y, z]), quat_about_z(yaw))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw where the bar starts, over the handle."""
        offset = rng.uniform((-0.05, -0.05, 0.01), (0.05, 0.05, 0.06))
        return Pose(fixture.position + offset, TOOL_DOWN)

    def goal(self, fixture: Pose) -> Goal:
        """Return the tool's pose with the bar in the hole, the drawer closed."""
        quat = quat_multiply(fixture.quat_wxyz, TOOL_DOWN)
        return Goal(fixture.position - DEEP * Z, quat, Z, float(fixture.position[2]))

    def judge(self, error: Vec3, goal: Goal, state: ArmState) -> Progress:
        """Return how far the drawer is open: by its joint, or by the bar in it."""
        x, y, z = error.tolist()
        moved = math.hypot(x, y)
        is_in = z < DEEP - IN and moved < HALF - BAR_RADIUS  # the plate is elsewhere
        if state.parts.size:  # a simulation
            opened = float(state.parts[0])
        else:
            opened = moved - self.clearance if is_in else 0.0
        return Progress(opened, is_in and opened >= OPEN)

    def weigh(
        self, position_error: Vec3, theta_error: float, success: bool, force: float
    ) -> float:
        """Return the reward: the way that is left, into the hole and then along."""
        x, y, z = position_error.tolist()
        if z < DEEP - IN and math.hypot(x, y) < HALF:
            left = max(0.0, OPEN + x)  # drawers open towards -x, within 0.3 rad
        else:
            left = OPEN + math.hypot(x, y, z)
        return self.reward.bonus * success - left


register_task("OpenDrawer-v0", OpenDrawer)


def main() -> None:
    """Open the drawer by hand-written actions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one episode only")
    episodes = 1 if parser.parse_args().quick else 10
    env = gym.make("OpenDrawer-v0")
    print(f"actions move {' '.join(env.unwrapped.commands.axes)}")
    done = 0
    for seed in range(episodes):
        _, info = env.reset(seed=seed)
        ended = cut = False
        while not (ended or cut):
            x, y, z = info["position_error"]
            if z < DEEP - IN:  # in the hole
                action = np.array([-1.0, 0.0, -0.1])
            else:
                down = -0.3 if math.hypot(x, y) < 0.001 or z > 0.02 else 0.3
                action = np.clip([-20.0 * x, -20.0 * y, down], -1.0, 1.0)
            _, _, ended, cut, info = env.step(action.astype(np.float32))
        done += bool(info["success"])
        print(f"episode {seed}: the drawer is open by {1e3 * info['depth']:.1f} mm")
    env.close()
    print(f"the drawer is open in {done} of {episodes} episodes")


if __name__ == "__main__":
    main()
