"""Everything in one command, as small as it runs, and what it says when it cannot."""

import json
import tomllib
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console
from toy_results import finish

from dovetail.cli import run
from dovetail.commands.reproduce import describe_failures
from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.learn.policy import RUN_POLICY, Policy
from dovetail.reproduce import run as runner
from dovetail.reproduce.budget import SMOKE
from dovetail.reproduce.design import Design
from dovetail.reproduce.folder import DONE, LOG, RUN, stage_folder
from dovetail.reproduce.plan import plan
from dovetail.reproduce.run import ReproduceConfig, Reproduction, reproduce
from dovetail.reproduce.workflow import RunSummary
from extras import need

TINY = replace(
    SMOKE,
    name="tiny",
    train={
        "steps": 40,  # fewer than learning_starts: nothing is compiled, nor learned
        "net": [8],
        "learning_starts": 100,
        "num_envs": 1,
        "max_steps": 20,
        "eval_episodes": 1,
    },
    fine_tune_steps=40,
    scratch_steps=40,
    sequence_steps=4,
    evaluations=10,
    search_steps=20,
)


def config(out, **changes):
    return ReproduceConfig(out=out, **changes)


REAL = (
    *("record-sampled-0-fitted", "record-sampled-0-held-out"),
    *("fit-sampled-0-paper", "report-fit-sampled-0-paper"),
    *("train-paper-nominal-seed-0", "try-paper-nominal-seed-0-on-sampled-0"),
    *("train-paper-identified-paper-sampled-0", "train-paper-truth-sampled-0"),
    *("arm-tune-seed-0", "arm-after-seed-0"),
)
"""Stages that are planned: each kind. The others are there as if they had run."""


