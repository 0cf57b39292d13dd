"""The same policy and evaluation over FRI, on a cabinet in lockstep."""

from contextlib import contextmanager
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from arms.loopback import free_port, lockstep_address, make_cabinet
from dovetail.envs.registered import find_cell
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.learn.config import TrainConfig
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z
from extras import need

HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
Q_START = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0])


@contextmanager
def cabinet(clearance=0.002):
    """Yields the address of an arm behind a lockstep cabinet."""
    plant = make_plant("mujoco", find_cell(clearance=clearance), DynamicsConfig())
    plant.reset(Q_START, HOLE)
    with lockstep_address(plant) as address:
        yield address


def run(policy_file, out, **settings):
    config = EvaluationConfig(policy=str(policy_file), tries=1, out=out, **settings)
    return evaluate(config, Console(file=StringIO()))


def test_the_policy_inserts_over_fri_as_in_this_process(policy_file, tmp_path):
    with cabinet() as address:
        over_fri = run(policy_file, tmp_path / "fri", arm=address)
    here = run(policy_file, tmp_path / "here", arm="mujoco")
    assert over_fri.rows[-1].successes == here.rows[-1].successes == 3
    assert over_fri.rows[-1].violations == 0
    assert np.isnan(over_fri.rows[-1].force.peak)
    for mine, theirs in zip(over_fri.outcomes, here.outcomes, strict=True):
        mine, theirs = mine.course, theirs.course
        assert abs(mine.steps - theirs.steps) <= 3  # FRI sends no velocity
        np.testing.assert_allclose(mine.path[0], theirs.path[0], atol=1e-4)


def test_pushes_and_a_moving_hole_are_the_same_over_fri(policy_file, tmp_path):
    asked = {"push": 30.0, "fixture_speed": 0.02, "fixture": (0.6, 0.0, 0.1, 0.0)}
    with cabinet() as address:
        over_fri = run(policy_file, tmp_path / "fri", arm=address, **asked).outcomes[0]
    here = run(policy_file, tmp_path / "here", arm="mujoco", **asked).outcomes[0]
    calm = {"fixture": asked["fixture"], "fixture_speed": 0.02}
    calm = run(policy_file, tmp_path / "calm", arm="mujoco", **calm).outcomes[0]
    assert over_fri.conditions.perturbation == here.conditions.perturbation
    over_fri, here, calm = (o.course.path for o in (over_fri, here, calm))
    count = min(200, len(here), len(over_fri), len(calm))
    pushed = np.abs(calm[:count] - here[:count]).max()
    assert pushed > 1e-3
    between = np.abs(over_fri[:count] - here[:count]).max()
    assert between < pushed / 3.0


@pytest.mark.parametrize(
    ("policy", "search"), [("peg_square", "corner"), ("search_square", "none")]
)
def test_a_hidden_hole_is_found_over_a_link_that_loses(policy, search, tmp_path):
    plant = make_twin(load_twin("medium"), find_cell(clearance=0.0005))
    plant.reset(Q_START, HOLE)
    # Twice 5 % of 100 answers are missing now and then in more than 20.
    port = free_port()
    asked = {"patience": 1.0, "good_from": 0.5}
    cabinet = make_cabinet(plant, port, 0.005, clock="lockstep", **asked)
    with cabinet:
        cabinet.request({"do": "fault", "text": "loss=0.05"})
        found = evaluate(
            EvaluationConfig(
                policy=policy,
                search=search,
                arm=f"fri://127.0.0.1:{port}?clock=lockstep"
                f"&control={cabinet.control_address}",
                fixture=(0.6, 0.0, 0.1, 0.0),
                fixture_shift=0.02,
                tries=1,
                accept_contact=True,
                out=tmp_path / "out",
            ),
            Console(file=StringIO()),
        )
        counts = cabinet.status()["counts"]
    plant.close()
    assert found.rows[-1].successes == 1
    assert found.rows[-1].violations == 0
    assert counts["active_missed"] > 50
    assert counts.get("stops", 0) <= 1  # the client's leave


@pytest.mark.parametrize("reset", ["place", "move"])
def test_an_arm_over_fri_can_be_trained_on_directly(reset, tmp_path):
    need("sbx")
    from dovetail.learn.train import train

    with cabinet(0.0005) as address:
        config = TrainConfig(
            out=tmp_path / "run",
            arm=f"{address}&reset={reset}",
            fixed_goal=True,
            from_policy="peg_square",
            steps=60,
            learning_starts=100,
            max_steps=20,
            eval_episodes=1,
        )
        (result,) = train(config)
    assert result.steps == 60
    assert result.evaluation["limit_violations"] == 0
