"""Everything in one command, as small as it runs, and what it says when it cannot."""

import json
from io import StringIO

import pytest
from rich.console import Console
from toy_results import finish

from dovetail.cli import run
from dovetail.commands.reproduce import describe_failures
from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.learn.policy import Policy
from dovetail.reproduce import run as runner
from dovetail.reproduce.budget import Budget
from dovetail.reproduce.folder import DONE, LOG, stage_folder
from dovetail.reproduce.run import ReproduceConfig, Reproduction, reproduce
from dovetail.reproduce.workflow import RunSummary, summarise
from extras import need

TINY = Budget(
    name="tiny",
    seeds=1,
    train={
        "steps": 40,  # fewer than learning_starts: nothing is compiled, nor learned
        "net": [8],
        "learning_starts": 100,
        "num_envs": 1,
        "max_steps": 20,
        "eval_episodes": 1,
    },
    sequences=2,
    sequence_steps=4,
    evaluations=10,
    tries=1,
    shifts=(),
    searches=(0.02,),
    search_tries=1,
    search_steps=20,
    pushes=(),
    speeds=(0.02,),
)


def config(out, **changes):
    """In MuJoCo: it is everywhere, and quicker to start."""
    return ReproduceConfig(
        out=out, twins=("medium",), plant="mujoco", parameters="paper", **changes
    )


REAL = (
    *("record-medium-fitted", "record-medium-held-out"),
    *("fit-medium-paper", "report-fit-medium-paper"),
    *("train-stack-0-seed-0", "transfer-stack-0-triangle-seed-0"),
    *("train-on-twin-seed-0", "transfer-on-twin-square-seed-0"),
)
"""Stages that run: each kind. The others are those of a sitting before."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The results of every experiment at its smallest, and what was shown meanwhile."""
    for module in ("sbx", "cmaes", "plotly", "snakemake"):
        need(module)
    out = StringIO()
    folder = tmp_path_factory.mktemp("reproduce") / "out"

    def begin(root, stages, words, console):
        for stage in stages:
            if stage.name not in REAL:
                finish(root, stage)
        return summarise(root, stages)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "run_stages", begin)
        patch.setattr(runner, "write_reproduction", lambda *_: [])
        reproduce(config(folder), Console(file=out), TINY)
    for name in ("json", "dovetail"):  # nothing in the folder is executed
        (folder / f"{name}.py").write_text("raise SystemExit('evil')\n")
    result = reproduce(config(folder), Console(file=out, width=200), TINY)
    return result, out.getvalue()


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
    assert len(results["transfer"]) == 7
    assert all(entry["ours_on_a_twin"] for entry in results["transfer"])
    assert all(entry["tries"] for entry in results["robustness"])
    assert all(entry["stack_0"] for entry in results["with_and_without_identification"])
    (fit,) = results["identification"]
    assert fit["judged"]["errors_m"].keys() == {"fitting log", "held-out log"}
    assert "not run" not in (result.root / "report.html").read_text()


@pytest.mark.timeout(1200)
def test_every_training_is_what_its_row_says(finished):
    result, _ = finished

    def settings(variant):
        folder = stage_folder(result.root, f"train-{variant}-seed-0") / "run"
        policy = Policy.load(folder / "policy.safetensors")
        return policy.metadata["provenance"]

    stack_0, on_twin = settings("stack-0"), settings("on-twin")
    assert stack_0["steps"] == 40
    assert stack_0["config"]["model"]["mass_scale"]
    assert stack_0["config"]["max_steps"] == 20
    assert on_twin["config"]["arm"].startswith("fri://127.0.0.1:")
    assert on_twin["config"]["fixed_goal"] is True


@pytest.mark.timeout(1200)
def test_the_same_command_again_does_only_what_is_not_done(finished):
    result, _ = finished
    times = {
        path: path.stat().st_mtime_ns for path in result.root.glob(f"stages/*/{DONE}")
    }
    redone = stage_folder(result.root, "transfer-stack-0-square-seed-0") / DONE
    redone.unlink()
    out = StringIO()
    reproduce(config(result.root), Console(file=out, width=200), TINY)
    assert f"{len(times) - 1} of {len(times)} stages were done before" in out.getvalue()
    changed = [p for p, time in times.items() if p.stat().st_mtime_ns != time]
    assert changed == [redone]


@pytest.mark.timeout(1200)
def test_a_killed_training_on_the_twin_goes_on_at_the_same_address(finished):
    result, _ = finished
    name = "train-on-twin-seed-0"
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
        ({"twins": ()}, "twins is empty"),
        ({"parameters": "colour"}, "parameter 'colour' is unknown"),
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


def test_without_pybullet_it_trains_in_mujoco(monkeypatch):
    monkeypatch.setattr(runner.importlib.util, "find_spec", lambda name: None)
    assert runner.default_plant() == "mujoco"


def test_failures_are_named_with_their_log_and_the_way_on(tmp_path):
    tally = RunSummary(
        failed={"train-stack-0-seed-0": "a bolt came off"},
        left_out={"transfer-stack-0-square-seed-0": "train-stack-0-seed-0"},
    )
    text = describe_failures(Reproduction(tmp_path, tally, []))
    assert "1 stages failed" in text
    assert "train-stack-0-seed-0: a bolt came off" in text
    assert f"log: {tmp_path}/stages/train-stack-0-seed-0/log.txt" in text
    assert "left out: transfer-stack-0-square-seed-0" in text
    assert "the same command goes on where it stopped" in text
