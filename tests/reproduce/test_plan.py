"""The plan has every experiment of the paper, and nothing that cannot be made."""

from dataclasses import replace

import pytest

from dovetail.commands import evaluate, identify
from dovetail.commands.command_line import parse
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.reproduce.budget import BUDGETS, FULL, QUICK, SMOKE, find_budget
from dovetail.reproduce.paper import TRANSFER
from dovetail.reproduce.plan import RECIPE, PlanConfig, plan, transfer_name


def config(budget=QUICK, **changes):
    chosen = {"twins": ("medium", "hard"), "plant": "bullet"} | changes
    return PlanConfig(budget=budget, **chosen)


def by_name(plan_config):
    return {stage.name: stage for stage in plan(plan_config)}


@pytest.mark.parametrize("budget", BUDGETS.values(), ids=BUDGETS)
def test_every_stage_has_its_own_name_and_comes_after_those_it_needs(budget):
    seen = set()
    for stage in plan(config(budget)):
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
def test_what_a_stage_gives_its_command_are_options_of_it(rule):
    command, beside = COMMANDS[rule]
    given = {}
    for stage in plan(config(FULL)):
        if stage.rule == rule:
            given.setdefault(tuple(stage.options), stage)
    for stage in given.values():
        found = parse(command, [*stage.to_json()["options"], *beside])
        for name, value in stage.options.items():
            if name == "peg":
                assert found.task_options["peg"] == value
            elif value is not None and name != "twin":
                assert getattr(found, name) == value


def test_every_row_of_the_papers_table_is_evaluated():
    stages = by_name(config())
    for row in TRANSFER:
        options = stages[transfer_name(row.variant, row.peg, 0)].options
        assert options["peg"] == row.peg
        assert options["tries"] == 20
        assert ("fixture" in options) == (len(row.cells) == 1)


def test_quick_trains_one_seed_of_each_variant_and_full_five():
    def count(budget, variant):
        names = by_name(config(budget))
        return sum(name.startswith(f"train-{variant}-seed") for name in names)

    for variant in ("stack-0", "stack-4", "randomised"):
        assert (count(QUICK, variant), count(FULL, variant)) == (1, 5)
    assert count(FULL, "on-twin") == 1


def test_stack_0_and_4_are_trained_in_the_identified_simulation():
    stages = by_name(config())
    for name, stack in (("stack-0", 0), ("stack-4", 4)):
        stage = stages[f"train-{name}-seed-0"]
        model = stage.options["model"].as_posix()
        assert model == "stages/fit-medium-extended/fit/model.toml"
        assert stage.needs == ("fit-medium-extended",)
        assert stage.settings["stack"] == stack


def test_randomised_and_unidentified_know_no_model():
    stages = by_name(config())
    for name in ("randomised", "unidentified"):
        stage = stages[f"train-{name}-seed-0"]
        assert stage.options["model"] is None
        assert "model" not in stage.settings
        assert not stage.needs
        assert stage.settings["randomise_dynamics"] == (name == "randomised")


def test_no_fit_sees_the_held_out_log():
    stages = by_name(config())
    for twin in ("medium", "hard"):
        fitted = stages[f"record-{twin}-fitted"].options
        held_out = stages[f"record-{twin}-held-out"].options
        assert fitted["seed"] != held_out["seed"]
        (log,) = stages[f"fit-{twin}-extended"].words
        assert log == f"stages/record-{twin}-fitted/recording"


def test_stack_0_meets_every_twin_with_and_without_identification():
    stages = by_name(config())
    for name, policy in (
        ("medium-unidentified", "train-unidentified-seed-0"),
        ("hard-unidentified", "train-unidentified-seed-0"),
        ("hard-identified-hard", "train-identified-hard-seed-0"),
    ):
        stage = stages[f"identified-or-not-{name}-seed-0"]
        assert stage.words == (f"stages/{policy}/run/policy.safetensors",)
        assert "tare" not in stage.options  # as the policy was trained
    bare = stages["identified-or-not-hard-untared-seed-0"]
    assert bare.needs == ("train-unidentified-seed-0",)
    assert "--no-tare" in bare.to_json()["options"]
    assert stages["train-identified-hard-seed-0"].needs == ("fit-hard-extended",)


def test_robustness_has_every_disturbance_of_the_paper():
    settings = [
        stage.options
        for name, stage in by_name(config()).items()
        if name.startswith("robustness-")
    ]
    alone = [s for s in settings if "search" not in s]
    shifts = [s["fixture_shift"] for s in alone if "fixture_shift" in s]
    assert sorted(shifts) == [0.005, 0.01, 0.015, 0.02, 0.025, 0.03]  # 0: the table
    assert max(s.get("push", 0.0) for s in settings) == 30.0
    assert 0.02 in [s.get("fixture_speed") for s in settings]
    assert "below" in [s.get("start") for s in settings]


def test_a_moved_hole_is_also_searched_for_and_the_long_logs_are_not_kept():
    options = by_name(config())["robustness-stack-0-search-20-seed-0"].options
    assert options["search"] == "corner"
    assert options["fixture_shift"] == 0.02
    assert options["keep_logs"] is False


def test_trainings_use_one_recipe_and_write_all_settings_down():
    settings = by_name(config())["train-unidentified-seed-0"].settings
    default = TrainConfig(plant="bullet", **RECIPE).to_json()
    assert default["until"] == 1.0
    left_out = ("out", "resume", "threads")
    assert settings == {
        k: v for k, v in default.items() if v is not None and k not in left_out
    }
    assert "fixture" not in settings  # another one in each episode


def test_the_training_on_the_twin_itself_has_one_hole_pose_and_no_simulation():
    stage = by_name(config())["train-on-twin-seed-0"]
    settings = stage.settings
    assert stage.twin == "twins/medium.toml"
    assert settings["fixed_goal"] is True
    assert tuple(settings["fixture"]) == (0.6, 0.0, 0.1, 0.0)
    assert "plant" not in settings


def test_the_other_direction_is_planned_where_pybullet_is():
    name = "transfer-other-direction-square-seed-0"
    stage = by_name(config(FULL))[name]
    assert stage.options["twin"].name == "medium-in-bullet.toml"
    assert name not in by_name(config(FULL, plant="mujoco"))


def test_a_later_seed_plans_other_trainings():
    names = by_name(config(seed=7))
    assert "train-stack-0-seed-7" in names
    assert "train-stack-0-seed-0" not in names


def test_what_decides_a_result_decides_its_stage():
    stages = by_name(config())
    longer = by_name(config(replace(QUICK, train={"steps": 70_000})))
    name = "train-stack-0-seed-0"
    assert stages[name].to_json() != longer[name].to_json()


def test_smoke_runs_every_kind_of_stage():
    kinds = {stage.rule for stage in plan(config(FULL))}
    assert {stage.rule for stage in plan(config(SMOKE))} == kinds


def test_an_unknown_budget_lists_the_known_ones():
    with pytest.raises(ConfigError, match="known: smoke, quick, full"):
        find_budget("huge")
