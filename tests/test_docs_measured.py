"""The page of the experiments shows the numbers beside it, and no older ones."""

import pytest

import docs_scripts
from dovetail.reproduce.budget import SMOKE
from dovetail.reproduce.design import Design
from dovetail.reproduce.plan import plan
from dovetail.reproduce.report import RESULTS, stamped, write_reproduction
from dovetail.reproduce.workflow import RunSummary
from extras import need

measured = docs_scripts.load("measured")


def test_the_page_and_its_figures_are_of_the_numbers_beside_them():
    assert not measured.differences()


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The results folder of a run of which no stage is done."""
    need("plotly")
    folder = tmp_path_factory.mktemp("results")
    design = Design(budget=SMOKE, twins=("medium",))
    write_reproduction(folder, design, plan(design), RunSummary())
    return folder


@pytest.fixture
def taken(results, tmp_path):
    page, numbers = tmp_path / "page.md", tmp_path / "measured"
    page.write_text(f"# Before\n{measured.BEGIN}old\n{measured.END}after\n")
    measured.take(results, page, numbers)
    return page, numbers


def test_taking_over_leaves_the_rest_of_the_page(taken):
    page, _ = taken
    text = page.read_text()
    assert text.startswith("# Before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| open |" in text
    assert not measured.differences(*taken)


def test_a_number_that_was_changed_by_hand_is_found(taken):
    page, _ = taken
    page.write_text(page.read_text().replace("| open |", "| yes |", 1))
    assert len(measured.differences(*taken)) == 1


def test_a_figure_of_other_numbers_is_found(taken):
    _, numbers = taken
    path = numbers / "transfer.png"
    path.write_bytes(stamped(path.read_bytes(), "{}"))
    (found,) = measured.differences(*taken)
    assert "transfer.png" in found


def test_new_numbers_make_all_old_figures_old(taken):
    _, numbers = taken
    results = numbers / RESULTS
    results.write_text(results.read_text() + "\n")
    assert len(measured.differences(*taken)) == len(measured.FIGURES)


def test_a_page_without_its_numbers_is_found(taken, tmp_path):
    page, _ = taken
    assert len(measured.differences(page, tmp_path / "nowhere")) == 1
