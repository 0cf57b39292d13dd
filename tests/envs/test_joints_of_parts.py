"""Joints of parts in states, columns, logs, messages and pictures."""

from contextlib import closing
from dataclasses import dataclass, replace

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from dovetail import PegInHole, Progress, register_task
from dovetail.cockpit.recorded import _parts
from dovetail.envs.free_start import StartCheck
from dovetail.envs.log_facts import part_columns
from dovetail.envs.observation import Layout
from dovetail.envs.registered import find_cell
from dovetail.episode import Episode, unit_of
from dovetail.errors import ConfigError, LogError
from dovetail.plants.mjcf import model_positions
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import matrix_from_quat
from dovetail.robots.iiwa14 import iiwa14
from dovetail.view.cell_model import cell_spec
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, Part, Primitive
from extras import need
from plants.conftest import HOLE, Q_BENT

OPEN = 0.5
STEP = np.zeros(4, dtype=np.float32)


def door():
    """Return a door beside the hole that falls shut."""
    joint = Joint(
        name="door",
        kind="hinge",
        axis=np.array([0.0, 1.0, 0.0]),
        origin=np.array([0.08, 0.0, 0.0]),
        range=(0.0, 1.5),
        start=OPEN,
    )
    leaf = Primitive(
        "leaf", "box", (0.04, 0.04, 0.002), np.array([0.12, 0.0, 0.0]), mass=0.1
    )
    return Moving(joint, (leaf,))


@dataclass(frozen=True, kw_only=True)
class DoorBesideHole(PegInHole):
    """Done is that the door has fallen."""

    columns: tuple[str, ...] = ("position", "parts")

    def fixture(self, widened: float) -> Part:
        return replace(super().fixture(widened), moving=(door(),))

    def judge(self, error, goal, state) -> Progress:
        return Progress(float(state.parts[0]), bool(state.parts[0] > 1.0))


register_task("test/DoorBesideHole-v0", DoorBesideHole)


@pytest.fixture
def env():
    with closing(gym.make("test/DoorBesideHole-v0", tare=False)) as env:
        yield env


def test_a_task_judges_by_the_joint_and_shows_it_where_asked(env):
    env.reset(seed=0)
    core = env.unwrapped
    assert core.state.parts == pytest.approx([OPEN])
    assert part_columns(env) == ("hinge_door",)
    assert [c.name for c in core.columns][-1] == "obs_hinge_door"
    info = {"success": False}
    for _ in range(40):
        *_, info = env.step(STEP)
        if info["success"]:
            break
    assert info["success"]
    assert core.state.parts[0] > 1.0
    assert info["observation_raw"][-1] == core.state.parts[0]


def test_joints_are_shown_only_where_asked():
    with closing(gym.make("dovetail/PegInHole-v0")) as env:
        env.reset(seed=0)
        assert env.unwrapped.state.parts.shape == (0,)
    with pytest.raises(ConfigError):
        Layout(("position", "parts"), iiwa14(), np.zeros(3))


def test_a_log_has_a_column_for_each_joint(tmp_path):
    log = np.zeros((3, len(CYCLE_COLUMNS)))
    log[:, CYCLE_COLUMNS.index("time")] = 0.0, 0.005, 0.01
    later = log.copy()
    later[:, CYCLE_COLUMNS.index("time")] += 0.015
    episode = Episode(metadata={}, parts=("hinge_door", "slide_x"), observed=())
    episode.append(log, 0, [0.0], 0.0, parts=[0.5, 0.01])
    episode.append(later, 1, [0.0], 0.0, parts=[0.6, 0.02])
    read = Episode.load(episode.save(tmp_path / "log.npz"))
    np.testing.assert_array_equal(read["hinge_door"], [0.5] * 3 + [0.6] * 3)
    units = dict(zip(read.columns, read.units, strict=True))
    assert (units["hinge_door"], units["slide_x"]) == ("rad", "m")
    assert unit_of("screw_nut") == unit_of("obs_screw_nut") == "rad"
    columns = {name: read[name] for name in read.columns}
    assert _parts(columns, ["hinge_door", "slide_x"])[-1] == pytest.approx([0.6, 0.02])
    assert _parts(columns, ["hinge_other"]).shape == (6, 0)
    with pytest.raises(LogError):
        episode.append(log, 2, [0.0], 0.0, parts=[0.5])


def test_a_log_of_an_arm_that_knows_no_joints_has_not_a_number(tmp_path):
    episode = Episode(metadata={}, parts=("hinge_door",), observed=())
    episode.append(np.zeros((1, len(CYCLE_COLUMNS))), 0, [0.0], 0.0)
    assert np.isnan(Episode.load(episode.save(tmp_path / "log.npz"))["hinge_door"][0])


def test_a_message_carries_the_joints(env):
    need("grpc")
    from dovetail.rpc import dovetail_pb2 as pb
    from dovetail.rpc.messages import read_state, write_state

    env.reset(seed=0)
    message = pb.ArmState()
    write_state(env.unwrapped.state, message)
    assert read_state(message).parts == pytest.approx([OPEN])


def test_a_start_is_checked_with_the_joints_where_they_start(env):
    cell = env.unwrapped.cell
    assert StartCheck(cell).overlap(Q_BENT, HOLE).depth == 0.0


def test_a_picture_shows_the_piece_where_it_is(env):
    from dovetail.view.renderer import Renderer

    with closing(Renderer(env.unwrapped.cell)) as renderer:
        start = renderer.draw(Q_BENT, HOLE)
        given = renderer.draw(Q_BENT, HOLE, parts=np.array([OPEN]))
        fallen = renderer.draw(Q_BENT, HOLE, parts=np.array([1.4]))
    np.testing.assert_array_equal(start, given)
    assert np.abs(start.astype(int) - fallen).max(axis=2).astype(bool).sum() > 100


def test_a_drawn_screw_lies_where_its_turn_puts_it():
    lid = np.array([0.0, 0.0, 0.01])
    cap = Primitive("cap", "box", (0.02, 0.01, 0.005), lid, mass=0.1)
    thread = Joint(
        name="thread", kind="screw", axis=(0.0, 0.6, 0.8), pitch=-0.03,
        origin=(0.01, 0.02, 0.0), range=(-9.0, 9.0), start=0.5,
    )  # fmt: skip
    screw = Moving(thread, (cap,))
    fixture = replace(find_cell().fixture, moving=(door(), screw))
    cell = replace(find_cell(), make_fixture=lambda _: fixture)
    model = cell_spec(cell).compile()
    data = mujoco.MjData(model)
    data.mocap_pos[0], data.mocap_quat[0] = HOLE
    data.qpos[:] = model_positions(Q_BENT, cell.joints, np.array([0.7, 4.0]))
    mujoco.mj_kinematics(model, data)
    (shape,) = screw.at(4.0)
    expected = HOLE.position + shape.position
    np.testing.assert_allclose(data.geom("cap").xpos, expected, atol=1e-12)
    R = data.geom("cap").xmat.reshape(3, 3)
    np.testing.assert_allclose(R, matrix_from_quat(shape.quat_wxyz), atol=1e-9)