def plan_some(design):
    return tuple(stage for stage in plan(design) if stage.name in REAL)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The results of every experiment at its smallest, and what was shown meanwhile."""
    for module in ("sbx", "cmaes", "plotly", "snakemake"):
        need(module)
    out = StringIO()
    folder = tmp_path_factory.mktemp("reproduce") / "out"
    twins = ("sampled-0",)
    for stage in plan(Design(budget=TINY, twins=twins, engines=runner._engines())):
        if stage.name not in REAL:
            finish(folder, stage)
    (folder / "stages").rename(folder.parent / "stages")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "plan", plan_some)
        with pytest.MonkeyPatch.context() as first:  # the folder and no stage
            first.setattr(runner, "run_stages", lambda *_: RunSummary())
            first.setattr(runner, "write_reproduction", lambda *_: [])
            folder.rmdir()
            reproduce(config(folder), Console(file=out), TINY)
        for made in (folder.parent / "stages").iterdir():
            made.rename(folder / "stages" / made.name)
        for name in ("json", "dovetail"):  # nothing in the folder is executed
            (folder / f"{name}.py").write_text("raise SystemExit('evil')\n")
        result = reproduce(config(folder), Console(file=out, width=200), TINY)
        yield result, out.getvalue()


@pytest.mark.timeout(1200)
def test_every_experiment_runs_and_is_in_the_report(finished):
    result, shown = finished
    logs = [
        (stage_folder(result.root, n) / LOG).read_text() for n in result.tally.failed
    ]
    assert not result.tally.failed, (shown, logs)
    assert all(path.is_file() for path in result.files)
    results = json.loads((result.root / "results.json").read_text())
    assert not results["missing"]
    assert all(cell["tries"] for cell in results["cells"])
    assert len(results["identification"]["paper"]) == 1
    assert "not run" not in (result.root / "report.html").read_text()


@pytest.mark.timeout(1200)
def test_every_training_is_what_its_row_says(finished):
    result, _ = finished

    def facts(stage):
        policy = Policy.load(stage_folder(result.root, stage) / RUN / RUN_POLICY)
        return policy.metadata["provenance"]

    nominal = facts("train-paper-nominal-seed-0")
    assert nominal["steps"] == 40
    assert nominal["config"]["model"] is None
    truth = facts("train-paper-truth-sampled-0")["config"]["model"]
    twin = tomllib.loads((result.root / "twins/sampled-0.toml").read_text())
    assert truth["mass_scale"] == twin["mass_scale"]
    fitted = facts("train-paper-identified-paper-sampled-0")["config"]["model"]
    assert fitted["mass_scale"] != twin["mass_scale"]
    tuned = facts("arm-tune-seed-0")["config"]
    assert tuned["arm"].startswith("fri://127.0.0.1:")
    assert tuned["fixed_goal"] is True


@pytest.mark.timeout(1200)
def test_the_same_command_again_does_only_what_is_not_done(finished):
    result, _ = finished
    done = [stage_folder(result.root, name) / DONE for name in REAL]
    times = {path: path.stat().st_mtime_ns for path in done}
    redone = stage_folder(result.root, "try-paper-nominal-seed-0-on-sampled-0") / DONE
    redone.unlink()
    out = StringIO()
    reproduce(config(result.root), Console(file=out, width=200), TINY)
    assert f"{len(times) - 1} of {len(times)} stages were done before" in out.getvalue()
    changed = [p for p, time in times.items() if p.stat().st_mtime_ns != time]
    assert changed == [redone]


@pytest.mark.timeout(1200)
def test_a_killed_training_on_the_arm_goes_on_at_the_same_address(finished):
    result, _ = finished
    name = "arm-tune-seed-0"
    folder = stage_folder(result.root, name)
    (folder / DONE).unlink()
    (folder / "run" / "policy.safetensors").unlink()
    before = (folder / "run" / "config.toml").read_bytes()
    again = reproduce(config(result.root), Console(file=StringIO()), TINY)
    assert name in again.tally.done
    assert (folder / "run" / "policy.safetensors").is_file()
    assert (folder / "run" / "config.toml").read_bytes() == before


@pytest.mark.timeout(1200)
def test_results_of_another_configuration_are_refused(finished, capsys):
    result, _ = finished
    words = ["reproduce", "--budget", "smoke", "--out", str(result.root)]
    assert run(words) == 2
    message = capsys.readouterr().err
    assert "holds results of another configuration" in message
    assert "nothing was changed" in message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"twins": ("softer",)}, "no twin 'softer'; shipped twins: easy, hard, medium"),
        ({"twins": ("hard", "hard")}, "twin 'hard' is given twice"),
        ({"workers": 0}, "workers is 0; needs at least 1"),
    ],
)
def test_a_wrong_setting_is_refused_before_anything_is_written(
    tmp_path, changes, message
):
    out = tmp_path / "out"
    with pytest.raises(ConfigError) as error:
        reproduce(ReproduceConfig(out=out, **changes), Console(file=StringIO()))
    assert message in str(error.value)
    assert not out.exists()


def test_a_missing_extra_is_named_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(runner.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError) as error:
        reproduce(config(tmp_path / "out"), Console(file=StringIO()))
    assert install_command("learn", "identify") in str(error.value)
    assert not (tmp_path / "out").exists()


def test_twins_of_ones_own_take_the_place_of_those_that_are_drawn(
    tmp_path, monkeypatch
):
    need("snakemake")
    seen = []
    monkeypatch.setattr(runner, "plan", plan)
    monkeypatch.setattr(
        runner, "run_stages", lambda root, stages, *_: seen.extend(stages)
    )
    monkeypatch.setattr(runner, "write_reproduction", lambda *_: [])
    out = tmp_path / "out"
    reproduce(config(out, twins=("hard",)), Console(file=StringIO()), TINY)
    twins = {path.stem for path in (out / "twins").iterdir()}
    assert twins == {"hard", "hard-in-drake", "medium", "medium-in-drake"}
    assert "train-ours-truth-hard" in {stage.name for stage in seen}


def test_engines_that_are_not_installed_have_no_cells(monkeypatch):
    monkeypatch.setattr(runner.importlib.util, "find_spec", lambda name: None)
    assert runner._engines() == ("mujoco",)


def test_failures_are_named_with_their_log_and_the_way_on(tmp_path):
    tally = RunSummary(
        failed={"train-ours-nominal-seed-0": "a bolt came off"},
        left_out={"try-ours-nominal-seed-0-on-sampled-0": "train-ours-nominal-seed-0"},
    )
    text = describe_failures(Reproduction(tmp_path, tally, []))
    assert "1 stages failed" in text
    assert "train-ours-nominal-seed-0: a bolt came off" in text
    assert f"log: {tmp_path}/stages/train-ours-nominal-seed-0/log.txt" in text
    assert "left out: try-ours-nominal-seed-0-on-sampled-0" in text
    assert "the same command goes on where it stopped" in text
