"""The plan has every cell of the design, and nothing that cannot be made."""

from dataclasses import replace

import pytest

from dovetail.commands import evaluate, identify
from dovetail.commands.command_line import parse
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.reproduce.budget import BUDGETS, FULL, QUICK, SMOKE, find_budget
from dovetail.reproduce.design import DECISIVE, LAWS, MODELS, Design
from dovetail.reproduce.paper import TRANSFER
from dovetail.reproduce.plan import (
    ARM,
    LEARNERS,
    SCRATCH,
    arm_name,
    learner_name,
    plan,
    script_name,
)

ALL = ("mujoco", "bullet", "drake")


def design(budget=QUICK, engines=ALL, **changes):
    twins = tuple(f"twin-{number}" for number in range(budget.twins))
    return Design(**({"budget": budget, "twins": twins, "engines": engines} | changes))


def by_name(given):
    return {stage.name: stage for stage in plan(given)}


@pytest.fixture(scope="module")
def quick():
    return by_name(design())


@pytest.mark.parametrize("budget", BUDGETS.values(), ids=BUDGETS)
def test_every_stage_has_its_own_name_and_comes_after_those_it_needs(budget):
    seen = set()
    for stage in plan(design(budget)):
        assert stage.name not in seen
        assert seen.issuperset(stage.needs)
        seen.add(stage.name)


COMMANDS = {
    "record": (identify.IdentifyRecord, ("--out", "recording")),
    "fit": (identify.IdentifyFit, ("--out", "fit", "--resume", "--workers", "1")),
    "report": (identify.IdentifyReport, ("--out", "report")),
    "evaluate": (evaluate.Evaluate, ("--out", "evaluation")),
}


@pytest.mark.parametrize("rule", COMMANDS)
def test_what_a_stage_gives_its_command_are_options_of_it(quick, rule):
    command, beside = COMMANDS[rule]
    given = {}
    for stage in quick.values():
        if stage.rule == rule:
            given.setdefault(tuple(stage.options), stage)
    assert given
    for stage in given.values():
        found = parse(command, [*stage.to_json()["options"], *beside])
        for name, value in stage.options.items():
            if name == "peg":
                assert found.task_options["peg"] == value
            elif value is not None and name != "twin":
                assert getattr(found, name) == value


def test_each_model_is_trained_with_each_law(quick):
    for law in LAWS:
        for model, facts in MODELS.items():
            for number in range(QUICK.twins if facts.is_of_twin else QUICK.seeds):
                end = f"twin-{number}" if facts.is_of_twin else f"seed-{number}"
                stage = quick[f"train-{law}-{model}-{end}"]
                assert stage.settings["randomise_dynamics"] == facts.is_randomised
                assert stage.settings["tare"] == (law == "tared")
                force_damping = stage.settings["force_damping"]
                assert (max(force_damping) == 0.0) == (law == "paper")
                assert stage.settings["until"] == 1.0


def test_a_model_of_a_twin_is_that_twins(quick):
    for model, file in {
        "identified": "stages/fit-twin-1-extended/fit/model.toml",
        "identified-randomised": "stages/fit-twin-1-extended/fit/model.toml",
        "identified-paper": "stages/fit-twin-1-paper/fit/model.toml",
        "truth": "twins/twin-1.toml",
    }.items():
        stage = quick[f"train-ours-{model}-twin-1"]
        assert stage.options["model"].as_posix() == file
    assert quick["train-ours-nominal-seed-1"].options["model"] is None


def test_who_knows_no_twin_is_tried_on_all_and_the_others_on_their_own(quick):
    for law in LAWS:
        for model, facts in MODELS.items():
            tried = {
                name
                for name, stage in quick.items()
                if name.startswith(
                    (f"try-{law}-{model}-twin", f"try-{law}-{model}-seed")
                )
                and "triangle" not in name
                and "drake" not in name
            }
            each = 1 if facts.is_of_twin else QUICK.seeds
            assert len(tried) == QUICK.twins * each
    name = "try-paper-truth-twin-2-on-twin-2"
    assert quick[name].needs == ("train-paper-truth-twin-2",)
    assert quick[name].options["twin"].as_posix() == "twins/twin-2.toml"


def test_the_decisive_cells_are_in_every_engine(quick):
    for model in DECISIVE:
        bullet = [n for n in quick if n.startswith(f"train-paper-{model}-bullet")]
        assert bullet
        assert all(quick[name].settings["plant"] == "bullet" for name in bullet)
        for law in LAWS:
            drake = [
                n
                for n in quick
                if n.startswith(f"try-{law}-{model}") and n.endswith("-drake")
            ]
            assert drake
            twin = quick[drake[0]].options["twin"].as_posix()
            assert twin.startswith("twins/twin-")
            assert twin.endswith("-in-drake.toml")


