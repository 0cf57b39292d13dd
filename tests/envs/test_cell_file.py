"""An environment in a cell file's cell: draws, starts, walls, tare, both ends."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest

from arms.loopback import lockstep_address
from dovetail.arms.address import parse_address
from dovetail.envs.config import EnvConfig
from dovetail.envs.free_start import StartError
from dovetail.envs.log_facts import CELL, describe_cell
from dovetail.envs.registered import find_cell, make, make_env, register_task
from dovetail.errors import ArmError, ConfigError, PolicyError
from dovetail.evaluation.config import EvaluationConfig, environment_options
from dovetail.evaluation.evaluate import evaluate
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import read_settings, to_toml
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import make_policy_env, policy_settings
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, FLAG_MASK
from dovetail.plants.twin import load_twin
from dovetail.poses import (
    Pose,
    quat_about_z,
    quat_from_matrix,
    rotation_error,
    tool_down,
)
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.region import Region
from dovetail.workcell.cell_config import CellConfig, load_cell
from extras import need

EXAMPLE = Path(__file__).parents[2] / "examples" / "cell.toml"
PEG = "dovetail/PegInHole-v0"


@pytest.fixture(scope="module")
def cell():
    return load_cell(EXAMPLE)


def test_fixtures_and_starts_are_drawn_where_the_file_says(cell):
    env = make(PEG, cell=cell)
    core, region = env.unwrapped, Region.of(env.unwrapped.cell)
    for seed in range(20):
        env.reset(seed=seed)
        assert (core.fixture.position >= np.array(region.low) - 1e-12).all()
        assert (core.fixture.position <= np.array(region.high) + 1e-12).all()
        at = core.state.tool.position
        assert (at >= np.array(cell.start_low) - 1e-3).all()
        assert (at <= np.array(cell.start_high) + 1e-3).all()
    assert core.cell.walls == (cell.walls_low, cell.walls_high)
    assert tuple(core.arm.facts.limits.x_min) == cell.walls_low
    env.close()


def test_a_path_a_table_and_a_cell_are_the_same(cell):
    ways = [make(PEG, cell=way).unwrapped for way in (str(EXAMPLE), cell.table(), cell)]
    names = {core.cell.name for core in ways}
    assert len(names) == 1
    assert find_cell().name not in names
    seen = [core.reset(seed=4)[0] for core in ways]
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], seen[2])


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_the_table_stands_where_the_file_says_in_each_engine(engine):
    """A tool that is pressed down meets the table 0.12 m higher."""
    if engine == "bullet":
        need("pybullet")
    raised = CellConfig(
        table_height=0.12,
        walls_low=(0.38, -0.22, 0.15),
        walls_high=(0.82, 0.22, 0.42),
        fixture_low=(0.6, 0.0, 0.22),
        fixture_high=(0.6, 0.0, 0.22),
        fixture_yaw=(0.0, 0.0),
    )
    for cell, top in ((None, 0.0), (raised, 0.12)):
        plant = make_plant(engine, find_cell(cell=cell))
        robot, chain = plant.robot, plant.robot.chain()
        aside = Pose(np.array([0.55, 0.15, top + 0.003]), tool_down(0.0))
        q = robot.inverse_kinematics(aside, robot.posture("down"))
        plant.reset(q, Pose(np.array([0.6, -0.1, top + 0.1]), quat_about_z(0.0)))
        for _ in range(100):
            q, dq = plant.read()
            position, rotation = chain.pose(q)[:2]
            pull = 1000.0 * (aside.position - position - np.array([0.0, 0.0, 0.02]))
            turn = 60.0 * rotation_error(aside.quat_wxyz, quat_from_matrix(rotation))
            plant.apply(chain.jacobian(q).T @ [*pull, *turn] - 10.0 * dq, 0.005)
        assert plant.tool_pose().position[2] == pytest.approx(top, abs=5e-4)
        assert plant.contact_force()[2] > 5.0
        plant.close()


@dataclass(frozen=True, kw_only=True)
class Own(PegInHole):
    """A task of one's own: no region, one trial pose, starts that may not be."""

    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("one", 0.6, 0.0, 0.1, 0.0),
    )
    trial_region: ClassVar[Region | None] = None

    def draw_in(self, rng, region):
        return region.draw(rng, self.trial_poses[0].facing)

    def draw_start(self, rng, fixture):
        start = super().draw_start(rng, fixture)
        aside = np.array([0.0, rng.choice([0.0, 1.0]), 0.0])
        return start._replace(position=start.position + aside)


