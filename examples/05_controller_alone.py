"""Run the C++ controller against the exact plant, without Gymnasium or an engine.

The task asks for 8 m/s2 towards +x for ever. The controller speeds up, brakes before
the wall at x_max and stays there: a limit is enforced, not merely declared.
"""

import argparse

import numpy as np

from dovetail import (
    Flags,
    LimitConfig,
    OscConfig,
    RigidPlant,
    Target,
    find_cell,
    make_controller,
)

PERIOD = 0.001
MASKS = (
    "joint_velocity",
    "joint_acceleration",
    "torque",
    "wall_position",
    "wall_velocity",
    "wall_acceleration",
)


def at_work(flags: Flags) -> str:
    """Return the names of the limits that bound this cycle."""
    return ", ".join(name for name in MASKS if getattr(flags, name)) or "none"


def main() -> None:
    """Push against the wall and print how close the tool comes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="half a second only")
    args = parser.parse_args()

    robot = find_cell().loaded_robot()
    limits = LimitConfig.for_period(robot, PERIOD)
    osc = OscConfig.for_period(PERIOD)
    controller = make_controller(robot, osc, limits, "XYZ:force ABC:hold", PERIOD)
    plant = RigidPlant(robot.chain(), damping=np.full(7, 0.5), armature=np.full(7, 0.1))

    q = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0])
    hold = robot.tool_pose(q)
    plant.reset(q, np.zeros(7))
    controller.reset(q, hold.position, hold.quat_wxyz)
    target = Target()
    target.f_star = np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    wall, nearest = limits.x_max[0], np.inf
    for cycle in range(500 if args.quick else 2000):
        q, dq = plant.read()
        result = controller.step(q, dq, target)
        plant.apply(result.tau, PERIOD)
        x = robot.tool_pose(q).position[0]
        nearest = min(nearest, wall - x)
        if cycle % 100 == 0:
            print(
                f"{1e3 * cycle * PERIOD:5.0f} ms: x {x:.4f} m, wall at {wall:.2f} m, "
                f"limits at work: {at_work(result.flags)}"
            )
    print(f"nearest to the wall: {1e3 * nearest:.2f} mm")


if __name__ == "__main__":
    main()
