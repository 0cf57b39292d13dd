"""How well is a pose reached, followed and held, beside robosuite's controller?

On the same simulated arm, in the same run: our controller, at its defaults for the
period, and robosuite's own class OperationalSpaceController, at its default gains (kp
150, damping ratio 1) and at ours (kp 400). Each axis makes a step of 50 mm or 0.3 rad;
the tool goes round a tilted circle of 50 mm at 0.1 m/s; the pose is held for 10 s. What
counts is the arm's true pose. Our Targets are renewed every 50 ms and carry the path's
velocity and acceleration; robosuite's goal, which has neither, is renewed every cycle.

    python benchmarks/tracking.py --robosuite PYTHON --out tracking.json

PYTHON is an interpreter with robosuite (pip install robosuite==1.5.2 mujoco==3.3.0).
Without it our controller runs alone. "tared" is ours with a constant f* beside it: what
the disturbance estimate said after holding for 1.5 s. A number is the mean of `--seeds`
runs, each with its own noise: dry friction makes small numbers a matter of luck.
`--report FILE` prints the tables of docs/tracking.md from what was written.
"""

import argparse
import json
import re
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from tracking_report import print_exceptions, print_markdown, print_table

from dovetail import _core, poses
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import PlantError
from dovetail.plants.mjcf import build_mjcf
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import Plant
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.types import Array, Vec6, Vec7

OURS = ("ours", "tared")
TWINS = ("plain", "easy", "medium", "hard")
PERIODS = (0.001, 0.005)
CENTRE = Pose(np.array([0.6, 0.0, 0.22]), np.array([0.0, 1.0, 0.0, 0.0]))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.5, 0.35, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))  # out of reach
STEP = np.repeat([0.05, 0.3], 3)  # m, rad
SETTLE, WATCH, HOLD = 1.0, 1.5, 10.0  # s
RENEWED = 0.05  # s, our Target
RADIUS, SPEED = 0.05, 0.1  # m, m/s
TARE, SLOW = 1.5, 0.2  # s
LEVEL, STEEP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)


class Wanted(NamedTuple):
    """Where the tool should be, and how that moves."""

    position: Array
    quat: Array
    velocity: Vec6 = np.zeros(6)
    acceleration: Vec6 = np.zeros(6)


Path6 = Callable[[float], Wanted]


class Cycles(NamedTuple):
    """How the arm is read."""

    period: float
    """Control period [s]."""
    seed: int
    """Of the sensors' noise."""


class Law(Protocol):
    """A controller: state and wish in, overlay torque out."""

    def reset(self, q: Vec7) -> None:
        """Begin at rest at q [rad]."""
        ...

    def torque(self, time: float, q: Vec7, dq: Vec7, path: Path6) -> Vec7:
        """Return the overlay torque [Nm] of one cycle."""
        ...


