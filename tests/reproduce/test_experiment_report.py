"""The report says what came out, what the paper says, and what is missing."""

import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from toy_results import finish

from dovetail.learn.progress import EpisodeRow
from dovetail.reproduce.budget import SMOKE
from dovetail.reproduce.design import LAWS, MODELS, Design
from dovetail.reproduce.figures import curve, draw_robustness, moving_average
from dovetail.reproduce.plan import plan
from dovetail.reproduce.report import write_reproduction
from dovetail.reproduce.results import gather, learned_at
from dovetail.reproduce.workflow import RunSummary
from extras import need

need("plotly")
TWINS = ("a", "b", "c")
DESIGN = Design(
    budget=replace(SMOKE, name="toy", seeds=3, twins=3, drake_twins=2, paper_twins=2),
    twins=TWINS,
    engines=("mujoco", "bullet", "drake"),
)
STAGES = plan(DESIGN)
NAMES = {stage.name for stage in STAGES}


def successes(name):
    """Returns how many of 6 tries succeed: identified ones all, nominal ones a third.

    With a tare all of all.
    """
    return 2 if "nominal" in name and "tared" not in name else 6


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """All stages done."""
    folder = tmp_path_factory.mktemp("results")
    for stage in STAGES:
        finish(folder, stage, successes(stage.name))
    return folder


def write(root, design=DESIGN, tally=None):
    files = write_reproduction(root, design, STAGES, tally or RunSummary(done=NAMES))
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
        *["4/4"] * 3,
        "12/12 (76 to 100 %)",
    ]
    numbers = ["40 / 40", "20"]
    one_pose = row(page, "trained on the arm, one pose")
    assert one_pose == ["20/20", "2/2", "", "", "2/2 (34 to 100 %)", *numbers]


def test_a_cell_has_success_time_force_and_training(page):
    found = row(page, "nominal")
    assert found[:2] == ["MuJoCo", "33.3 % of 54"]  # 3 policies on 3 twins, 6 tries
    assert found[2:4] == ["33 to 33 %", "100 %"]
    # two of six took 40 steps, the others the longest, 40 in this budget
    assert found[4:] == ["2.00", "20.0", "99.5 %", "2,900", "0", "0"]
    assert row(page, "nominal", 1)[0] == "PyBullet to MuJoCo"
    assert row(page, "nominal", 2)[0] == "MuJoCo to Drake"


def test_the_answers_follow_from_the_cells(page, written):
    question = "Does identification improve transfer?"
    value = "+66.7 points (+66.7 to +66.7)"
    none = "+0.0 points (+0.0 to +0.0)"
    papers, ours, tared = (row(page, question, law)[1:] for law in range(3))
    assert papers == ["the paper's law", value, "yes"]
    assert ours == ["our law", value, "yes"]
    assert tared == ["our law with a tare", none, "open"]
    assert f"With our law: yes, {value}." in page
    less = row(page, "Does identification matter less with a tare?")
    assert less[2:] == [value, "yes"]
    verdicts = [one["verdict"] for one in written[1]["answers"]]
    assert verdicts.count("yes") >= 3


def test_the_markdown_has_the_same_tables(root, page):
    lines = (root / "results.md").read_text().splitlines()
    cells = row(page, "nominal")
    assert f"| nominal | {' | '.join(cells)} |" in lines


def test_a_figure_says_which_numbers_it_shows(root, written):
    digest = hashlib.sha256((root / "results.json").read_bytes()).hexdigest()
    for name in ("transfer", "training", "learners", "robustness"):
        with Image.open(root / f"{name}.png") as image:
            assert image.info["results"] == digest


def test_every_number_is_in_the_json(written):
    _, results, _ = written
    cell = next(c for c in results["cells"] if c["model"] == "nominal")
    assert cell["measures"]["success"] == [[0.3333] * 3] * 3
    assert len(results["cells"]) == 3 * len(MODELS) + 3 + 9


def test_the_script_is_a_row_of_its_own(page):
    assert row(page, "scripted search")[:2] == ["MuJoCo", "100.0 % of 18"]


