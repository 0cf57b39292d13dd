"""Every page can be read beside a program: narrow lines, and a README of one page."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
PROSE, TABLE = 100, 160  # characters
README_WORDS = 900


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_lines_are_narrow(page):
    """A shell command is broken by a backslash, a table with long cells is a list."""
    wide = {
        number: len(line)
        for number, line in enumerate(page.read_text().splitlines(), 1)
        if len(line) > (TABLE if line.lstrip().startswith("|") else PROSE)
    }
    assert not wide


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text().split()) <= README_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_to_other_pages_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        if "://" not in link:
            assert (page.parent / link).exists(), link