def test_the_region_is_drawn_from_for_a_task_of_ones_own_too(cell):
    env = make_env(Own, cell=cell)
    for seed in range(10):
        env.reset(seed=seed)
        assert (env.fixture.position >= np.array(cell.fixture_low) - 1e-12).all()
        assert env.state.tool.position[1] < cell.walls_high[1]
    assert Own().trial_poses_in(env.cell)[0][1:4] == pytest.approx((0.54, 0.15, 0.22))
    env.close()


def test_a_start_that_cannot_be_ends_no_evaluation(cell, tmp_path):
    @dataclass(frozen=True, kw_only=True)
    class Behind(Own):
        def draw_start(self, rng, fixture):
            start = PegInHole.draw_start(self, rng, fixture)
            far = 1.0 if fixture.position[0] < 0.52 else 0.0  # one of three places
            aside = np.array([0.0, far, 0.0])
            return start._replace(position=start.position + aside)

    Behind.trial_poses = PegInHole.trial_poses
    Behind.trial_region = PegInHole.trial_region
    register_task("CellBehind-v0", Behind)
    policy = Policy.load(find_policy("peg_square"))
    policy.metadata["env_id"] = "CellBehind-v0"
    file = policy.save(tmp_path / "policy")
    found = evaluate(
        EvaluationConfig(
            policy=str(file),
            env="CellBehind-v0",
            plant="mujoco",
            cell=cell,
            tries=1,
            max_steps=2,
            out=tmp_path / "out",
        )
    )
    reasons = [outcome.stop.reason for outcome in found.outcomes]
    assert reasons == ["start", "", ""]
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["config"]["cell"] == cell.table()


def test_a_fixture_before_which_no_start_can_be_is_drawn_again():
    """Half of the region has no start in the box: training goes on with the other."""
    cell = CellConfig(
        fixture_low=(0.50, -0.02, 0.1),
        fixture_high=(0.72, 0.02, 0.1),
        fixture_yaw=(0.0, 0.0),
        start_low=(0.40, -0.2, 0.05),
        start_high=(0.48, 0.2, 0.28),
    )
    env = make(PEG, cell=cell)
    at = []
    for seed in range(12):
        env.reset(seed=seed)
        at.append(env.unwrapped.fixture.position[0])
    assert max(at) < 0.48 + 0.12
    far = Pose(np.array([0.72, 0.0, 0.1]), quat_about_z(0.0))
    with pytest.raises(StartError):
        env.reset(options={"fixture": far})
    env.close()


@pytest.mark.parametrize(
    ("place", "seed"),
    [
        ((0.5, 0.12, 0.15, 0.0), 6),  # joint 4 within the limits' margin
        ((0.5, -0.12, 0.1, 1.0), 7),
        ((0.5, 0.12, 0.15, 0.0), 5),  # the inner wall's margin in the tare's way
        ((0.5, -0.12, 0.1, 1.0), 5),
    ],
)
def test_the_limits_hold_no_tare_near_the_inner_edge_of_reach(place, seed):
    from dovetail.evaluation.trials import plan_trials

    env = gym.make(PEG, twin="medium").unwrapped
    job = plan_trials(1, 12, 0)[seed]
    fixture = FixturePose.given(place).pose()
    _, info = env.reset(seed=job.seed, options={"fixture": fixture})
    flags = env.state.log[:, COLUMN["flags"]].astype(int)
    for name in ("joint_position", "wall_position"):
        assert not (flags & FLAG_MASK[name]).any()
    # By the weight that the model misses there, see docs/tare.md.
    assert info["tare"][0] == pytest.approx(-1.0, abs=0.15)
    env.close()


