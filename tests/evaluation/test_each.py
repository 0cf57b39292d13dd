"""One evaluation for each value of an option, and a row for each."""

import json
from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

import dovetail.evaluation.each as each_module
from dovetail.commands.command_line import parse
from dovetail.commands.evaluate import Evaluate
from dovetail.errors import ConfigError, LimitError, PlantError
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.each import evaluate_each
from dovetail.evaluation.evaluate import evaluate


def config(tmp_path, **settings):
    given = {"policy": "peg_square", "plant": "mujoco", "tries": 1, "max_steps": 3}
    given |= {"keep_logs": False, "fixture": (0.6, 0.0, 0.1, 0.0)}
    return EvaluationConfig(**given | settings, out=tmp_path / "out")


def test_each_value_has_a_row_and_a_folder_and_the_last_is_the_sum(tmp_path):
    output = StringIO()
    vary = "peg=square,triangle&clearance=0.001,0.002"
    each = evaluate_each(config(tmp_path, tries=2), vary, Console(file=output))
    assert [row.tries for row in each.rows] == [2, 2, 2, 2, 8]
    labels = [row.label for row in each.rows]
    assert len(set(labels)) == 5
    assert "square" in labels[0]
    assert "triangle" in labels[1]
    assert labels[-1] == "all"
    assert all(label in output.getvalue() for label in labels)
    parts = [
        json.loads((each.folder / f"{i:03d}/report.json").read_text()) for i in (0, 3)
    ]
    assert parts[0]["title"] != parts[1]["title"]
    table = json.loads((each.folder / "table.json").read_text())
    assert [row["label"] for row in table] == labels
    assert table[-1]["successes"] == 0
    assert table[-1]["steps_median"] is None


def test_values_with_the_same_words_keep_a_row_each(tmp_path):
    vary = "clearance=0.001,0.001,0.002"
    each = evaluate_each(config(tmp_path), vary, Console(file=StringIO()))
    assert [row.tries for row in each.rows] == [1, 1, 1, 3]
    assert len({row.label for row in each.rows}) == 4


@pytest.mark.parametrize("error", [ConfigError, LimitError, PlantError])
def test_a_value_that_is_refused_is_named_and_the_others_are_tried(
    tmp_path, monkeypatch, error
):
    def refuse_wide(given, console):
        if given.task_options["clearance"] == 0.002:
            raise error("too wide")
        return evaluate(given, console)

    monkeypatch.setattr(each_module, "evaluate", refuse_wide)
    each = evaluate_each(
        config(tmp_path), "clearance=0.002,0.001", Console(file=StringIO())
    )
    assert list(each.refused.values()) == ["too wide"]
    assert [row.tries for row in each.rows] == [1, 1]
    with pytest.raises(ConfigError, match="too wide"):
        evaluate_each(
            replace(config(tmp_path), out=tmp_path / "none"),
            "clearance=0.002",
            Console(file=StringIO()),
        )


def test_the_command_takes_values_or_none(tmp_path):
    words = ["peg_square", "--plant", "mujoco", "--tries", "1", "--max-steps", "3"]
    words += ["--fixture", "0.6", "0", "0.1", "0"]
    for name, more in (("one", []), ("each", ["--vary", "clearance=0.001,0.002"])):
        given = [*words, "--out", str(tmp_path / name), *more]
        assert parse(Evaluate, given).run(Console(file=StringIO())) == 0
    assert (tmp_path / "one/report.json").is_file()
    rows = json.loads((tmp_path / "each/table.json").read_text())
    assert [row["tries"] for row in rows] == [1, 1, 2]


@pytest.mark.parametrize("vary", ["peg=", "pig=1,2", "clearance=0.001,wide"])
def test_values_that_cannot_be_are_refused_before_the_first_try(tmp_path, vary):
    with pytest.raises(ConfigError):
        evaluate_each(config(tmp_path), vary, Console(file=StringIO()))
    assert not (tmp_path / "out").exists()
