"""The plan has every experiment of the paper, and nothing that cannot be made."""

from dataclasses import replace

import pytest

from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.reproduce.budget import BUDGETS, FULL, QUICK, SMOKE, find_budget
from dovetail.reproduce.paper import TRANSFER
from dovetail.reproduce.plan import RECIPE, PlanConfig, plan, transfer_name
from dovetail.reproduce.schedule import check_plan
from dovetail.reproduce.settings import as_config


def config(budget=QUICK, **changes):
    chosen = {"twins": ("medium", "hard"), "plant": "bullet"} | changes
    return PlanConfig(budget=budget, **chosen)


def by_name(plan_config):
    return {stage.name: stage for stage in plan(plan_config)}


@pytest.mark.parametrize("budget", BUDGETS.values(), ids=BUDGETS)
def test_every_budget_can_be_put_in_order(budget):
    check_plan(plan(config(budget)))


def test_every_row_of_the_papers_table_is_evaluated():
    stages = by_name(config())
    for row in TRANSFER:
        stage = stages[transfer_name(row.variant, row.peg, 0)]
        assert stage.settings["peg"] == row.peg
        assert stage.settings["tries"] == 20
        assert ("hole" in stage.settings) == (len(row.cells) == 1)


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
        assert stage.settings["model_of"] == "fit-medium-extended"
        assert stage.needs == ("fit-medium-extended",)
        assert stage.settings["stack"] == stack


def test_randomised_and_unidentified_know_no_model():
    stages = by_name(config())
    for name in ("randomised", "unidentified"):
        stage = stages[f"train-{name}-seed-0"]
        assert "model_of" not in stage.settings
        assert not stage.needs
        assert stage.settings["randomise_dynamics"] == (name == "randomised")


def test_no_fit_sees_the_held_out_log():
    stages = by_name(config())
    for twin in ("medium", "hard"):
        fitted = stages[f"record-{twin}-fitted"].settings
        held_out = stages[f"record-{twin}-held-out"].settings
        assert fitted["seed"] != held_out["seed"]
        assert stages[f"fit-{twin}-extended"].settings["log_of"].endswith("-fitted")


def test_stack_0_meets_every_twin_with_and_without_identification():
    stages = by_name(config())
    for name, policy in (
        ("medium-unidentified", "train-unidentified-seed-0"),
        ("hard-unidentified", "train-unidentified-seed-0"),
        ("hard-identified-hard", "train-identified-hard-seed-0"),
    ):
        stage = stages[f"identified-or-not-{name}-seed-0"]
        assert stage.settings["policy_of"] == policy
        assert "tare" not in stage.settings  # as the policy was trained
    bare = stages["identified-or-not-hard-untared-seed-0"].settings
    assert bare["policy_of"] == "train-unidentified-seed-0"
    assert bare["tare"] is False
    model = stages["train-identified-hard-seed-0"].settings["model_of"]
    assert model == "fit-hard-extended"


def test_robustness_has_every_disturbance_of_the_paper():
    settings = [
        stage.settings
        for name, stage in by_name(config()).items()
        if name.startswith("robustness-")
    ]
    alone = [s for s in settings if "search" not in s]
    shifts = [s["hole_shift"] for s in alone if "hole_shift" in s]
    assert sorted(shifts) == [0.005, 0.01, 0.015, 0.02, 0.025, 0.03]  # 0: the table
    assert max(s.get("push", 0.0) for s in settings) == 30.0
    assert 0.02 in [s.get("hole_speed") for s in settings]
    assert "below" in [s.get("start") for s in settings]


def test_a_moved_hole_is_also_searched_for_and_the_long_logs_are_not_kept():
    stage = by_name(config())["robustness-stack-0-search-20-seed-0"]
    assert stage.settings["search"] == "corner"
    assert stage.settings["hole_shift"] == 0.02
    assert stage.settings["keep_logs"] is False


def test_trainings_use_one_recipe_and_write_all_settings_down():
    settings = by_name(config())["train-unidentified-seed-0"].settings
    default = TrainConfig(plant="bullet", **RECIPE).to_json()
    assert default["until"] == 1.0
    default["hole"] = default.pop("fixture")
    assert settings == {k: v for k, v in default.items() if v is not None}
    assert "hole" not in settings  # another one in each episode


def test_the_training_on_the_twin_itself_has_one_hole_pose_and_no_simulation():
    settings = by_name(config())["train-on-twin-seed-0"].settings
    assert settings["twin"] == "medium"
    assert settings["fixed_goal"] is True
    assert as_config(settings)["fixture"] == (0.6, 0.0, 0.1, 0.0)
    assert "plant" not in settings


def test_the_other_direction_is_planned_where_pybullet_is():
    name = "transfer-other-direction-square-seed-0"
    stage = by_name(config(FULL))[name]
    assert stage.settings["twin"] == "medium-in-bullet"
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
    kinds = {stage.run for stage in plan(config(FULL))}
    assert {stage.run for stage in plan(config(SMOKE))} == kinds


def test_an_unknown_budget_lists_the_known_ones():
    with pytest.raises(ConfigError, match="known: smoke, quick, full"):
        find_budget("huge")
