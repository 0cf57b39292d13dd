"""The page of the experiments shows the numbers beside it, and no older ones."""

import importlib.util
import shutil
import sys
from pathlib import Path

import pytest

from dovetail.reproduce.report import RESULTS, stamped

FILE = Path(__file__).parent.parent / "docs" / "measured.py"


def load_script():
    spec = importlib.util.spec_from_file_location("docs_measured", FILE)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


measured = load_script()


def test_the_page_and_its_figures_are_of_the_numbers_beside_them():
    assert not measured.differences()


@pytest.fixture
def copied(tmp_path):
    page, numbers = tmp_path / "page.md", tmp_path / "measured"
    shutil.copyfile(measured.PAGE, page)
    shutil.copytree(measured.NUMBERS, numbers)
    return page, numbers


def test_a_number_that_was_changed_by_hand_is_found(copied):
    page, _ = copied
    page.write_text(page.read_text().replace("| open |", "| yes |", 1))
    assert len(measured.differences(*copied)) == 1


def test_a_figure_of_other_numbers_is_found(copied):
    _, numbers = copied
    path = numbers / "transfer.png"
    path.write_bytes(stamped(path.read_bytes(), "{}"))
    (found,) = measured.differences(*copied)
    assert "transfer.png" in found


def test_new_numbers_make_all_old_figures_old(copied):
    _, numbers = copied
    results = numbers / RESULTS
    results.write_text(results.read_text() + "\n")
    assert len(measured.differences(*copied)) == len(measured.FIGURES)


def test_taking_over_mends_the_page(copied, tmp_path):
    page, numbers = copied
    page.write_text(page.read_text().replace("| open |", "| yes |", 1))
    shutil.copytree(numbers, tmp_path / "results")
    measured.take(tmp_path / "results", page, numbers)
    assert not measured.differences(*copied)