def test_the_files_hold_the_content_and_not_the_path(cell, tmp_path):
    config = TrainConfig(cell=EXAMPLE)
    assert config.cell == cell
    assert config.policy_env()["cell"] == cell.table()
    assert json.loads(json.dumps(config.to_json()))["cell"] == cell.table()
    file = tmp_path / "config.toml"
    file.write_text(to_toml(config))
    assert read_settings(file)["cell"] == cell
    other = TrainConfig(cell=replace(cell, tool_mass=1.6))
    with pytest.raises(ConfigError) as error:
        other.require_same(config)
    assert error.value.name == "cell.tool_mass"
    assert "--cell" in config.command()
    file.write_text('cell = "beside.toml"\n')
    (tmp_path / "beside.toml").write_text(EXAMPLE.read_text())
    assert read_settings(file)["cell"] == cell
    env = make(PEG, cell=cell)
    assert describe_cell(env)[CELL]["cell"] == cell.table()
    assert "cell" not in describe_cell(make(PEG))[CELL]


def test_a_policys_file_gives_content_and_no_path_and_no_walls_to_a_robot(cell):
    policy = Policy.load(find_policy("peg_square"))
    env = policy.metadata["env"]
    env["cell"] = str(EXAMPLE)
    with pytest.raises(PolicyError):
        policy_settings(policy.metadata)
    env["cell"] = cell.table()
    assert policy_settings(policy.metadata)["cell"] == cell
    here = make_policy_env(policy)
    assert here.unwrapped.cell.own == cell.describe()
    robot = {"arm": "fri://127.0.0.1:30200"}
    with pytest.raises(ConfigError, match="--cell"):
        make_policy_env(policy, **robot)
    asked = EvaluationConfig(policy="peg_square", fixture=(0.6, 0.0, 0.1, 0.0), **robot)
    with pytest.raises(ConfigError, match="--cell"):
        environment_options(asked, policy.metadata)
    given = environment_options(replace(asked, cell=cell), policy.metadata)
    assert given["cell"] == cell


def test_an_arm_that_was_built_for_another_cell_is_refused(cell):
    arm = make(PEG).unwrapped.arm
    for other in (
        CellConfig(walls_high=(0.8, 0.22, 0.3)),
        CellConfig(tool_length=0.19),
        CellConfig(tool_mass=1.3),
    ):
        with pytest.raises(ConfigError) as error:
            make_env(PegInHole, arm, EnvConfig(cell=other))
        assert error.value.name == "cell"
    same = make_env(PegInHole, arm, EnvConfig(cell=CellConfig(tool_opening=0.1)))
    assert same.cell.own
    arm.close()


def test_a_service_of_another_cell_is_refused_with_both(cell):
    need("grpc")
    from dovetail.rpc.server import ArmServer

    walls = replace(cell, tool=None, tool_length=None, tool_mass=None)
    offered = OfferedArm(parse_address("mujoco"), find_cell())
    with ArmServer(offered, "127.0.0.1:0") as server:
        with pytest.raises(ConfigError, match="tool"):
            make(PEG, arm=server.url, cell=cell)  # by the arm's masses
        with pytest.raises(ConfigError) as error:
            make(PEG, arm=server.url, cell=walls)
    assert walls.describe() in str(error.value)
    assert repr(find_cell().name) in str(error.value)


def test_a_cabinet_of_another_cell_is_refused_with_both(cell):
    plant = make_plant("mujoco", find_cell())
    fixture = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
    plant.reset(plant.robot.posture("down"), fixture)
    with lockstep_address(plant) as address:
        env = make(PEG, arm=address, cell=cell, tare=False)
        with pytest.raises(ArmError) as error:
            env.reset(seed=0)
        assert "no cell file" in str(error.value)
        assert "tool_length 0.25" in str(error.value)
        env.close()


def test_a_twin_is_of_the_cell_too(cell):
    env = make(PEG, cell=cell, twin=load_twin("medium"))
    env.reset(seed=1)
    mass = env.unwrapped.cell.payload().mass
    assert mass == pytest.approx(find_cell().payload().mass + 0.3)
    env.close()
