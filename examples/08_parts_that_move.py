"""A button, a drawer, a door, a lever and a nut: parts that move, by the tool."""

import argparse
import math
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
    quat_multiply,
    rotation_error,
    turned_box,
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


FLATS, GAP, WALL = 0.017, 0.0002, 0.004  # m: an M10 nut, and a socket around it
SIDE = FLATS / math.sqrt(3.0)


def nut() -> Part:
    """A hexagon nut on an M10 bolt, with a pitch of 1.5 mm."""
    joint = Joint(
        name="nut", kind="screw", axis=Z, pitch=0.0015, range=(-12.0, 12.0),
        friction=0.3,
    )  # fmt: skip
    size, middle = (FLATS / 2, SIDE / 2, 0.004), -0.006 * Z
    hexagon = tuple(  # three bars across each other
        turned_box(f"nut_{i}", size, middle, i * math.pi / 3)._replace(mass=0.004)
        for i in range(3)
    )
    bolt = Primitive("bolt", "cylinder", (0.005, 0.035), -0.035 * Z)
    return Part("nut", (BASE, bolt), (Moving(joint, hexagon),))


def wrench() -> Part:
    """A socket wrench for the nut; the TCP is in the middle of its open end."""
    width = FLATS / 2 + GAP
    size = (WALL / 2, (width + WALL) / math.sqrt(3.0), 0.010)
    middle = np.array([width + WALL / 2, 0.0, -0.010])
    walls = [
        turned_box(f"wall_{i}", size, middle, i * math.pi / 3)._replace(mass=0.01)
        for i in range(6)
    ]
    shank = Primitive("shank", "box", (0.015, 0.015, 0.025), -0.045 * Z, mass=0.1)
    return Part("wrench", (*walls, shank))


STRAIGHT = math.pi / 3  # rad, the wrench on the nut: a flat is over a flat
WAYS = {  # in the fixture's frame [m, m, m, rad]: the tool's tip goes along, and turns
    button: [(0.0, 0.0, 0.004, 0.0), (0.0, 0.0, -0.006, 0.0)],
    drawer: [(-0.035, 0.0, -0.02, 0.0), (0.020, 0.0, -0.02, 0.0)],
    door: [(-0.035, 0.02, -0.02, 0.0), (0.020, 0.02, -0.02, 0.0)],
    lever: [(-0.055, 0.0, -0.02, 0.0), (-0.012, 0.0, -0.02, 0.0)],
    nut: [(0, 0, 0.004, STRAIGHT), (0, 0, -0.008, STRAIGHT), (0, 0, -0.008, -1.0)],
}
HELD = {nut: wrench}  # else it is the peg


def tool_at(x: float, y: float, z: float, turn: float) -> Pose:
    """Return the pose of a tool that points down, at a place of the fixture's."""
    quat = quat_multiply(quat_about_z(turn), TOOL_DOWN)
    return Pose(FIXTURE.position + np.array([x, y, z]), quat)


def push(
    part: Part, held: Part | None, stops: list[tuple[float, ...]], engine: str,
    seconds: float,
) -> tuple[float, float]:  # fmt: skip
    """Move the tool from stop to stop by a soft spring.

    Returns:
        The joint's position at the end [rad, m], and the largest force [N].
    """
    cell = replace(find_cell(), name=part.name, make_fixture=lambda _: part)
    if held is not None:
        cell = replace(cell, held=held)
    plant = make_plant(engine, cell)
    chain = plant.robot.chain()
    plant.reset(plant.robot.inverse_kinematics(tool_at(*stops[0]), Q_SEED), FIXTURE)
    peak, steps = 0.0, round(seconds / PERIOD)
    for i in range(steps):
        share = min(1.0, 1.3 * i / steps) * (len(stops) - 1)
        at = [np.interp(share, range(len(stops)), a) for a in zip(*stops, strict=True)]
        wanted = tool_at(*at)
        q, dq = plant.read()
        J, pose = chain.jacobian(q), plant.robot.tool_pose(q)
        pull = 3000.0 * (wanted.position - pose.position)
        twist = 60.0 * rotation_error(wanted.quat_wxyz, pose.quat_wxyz)
        damping = np.array([100.0] * 3 + [3.0] * 3) * (J @ dq)
        plant.apply(J.T @ (np.concatenate([pull, twist]) - damping) - 0.5 * dq, PERIOD)
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
    for make, stops in WAYS.items():
        part, held = make(), HELD[make]() if make in HELD else None
        joint = part.moving[0].joint
        seconds = 1.0 if options.quick else 3.0
        found, peak = push(part, held, stops, options.engine, seconds)
        print(
            f"{part.name}: from {joint.start:g} to {found:.4f} {joint.unit} of "
            f"{joint.stops}, largest force {peak:.1f} N"
            + (f", {1e3 * found * joint.lead:.2f} mm along" if joint.lead else "")
        )


if __name__ == "__main__":
    main()