def test_error_before_and_after_and_cost_of_the_fits_are_told(page):
    found = row(page, "extended")
    assert found == ["3", "14.0 (14.0 to 14.0)", "2.00 (2.00 to 2.00)", "60", "30 s"]


def test_trainings_on_the_arm_are_told_before_and_after(page):
    found = row(page, "nominal, the paper's law, seed 0")
    assert found == ["2/2", "20", "2/2", "20", "60,000", "50.0", "0"]


def test_a_result_says_twin_and_the_paper_says_robot(page):
    assert "nothing here has run on a robot" in page
    assert "paper, robot" in page


def test_a_training_has_learned_when_nine_of_ten_succeed():
    def rows(*successes):
        return [EpisodeRow(10 * i, 0.0, 40, s, 0.0, i) for i, s in enumerate(successes)]

    assert learned_at(rows(*[0] * 60)) is None
    assert learned_at(rows(*[1] * 49)) is None
    learned = learned_at(rows(*[0] * 20, *[1] * 60))
    assert learned is not None
    assert learned.step == 640  # the 45th success after 20 failures


SCRIPT = re.compile(r"<script[^>]*>(.*?)</script>", re.DOTALL)


def test_the_page_needs_nothing_else(page):
    assert "<script src" not in page
    page = SCRIPT.sub("", page)
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert page.count("data:image/png;base64,") == 4


def drawn(page):
    """Returns the lines of the curves that one can zoom into."""
    (script,) = (s for s in SCRIPT.findall(page) if '"legendgroup"' in s[:100_000])
    return json.JSONDecoder().raw_decode(script[script.index("[{") :])[0]


def test_each_training_is_a_curve_to_zoom_into(page):
    lines = drawn(page)
    count = sum(9 for _ in LAWS for _ in MODELS)  # 3 policies, 3 panels
    assert len(lines) == count
    assert {line["name"] for line in lines} == {
        f"{model.label}, {law.label}"
        for law in LAWS.values()
        for model in MODELS.values()
    }
    assert (lines[0]["x"][0], lines[0]["x"][-1]) == (100, 2900)
    assert (lines[0]["y"][0], lines[0]["y"][-1]) == (100.0, 50.0)
    assert sum(len(script) > 1_000_000 for script in SCRIPT.findall(page)) == 1


def test_what_is_missing_is_named_and_the_rest_is_there(tmp_path):
    lost = "train-paper-nominal-seed-0"
    for stage in STAGES:
        if not stage.name.startswith(("train-paper-nominal", "try-paper-nominal")):
            finish(tmp_path, stage)
    after = "try-paper-nominal-seed-0-on-a"
    tally = RunSummary(failed={lost: "a <bolt> came off"}, left_out={after: lost})
    _, results, page = write(tmp_path, tally=tally)
    assert results["missing"][lost] == "a <bolt> came off"
    assert row(page, lost) == ["a <bolt> came off"]
    assert row(page, after) == [f"left out, it needs {lost}"]
    question = "Does identification improve transfer?"
    assert row(page, question, 0)[2:] == ["nothing yet", "open"]
    assert row(page, question, 1)[2:] != ["nothing yet", "open"]


def test_a_report_of_nothing_can_be_written(tmp_path):
    files, results, page = write(
        tmp_path, tally=RunSummary(failed=dict.fromkeys(NAMES, "x"))
    )
    assert all(path.stat().st_size for path in files)
    assert {one["verdict"] for one in results["answers"]} == {"open"}
    assert f"{len(NAMES)} of {len(NAMES)} stages are missing" in page


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engines": ("mujoco", "drake")}, "PyBullet is not installed"),
        ({"budget": replace(DESIGN.budget, name="smoke")}, "learns nothing"),
    ],
)
def test_what_a_result_cannot_show_is_said(tmp_path, changes, words):
    _, _, page = write(tmp_path, design=replace(DESIGN, **changes))
    assert words in page


def test_the_moving_average_looks_back_over_its_window():
    values = np.arange(30.0)
    average = moving_average(list(values), window=10)
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
    assert draw_robustness(gather(root, DESIGN).robustness).startswith(b"\x89PNG")