def test_engines_that_are_not_installed_are_left_out():
    names = by_name(design(engines=("mujoco",)))
    assert not [name for name in names if "bullet" in name or "drake" in name]


def test_no_fit_sees_the_held_out_log(quick):
    fitted = quick["record-twin-1-fitted"].options
    held_out = quick["record-twin-1-held-out"].options
    assert fitted["seed"] != held_out["seed"]
    for parameters in ("paper", "extended"):
        (log,) = quick[f"fit-twin-1-{parameters}"].words
        assert log == "stages/record-twin-1-fitted/recording"


def test_every_row_of_the_papers_table_is_tried(quick):
    chosen = design()
    for row in TRANSFER:
        if row.is_on_arm:
            assert f"try-{SCRATCH}" in quick
            continue
        trials = chosen.paper_trials(row.stack, row.peg)
        assert len(trials) == QUICK.paper_twins
        for trial in trials:
            stage = quick[trial.name]
            assert stage.options.get("peg", "square") == row.peg
            trained = quick[stage.needs[0]].settings
            assert trained["stack"] == (row.stack or 0)
            assert trained["randomise_dynamics"] == (row.stack is None)


def test_the_script_is_called_a_script(quick):
    for number in range(QUICK.twins):
        stage = quick[script_name(f"twin-{number}")]
        assert stage.options["search"] == "corner"
    assert not [
        name
        for name, stage in quick.items()
        if stage.options.get("search") and "script" not in name and "search" not in name
    ]


def test_policies_are_tuned_on_the_arm_and_tried_before_and_after(quick):
    tune = quick[arm_name("tune", 0)]
    assert tune.rule == "train_on_twin"
    assert tune.twin == f"twins/{ARM}.toml"
    assert tune.needs == ("train-paper-nominal-seed-0",)
    assert tune.settings["from_policy"].startswith("stages/train-paper-nominal-seed-0/")
    assert tune.settings["steps"] == QUICK.fine_tune_steps
    assert tune.settings["updates_per_step"] == 2.0  # an arm's steps are dear
    assert tune.settings["fixed_goal"] is True
    assert not {"arm", "plant"} & tune.settings.keys()
    assert quick[arm_name("before", 0)].needs == tune.needs
    assert quick[arm_name("after", 0)].needs == (tune.name,)
    fixtures = {quick[arm_name(w, 0)].options["fixture"] for w in ("before", "after")}
    assert fixtures == {tuple(tune.settings["fixture"])}


def test_each_learning_algorithm_has_its_own_settings(quick):
    seen = set()
    for learner in LEARNERS:
        settings = dict(quick[learner_name(learner, 0)].settings)
        assert settings["steps"] == QUICK.train["steps"]
        assert not settings["fixed_goal"]
        seen.add(str(sorted(settings.items())))
    assert len(seen) == len(LEARNERS)


def test_trainings_write_all_settings_down(quick):
    settings = quick["train-tared-nominal-seed-0"].settings
    default = TrainConfig(until=1.0, tare=True, **QUICK.train).to_json()
    left_out = ("out", "resume", "threads")
    assert settings == {
        k: v for k, v in default.items() if v is not None and k not in left_out
    }


def test_robustness_has_every_disturbance_of_the_paper(quick):
    options = [s.options for name, s in quick.items() if name.startswith("robustness")]
    for name in ("fixture_shift", "push", "fixture_speed", "start", "search"):
        assert any(name in given for given in options)


def test_a_later_seed_plans_other_trainings():
    names = by_name(design(seed=7))
    assert "train-ours-nominal-seed-7" in names
    assert "train-ours-nominal-seed-0" not in names


def test_what_decides_a_result_decides_its_stage(quick):
    longer = by_name(design(replace(QUICK, train={"steps": 70_000})))
    name = "train-ours-nominal-seed-0"
    assert quick[name].to_json() != longer[name].to_json()


def test_smoke_runs_every_kind_of_stage(quick):
    kinds = {stage.rule for stage in quick.values()}
    assert {stage.rule for stage in plan(design(SMOKE))} == kinds


def test_full_has_the_sizes_that_were_fixed_before_it_ran():
    assert (FULL.seeds, FULL.twins) == (10, 20)
    names = by_name(design(FULL))
    assert sum(name.startswith("train-") for name in names) >= 300


def test_an_unknown_budget_lists_the_known_ones():
    with pytest.raises(ConfigError, match="known: smoke, quick, full"):
        find_budget("huge")
