"""The report says what came out, what the paper says, and what is missing."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from toy_results import finish

from dovetail.learn.progress import EpisodeRow
from dovetail.reproduce.budget import QUICK
from dovetail.reproduce.figures import curve, draw_robustness, moving_average
from dovetail.reproduce.plan import VARIANTS, PlanConfig, plan
from dovetail.reproduce.report import write_reproduction
from dovetail.reproduce.results import gather
from dovetail.reproduce.workflow import RunSummary
from extras import need

need("plotly")
TWO_SEEDS = PlanConfig(
    budget=replace(QUICK, seeds=2, other_direction=True),
    twins=("medium", "hard"),
    plant="bullet",
)
STAGES = plan(TWO_SEEDS)
NAMES = {stage.name for stage in STAGES}


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """All stages done: seed 0 inserted 6 of 6, seed 1 5 of 6 (one pose: all)."""
    folder = tmp_path_factory.mktemp("results")
    for stage in STAGES:
        seed_1 = stage.name.endswith("seed-1")
        finish(folder, stage, successes=5 if seed_1 else 6)
    return folder


def write(root, config=TWO_SEEDS, tally=None):
    files = write_reproduction(root, config, STAGES, tally or RunSummary(done=NAMES))
    results = json.loads((root / "results.json").read_text())
    return files, results, (root / "report.html").read_text()


@pytest.fixture(scope="module")
def written(root):
    return write(root)


@pytest.fixture(scope="module")
def page(written):
    return written[2]


class Cells(HTMLParser):
    """Collects the cells of every table row."""

    def __init__(self):
        super().__init__()
        self.rows = []
        self.is_inside = False

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        self.is_inside = tag in ("td", "th")
        if self.is_inside:
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        self.is_inside = False

    def handle_data(self, data):
        if self.is_inside:
            self.rows[-1][-1] += data


def row(page, name, number=0):
    """Returns the cells after the name in a row of that name."""
    parser = Cells()
    parser.feed(page)
    return [cells[1:] for cells in parser.rows if cells[:1] == [name]][number]


def test_the_papers_cells_stand_beside_ours(page):
    assert row(page, "dynamics randomisation, triangle")[:5] == [
        "20/20 20/20 10/20",
        "4/4 (51-100 %)",
        "4/4 (51-100 %)",
        "3/4 (30-95 %)",
        "11/12 (65-99 %)",
    ]


def test_several_seeds_are_told_apart(page):
    assert row(page, "stack 4", number=1) == ["6/6", "5/6"]


def test_every_cell_has_its_wilson_interval_in_the_numbers_too(written):
    _, results, _ = written
    (stack_0, *_) = results["transfer"]
    assert stack_0["paper_on_a_robot"]["cells"] == ["20/20"] * 3
    total = stack_0["ours_on_a_twin"]["rows"][-1]
    assert (total["successes"], total["tries"]) == (11, 12)
    assert total["interval"] == pytest.approx([0.646, 0.985], abs=1e-3)
    assert stack_0["ours_on_a_twin"]["by_seed"] == {"0": "6/6", "1": "5/6"}


def test_steps_forces_and_limits_are_told(page):
    # median and largest steps; mean, p95 and largest force; limits broken
    numbers = ["40 / 40", "3.0", "20.0", "20.0", "0"]
    one_pose = row(page, "trained on the twin itself, one pose")
    assert one_pose == ["20/20", "2/2 (34-100 %)", "", "", "2/2 (34-100 %)", *numbers]


def test_steps_and_time_of_the_trainings_are_told(page):
    trained = row(page, "stack 4", number=2)
    assert trained == ["0", "60,000", "12:05 min", "199/200"]


def test_error_before_and_after_cost_and_verdict_of_a_fit_are_told(page):
    errors = ["12.50", "1.25", "14.00", "2.00"]
    assert row(page, "twin hard, extended") == [*errors, "60", "30 s", "go"]


def test_stack_0_is_told_with_and_without_identification(page):
    for word in ("neither tared nor identified", "tared", "tared and identified"):
        found = row(page, f"twin hard, {word}")
        assert found[0] == "11/12 (65-99 %)"


def test_the_other_direction_is_a_row(page):
    name = "train MuJoCo, twin PyBullet (twin medium-in-bullet (mujoco))"
    assert row(page, name)[0] == "11/12 (65-99 %)"


def test_a_result_says_twin_and_the_paper_says_robot(page):
    assert "nothing here has run on a robot" in page
    assert "paper, robot" in page
    assert "twin, pose A" in page


def test_level_0_of_a_disturbance_is_the_transfer_table(root):
    found = gather(root, TWO_SEEDS)
    level = found.robustness["stack-0", "push"][0]
    assert level.level == 0.0
    assert level.table.by_seed == found.transfer[0][1].by_seed


SCRIPT = re.compile(r"<script[^>]*>(.*?)</script>", re.DOTALL)


def test_the_page_needs_nothing_else(page):
    assert "<script src" not in page
    page = SCRIPT.sub("", page)
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert page.count("data:image/png;base64,") == 5  # 3 figures, one of each fit


def drawn(page):
    """Returns the lines of the curves that one can zoom into."""
    (script,) = (s for s in SCRIPT.findall(page) if '"legendgroup"' in s[:100_000])
    return json.JSONDecoder().raw_decode(script[script.index("[{") :])[0]


def test_each_training_is_a_curve_to_zoom_into(page):
    lines = drawn(page)
    names = [f"{v}, seed {s}" for v in VARIANTS.values() for s in (0, 1)]
    assert [line["name"] for line in lines] == 3 * names  # success, reward, length
    for line, first, last in ((lines[0], 100.0, 50.0), (lines[6], -8.0, 15.5)):
        assert (line["x"][0], line["x"][-1]) == (100, 2900)
        assert (line["y"][0], line["y"][-1]) == (first, last)
    assert lines[-1]["y"] == [40.0] * len(lines[-1]["x"])
    assert sum(len(script) > 1_000_000 for script in SCRIPT.findall(page)) == 1


def test_a_training_that_is_missing_takes_no_other_seeds_name(tmp_path):
    for stage in STAGES:
        if stage.name != "train-stack-0-seed-0":
            finish(tmp_path, stage)
    names = {line["name"] for line in drawn(write(tmp_path)[2])}
    wanted = {f"{v}, seed {s}" for v in VARIANTS.values() for s in (0, 1)}
    assert names == wanted - {"stack 0, seed 0"}


def test_what_is_missing_is_named_and_the_rest_is_there(tmp_path):
    lost = "train-stack-4-seed-0"
    for stage in STAGES:
        if "stack-4" not in stage.name:
            finish(tmp_path, stage)
    tally = RunSummary(
        failed={lost: "a <bolt> came off"},
        left_out={"transfer-stack-4-square-seed-0": lost},
    )
    _, results, page = write(tmp_path, tally=tally)
    assert results["missing"][lost] == "a <bolt> came off"
    assert results["transfer"][1]["ours_on_a_twin"] is None
    assert results["transfer"][0]["ours_on_a_twin"] is not None
    assert row(page, lost) == ["a <bolt> came off"]
    after = row(page, "transfer-stack-4-square-seed-0")
    assert after == [f"left out, it needs {lost}"]
    assert "not run" in row(page, "stack 4, triangle")


def test_a_report_of_nothing_can_be_written(tmp_path):
    files, results, page = write(
        tmp_path, tally=RunSummary(failed=dict.fromkeys(NAMES, "x"))
    )
    assert all(path.stat().st_size for path in files)
    assert not results["trainings"]
    assert f"{len(NAMES)} of {len(NAMES)} stages are missing" in page


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plant": "mujoco"}, "its contacts are no test of transfer"),
        ({"budget": replace(QUICK, name="smoke")}, "learns nothing"),
    ],
)
def test_what_a_result_cannot_show_is_said(tmp_path, changes, words):
    _, _, page = write(tmp_path, config=replace(TWO_SEEDS, **changes))
    assert words in page


def test_the_moving_average_looks_back_over_its_window():
    values = np.arange(30.0)
    average = moving_average(values, window=10)
    assert average[29] == np.mean(values[20:])
    assert average[3] == np.mean(values[:4])


def test_a_curve_covers_the_steps_that_all_seeds_have():
    def run(last):
        return [EpisodeRow(s, -1.0, 40, 1, 0.0, 0.0) for s in range(100, last, 100)]

    steps, lines = curve([run(1000), run(2000), []], "success")
    assert (steps[0], steps[-1]) == (100, 900)
    assert lines.shape == (2, len(steps))
    assert (lines == 1.0).all()


def test_one_level_of_a_disturbance_can_be_drawn(root):
    robustness = gather(root, TWO_SEEDS).robustness
    few = {key: levels[-1:] for key, levels in robustness.items()}
    assert draw_robustness(few).startswith(b"\x89PNG")
