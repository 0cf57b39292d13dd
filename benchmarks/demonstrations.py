"""How many steps a training needs with 20 demonstrations, and with none.

A script demonstrates as a hand does: strokes of minimum jerk that go a little too far
and are corrected, tremor, pauses, an eye that is some tenths of a millimetre off; it
says ten times per second where the tool is to go, as the gizmo of the cockpit does.

    python benchmarks/demonstrations.py --seeds 0 1 2
    python benchmarks/demonstrations.py --every 500 --pretrain 0
    python benchmarks/demonstrations.py --only-show --out FOLDER

A training counts as done at the first of its tests, every 1000 steps and without
exploration, in which 99 of 100 episodes succeed; one that cannot come to 90 any more is
cut short. The rate of learning falls as in `dovetail train`, once nine of ten tries
succeed. Both trainings of a seed have the same test episodes and the same settings but
`demos`.
"""

import argparse
import json
import math
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import dovetail
from dovetail.cockpit.episode_logger import DEMONSTRATIONS, EpisodeLogger
from dovetail.cockpit.teleoperator import Teleoperator
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.log_facts import describe_cell, observed_columns
from dovetail.envs.teleop import TeleopWrapper
from dovetail.envs.unwrapped import require_contact_env
from dovetail.learn.config import TrainConfig
from dovetail.learn.progress import EpisodeRow
from dovetail.learn.run_config import LengthConfig
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.types import Vec3

RATE = 10
"""How often the hand says where to [Hz]."""
TREMOR = 0.0003
"""Standard deviation of the tremor [m]."""
OVERSHOOT = 0.06
"""Standard deviation of how much too far a stroke goes [1]."""
EYE, EYE_TURN = 0.0008, 0.02
"""Standard deviation of what the eye is off by [m, rad]."""
ABOVE = 0.015
"""How far above the mouth the hand lines up [m]."""
STEPS_MAX = 400
_AT_ONCE = round(1.0 / RATE / 0.05)  # steps of the environment per wish


class Hand:
    """Moves by strokes of minimum jerk from where it is to where it wants to be."""

    def __init__(self, core: ContactEnv, rng: np.random.Generator) -> None:
        """Begin at the tool."""
        self._core, self._rng = core, rng
        self._at = core.state.tool.position.copy()
        self._turn = self._turn_left()
        self._stroke: list[tuple[Vec3, float]] = []
        self._phase, self._tries = "line up", 0
        self._deepest, self._stuck = math.inf, 0
        self._aim()

    def _turn_left(self) -> float:
        goal = self._core.task.goal(self._core.fixture)
        state = self._core.state
        twist = quat_multiply(
            state.tool.quat_wxyz, goal.quat_wxyz * np.array([1.0, -1.0, -1.0, -1.0])
        )
        return 2.0 * math.atan2(twist[3], twist[0])

    def _aim(self) -> None:
        """Look anew at where the hole is; close to it, better."""
        size = EYE / (1.0 + 0.5 * self._tries)
        self._off = size * self._rng.normal(size=2)
        self._off_turn = EYE_TURN * self._rng.normal()

    def _place(self, height: float) -> Vec3:
        mouth = self._core.fixture.position
        return mouth + np.array([*self._off, height])

    def _go(self, to: Vec3, turn: float, speed: float) -> None:
        """Plan a stroke, its overshoot and the correction, and a pause."""
        rng = self._rng
        way = to - self._at
        distance = float(np.linalg.norm(way))
        far = 1.0 + abs(rng.normal(0.0, OVERSHOOT)) if distance > 0.02 else 1.0
        begin, first = (self._at, self._turn), self._at + far * way
        for goal, length in ((first, distance), (to, distance * (far - 1.0))):
            # As Fitts' law has it, short strokes are slower than their length.
            count = max(2, round(RATE * (0.25 + length / speed)))
            for i in range(1, count + 1):
                s = i / count
                s = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
                here = begin[0] + s * (goal - begin[0])
                self._stroke.append((here, begin[1] + s * (turn - begin[1])))
            begin = (goal, turn)
        pause = int(rng.integers(0, 5))
        self._stroke += [begin] * pause

    def wish(self) -> Pose:
        """Return where the tool is to go in the next tenth of a second."""
        if not self._stroke:
            self._next()
        self._at, self._turn = self._stroke.pop(0)
        goal = self._core.task.goal(self._core.fixture)
        tremor = TREMOR * self._rng.normal(size=3)
        quat = quat_multiply(quat_about_z(self._turn), goal.quat_wxyz)
        return Pose(self._at + tremor, quat)

    def _next(self) -> None:
        """Decide what to do after a stroke."""
        core = self._core
        height = float((core.state.tool.position - core.fixture.position)[2])
        if self._phase == "line up":
            self._go(self._place(ABOVE), self._off_turn, 0.10)
            self._phase = "push"
        elif height < -0.002 or self._tries == 0 or self._stuck < 1:
            self._stuck = 0 if height < self._deepest - 0.001 else self._stuck + 1
            self._deepest = min(height, self._deepest)
            self._tries = max(self._tries, 1)
            self._go(self._place(max(height, -0.03) - 0.012), self._off_turn, 0.03)
        else:  # it stands on the rim: a little up, and another place
            self._tries += 1
            self._stuck, self._deepest = 0, math.inf
            self._aim()
            self._go(self._place(0.003), self._off_turn, 0.05)


