"""A folder of LeRobotDataset: its files, and what the package itself makes of them."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dovetail.envs.log_facts import CELL, describe_cell
from dovetail.errors import ConfigError, LogError
from dovetail.learn.lerobot_folder import write_lerobot
from dovetail.learn.recorded_steps import read_steps
from extras import need

from .test_demonstrations import STEPS, make, record

FOLDER = Path(sys.prefix) / "lerobot"
"""Where the Makefile puts the package, on top of what this interpreter has."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    need("pyarrow")
    folder = tmp_path_factory.mktemp("logs")
    env = make()
    record(env, folder / "001.npz", success=True, led=True)
    record(env, folder / "002.npz", seed=1, led=False)
    env.close()
    return folder


def test_the_tables_hold_what_the_logs_hold(logs, tmp_path):
    parquet = need("pyarrow.parquet")
    assert write_lerobot([logs], tmp_path / "set") == 2 * STEPS
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    steps = [read_steps(logs / f"00{i}.npz") for i in (1, 2)]
    states = np.array(table["observation.state"].to_pylist(), dtype=np.float32)
    wanted = np.concatenate([part.seen[:-1] for part in steps]).astype(np.float32)
    np.testing.assert_array_equal(states, wanted)
    actions = np.array(table["action"].to_pylist(), dtype=np.float32)
    np.testing.assert_array_equal(actions, np.concatenate([p.actions for p in steps]))
    np.testing.assert_array_equal(table["index"], np.arange(2 * STEPS))
    done = np.array(table["next.done"])
    assert done.sum() == 2
    assert np.array(table["next.success"]).nonzero()[0].tolist() == [STEPS - 1]
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())
    np.testing.assert_allclose(stats["action"]["mean"], actions.mean(axis=0), rtol=1e-5)
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert info["features"]["observation.state"]["names"][7] == "obs_x"
    assert (info["fps"], info["robot_type"]) == (20, "iiwa14")


def test_logs_of_two_robots_are_no_data_set_and_leave_nothing(logs, tmp_path):
    env = make()
    other = tmp_path / "other.npz"
    record(env, other, **{CELL: describe_cell(env)[CELL] | {"robot": "fr3"}})
    env.close()
    with pytest.raises(LogError, match="has the robot fr3"):
        write_lerobot([logs, other], tmp_path / "set")
    assert [path.name for path in tmp_path.iterdir()] == ["other.npz"]


@pytest.mark.parametrize(
    ("changed", "what"), [({"peg": "round"}, "task"), ({"f_scale": 2.0}, "scale")]
)
def test_logs_that_mean_something_else_are_no_data_set(logs, tmp_path, changed, what):
    env = make(**changed)
    record(env, tmp_path / "other.npz")
    env.close()
    with pytest.raises(LogError, match=f"has the {what}"):
        write_lerobot([logs, tmp_path / "other.npz"], tmp_path / "set")


def test_a_folder_that_holds_something_is_left_alone(logs, tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "mine").touch()
    with pytest.raises(ConfigError, match="holds mine"):
        write_lerobot([logs], tmp_path / "set")


@pytest.mark.slow
def test_the_package_itself_loads_the_folder_and_passes_its_checks(logs, tmp_path):
    if not (FOLDER / "ledataset").is_dir():
        pytest.skip(f"needs lerobot-dataset in {FOLDER}: make test puts it there")
    write_lerobot([logs], tmp_path / "set")
    done = subprocess.run(
        [sys.executable, Path(__file__).parent / "check_lerobot.py", tmp_path / "set"],
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
        env={
            **os.environ,
            "PYTHONPATH": str(FOLDER),
            "HF_HUB_OFFLINE": "1",
            "HF_HOME": str(tmp_path / "home"),
        },
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    steps = [read_steps(logs / f"00{i}.npz") for i in (1, 2)]
    expected = {
        "episodes": 2,
        "frames": 2 * STEPS,
        "second": STEPS,
        "fps": 20,
        "robot": "iiwa14",
        "task": "dovetail/PegInHole-v0, square",
        "version": "3.0",
        "shape": [2 * STEPS, 2, 14],
    }
    assert {name: found[name] for name in expected} == expected
    seen = np.concatenate([part.seen[:-1] for part in steps])
    np.testing.assert_allclose(found["states"], seen, rtol=1e-6, atol=1e-7)
    actions = np.concatenate([part.actions for part in steps])
    np.testing.assert_allclose(found["actions"], actions)
    np.testing.assert_allclose(found["mean"], actions.mean(axis=0), rtol=1e-5)
    assert found["led"] == [True] * STEPS + [False] * STEPS
    shutil.rmtree(tmp_path / "home", ignore_errors=True)
