"""Your own task in one file: put a ring over a post that stands on the table."""

import argparse
import math
from dataclasses import dataclass
from typing import ClassVar

import gymnasium as gym
import numpy as np

from dovetail import (
    TOOL_DOWN,
    ArmState,
    FixturePose,
    Goal,
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
    turned_box,
    wsg50,
)

POST_RADIUS, POST_HEIGHT = 0.010, 0.100  # m
RING_WIDTH, RING_HEIGHT, RING_SIDES = 0.008, 0.010, 8  # m, m
STALK = 0.060  # m, from the ring up into the gripper
DENSITY = 2700.0  # kg/m3, aluminium
DEEP = 0.030  # m over the post's end that count as done


@dataclass(frozen=True, kw_only=True)
class RingOverPost(Task):
    """A ring on a stalk is put over a post that stands on the table."""

    axes: str = "XYZ:force ABC:hold"
    clearance: float = 0.003
    """Gap between ring and post on each side [m]."""

    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("near", 0.55, -0.04, 0.10, 0.0),
        FixturePose("far", 0.65, 0.04, 0.10, 0.0),
    )

    def held(self) -> Part:
        """Return the ring on its stalk; the TCP is in the middle of its lower face."""
        inner = POST_RADIUS + self.clearance
        middle = np.array([inner + RING_WIDTH / 2, 0.0, -RING_HEIGHT / 2])
        half_side = (inner + RING_WIDTH) * math.tan(math.pi / RING_SIDES)
        size = (RING_WIDTH / 2, half_side, RING_HEIGHT / 2)
        mass = DENSITY * 8.0 * math.prod(size)
        ring = [
            turned_box(f"ring_{i}", size, middle, 2.0 * math.pi * i / RING_SIDES)
            for i in range(RING_SIDES)
        ]
        bar = (inner + RING_WIDTH, 0.004, 0.004)
        stalk = (0.015, 0.004, STALK / 2)
        above = -RING_HEIGHT - DEEP  # the post needs this room under the bar
        return Part(
            "ring",
            (
                *(side._replace(mass=mass) for side in ring),
                *(
                    Primitive(
                        f"leg_{i}",
                        "box",
                        (0.003, 0.004, DEEP / 2),
                        np.array([x, 0.0, -RING_HEIGHT - DEEP / 2]),
                        mass=0.01,
                    )
                    for i, x in enumerate((-inner - 0.005, inner + 0.005))
                ),
                Primitive(
                    "bar", "box", bar, np.array([0, 0, above - 0.004]), mass=0.02
                ),
                Primitive(
                    "stalk",
                    "box",
                    stalk,
                    np.array([0, 0, above - 0.008 - STALK / 2]),
                    mass=0.03,
                ),
            ),
        )

    def tool(self) -> Tool:
        """Return a gripper that holds the stalk."""
        reach = RING_HEIGHT + DEEP + 0.008 + STALK
        return wsg50(opening=0.030, reach=reach, length=0.220)

    def fixture(self, widened: float) -> Part:
        """Return the post; its frame is in the middle of its upper end."""
        size = (POST_RADIUS - widened, POST_HEIGHT / 2)
        middle = np.array([0.0, 0.0, -POST_HEIGHT / 2])
        return Part("post", (Primitive("post", "cylinder", size, middle),))

    def heights(self) -> tuple[float, ...]:
        """Return where the ring goes, over the post's end [m]."""
        return 0.0, -DEEP

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw where the post stands."""
        x, y = rng.uniform((0.55, -0.05), (0.65, 0.05))
        return Pose(np.array([x, y, POST_HEIGHT]), quat_about_z(0.0))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw where the ring starts, over the post."""
        offset = rng.uniform((-0.03, -0.03, 0.01), (0.03, 0.03, 0.06))
        return Pose(fixture.position + offset, TOOL_DOWN)

    def goal(self, fixture: Pose) -> Goal:
        """Return the tool's pose with the ring at the right depth."""
        up = np.array([0.0, 0.0, 1.0])
        quat = quat_multiply(fixture.quat_wxyz, TOOL_DOWN)
        top = float(fixture.position[2])
        return Goal(fixture.position - (DEEP + 0.002) * up, quat, up, top)

    def judge(self, error: Vec3, goal: Goal, state: ArmState) -> Progress:
        """Return how deep the post is in the ring."""
        depth = DEEP + 0.002 - float(error[2])
        is_over = math.hypot(error[0], error[1]) < 2.0 * self.clearance
        return Progress(depth, depth >= DEEP and is_over)


register_task("RingOverPost-v0", RingOverPost)


def main() -> None:
    """Lead the ring over the post by hand-written actions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one episode only")
    episodes = 1 if parser.parse_args().quick else 10
    env = gym.make("RingOverPost-v0")
    print(f"actions move {' '.join(env.unwrapped.commands.axes)}")
    done = 0
    for seed in range(episodes):
        _, info = env.reset(seed=seed)
        ended = cut = False
        while not (ended or cut):
            x, y, z = info["position_error"]
            is_over = math.hypot(x, y) < 0.001
            down = -0.3 if is_over or z > DEEP + 0.012 else 0.3
            action = np.clip([-20.0 * x, -20.0 * y, down], -1.0, 1.0)
            _, _, ended, cut, info = env.step(action.astype(np.float32))
        done += bool(info["success"])
        print(f"episode {seed}: the post is {1e3 * info['depth']:.1f} mm in the ring")
    env.close()
    print(f"the ring is over the post in {done} of {episodes} episodes")


if __name__ == "__main__":
    main()