class Ours:
    """The project's controller, all axes in one mode."""

    def __init__(
        self, robot: Robot, period: float, mode: str, kind: str = "ours"
    ) -> None:
        """Build it.

        Args:
            robot: The nominal arm.
            period: Control period [s].
            mode: "pose" or "hold".
            kind: "ours" or "tared", see the module.
        """
        osc = OscConfig.for_period(period)
        limits = LimitConfig.for_period(robot, period)
        self.controller = make_controller(robot, osc, limits, f"XYZABC:{mode}", period)
        self.chain, self.period = robot.chain(), period
        self.kind, self.lost = kind, np.zeros(6)
        self.armature = np.diag(limits.armature)

    def reset(self, q: Vec7) -> None:
        """Begin at rest at q [rad]; that is the pose to hold, too."""
        self.controller.reset(q, CENTRE.position, CENTRE.quat_wxyz)
        self.target, self.renewed = _core.Target(), -1.0
        self.is_learning = False

    def torque(self, time: float, q: Vec7, dq: Vec7, path: Path6) -> Vec7:
        """Return the overlay torque [Nm] of one cycle."""
        age = time - self.renewed
        if self.renewed < 0.0 or age > RENEWED - 0.5 * self.period:
            wanted, self.renewed, age = path(time), time, 0.0
            self.target.position_d = wanted.position
            self.target.quat_wxyz_d = wanted.quat
            self.target.velocity_d = wanted.velocity
            self.target.acceleration_d = wanted.acceleration
        self.target.age = age
        if self.is_learning:
            self.follow_estimate(q)
        self.target.f_star = self.target.f_tare = -self.lost
        return self.controller.step(q, dq, self.target).tau

    def follow_estimate(self, q: Vec7) -> None:
        """Filter what the estimate r does to the task [m/s2, rad/s2]."""
        M = self.chain.inertia_matrix(q) + self.armature
        now = self.chain.jacobian(q) @ np.linalg.solve(M, self.controller.disturbance)
        self.lost = self.lost + self.period / SLOW * (now - self.lost)

    def tare(self, plant: Plant, q: Vec7) -> None:
        """Hold for a while and keep what the estimate says."""
        self.lost = np.zeros(6)
        self.reset(plant.read()[0])
        self.is_learning = True
        for cycle in range(round(TARE / self.period)):
            torque = self.torque(cycle * self.period, *plant.read(), still)
            plant.apply(torque, self.period)
        plant.reset(q, HOLE)


