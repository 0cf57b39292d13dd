"""Logs of other people, and of other robots, in the replay."""

import json
import warnings

import numpy as np
import pytest

from dovetail.cockpit.recorded import COLUMNS, Recorded
from dovetail.envs.log_facts import CELL, describe_cell
from dovetail.envs.registered import DEFAULT_ENV, make_env, task_class
from dovetail.episode import Episode
from dovetail.errors import ConfigError, LogError, MissingDependencyError
from dovetail.robots.find import whole_robot
from robots.arm_files import urdf


@pytest.fixture(scope="module")
def env():
    env = make_env(task_class(DEFAULT_ENV))
    yield env
    env.close()


@pytest.fixture
def write(env, tmp_path):
    def write(metadata, steps=4, action=0.0, name="log.npz"):
        env.reset(seed=4)
        episode = Episode(metadata=metadata)
        for step in range(steps):
            _, reward, *_ = env.step(np.full(4, action, dtype=np.float32))
            episode.append(env.state.log, step, np.zeros(4), reward)
        return episode.save(tmp_path / name)

    return write


def test_a_log_is_drawn_at_any_time(write, env):
    recorded = Recorded.load(write(describe_cell(env)))
    assert recorded.end == pytest.approx(0.2, abs=0.006)
    for time, row in ((-1.0, 0), (0.0, 0), (recorded.end, -1), (99.0, -1)):
        np.testing.assert_array_equal(recorded.at(time)[0], recorded.q[row])
    assert recorded.curves.shape[1] == len(COLUMNS)
    assert len(recorded.path(recorded.end)) <= 601


def test_a_log_that_says_nothing_of_its_cell_gets_the_usual_one(write, env):
    recorded = Recorded.load(write({}))
    assert recorded.cell.name == env.cell.name


def test_a_fixture_of_an_evaluation_stands_where_the_try_had_it(write, env):
    pose = env.task.trial_poses[1]
    recorded = Recorded.load(write({"fixture_pose": pose._asdict()}))
    np.testing.assert_allclose(
        recorded.at(0.1)[2].position, pose.pose().position, atol=1e-12
    )


def test_a_log_that_tells_of_neither_belief_nor_pull_is_drawn_without(write):
    recorded = Recorded.load(write({}))
    assert recorded.believed_at(0.1) is None
    np.testing.assert_array_equal(recorded.pull_at(0.1), 0.0)


def test_belief_and_pull_are_the_last_that_was_noted(write):
    file = write({})
    begin = float(Episode.load(file)["time"][0])
    metadata = {
        "believed_path [s, m, wxyz]": [
            [begin, 0.6, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0],
            [begin + 0.1, 0.6, 0.02, 0.1, 1.0, 0.0, 0.0, 0.0],
        ],
        "pull_path [s, N]": [[begin, 0.0, 0.0, 0.0], [begin + 0.05, 0.0, 7.0, 0.0]],
    }
    recorded = Recorded.load(write(metadata))
    for time, y, force in ((0.0, 0.0, 0.0), (0.06, 0.0, 7.0), (0.15, 0.02, 7.0)):
        assert recorded.believed_at(time).position[1] == pytest.approx(y)
        assert recorded.pull_at(time)[1] == pytest.approx(force)


@pytest.mark.parametrize("key", ["believed_path [s, m, wxyz]", "pull_path [s, N]"])
@pytest.mark.parametrize("rows", ["x", [[1, 2]], [[0.0] * 7 + [float("inf")]]])
def test_a_belief_or_pull_that_is_no_table_is_refused(write, key, rows):
    with pytest.raises(LogError, match="its"):
        Recorded.load(write({key: rows}))


def test_an_unmeasured_force_is_the_estimated_one(write, env, tmp_path):
    episode = Episode.load(write({}))
    measured = Recorded.load(tmp_path / "log.npz")
    assert not measured.is_estimated
    columns = [episode.columns.index(name) for name in ("fx", "fy", "fz")]
    episode.data[:, columns] = np.nan
    estimated = Recorded.load(episode.save(tmp_path / "estimated.npz"))
    assert estimated.is_estimated
    np.testing.assert_array_equal(estimated.force[:, 2], episode["wrench_fz"])
    assert np.isfinite(estimated.curves[:, COLUMNS.index("force")]).all()


def test_two_logs_are_as_far_apart_as_they_were(write):
    one = Recorded.load(write({}, name="one.npz"))
    two = Recorded.load(write({}, action=0.5, name="two.npz"))
    apart = one.compared(two)[:, -1]
    assert apart[0] < 1.0
    expected = 1e3 * np.linalg.norm(one.position[-1] - two.position[-1])
    assert apart[-1] == pytest.approx(expected)
    assert expected > 0.5
    np.testing.assert_array_equal(one.compared(one)[:, -1], 0.0)


@pytest.mark.parametrize(
    ("cell", "why"),
    [
        ({"env_id": "evil:Env-v0"}, "if you trust it"),
        ({"env_id": "evil:Env.xml"}, "if you trust it"),
        ({"robot": "evil:make"}, "if you trust it"),
        ({"env_id": "dovetail/Nothing-v9"}, "unknown"),
        ({"task": {"clearance": 99.0}}, "clearance"),
        ({"task": {"nonsense": 1}}, "nonsense"),
        ("text", "no table"),
    ],
)
def test_a_log_may_name_no_module_and_nothing_unknown(write, cell, why):
    with pytest.raises((ConfigError, LogError), match=why):
        Recorded.load(write({CELL: cell}))


def test_a_log_of_another_robot_than_the_one_given_is_refused(write, env):
    file = write(describe_cell(env))
    with pytest.raises(ConfigError, match="the log says 'iiwa14'"):
        Recorded.load(file, robot="my_robot:make")


def test_a_log_may_hold_the_robot_of_the_file_that_is_given(write, env, tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(urdf())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what the file leaves open
        log = write(describe_cell(env) | {CELL: {"robot": whole_robot(str(file))}})
        assert Recorded.load(log, robot=str(file)).cell.robot.name == "arm"


@pytest.mark.parametrize(
    "place", ["x", [[1, 2]], [[0.0, 0.6, 0.0, float("nan"), 1, 0, 0, 0]]]
)
def test_a_fixture_that_is_nowhere_is_refused(write, place):
    metadata = {"fixture_path [s, m, wxyz]": place}
    with pytest.raises(LogError, match="fixture"):
        Recorded.load(write(json.loads(json.dumps(metadata))))


def test_an_empty_log_and_one_cut_short_are_refused(write, tmp_path):
    with pytest.raises(LogError, match="empty"):
        Recorded.load(write({}, steps=0))
    file = write({}, name="whole.npz")
    cut = tmp_path / "cut.npz"
    cut.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(LogError, match="cut short"):
        Recorded.load(cut)


def test_a_page_without_viser_says_what_to_install(monkeypatch):
    import sys

    from dovetail.cockpit.server import open_server

    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingDependencyError, match="viser"):
        open_server(0)
