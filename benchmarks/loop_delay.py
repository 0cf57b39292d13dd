"""The delay that the doctor measures on twins whose delay is known.

    python benchmarks/loop_delay.py

Each joint is pushed for two seconds; a line for each twin and period.
"""

import argparse
from dataclasses import replace

from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.diagnosis import diagnose_arm
from dovetail.doctor.excitation import excitation_gains, simulated_step
from dovetail.doctor.simulated_arm import above_fixture
from dovetail.envs.arm_setup import build_local_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.twin import load_twin

PERIODS = (0.001, 0.002, 0.0025, 0.005)
DELAYS = (0.0, 0.002, 0.005, 0.008, 0.010, 0.015)


def measure(twin: str, period: float, delay: float, seed: int) -> tuple[float, float]:
    """Return the simulated and the measured delay [s]."""
    config = replace(load_twin(twin), command_delay=delay, seed=seed)
    cell = find_cell()
    arm = build_local_arm(
        cell,
        TaskSpec.parse("XYZABC:hold"),
        EnvConfig(twin=config, period=period, force_damping=0.0),
    )
    osc, limits = excitation_gains(arm.facts.osc, arm.facts.limits)
    robot = arm.facts.robot
    held = LocalArm(arm.plant, robot, osc, limits, arm.facts.task, period)
    q = robot.inverse_kinematics(above_fixture(cell), robot.posture("rest"))
    held.reset(q, cell.place)
    step = simulated_step(period)
    found = diagnose_arm(held, q, integration_step=step, seed=seed)
    held.close()
    return config.command_delay, found.delay.delay


def main() -> None:
    """Print a line for each twin and period, and the worst of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", nargs="*", default=["easy", "medium", "hard"])
    parser.add_argument("--periods", nargs="*", type=float, default=PERIODS, help="[s]")
    parser.add_argument("--delays", nargs="*", type=float, default=DELAYS, help="[s]")
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    worst = 0.0
    for twin in options.twins:
        for period in options.periods:
            pairs = [
                measure(twin, period, delay, seed)
                for delay in options.delays
                for seed in range(options.seeds)
            ]
            errors = [1e3 * abs(found - true) for true, found in pairs]
            worst = max(worst, *errors)
            said = " ".join(f"{1e3 * t:g}:{1e3 * f:.2f}" for t, f in pairs)
            print(f"{twin} at {1e3 * period:g} ms: {said} (ms)", flush=True)
    print(f"worst error: {worst:.2f} ms")


if __name__ == "__main__":
    main()
