"""Tries are seeded, logged, and measured in the hole's frame."""

from functools import partial
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from dovetail.arms.arm import ArmState, ToolState
from dovetail.envs.config import EnvConfig
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.free_start import Overlap, OverlapError, StartError
from dovetail.envs.observation import GROUPS, USUAL_GROUPS
from dovetail.envs.registered import find_cell
from dovetail.episode import Episode
from dovetail.errors import ArmError, ConfigError
from dovetail.evaluation import trials
from dovetail.evaluation.job import TrialJob
from dovetail.evaluation.transfer import summarise
from dovetail.evaluation.trials import plan_trials, run_trials
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.tasks.peg_in_hole.task import PegInHole

CYCLES = 10


def known(log):
    """The state of an arm of which nobody asks but its log and flags."""
    zero, tool = np.zeros(3), ToolState(*[np.zeros(3)] * 3)
    return ArmState(zero, zero, zero, tool, zero, zero, flags=0, log=log)


class FallingEnv(ContactEnv):
    """The tool sinks 4 mm per step from above the hole; no physics."""

    def __init__(
        self, drop=0.004, force=(3.0, 0.0, 4.0), fail_at=None, error=RuntimeError
    ):
        self.observation_space = gym.spaces.Box(-1, 1, (14,))
        self.action_space = gym.spaces.Box(-1, 1, (4,))
        self.drop, self.force, self.fail_at = drop, force, fail_at
        self.error = error
        self.task, self.config = PegInHole(), EnvConfig()  # a log names these
        self.commands = SimpleNamespace(axes=("X", "Y", "Z", "A"), scale=[4.0] * 4)
        columns = [column for name in USUAL_GROUPS for column in GROUPS[name].columns]
        self.scaling = SimpleNamespace(columns=columns)
        self.cell = find_cell()

    def reset(self, *, seed=None, options=None):
        gym.Env.reset(self, seed=seed)
        self.fixture = self.believed = options["fixture"]
        self.height = self.np_random.uniform(0.01, 0.05)
        self.time, self.steps = 0.0, 0
        self.state = known(np.empty((0, len(CYCLE_COLUMNS))))
        info = {"success": False, "depth": -self.height}
        return np.zeros(14), info | {"observation_raw": np.zeros(14)}

    def step(self, action):
        if self.steps == self.fail_at:
            raise self.error("the plant diverged")
        log = np.zeros((CYCLES, len(CYCLE_COLUMNS)))
        log[:, COLUMN["time"]] = self.time + 0.005 * np.arange(CYCLES)
        log[:, COLUMN["x"] : COLUMN["z"] + 1] = self.fixture.position
        log[:, COLUMN["z"]] += self.height - self.drop * np.linspace(0, 1, CYCLES)
        if self.height < 0.0:
            log[CYCLES // 2 :, COLUMN["fx"] : COLUMN["fz"] + 1] = self.force
        self.time, self.steps = self.time + 0.05, self.steps + 1
        self.height -= self.drop
        self.state = known(log)
        success = self.height <= -0.028
        info = {
            "success": success,
            "depth": -self.height,
            "limit_violations": 1 if self.steps == 2 else 0,
            "observation_raw": np.zeros(14),
        }
        return np.zeros(14), 0.0, success, self.steps >= 30 and not success, info

    def close(self):
        """Nothing is held."""


class IdlePolicy:
    """Does nothing, and counts its steps since the last reset."""

    def __init__(self):
        self.steps = None

    def reset(self):
        self.steps = 0

    def __call__(self, observation):
        self.steps += 1
        return np.zeros(4, dtype=np.float32)


POSES = PegInHole.trial_poses


def run(jobs, make_env=FallingEnv, **options):
    return list(run_trials(make_env, IdlePolicy, jobs, poses=POSES, **options))


def test_hole_poses_differ_in_x_y_z_and_theta():
    for values in zip(*(pose[1:5] for pose in PegInHole.trial_poses), strict=True):
        assert len(set(values)) == 3
    assert len({pose.name for pose in PegInHole.trial_poses}) == 3


def test_plan_gives_every_try_a_seed_of_its_own_and_the_same_each_time():
    jobs = plan_trials(3, 20, seed=0)
    assert len(jobs) == 60
    assert len({job.seed for job in jobs}) == 60
    assert jobs == plan_trials(3, 20, seed=0)
    assert jobs != plan_trials(3, 20, seed=1)


@pytest.mark.parametrize(("tries", "seed"), [(0, 0), (-1, 0), (1, -1)])
def test_impossible_plans_are_refused(tries, seed):
    with pytest.raises(ConfigError, match="allowed: "):
        plan_trials(3, tries, seed)


def test_outcomes_come_in_order_with_what_the_environment_said():
    outcomes = run(plan_trials(3, 2, seed=0))
    assert [(o.job.pose, o.job.attempt) for o in outcomes] == [
        (pose, attempt) for pose in range(3) for attempt in range(2)
    ]
    for o in outcomes:
        assert o.success
        assert o.depth >= 0.028
        assert o.course.violations == 1
        assert 10 <= o.course.steps <= 25


def test_the_same_seed_gives_the_same_outcome_and_another_seed_another():
    first, again, other = run([TrialJob(0, 0, 5), TrialJob(0, 0, 5), TrialJob(0, 0, 6)])
    np.testing.assert_array_equal(first.course.path, again.course.path)
    assert first.course.path[0, 2] != other.course.path[0, 2]


def test_path_is_in_the_holes_frame():
    (outcome,) = run([TrialJob(2, 0, 5)])
    path = outcome.course.path
    np.testing.assert_allclose(path[:, :2], 0.0, atol=1e-12)
    assert path.shape == (CYCLES * outcome.course.steps, 3)
    assert 0.0 < path[0, 2] <= 0.05


def test_force_is_averaged_over_the_cycles_in_contact_only():
    (outcome,) = run([TrialJob(0, 0, 5)])
    assert outcome.force.peak == pytest.approx(5.0)
    assert outcome.force.mean == pytest.approx(5.0)
    assert 0 < outcome.force.cycles < CYCLES * outcome.course.steps
    assert outcome.force.step == pytest.approx(2.5)  # 5 N in half of the cycles


def test_a_try_that_times_out_is_no_success():
    (outcome,) = run([TrialJob(0, 0, 5)], partial(FallingEnv, drop=1e-5))
    assert not outcome.success
    assert outcome.course.steps == 30


def test_every_try_leaves_a_log_that_loads(tmp_path):
    outcomes = run(plan_trials(1, 2, seed=3), logs=tmp_path)
    for o in outcomes:
        episode = Episode.load(tmp_path / o.files.log)
        assert len(episode) == CYCLES * o.course.steps
        assert episode.metadata["seed"] == o.job.seed
        assert episode.metadata["fixture_pose"]["name"] == "A"


def test_a_try_that_dies_still_leaves_its_log(tmp_path):
    with pytest.raises(RuntimeError, match="diverged"):
        run([TrialJob(0, 0, 5)], partial(FallingEnv, fail_at=4), logs=tmp_path)
    episode = Episode.load(tmp_path / "A_00.npz")
    assert len(episode) == 4 * CYCLES


@pytest.mark.parametrize("step", [0, 3])
def test_a_try_that_the_arm_ends_is_a_failure_and_the_next_one_begins(tmp_path, step):
    class Stopping(FallingEnv):
        def __init__(self):
            super().__init__(fail_at=step, error=partial(ArmError, reason="no_target"))

    outcomes = run(plan_trials(1, 2, 0), Stopping, logs=tmp_path)
    assert [o.stop.reason for o in outcomes] == ["no_target"] * 2
    assert not any(o.success for o in outcomes)
    assert [o.course.steps for o in outcomes] == [step] * 2
    assert len(list(tmp_path.glob("*.npz"))) == 2


@pytest.mark.parametrize("reason", ["tare", "motion_ended"])
def test_what_ends_before_it_begins_is_a_missed_try_and_the_next_one_begins(
    tmp_path, reason
):
    class Swinging(FallingEnv):
        violations = SimpleNamespace(count=len)  # every cycle

        def reset(self, **options):
            self.resets = getattr(self, "resets", 0) + 1
            if self.resets == 1:
                state = known(np.zeros((7, len(CYCLE_COLUMNS))))
                raise ArmError("the rounds disagree", reason, state)
            return super().reset(**options)

    first, second = run(plan_trials(1, 2, 0), Swinging, logs=tmp_path)
    assert (first.stop.reason, first.success, first.course.steps) == (reason, False, 0)
    assert first.stop.text == "the rounds disagree"
    assert first.course.violations == 7  # no limit is exceeded unseen
    assert second.success


@pytest.mark.parametrize(
    "error",
    [StartError("too far"), OverlapError(Overlap(0.004, "peg", "block"), "go up")],
)
def test_a_start_that_cannot_be_is_a_missed_try_and_the_next_one_begins(error):
    class Beside(FallingEnv):
        def reset(self, **options):
            self.resets = getattr(self, "resets", 0) + 1
            if self.resets == 1:
                raise error
            return super().reset(**options)

    first, second = run(plan_trials(1, 2, 0), Beside)
    assert (first.stop.reason, first.success, first.course.steps) == ("start", False, 0)
    assert first.stop.text == str(error)
    assert second.success
    row = summarise([first, second], ["A"])[-1]
    assert row.force.peak == second.force.peak  # forces are of tries that began


def test_a_film_that_fails_is_noted_and_the_tries_go_on(tmp_path, monkeypatch):
    def fail(cell):
        raise ArithmeticError("out of memory")

    monkeypatch.setattr(trials, "Renderer", fail)
    monkeypatch.setattr(FallingEnv, "cell", None, raising=False)
    outcomes = run(plan_trials(1, 2, 0), films=tmp_path)
    assert [o.files.film_error for o in outcomes] == ["no A.gif: out of memory", ""]
    assert all(o.success for o in outcomes)


def test_an_arm_that_is_lost_at_the_reset_ends_the_tries():
    class Lost(FallingEnv):
        def reset(self, **options):
            raise ArmError("no cabinet", "no_cabinet")

    with pytest.raises(ArmError, match="no cabinet"):
        run(plan_trials(1, 2, 0), Lost)
