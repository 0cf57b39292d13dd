"""Fits of short recordings: what they find, how they go on, what they refuse."""

import io
import json
import re
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from dovetail.cli import run
from dovetail.errors import ConfigError, LogError
from dovetail.identify import fit as module
from dovetail.identify.fit import FitConfig, fit
from dovetail.identify.parameters import ParameterSet
from dovetail.identify.population import evaluate_population
from dovetail.plants.twin import load_twin
from extras import need

need("cmaes")


@pytest.fixture(scope="module")
def config(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("fit") / "fit"
    return FitConfig(log=folder, out=out, workers=1, evaluations=400)


@pytest.fixture(scope="module")
def result(config, quiet):
    """A fit of the paper's parameters."""
    return fit(config, quiet)


@pytest.fixture(scope="module")
def cold(config, tmp_path_factory):
    """Settings of a search that needs all its generations."""
    out = tmp_path_factory.mktemp("cold") / "fit"
    names = "gravity_z,mass_scale,damping"
    return again(config, out, parameters=names, warm_start=False, evaluations=48)


@pytest.fixture(scope="module")
def cold_result(cold, quiet):
    return fit(cold, quiet)


def again(config, out, **changes):
    return replace(config, **({"out": out} | changes))


def test_planted_parameters_are_recovered(result):
    gravity, (scale, damping) = result.vector[:3], result.vector[3:]
    np.testing.assert_allclose(gravity, [0.2, -0.1, 0.15], atol=0.02)  # m/s2
    assert scale == pytest.approx(1.04, rel=0.01)
    assert damping == pytest.approx(0.8, rel=0.05)
    assert result.rms_after < 1e-3 * result.rms_before


def test_ctrl_c_names_the_command_that_goes_on(
    cold, cold_result, tmp_path, monkeypatch
):
    out, asked = tmp_path / "cut short", []

    def interrupted(models, population):
        asked.append(models)
        if len(asked) > 2:
            raise KeyboardInterrupt
        return evaluate_population(models, population)

    monkeypatch.setattr(module, "evaluate_population", interrupted)
    console = Console(file=io.StringIO(), record=True, width=1000)
    with pytest.raises(KeyboardInterrupt):
        fit(again(cold, out), console)
    monkeypatch.undo()
    command = console.export_text().partition("go on with: dovetail ")[2]
    assert run(shlex.split(command)) == 0
    assert load_twin(out / "model.toml") == cold_result.model


def test_the_model_file_is_the_result_and_says_where_it_is_from(result, config):
    file = config.out / "model.toml"
    assert load_twin(file) == result.model
    text = file.read_text()
    assert "# Parameters: gravity_x, gravity_y, gravity_z, mass_scale, damping" in text
    assert "mm after" in text


def test_the_summary_holds_settings_history_and_result(cold_result, cold):
    summary = json.loads((cold.out / "fit.json").read_text())
    assert summary["state"] == "done"
    assert summary["log"] == str(cold.log)
    names = [p["name"] for p in summary["parameters"]]
    assert names == ["gravity_z", "mass_scale", "damping"]
    assert summary["parameters"][1]["value"] == cold_result.vector[1]
    history = summary["history_mm"]
    assert len(history) == 48 / 8
    assert history == sorted(history, reverse=True)
    assert summary["result"]["rms_after"] == cold_result.rms_after
    assert summary["result"]["evaluations"] == cold_result.evaluations


def test_a_fit_that_was_killed_goes_on_to_the_same_result(
    cold_result, cold, quiet, tmp_path
):
    """Killed in the middle of writing its fourth generation."""
    out = shutil.copytree(cold.out, tmp_path / "fit")
    lines = (out / "generations.jsonl").read_text().splitlines(keepends=True)
    (out / "generations.jsonl").write_text("".join(lines[:3]) + lines[3][:20])
    (out / "model.toml").unlink()
    resumed = fit(again(cold, out, resume=True), quiet)
    np.testing.assert_array_equal(resumed.vector, cold_result.vector)
    assert resumed.evaluations == cold_result.evaluations
    assert (out / "generations.jsonl").read_text().count("\n") == len(lines)
    assert load_twin(out / "model.toml") == resumed.model


def test_processes_find_what_one_process_finds(cold_result, cold, quiet, tmp_path):
    spread = fit(again(cold, tmp_path / "fit", workers=2), quiet)
    np.testing.assert_array_equal(spread.vector, cold_result.vector)


def test_without_a_warm_start_it_begins_at_the_nominal_model(cold_result, cold):
    warm_start = json.loads((cold.out / "fit.json").read_text())["warm_start"]
    np.testing.assert_allclose(warm_start["mean"], [0.5, 0.5, 0.125])
    assert warm_start["rms_start"] == warm_start["rms_before"] == cold_result.rms_before


def test_without_a_warm_start_it_comes_closer_too(cold_result):
    assert cold_result.rms_after < cold_result.rms_before


def test_a_folder_that_holds_a_fit_is_not_overwritten(result, config, quiet):
    assert result
    with pytest.raises(ConfigError, match="holds a fit; nothing was overwritten"):
        fit(config, quiet)


def test_a_fit_of_another_configuration_is_not_continued(result, config, quiet):
    assert result
    other = again(config, config.out, resume=True, seed=1)
    with pytest.raises(ConfigError, match=r"another configuration: seed is 0 .* and 1"):
        fit(other, quiet)


def test_a_folder_of_something_else_is_not_written_to(config, quiet, tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(ConfigError, match="not empty and holds no fit"):
        fit(again(config, tmp_path), quiet)


def test_damaged_generations_are_named(result, config, quiet, tmp_path):
    assert result
    out = shutil.copytree(config.out, tmp_path / "fit")
    (out / "generations.jsonl").write_text("{]\n")
    with pytest.raises(LogError, match=r"generations.jsonl is damaged"):
        fit(again(config, out, resume=True), quiet)


def test_generations_of_another_size_are_named(result, config, quiet, tmp_path):
    assert result
    out = shutil.copytree(config.out, tmp_path / "fit")
    (out / "generations.jsonl").write_text('{"values": [1.0], "time": 1}\n')
    with pytest.raises(LogError, match="generation 0 has 1 values, the search asks"):
        fit(again(config, out, resume=True), quiet)


def test_a_parameter_without_effect_is_named_and_stays(config, tmp_path):
    """A tenth of a millisecond of delay is less than the encoders' noise."""
    console = Console(record=True, width=200, file=(tmp_path / "text").open("w"))
    names = "gravity_x,command_delay=0:0.001"
    changes = {"parameters": names, "evaluations": 12}
    found = fit(again(config, tmp_path / "fit", **changes), console)
    assert found.vector[1] == 0.0
    said = r"command_delay moves the TCP by 0.00\d+ mm RMS per 0.0001 s: it has no"
    assert re.match(said, found.warnings[0])
    assert "warning: command_delay moves" in console.export_text()


def test_a_fit_without_any_effect_is_refused(config, quiet, tmp_path):
    useless = again(config, tmp_path / "f", parameters="command_delay=0:0.001")
    with pytest.raises(ConfigError, match="no parameter has an effect on this log"):
        fit(useless, quiet)


def test_a_fit_that_ends_at_a_bound_says_so(config, quiet, tmp_path):
    names = "gravity,mass_scale=0.9:1.01,damping"
    changes = {"parameters": names, "evaluations": 150}
    found = fit(again(config, tmp_path / "fit", **changes), quiet)
    (line,) = [w for w in found.warnings if w.startswith("mass_scale")]
    assert "mass_scale ends at its upper bound of 1.01" in line
    shares = (found.vector[3] - 0.9) / 0.11
    assert shares > 0.99


def test_bounds_that_exclude_the_start_are_refused(config, quiet, tmp_path):
    with pytest.raises(ConfigError, match=r"bounds 1.1 to 1.2 1 exclude"):
        fit(again(config, tmp_path / "fit", parameters="mass_scale=1.1:1.2"), quiet)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"workers": 0}, "workers is 0; needs at least 1"),
        ({"evaluations": -1}, "evaluations is -1"),
        ({"seed": -1}, "seed -1"),
        ({"plant": "gazebo"}, "known plants: mujoco, bullet"),
    ],
)
def test_a_setting_out_of_range_is_named(config, quiet, tmp_path, changes, message):
    with pytest.raises(ConfigError, match=message):
        fit(again(config, tmp_path / "fit", **changes), quiet)


def test_the_names_of_a_set_stay_in_order(result, config):
    summary = json.loads((config.out / "fit.json").read_text())
    names = [p["name"] for p in summary["parameters"]]
    assert tuple(names) == ParameterSet.parse("paper").names
    assert len(result.vector) == len(names)
