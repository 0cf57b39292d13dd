"""How fast the simulated arm runs: against bare MuJoCo, and against robosuite.

Times are processor time, so that other work on the machine disturbs them less. Prints,
for control at 5 ms and at 1 ms,

* the control loop's speed as a fraction of bare ``mj_step`` on the same scene, states
  and torques: the torques of a run with a random policy are recorded and replayed by
  MuJoCo's own C loop, ``mujoco.rollout``, in the same process;
* environment steps per second of `dovetail/PegInHole-v0` (50 ms simulated per step),
  resets included;
* with ``--robosuite PYTHON``, an interpreter that has robosuite, the steps per second
  of its Lift task with its IIWA, the same arm, and its Panda, each with its default
  operational-space controller at 20 Hz (50 ms per step, 2 ms physics, its default), no
  camera, and the ratios. robosuite 1.5.2 ran with mujoco 3.3.0; with 3.17.0 and later
  it fails to build its model. Another task: the ratio says what a step costs a user,
  not whose physics is faster.
"""

import argparse
import subprocess
import time
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco import rollout

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose, quat_about_z, quat_multiply

if TYPE_CHECKING:
    from numpy.typing import NDArray

TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
STEP = 0.05
TAU = slice(COLUMN["tau1"], COLUMN["tau7"] + 1)

PEERS = ("IIWA", "Panda")

ROBOSUITE = """
import sys, time, numpy as np, robosuite
env = robosuite.make('Lift', robots=sys.argv[1], has_renderer=False,
    has_offscreen_renderer=False, use_camera_obs=False, control_freq=20,
    horizon=200, hard_reset=False)
low, high = env.action_spec
rng = np.random.default_rng(0)
env.reset()
best = 0.0
for _ in range(3):
    start = time.process_time()
    for i in range(400):
        if i % 200 == 0:
            env.reset()
        env.step(rng.uniform(low, high))
    best = max(best, 400 / (time.process_time() - start))
print(best)
"""


def build_arm(period: float) -> tuple[MujocoPlant, LocalArm]:
    """Build the paper's task on MuJoCo."""
    plant = MujocoPlant(find_cell())
    osc = OscConfig(force_damping=np.array([16.0, 16.0, 16.0, 0.0, 0.0, 0.0]))
    limits = LimitConfig.for_period(plant.robot, period)
    arm = LocalArm(plant, plant.robot, osc, limits, "XYZ:force A:pose BC:hold", period)
    return plant, arm


def run_trials(
    plant: MujocoPlant, arm: LocalArm, period: float, steps: int
) -> tuple[float, list[tuple["NDArray", "NDArray"]]]:
    """Run random trials; return the seconds in the loop, and starts with torques."""
    rng = np.random.default_rng(0)
    cycles = round(STEP / period)
    seconds, trials = 0.0, []
    while steps > 0:
        tip = np.array([0.6, 0.0, 0.13]) + rng.uniform(-0.02, 0.02, 3)
        q = arm.facts.robot.inverse_kinematics(Pose(tip, TOOL_DOWN), Q_SEED)
        arm.reset(q, HOLE)
        torques = []
        for _ in range(200):
            f_star = np.array([*rng.uniform(-4.0, 4.0, 3), 0.0, 0.0, 0.0])
            f_star[2] -= 1.0  # towards the block, so that contacts are part of it
            quat = quat_multiply(quat_about_z(rng.uniform(-0.2, 0.2)), TOOL_DOWN)
            target = _core.Target(f_star=f_star, quat_wxyz_d=quat)
            begin = time.process_time()
            log, _, _ = plant.run_cycles(arm.controller, target, cycles, period)
            seconds += time.process_time() - begin
            torques.append(log[:, TAU])
        trials.append((q, np.concatenate(torques)))
        steps -= 200
    return seconds, trials


def replay_bare(
    plant: MujocoPlant, period: float, trials: list[tuple["NDArray", "NDArray"]]
) -> tuple[float, int, float]:
    """Time MuJoCo alone on the recorded torques.

    Returns:
        Seconds, physics steps, and the share of steps with a contact.
    """
    model, chain = plant.model, plant.robot.chain()
    per_cycle = round(period / model.opt.timestep)
    spec = mujoco.mjtState.mjSTATE_QFRC_APPLIED
    seconds, steps, touching = 0.0, 0, 0
    for q, torques in trials:
        plant.reset(q, HOLE)
        forces = np.empty((len(torques) * per_cycle, 7))
        for i in range(len(forces)):  # once in Python, to record what acted per step
            forces[i] = torques[i // per_cycle] + chain.gravity(plant.data.qpos)
            plant.data.qfrc_applied[:] = forces[i]
            mujoco.mj_step(model, plant.data)
            touching += plant.data.ncon > 0
        plant.reset(q, HOLE)
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        state = np.empty(size)
        full = mujoco.mjtState.mjSTATE_FULLPHYSICS
        mujoco.mj_getState(model, plant.data, state, full)
        begin = time.process_time()
        rollout.rollout(
            model, plant.data, state[None], forces[None], control_spec=spec.value
        )
        seconds += time.process_time() - begin
        steps += len(forces)
    return seconds, steps, touching / steps


def measure_loop(period: float, steps: int) -> None:
    """Print the loop's speed against bare MuJoCo, best of three."""
    plant, arm = build_arm(period)
    fractions: list[tuple[float, float, float]] = []
    count, touching = 1, 0.0
    for _ in range(3):
        with_control, trials = run_trials(plant, arm, period, steps)
        bare, count, touching = replay_bare(plant, period, trials)
        fractions.append((bare / with_control, with_control, bare))
    fraction, with_control, bare = max(fractions)
    print(
        f"period {period * 1e3:.0f} ms: loop {with_control / count * 1e6:.2f} us, bare "
        f"mj_step {bare / count * 1e6:.2f} us per physics step "
        f"({touching:.0%} with contact): fraction {fraction:.2f}"
    )


def measure_env(period: float, steps: int) -> float:
    """Print and return environment steps per second, resets included, best of three."""
    import gymnasium

    env = gymnasium.make("dovetail/PegInHole-v0", period=period)
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    best = 0.0
    for _ in range(3):
        begin = time.process_time()
        for _ in range(steps):
            action = rng.uniform(-1.0, 1.0, 4).astype(np.float32)
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        best = max(best, steps / (time.process_time() - begin))
    env.close()
    print(f"period {period * 1e3:.0f} ms: {best:.0f} environment steps/s")
    return best


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1000, help="steps per repetition")
    parser.add_argument("--robosuite", metavar="PYTHON", help="interpreter with it")
    options = parser.parse_args()
    for period in (0.005, 0.001):
        measure_loop(period, options.steps)
    rates = {period: measure_env(period, options.steps) for period in (0.005, 0.001)}
    for robot in PEERS if options.robosuite else ():
        done = subprocess.run(
            [options.robosuite, "-c", ROBOSUITE, robot],
            check=True,
            capture_output=True,
            text=True,
        )
        peer = float(done.stdout.split()[-1])
        print(f"robosuite Lift with {robot} and its controller: {peer:.0f} steps/s")
        for period, rate in rates.items():
            print(f"period {period * 1e3:.0f} ms: {rate / peer:.1f} times that")


if __name__ == "__main__":
    main()
