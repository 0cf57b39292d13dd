"""What does `state.wrench` of an environment say where nothing touches, and in contact?

Seeded starts over the block, with a tare and without: slow random motion in free air,
then a push down on the block by half of the range, beside the hole. The columns are the
wrench's z in free air (mean; largest), the largest part of x and y there, its z minus
the true contact force while it presses (mean; largest), and in how many of the starts
"more than 8 N" would have been said in free air.

    python benchmarks/tared_wrench.py
"""

import argparse
from typing import Any

import gymnasium as gym
import numpy as np

import dovetail  # noqa: F401  (registers the environments)
from dovetail.plants.plant import COLUMN
from dovetail.plants.twin import list_twins
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.types import Array

BLOCK = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
FREE, PRESSED = 30, 80
"""Policy steps of each part."""
TOUCHED = 8.0  # N


def play(env: Any, seed: int) -> tuple[Array, Array]:
    """Return the force in free air, and its error in z while pressed [N]."""
    rng = np.random.default_rng(seed)
    robot = env.unwrapped.arm.facts.robot
    offset = rng.uniform((0.028, -0.01, 0.02), (0.035, 0.01, 0.05))
    start = Pose(BLOCK.position + offset, tool_down(0.0))
    q = robot.inverse_kinematics(start, robot.posture("down"))
    env.reset(seed=seed, options={"fixture": BLOCK, "start": q})
    free, errors = [], []
    action = np.zeros(4, dtype=np.float32)
    for step in range(FREE + PRESSED):
        if step % 5 == 0:
            action = rng.uniform(-0.3, 0.3, 4).astype(np.float32)
            action[2] = abs(action[2])
        if step >= FREE:
            action = np.array([0.0, 0.0, -0.5, 0.0], dtype=np.float32)
        env.step(action)
        state = env.unwrapped.state
        true = state.log[-1, COLUMN["fz"]]
        if step < FREE:
            free.append(state.wrench[:3])
        elif step >= FREE + PRESSED - 10 and true > 0.0:
            errors.append(state.wrench[2] - true)
    return np.array(free), np.array(errors)


def row(twin: str, *, tare: bool, starts: int) -> str:
    """Return a line of the table."""
    place: dict[str, Any] = {} if twin == "none" else {"twin": twin}
    env = gym.make(
        "dovetail/PegInHole-v0", tare=tare, disable_env_checker=True, **place
    )
    played = [play(env, seed) for seed in range(starts)]
    env.close()
    free = np.array([one for one, _ in played])
    error = np.concatenate([errors for _, errors in played])
    touched = int((free[:, :, 2] > TOUCHED).any(axis=1).sum())
    z, side = free[:, :, 2], np.abs(free[:, :, :2]).max()
    pressed = "never in contact"
    if error.size:
        pressed = f"{error.mean():.1f}; {np.abs(error).max():.1f}"
    return (
        f"| {twin} | {'yes' if tare else 'no'} | {z.mean():.1f}; {np.abs(z).max():.1f} "
        f"| {side:.1f} | {pressed} | {touched} of {starts} |"
    )


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--twins", nargs="+", default=["none", *list_twins()])
    arguments = parser.parse_args()
    print(
        "| twin | tare | free air: z mean; largest [N] | x, y largest [N] | pressed: z "
        'minus contact, mean; largest [N] | "over 8 N" in free air |'
    )
    print("|---|---|---|---|---|---|")
    for twin in arguments.twins:
        for tare in (False, True):
            print(row(twin, tare=tare, starts=arguments.starts), flush=True)


if __name__ == "__main__":
    main()