class Robosuite:
    """robosuite's class in its own interpreter, see `robosuite_osc.py`."""

    def __init__(self, robot: Robot, python: str, kp: float) -> None:
        """Start it on the nominal arm.

        Args:
            robot: The nominal arm.
            python: Interpreter with robosuite.
            kp: Its stiffness [1/s2].
        """
        self.kp, self.tau_max, self.chain = kp, robot.limits.tau_max, robot.chain()
        self.folder = tempfile.TemporaryDirectory()
        write_model(Path(self.folder.name))
        script = Path(__file__).with_name("robosuite_osc.py")
        self.process = subprocess.Popen(
            [python, str(script), self.folder.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def ask(self, row: Array) -> Vec7:
        """Send 20 numbers, return 7."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(np.ascontiguousarray(row, dtype=float).tobytes())
        self.process.stdin.flush()
        answer = self.process.stdout.read(56)
        if len(answer) != 56:
            raise SystemExit("robosuite's process has ended; its words are above")
        return np.frombuffer(answer)

    def reset(self, q: Vec7) -> None:
        """Begin at rest at q [rad], which is its posture, too."""
        self.ask(np.array([np.nan, self.kp, 1.0, 0, 0, 0, 0, *q, 0, 0, 0, 0, 0, 0]))

    def torque(self, time: float, q: Vec7, dq: Vec7, path: Path6) -> Vec7:
        """Return the overlay torque [Nm] of one cycle, inside the motors' limits."""
        wanted = path(time)
        turn = poses.rotation_error(wanted.quat, np.array([1.0, 0.0, 0.0, 0.0]))
        tau = self.ask(np.concatenate([q, dq, wanted.position, turn]))
        g = self.chain.gravity(q)
        return np.clip(tau, -self.tau_max - g, self.tau_max - g)

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(timeout=10.0)
        self.folder.cleanup()


def write_model(folder: Path) -> None:
    """Write the nominal arm for robosuite: the MJCF, and what `configure` sets."""
    cell = find_cell()
    text = build_mjcf(cell.loaded_robot(), cell)
    base = '<site name="robot0_right_center" pos="0 0 0"/>'  # robosuite reads its speed
    text = text.replace("<worldbody>", f"<worldbody>{base}")
    text = re.sub(r"<flag [^>]*/>", "", text)  # newer than its MuJoCo
    (folder / "model.xml").write_text(text)
    model = MujocoPlant(cell).model
    names = ("body_mass", "body_inertia", "body_iquat", "dof_armature")
    numbers = {name: getattr(model, name) for name in names}
    ipos = model.body_ipos.copy()
    ipos[model.body("flange").id] = 0.0  # massless; moved for pushes alone
    np.savez(folder / "model.npz", body_ipos=ipos, **numbers)


def require_same_model(law: Robosuite, robot: Robot) -> None:
    """Compare robosuite's torque at rest with its equation on our model.

    Raises:
        SystemExit: They differ: the two do not control the same arm.
    """
    q = robot.inverse_kinematics(CENTRE, Q_SEED)
    law.reset(q)
    aside = CENTRE.position + np.array([0.01, -0.02, 0.015])
    tau = law.torque(0.0, q, np.zeros(7), lambda _: Wanted(aside, CENTRE.quat_wxyz))
    now, chain = robot.tool_pose(q), robot.chain()
    J = chain.jacobian(q)[:3]
    M = chain.inertia_matrix(q) + 0.1 * np.eye(7)
    mobility = J @ np.linalg.solve(M, J.T)
    force = np.linalg.solve(mobility, law.kp * (aside - now.position))
    if np.abs(tau - J.T @ force).max() > 1e-3:
        raise SystemExit(
            f"robosuite's torque is {tau}, its equation gives {J.T @ force}"
        )


def run(
    plant: Plant, law: Law, cycles: Cycles, path: Path6, seconds: float, q: Vec7
) -> tuple[Array, Array]:
    """Return the tool's way from the start and its error, each (cycles, 6).

    Rows are [m, rad] in world axes, the rotation as a vector.
    """
    period, seed = cycles
    plant.seed(seed)
    plant.reset(q, HOLE)
    if isinstance(law, Ours) and law.kind == "tared":
        law.tare(plant, q)
    law.reset(plant.read()[0])
    way, errors = [], []
    for cycle in range(round(seconds / period)):
        now, wanted = plant.tool_pose(), path(cycle * period)
        turned = poses.rotation_error(now.quat_wxyz, CENTRE.quat_wxyz)
        missed = poses.rotation_error(wanted.quat, now.quat_wxyz)
        way.append([*(now.position - CENTRE.position), *turned])
        errors.append([*(wanted.position - now.position), *missed])
        q_m, dq_m = plant.read()
        plant.apply(law.torque(cycle * period, q_m, dq_m, path), period)
    return np.array(way), np.array(errors)


def step_of(axis: int) -> Path6:
    """Return the path that jumps along or about one axis after `SETTLE`."""
    move = STEP * np.eye(6)[axis]
    quat = poses.quat_multiply(poses.quat_from_vector(move[3:]), CENTRE.quat_wxyz)
    after = Wanted(CENTRE.position + move[:3], quat)
    return lambda time: after if time > SETTLE - 1e-9 else Wanted(*CENTRE)


def still(_: float) -> Wanted:
    """Return the pose to hold."""
    return Wanted(*CENTRE)


def circle(time: float) -> Wanted:
    """Return the point of the tilted circle; it begins at its lowest, in motion."""
    rate = SPEED / RADIUS
    s, c = np.sin(rate * time), np.cos(rate * time)
    zero = np.zeros(3)
    return Wanted(
        CENTRE.position + RADIUS * (s * LEVEL + (1.0 - c) * STEEP),
        CENTRE.quat_wxyz,
        np.concatenate([SPEED * (c * LEVEL + s * STEEP), zero]),
        np.concatenate([SPEED * rate * (c * STEEP - s * LEVEL), zero]),
    )


def measure_step(way: Array, errors: Array, axis: int, period: float) -> dict:
    """Return what one axis did after its jump."""
    begin = round(SETTLE / period)
    moved = way[begin:] - way[begin - 1]
    size, along = STEP[axis], moved[:, axis]
    low, high = (int(np.argmax(along >= s * size)) for s in (0.1, 0.9))
    other = np.delete(np.abs(moved), axis, axis=1).max(axis=0)
    linear = other[: 3 - (axis < 3)]
    return {
        "rise": (high - low) * period if along.max() >= 0.9 * size else float("inf"),
        "overshoot": max(0.0, float(way[begin:, axis].max()) / size - 1.0),
        "steady": float(np.abs(errors[-round(0.3 / period) :, axis]).mean()),
        "cross_linear": float(linear.max()),
        "cross_angular": float(other[len(linear) :].max()),
    }


def measure_often(
    plant: Plant, laws: tuple[Law, Law], period: float, q: Vec7, seeds: int
) -> dict:
    """Return the mean over seeds of every number of one law, for poses and held."""
    runs = [measure(plant, *laws, Cycles(period, s), q) for s in range(1, seeds + 1)]
    return {name: np.mean([r[name] for r in runs], axis=0).tolist() for name in runs[0]}


def measure(plant: Plant, law: Law, held: Law, cycles: Cycles, q: Vec7) -> dict:
    """Return every number of one law on one plant, by metric, one for each axis."""
    period = cycles.period
    found: dict[str, list[float]] = {}
    for axis in range(6):
        way, errors = run(plant, law, cycles, step_of(axis), SETTLE + WATCH, q)
        for name, value in measure_step(way, errors, axis, period).items():
            found.setdefault(name, []).append(value)
    turn = 2.0 * np.pi * RADIUS / SPEED
    _, errors = run(plant, law, cycles, circle, 1.25 * turn, q)
    errors = errors[round(0.25 * turn / period) :]
    found["circle_rms"] = np.sqrt((errors**2).mean(axis=0)).tolist()
    found["circle_max"] = np.abs(errors).max(axis=0).tolist()
    way, _ = run(plant, held, cycles, still, HOLD, q)
    found["held"] = np.abs(way).max(axis=0).tolist()
    found["drift"] = np.abs(way[-round(0.3 / period) :].mean(axis=0)).tolist()
    return found


def build_plant(twin: str) -> Plant:
    """Build the arm in MuJoCo: as the model, or one of the shipped twins."""
    cell = find_cell()
    return MujocoPlant(cell) if twin == "plain" else make_twin(load_twin(twin), cell)


def at_least_one(text: str) -> int:
    """Read how many runs to take the mean of."""
    if (count := int(text)) < 1:
        raise argparse.ArgumentTypeError(f"{text}; allowed: 1 and more")
    return count


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robosuite", metavar="PYTHON", help="interpreter with it")
    parser.add_argument("--twins", nargs="+", default=TWINS, choices=TWINS)
    parser.add_argument("--periods", nargs="+", type=float, default=PERIODS)
    parser.add_argument(
        "--seeds", type=at_least_one, default=8, help="of the sensors' noise"
    )
    parser.add_argument("--out", type=Path, help="write the numbers here, as JSON")
    parser.add_argument("--report", type=Path, metavar="FILE", help="only its tables")
    options = parser.parse_args()
    if options.report:
        print_markdown(json.loads(options.report.read_text()))
        return
    robot = find_cell().loaded_robot()
    q = robot.inverse_kinematics(CENTRE, Q_SEED)
    peers: dict[str, Robosuite] = {}
    for kp in (150.0, 400.0) if options.robosuite else ():
        peers[f"robosuite {kp:g}"] = Robosuite(robot, options.robosuite, kp)
        require_same_model(peers[f"robosuite {kp:g}"], robot)
    results: dict[str, dict] = {}
    for period in options.periods:
        for twin in options.twins:
            laws: dict[str, tuple[Law, Law]] = {
                name: (p, p) for name, p in peers.items()
            }
            for name in OURS:
                pose, hold = (
                    Ours(robot, period, mode, name) for mode in ("pose", "hold")
                )
                laws[name] = (pose, hold)
            row = results[f"{twin} {1e3 * period:g} ms"] = {}
            for name, pair in laws.items():
                try:
                    row[name] = measure_often(
                        build_plant(twin), pair, period, q, options.seeds
                    )
                except PlantError as error:
                    row[name] = {"diverged": str(error)}
            print_table(f"{twin}, {1e3 * period:g} ms", row)
            if options.out:
                options.out.write_text(json.dumps(results, indent=1))
    print_exceptions(results)
    for peer in peers.values():
        peer.close()


if __name__ == "__main__":
    main()
