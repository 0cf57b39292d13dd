"""Each try starts a policy's memory anew, wherever the arm is."""

from contextlib import contextmanager

import gymnasium as gym
import numpy as np
import pytest

from arms.loopback import lockstep_address
from dovetail.arms.address import parse_address
from dovetail.envs.registered import find_cell
from dovetail.evaluation.job import TrialJob
from dovetail.evaluation.trials import run_trials
from dovetail.learn.policy import Policy
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.tasks.peg_in_hole.task import PegInHole
from extras import need

ID = "dovetail/PegInHole-v0"
Q_START = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0])
STEPS = 12


class Remembering(Policy):
    """A policy of one's own whose actions depend on all that the episode has shown."""

    def __init__(self, *args):
        super().__init__(*args)
        self.state = np.zeros(4)
        self.weights = np.random.default_rng(8).normal(size=(18, 4))

    def reset(self):
        self.state = np.zeros(4)

    def __call__(self, observation):
        self.state = np.tanh(np.append(observation, self.state) @ self.weights)
        return self.state.astype(np.float32)


@contextmanager
def here():
    yield "mujoco"


@contextmanager
def cabinet():
    plant = make_plant("mujoco", find_cell(), DynamicsConfig())
    plant.reset(Q_START, PegInHole.trial_poses[0].pose())
    with lockstep_address(plant) as address:
        yield address


@contextmanager
def service():
    need("grpc")
    from dovetail.rpc.offered_arm import OfferedArm
    from dovetail.rpc.server import ArmServer

    server = ArmServer(OfferedArm(parse_address("mujoco"), find_cell()), "127.0.0.1:0")
    server.start()
    try:
        yield f"{server.url}&margins=model"
    finally:
        server.close()


def paths(address, load):
    """Return the paths of three tries of which two have the same seed."""
    jobs = [TrialJob(0, i, seed) for i, seed in enumerate((5, 6, 5))]
    make = lambda: gym.make(ID, arm=address, max_episode_steps=STEPS)  # noqa: E731
    outcomes = run_trials(make, load, jobs, poses=PegInHole.trial_poses)
    return [outcome.course.path for outcome in outcomes]


@pytest.mark.parametrize("ground", [here, cabinet, service])
def test_a_try_does_not_depend_on_the_try_before(ground, policy_file):
    with ground() as address:
        first, other, again = paths(address, lambda: Remembering.load(policy_file))
    assert len(first) == len(again)
    np.testing.assert_allclose(first, again, atol=1e-9, rtol=0.0)
    assert np.abs(first[-1] - other[-1]).max() > 1e-3


def test_without_reset_it_would(policy_file):
    class NeverReset(Remembering):
        def reset(self):
            pass

    first, _, again = paths("mujoco", lambda: NeverReset.load(policy_file))
    assert np.abs(first - again).max() > 1e-5