def demonstrate(folder: Path, count: int, seed: int) -> dict[str, Any]:
    """Have the script's hand show the task so many times; keep what succeeded."""
    logger, teleoperator = EpisodeLogger(folder), Teleoperator()
    env = TeleopWrapper(
        gym.make(DEFAULT_ENV, disable_env_checker=True), teleoperator.action
    )
    core = require_contact_env(env)
    rng = np.random.default_rng([seed, 0xDE40])
    steps, force, failed = [], [], 0
    while len(steps) < count:
        _, info = env.reset(seed=int(rng.integers(1 << 31)))
        logger.begin(describe_cell(env), observed_columns(env))
        logger.begin_demonstration()
        logger.see_first(info["observation_raw"])
        logger.follow(core.state.stamp, core.fixture)
        teleoperator.reset()
        hand, peak, done = Hand(core, rng), 0.0, False
        teleoperator.grab(hand.wish())
        for step in range(STEPS_MAX):
            if step % _AT_ONCE == 0:
                teleoperator.move(hand.wish())
            _, reward, done, _, info = env.step(np.zeros(len(core.commands), "f4"))
            peak = max(peak, float(info["contact_force_max"]))
            logger.add(core.state, step, float(reward), info)
            if done:
                break
        teleoperator.let_go()
        if done:
            logger.end(success=True)
            steps.append(core.steps)
            force.append(peak)
        else:
            failed += 1
            logger.end_demonstration(is_kept=False)
    logger.close()
    env.close()
    return {
        "demonstrations": count,
        "thrown away": failed,
        "steps": f"median {np.median(steps):.0f}, {min(steps)} to {max(steps)}",
        "peak force [N]": f"median {np.median(force):.0f}, at most {max(force):.0f}",
    }


def steps_to_learn(config: TrainConfig, every: int, episodes: int) -> dict[str, Any]:
    """Train until a test is passed; return the step of it and all tests."""
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import configure

    from dovetail.learn.algorithms import derive_seed, make_vec_env
    from dovetail.learn.assess import TEST_SEED, play
    from dovetail.learn.checkpoint import seed_run
    from dovetail.learn.demonstrations import pretrain
    from dovetail.learn.export import current_policy
    from dovetail.learn.one_run import prepared
    from dovetail.learn.tester import stage_of

    test = make_vec_env(config)
    stage = stage_of(test)
    seeds = [derive_seed(TEST_SEED, i) for i in range(episodes)]
    tests: list[tuple[int, int]] = []

    class Test(BaseCallback):
        def _on_step(self) -> bool:
            infos, dones = self.locals["infos"], self.locals["dones"]
            for info, done in zip(infos, dones, strict=True):
                if done:
                    run.stop.note(_row(self.num_timesteps, info))
            return not (tests and tests[-1][1] >= 0.99 * episodes)

        def _on_rollout_start(self) -> None:
            done = self.num_timesteps
            if done < (len(tests) + 1) * every:
                return
            policy = current_policy(self.model, config)
            tried = found = 0
            # No more where nine in ten cannot come out: most take their full time.
            while tried < episodes and tried - found <= 0.1 * episodes:
                portion = seeds[tried : tried + 20]
                found += sum(one.success for one in play(policy, portion, stage))
                tried += len(portion)
            tests.append((done, found))
            if run.stop.is_due(done):  # the rate begins anew, as in a training
                failed = tried - found
                run.stop.is_passed(done, [[True] * found + [False] * failed])
            print(f"    step {done}: {found} of {tried}", flush=True)

    begin = time.process_time()
    with prepared(config) as run:
        seed_run(run.model, config.seed, 0)
        run.model.set_logger(configure(None, []))
        pretrain(run.model, config)
        run.model.learn(config.steps, callback=Test())
    test.close()
    is_learned = bool(tests) and tests[-1][1] >= 0.99 * episodes
    return {
        "steps": tests[-1][0] if is_learned else None,
        "tests": tests,
        "processor time [s]": round(time.process_time() - begin),
    }


def _row(step: int, info: dict[str, Any]) -> EpisodeRow:
    """Return a finished episode as a training notes it, without force and time."""
    done = info["episode"]
    return EpisodeRow(step, done["r"], done["l"], int(info["success"]), math.nan, 0.0)


def main() -> None:
    """Demonstrate, train, and say what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--steps", type=int, default=LengthConfig.steps)
    parser.add_argument("--every", type=int, default=1000)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--share", type=float, help="as --teacher-share of a training")
    parser.add_argument("--pretrain", type=int, help="as of dovetail train")
    parser.add_argument("--only-show", action="store_true")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    out = given.out or Path(tempfile.mkdtemp(prefix="demonstrations-"))
    facts = demonstrate(out, given.count, seed=1)
    print(f"dovetail {dovetail.__version__}: {json.dumps(facts)} in {out}", flush=True)
    if given.only_show:
        return
    shown = (str(out / DEMONSTRATIONS),)
    results: dict[str, list[Any]] = {"demonstrations": [], "none": []}
    for name, demos in (("demonstrations", shown), ("none", ())):
        for seed in given.seeds:
            print(f"  seed {seed}, {name}", flush=True)
            folder = out / f"{name}-{seed}"
            config = TrainConfig(
                out=folder,
                seed=seed,
                steps=given.steps,
                demos=demos,
                teacher_share=given.share if demos else None,
                pretrain=given.pretrain if demos else None,
                threads=1,
            )
            found = steps_to_learn(config, given.every, given.episodes)
            results[name].append(found["tests"])
            print(f"    learned at {found['steps']}: {json.dumps(found)}", flush=True)
    for name, runs in results.items():
        for share in (0.90, 0.99):
            enough = share * given.episodes
            steps = [
                min((s for s, n in tests if n >= enough), default=math.inf)
                for tests in runs
            ]
            print(f"{share:.0%}, {name}: {steps}, median {np.median(steps):.0f}")


if __name__ == "__main__":
    main()
