"""Wrong positions behind FRI: what one does to the torque and to the motion.

    python benchmarks/fri_spikes.py [--spikes 5000] [--period 0.001 0.002 0.005]

A simulated cabinet in lockstep, on real UDP, sends positions that are wrong by 1 to 500
mrad in one joint, in one message or in two. The arm of peg in hole rests or moves
freely. The cabinet ends a motion as a real one does: the position that is sent back may
not be faster than three times a joint's speed, nor 10 degrees from the measured one.
Printed are the motions that ended, why, and how near the sent position came to that
speed; the largest change of a torque from one cycle to the next within 20 cycles of a
wrong message, and the largest without wrong ones. Cycles in which the Target changes
are left out of both.
"""

import argparse
import itertools
import socket
import time
from collections import Counter

import numpy as np
from bad_samples import ACTION, AFTER, HOLE, IN_AIR, Q_SEED, TASK, TOOL_DOWN
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.cabinet.wire import Wire
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, DynamicsConfig
from dovetail.poses import Pose

Array = NDArray[np.float64]
HOST = "127.0.0.1"
SCENES = ("rest", "motion")
KINDS = ("single", "pair", "opposite pair")
SMALLEST, LARGEST = 1e-3, 0.5  # rad
F_MOTION = 4.0  # m/s2
SETTLE, EPISODE = 0.3, 3.0  # s before the first spike, s
SPACING = (0.05, 30)  # s, cycles: at least, between two spikes
TAU = slice(COLUMN["tau1"], COLUMN["tau7"] + 1)


class SpikedWire(Wire):
    """Says positions that are wrong, by errors that are given before."""

    def begin(self, errors: dict[int, Array]) -> None:
        """Take the errors of the next messages in a motion, by their number."""
        self.errors = errors
        self.active = 0
        self.fastest = 0.0
        """Largest step of the sent position, of what ends the motion."""
        self._q_sent: Array | None = None

    errors: dict[int, Array]
    active = 0

    def encode(self, stamp: tuple[int, int]) -> bytes:
        """Return the next message."""
        payload = super().encode(stamp)
        controller = self._controller
        if int(controller.state) != 4:
            self._q_sent = None
            return payload
        q = np.array(controller.policy.q)
        if self._q_sent is not None:
            steps = np.abs(q - self._q_sent) / controller.policy._step_max
            self.fastest = max(self.fastest, float(steps.max()))
        self._q_sent = q
        error = self.errors.get(self.active)
        self.active += 1
        if error is None:
            return payload
        version = self._version
        message = _core.FriMonitoring.decode(version, payload)
        assert message.q_measured is not None
        message.q_measured = message.q_measured + error
        return message.encode(version)


