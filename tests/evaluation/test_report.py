"""The report stands alone, and says what it must."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from dovetail.evaluation.figures import draw_forces, draw_paths
from dovetail.evaluation.job import TrialJob
from dovetail.evaluation.origin import Origin
from dovetail.evaluation.outcome import ContactForce, Course, Outcome, TryFiles
from dovetail.evaluation.report import Report
from dovetail.evaluation.terminal import run_shown
from dovetail.evaluation.transfer import summarise
from dovetail.tasks.peg_in_hole.geometry import HoleBlock, Peg, hole_outline
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.task import Task

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def report(rng):
    outcomes = [
        Outcome(
            job=TrialJob(pose, 0, 3),
            success=pose == 0,
            depth=0.028 if pose == 0 else 0.001,
            course=Course(
                steps=40 if pose == 0 else 200,
                violations=0,
                path=np.cumsum(rng.normal(scale=1e-3, size=(50, 3)), axis=0),
            ),
            force=ContactForce(mean=1.5, peak=7.0, step=3.0, cycles=10),
            files=TryFiles(log=f"{pose}.npz"),
        )
        for pose in range(2)
    ]
    return Report(
        title="peg_square on twin <medium>",
        ground="twin medium (mujoco)",
        period=0.005,
        rows=summarise(outcomes, ["A", "B"]),
        outcomes=outcomes,
        origin=Origin(
            config={"tries": 1, "twin": "medium"},
            policy={"provenance": {"command": "dovetail train --seed 0"}},
            provenance={"python": "3.11"},
            command="dovetail evaluate peg_square --twin medium",
        ),
    )


def test_json_holds_rows_and_tries_and_is_strict(report):
    content = json.loads(report.to_json(), parse_constant=pytest.fail)
    assert [row["label"] for row in content["rows"]] == ["A", "B", "all"]
    assert content["rows"][1]["steps_median"] is None
    assert content["rows"][0]["interval"] == pytest.approx([0.2065, 1.0], abs=1e-4)
    assert content["tries"][0]["log"] == "0.npz"
    assert "path" not in content["tries"][0]


@pytest.mark.parametrize("word", ["succeeded", "clipped on"])
def test_a_success_has_the_tasks_own_word(report, word):
    page = replace(report, done_word=word).to_html({"Paths": PNG})
    assert f"</span>{word} on twin medium" in page
    assert "inserted" not in page


def test_the_bar_counts_successes_by_the_tasks_own_word(report):
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=100)
    run_shown(iter(report.outcomes), 2, "title", ["A", "B"], "stacked", console)
    assert "1 stacked" in out.getvalue()


def test_what_goes_into_an_opening_is_inserted_and_other_tasks_succeed():
    assert (PegInHole.done_word, RailClip.done_word) == ("inserted", "clipped on")
    assert Task.done_word == "succeeded"


def test_html_needs_nothing_from_outside(report):
    page = report.to_html({"Paths": PNG})
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert len(sources) == 1
    assert sources[0].startswith("data:image/png;base64,")
    assert "http" not in page
    assert "<script" not in page
    assert "@import" not in page


def test_html_says_table_settings_policy_and_how_to_repeat(report):
    page = report.to_html({"Paths": PNG})
    for text in (
        "1/2",
        "0/1",
        "Wilson 95 %",
        report.origin.command,
        "provenance.command",
        "dovetail train --seed 0",
        "Settings",
        "twin medium (mujoco)",
    ):
        assert text in page


def test_html_escapes_what_users_write(report):
    page = report.to_html({})
    assert "twin &lt;medium&gt;" in page
    assert "<medium>" not in page


def test_a_twin_is_never_called_a_robot(report):
    assert "robot" not in report.to_html({"Paths": PNG}).lower()


@pytest.mark.parametrize(
    "task",
    [
        PegInHole(),
        PegInHole(peg="triangle", block=HoleBlock(floor_thickness=0.01)),
        PegInHole(peg="round"),
    ],
    ids=lambda cell: cell.peg,
)
def test_figures_are_png_for_every_peg(report, task):
    figure = draw_paths(
        report.outcomes, ["A", "B"], fixture=task.fixture(0.0), title="paths of a test"
    )
    assert figure.startswith(PNG)
    assert draw_forces(report.outcomes).startswith(PNG)


def test_tries_that_the_arm_ended_before_their_first_step_are_drawn(report):
    ended = [
        replace(
            o,
            course=replace(o.course, path=np.empty((0, 3))),
            force=replace(o.force, peak=np.nan, mean=np.nan),
        )
        for o in report.outcomes
    ]
    for outcomes in ([report.outcomes[0], ended[1]], ended):
        figure = draw_paths(
            outcomes, ["A", "B"], fixture=PegInHole().fixture(0.0), title="ended"
        )
        assert figure.startswith(PNG)
        assert draw_forces(outcomes).startswith(PNG)


def test_forces_without_any_contact_are_drawn(report):
    force = ContactForce(mean=0.0, peak=0.0, step=3.0, cycles=10)
    silent = [replace(o, force=force) for o in report.outcomes]
    assert draw_forces(silent).startswith(PNG)


@pytest.mark.parametrize("peg", ["square", "triangle", "round"])
def test_outline_is_closed_and_its_flats_lie_clearance_outside_the_peg(peg):
    outline = hole_outline(Peg(shape=peg), 0.001)
    np.testing.assert_allclose(outline[0], outline[-1], atol=1e-12)
    middles = 0.5 * (outline[1:] + outline[:-1])
    nearest = np.linalg.norm(middles, axis=1).min()
    assert nearest == pytest.approx(Peg(shape=peg).inner_radius + 0.001, rel=2e-3)
