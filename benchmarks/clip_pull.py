"""Pull at components that policies clipped on a rail: does a pull take them off?

Plays tries in the task's own simulation, or on a twin. After each success the arm goes
limp in the plane of the motion, so that the rail alone holds the component, and its
middle is pulled off the rail for a second. It came off where its face is more than
1.5 mm in front of the rail: hook and latch have a play of 0.8 and 0.1 mm.

    python benchmarks/clip_pull.py POLICY [--twin medium] [--pull 20] [--tries 60]
"""

import argparse

import numpy as np

from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.unwrapped import require_contact_env
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import make_policy_env
from dovetail.plants.plant import Plant
from dovetail.poses import rotation_error

FIRST = 50_000
"""Seed of the first try."""
OFF = 0.0015
"""Distance of its face from the rail's front at which a component is off [m]."""


def pull(core: ContactEnv, plant: Plant, force: float) -> tuple[float, float]:
    """Pull the held part out of the fixture with a force [N], for a second.

    Its arm is limp in the plane of the motion: neither the force nor a moment about
    the vertical is the arm's to hold.

    Returns:
        What the fixture bears [N], and how far out the TCP is of the goal [m].
    """
    goal, period = core.task.goal(core.fixture), core.config.period
    chain = plant.robot.chain()
    begin = plant.robot.tool_pose(plant.read()[0])
    for _ in range(round(1.0 / period)):
        q, dq = plant.read()
        J, pose = chain.jacobian(q), plant.robot.tool_pose(q)
        turn = 80.0 * rotation_error(begin.quat_wxyz, pose.quat_wxyz)
        wrench = np.append(force * goal.normal, [turn[0], turn[1], 0.0])
        wrench[2] += 4000.0 * (begin.position[2] - pose.position[2])
        damping = np.array([150.0] * 3 + [4.0] * 3) * (J @ dq)
        plant.apply(J.T @ (wrench - damping) - 0.5 * dq, period)
    out = plant.tool_pose().position - goal.position
    return -float(plant.contact_force() @ goal.normal), float(out @ goal.normal)


def main() -> None:
    """Count the tries that succeed, and those that bear the pull."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy")
    parser.add_argument("--twin")
    parser.add_argument("--pull", type=float, default=20.0, help="[N]")
    parser.add_argument("--tries", type=int, default=60)
    given = parser.parse_args()
    policy = Policy.load(find_policy(given.policy))
    env = make_policy_env(policy, twin=given.twin)
    core = require_contact_env(env)
    on, held = 0, 0
    for seed in range(FIRST, FIRST + given.tries):
        seen, info = env.reset(seed=seed)
        ended = cut = False
        while not (ended or cut):
            seen, _, ended, cut, info = env.step(policy(seen))
        on += info["success"]
        if info["success"]:
            borne, out = pull(core, vars(core.arm)["plant"], given.pull)
            held += abs(borne - given.pull) < 0.2 * given.pull and out < OFF
    env.close()
    where = given.twin or "own simulation"
    print(f"{where}: {on} of {given.tries} on; {held} bear {given.pull:g} N")


if __name__ == "__main__":
    main()
