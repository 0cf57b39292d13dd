import warnings
from dataclasses import replace

import numpy as np
import pytest

from dovetail.errors import ConfigError, PlantError, UnprovenWarning
from dovetail.identify.fit import FitConfig, fit
from dovetail.identify.fit_folder import MODEL
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording
from dovetail.identify.replay import DIVERGED, LogReplay
from dovetail.plants.twin import load_twin
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.links import NOMINAL, InertiaSet
from dovetail.robots.robot_text import write_robot_text
from extras import need


@pytest.fixture(scope="module")
def replay(folder):
    return LogReplay(Recording.load(folder))


def test_the_true_model_replays_the_log_exactly(replay, planted_file):
    assert replay.rms(load_twin(planted_file)) < 1e-12


def test_a_robot_with_masses_of_its_own_is_replayed_with_them(
    settings, quiet, tmp_path
):
    """It was called another robot's, in a warning of each process."""
    links = replace(iiwa14().links, inertia_set=NOMINAL, inertia_sets={})
    text = write_robot_text(replace(iiwa14(), name="told", links=links))
    out, short = tmp_path / "log", {"sequences": 1, "steps": 4}
    record(RecordConfig(out=out, robot=text, **settings | short), quiet)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnprovenWarning)
        replay = LogReplay(Recording.load(out))
    assert np.isfinite(replay.rms(nominal_model()))
    replay.close()
    config = FitConfig(log=out, out=tmp_path / "fit", evaluations=12, workers=1)
    fit(config, quiet)
    assert load_twin(tmp_path / "fit" / MODEL).inertia == NOMINAL


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_another_model_does_not(settings, quiet, tmp_path, period):
    out = tmp_path / "log"
    record(RecordConfig(out=out, period=period, **settings), quiet)
    assert 0.8e-3 < LogReplay(Recording.load(out)).rms(nominal_model()) < 0.1


def test_a_replay_leaves_nothing_behind_for_the_next(replay, planted_file):
    before = replay.run(nominal_model())
    replay.run(load_twin(planted_file))
    np.testing.assert_array_equal(before, replay.run(nominal_model()))


def test_other_links_move_the_tool_and_leave_nothing_behind(replay):
    links = replay.recording.cell.robot.links
    own = InertiaSet(links.mass, links.com, links.inertia)
    before = replay.run(nominal_model())
    np.testing.assert_array_equal(replay.run(nominal_model(), own), before)
    com = own.com.copy()
    com[3] += 0.02
    other = replay.run(nominal_model(), own._replace(com=com))
    assert np.abs(np.subtract(other, before)).max() > 5e-4
    np.testing.assert_array_equal(replay.run(nominal_model()), before)


def test_the_error_is_the_root_mean_square_over_all_cycles(replay):
    simulated = replay.run(nominal_model())
    pairs = zip(simulated, replay.recording.positions(), strict=True)
    squares = [np.sum((a - b) ** 2, axis=1) for a, b in pairs]
    expected = np.sqrt(np.mean(np.concatenate(squares)))
    assert replay.rms(nominal_model()) == pytest.approx(expected)


def test_a_model_that_diverges_has_the_largest_error(replay, monkeypatch):
    def fail(*_):
        raise PlantError("simulation diverged")

    monkeypatch.setattr(replay, "run", fail)
    assert replay.error(nominal_model()) is None
    assert replay.rms(nominal_model()) == DIVERGED


@pytest.mark.bullet
def test_the_other_engine_moves_nearly_alike(folder, replay):
    need("pybullet")
    other = LogReplay(Recording.load(folder), "bullet")
    pairs = zip(replay.run(nominal_model()), other.run(nominal_model()), strict=True)
    other.close()
    assert max(np.abs(a - b).max() for a, b in pairs) < 1e-3  # m


def test_an_unknown_engine_lists_the_known_ones(folder):
    with pytest.raises(ConfigError, match="known plants: mujoco, bullet"):
        LogReplay(Recording.load(folder), "gazebo")
