"""A button, a drawer, a door and a lever: parts that move, pushed by the tool."""

import argparse
from dataclasses import replace

import numpy as np

from dovetail import (
    TOOL_DOWN,
    Detent,
    Joint,
    Moving,
    Part,
    Pose,
    Primitive,
    find_cell,
    make_plant,
    quat_about_z,
    rotation_error,
)

X, Y, Z = np.eye(3)
FIXTURE = Pose(np.array([0.60, 0.0, 0.12]), quat_about_z(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
BASE = Primitive("base", "box", (0.06, 0.06, 0.01), -0.08 * Z)
PERIOD = 0.005  # s


def button() -> Part:
    """A preloaded button, which begins to move at 4 N."""
    joint = Joint(
        name="button", kind="slide", axis=Z, range=(-0.008, 0.0),
        stiffness=800.0, rest=0.005, damping=4.0,
    )  # fmt: skip
    cap = Primitive("cap", "cylinder", (0.012, 0.01), -0.01 * Z, mass=0.02)
    return Part("button", (BASE,), (Moving(joint, (cap,)),))


def drawer() -> Part:
    """A drawer that runs 50 mm with dry friction."""
    joint = Joint(name="drawer", kind="slide", axis=X, range=(0.0, 0.05), friction=3.0)
    tray = Primitive("tray", "box", (0.03, 0.02, 0.01), -0.05 * Z, mass=0.2)
    handle = Primitive("handle", "box", (0.004, 0.02, 0.02), -0.02 * Z, mass=0.02)
    return Part("drawer", (BASE,), (Moving(joint, (tray, handle)),))


def door() -> Part:
    """A door with a catch, which holds it closed."""
    joint = Joint(
        name="door", kind="hinge", axis=-Z, origin=-0.06 * Y, range=(0.0, 1.2),
        friction=0.02, damping=0.02, detents=(Detent(0.0, 0.4, 0.1),),
    )  # fmt: skip
    leaf = Primitive("leaf", "box", (0.003, 0.05, 0.03), -0.01 * Y - 0.03 * Z, mass=0.3)
    return Part("door", (BASE,), (Moving(joint, (leaf,)),))


def lever() -> Part:
    """A switch that snaps from one side to the other."""
    sides = Detent(-0.4, 0.3, 0.4), Detent(0.4, 0.3, 0.4)
    joint = Joint(
        name="lever", kind="hinge", axis=Y, origin=-0.06 * Z, range=(-0.45, 0.45),
        start=-0.4, damping=0.01, detents=sides,
    )  # fmt: skip
    bar = Primitive("bar", "box", (0.004, 0.01, 0.03), -0.03 * Z, mass=0.05)
    return Part("lever", (BASE,), (Moving(joint, (bar,)),))


WAYS = {  # in the fixture's frame [m]: the tool's tip goes from one point to the other
    button: ((0.0, 0.0, 0.004), (0.0, 0.0, -0.006)),
    drawer: ((-0.035, 0.0, -0.02), (0.020, 0.0, -0.02)),
    door: ((-0.035, 0.02, -0.02), (0.020, 0.02, -0.02)),
    lever: ((-0.055, 0.0, -0.02), (-0.012, 0.0, -0.02)),
}


Point = tuple[float, float, float]


def push(
    part: Part, begin: Point, end: Point, engine: str, seconds: float
) -> tuple[float, float]:
    """Move the tool along a line by a soft spring.

    Returns:
        The joint's position at the end [rad, m], and the largest force [N].
    """
    cell = replace(find_cell(), name=part.name, make_fixture=lambda _: part)
    plant = make_plant(engine, cell)
    chain = plant.robot.chain()
    start = Pose(FIXTURE.position + begin, TOOL_DOWN)
    plant.reset(plant.robot.inverse_kinematics(start, Q_SEED), FIXTURE)
    peak, steps = 0.0, round(seconds / PERIOD)
    for i in range(steps):
        share = min(1.0, 1.3 * i / steps)
        wanted = start.position + share * np.subtract(end, begin)
        q, dq = plant.read()
        J, pose = chain.jacobian(q), plant.robot.tool_pose(q)
        pull = 3000.0 * (wanted - pose.position)
        turn = 60.0 * rotation_error(TOOL_DOWN, pose.quat_wxyz)
        damping = np.array([100.0] * 3 + [3.0] * 3) * (J @ dq)
        plant.apply(J.T @ (np.concatenate([pull, turn]) - damping) - 0.5 * dq, PERIOD)
        peak = max(peak, float(np.linalg.norm(plant.contact_force_peak())))
    found = float(plant.part_positions()[0])
    plant.close()
    return found, peak


def main() -> None:
    """Push each of them, and say where it is then."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", default="mujoco", help="mujoco, bullet or drake")
    parser.add_argument("--quick", action="store_true", help="push faster")
    options = parser.parse_args()
    for make, (begin, end) in WAYS.items():
        part = make()
        joint = part.moving[0].joint
        seconds = 1.0 if options.quick else 3.0
        found, peak = push(part, begin, end, options.engine, seconds)
        print(
            f"{part.name}: from {joint.start:g} to {found:.4f} {joint.unit} of "
            f"{joint.stops}, largest force {peak:.1f} N"
        )


if __name__ == "__main__":
    main()