class Case:
    """One arm behind one cabinet, and what spikes did to it."""

    def __init__(self, period: float) -> None:
        """Start cabinet and arm."""
        cell, self.period = find_cell(), period
        robot = cell.loaded_robot()
        self.start = robot.inverse_kinematics(Pose(IN_AIR, TOOL_DOWN), Q_SEED)
        self.plant = make_plant("mujoco", cell, DynamicsConfig())
        self.plant.reset(self.start, HOLE)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((HOST, 0))
            port = probe.getsockname()[1]
        own = Endpoint(HOST, 0)
        config = CabinetConfig(
            period=period,
            clock="lockstep",
            client=Endpoint(HOST, port),
            bind=own,
            control=own,
            restart_delay=0.0,
        )
        self.cabinet = Cabinet(self.plant, config)
        self.wire = SpikedWire(self.cabinet.controller)
        self.wire.begin({})
        self.cabinet._wire = self.wire  # the one place that makes its messages
        settings = ControllerSettings(
            osc=OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3),
            limits=LimitConfig.for_period(robot, period),
            task=TaskSpec.parse(TASK),
            period=period,
        )
        address = FriAddress(
            host=HOST,
            port=port,
            clock="lockstep",
            control=str(self.cabinet.control_address),
        )
        self.arm = FriArm(address, robot, settings, log_folder=None)
        self.cabinet.start()
        self.spikes = 0
        self.step = self.step_clean = self.fastest = 0.0
        self.worst = ""
        self.ends: Counter[str] = Counter()
        self.ended: list[str] = []

    def close(self) -> None:
        """End both."""
        self.arm.close()
        self.cabinet.close()
        self.plant.close()

    def errors(
        self, rng: np.random.Generator, kind: str, cycles: int
    ) -> dict[int, Array]:
        """Return spikes in turn on every joint and to both sides."""
        errors: dict[int, Array] = {}
        k = round(SETTLE / self.period)
        space = max(round(SPACING[0] / self.period), SPACING[1])
        while k + space < cycles:
            size = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST)))
            joint, sign = self.spikes % 7, 1.0 if self.spikes // 7 % 2 else -1.0
            error = np.zeros(7)
            error[joint] = sign * size
            errors[k] = error
            if kind != "single":
                errors[k + 1] = -error if kind == "opposite pair" else error
            self.spikes += 1
            k += space + int(rng.integers(space))
        return errors

    def episode(self, scene: str, errors: dict[int, Array]) -> None:
        """Run one episode, and keep what the spikes did."""
        self.wire.begin(errors)
        self.arm.reset(self.start, HOLE)
        per_action = round(ACTION / self.period)
        tau = np.zeros((0, 7))
        for action in range(round(EPISODE / ACTION)):
            target = _core.Target(quat_wxyz_d=TOOL_DOWN)
            if scene == "motion":
                phase = 2.0 * np.pi * action * ACTION * np.array([0.7, 0.9, 1.1])
                target.f_star = np.append(F_MOTION * np.cos(phase), np.zeros(3))
            try:
                log = self.arm.step(target, ACTION).log
            except ArmError as error:
                self.note_end(error, errors)
                break
            tau = np.vstack([tau, log[:, TAU]])
        self.fastest = max(self.fastest, self.wire.fastest)
        self.judge(tau, errors, per_action)

    def judge(self, tau: Array, errors: dict[int, Array], per_action: int) -> None:
        """Keep the largest step of a torque after a spike, or without spikes."""
        steps = np.abs(np.diff(tau, axis=0, prepend=tau[:1])).max(axis=1)
        for k in range(round(SETTLE / self.period), len(steps)):
            if k % per_action == 0:
                continue
            last = max((j for j in errors if j <= k), default=-(10**9))
            if not errors:
                self.step_clean = max(self.step_clean, steps[k])
            elif k - last <= AFTER and steps[k] > self.step:
                self.step = steps[k]
                self.worst = f"{describe(errors[last])}, {k - last} later"

    def note_end(self, error: ArmError, errors: dict[int, Array]) -> None:
        """Count an end by the cabinet's reason, or by the arm's own."""
        why = self.cabinet.status()["stop_reason"]
        reason = error.reason if error.reason != "motion_ended" else why.split(":")[0]
        self.ends[reason] += 1
        now = self.wire.active - 1
        self.spikes -= sum(k > now and k - 1 not in errors for k in errors)
        last = max((j for j in errors if j <= now), default=0)
        text = why
        if error.reason != "motion_ended":
            assert isinstance(error.state, _core.ServoState)
            text = error.state.stop_text
        self.ended.append(f"{describe(errors[last])}, {now - last} later: {text}")


def describe(error: Array) -> str:
    """Say which joint is wrong by how much."""
    joint = int(np.abs(error).argmax())
    return f"A{joint + 1} {1e3 * error[joint]:+.1f} mrad"


def main() -> None:
    """Print a row per period, situation and kind of spike."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--spikes", type=int, default=5000, help="of all rows")
    parser.add_argument("--period", type=float, nargs="+", default=[1e-3, 2e-3, 5e-3])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--ended", type=int, default=3, help="ends to name in a row")
    args = parser.parse_args()
    rows: list[tuple[float, str, str]]
    rows = list(itertools.product(args.period, SCENES, args.kinds))
    print(
        "period, situation, spikes         number  ended  step [Nm]  without  "
        "sent speed, of what ends"
    )
    total, begin = 0, time.perf_counter()
    for period, scene, kind in rows:
        case = Case(period)
        rng = np.random.default_rng([args.seed, *map(ord, f"{period} {scene} {kind}")])
        case.episode(scene, {})
        while case.spikes < args.spikes / len(rows):
            errors = case.errors(rng, kind, round(EPISODE / period))
            case.episode(scene, errors)
        name = f"{1e3 * period:g} ms, {scene}, {kind}"
        print(
            f"{name:32s} {case.spikes:7d} {sum(case.ends.values()):6d} "
            f"{case.step:10.1f} {case.step_clean:8.1f} {case.fastest:10.2f}  "
            f"{case.worst} {dict(case.ends) or ''}",
            flush=True,
        )
        for ended in case.ended[: args.ended]:
            print(f"    {ended}")
        total += case.spikes
        case.close()
    print(f"{total} spikes, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
