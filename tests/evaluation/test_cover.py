"""A covered camera: the table of who finds the fixture, and where they searched."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from dovetail.episode import Episode
from dovetail.errors import ConfigError
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.cover import compare
from dovetail.evaluation.evaluate import evaluate

QUIET = Console(quiet=True)
SCRIPT = EvaluationConfig(
    policy="peg_square",
    plant="mujoco",
    search="corner",
    fixture=(0.6, 0.0, 0.1, 0.1),
    tries=1,
    tare=False,
    keep_logs=False,
)


def test_the_table_says_who_found_it_and_how_fast(tmp_path):
    cells = compare([("script", SCRIPT)], tmp_path / "out", QUIET, shifts=(0.0, 30.0))
    assert [(cell.shift, cell.row.successes) for cell in cells] == [(0.0, 1), (30.0, 1)]
    assert cells[0].row.steps.median < cells[1].row.steps.median
    written = json.loads((tmp_path / "out" / "cover.json").read_text())
    assert [entry["moved_mm"] for entry in written] == [0.0, 30.0]
    assert "1/1" in (tmp_path / "out" / "cover.html").read_text()
    figures = {path.parent.name for path in Path(tmp_path).rglob("search.png")}
    assert figures == {"script-30-mm"}  # nothing is searched for where it is seen


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"fixture_shift": 0.051}, "fixture_shift is 0.051 m; allowed: 0 to 0.05 m"),
        ({"fixture_shift": -0.001}, "fixture_shift"),
        ({"search": "spiral"}, "search is 'spiral'; known: none, corner"),
    ],
)
def test_what_cannot_be_covered_is_refused(settings, words, tmp_path):
    asked = EvaluationConfig(policy="peg_square", twin="easy", out=tmp_path / "out")
    with pytest.raises(ConfigError, match=words):
        evaluate(replace(asked, **settings), QUIET)
    assert not (tmp_path / "out").exists()


def test_a_policy_that_sees_more_columns_is_tried_and_its_logs_are_as_any_others(
    tmp_path,
):
    asked = EvaluationConfig(
        policy="search_square",
        plant="mujoco",
        fixture=(0.6, 0.0, 0.1, 0.1),
        fixture_shift=0.015,
        tries=1,
        out=tmp_path / "out",
    )
    found = evaluate(asked, QUIET)
    assert found.outcomes[0].success
    columns = Episode.load(found.folder / "logs" / found.outcomes[0].files.log).columns
    assert "action6" in columns
    assert "obs_vz" in columns
