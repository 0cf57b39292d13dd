"""Every page can be read beside a program, once: narrow lines, short sentences.

What counts as a sentence: tables, code blocks, headings and pictures are left out. A
paragraph, or one item of a list, ends its last sentence. Inside it a sentence ends at
`.`, `!` or `?`, with what closes behind it (brackets, quotes, stars), if white space
and no small letter follows. A colon or a semicolon ends nothing. A word is what white
space divides, if it has a letter or a digit in it. A code span is one word, and of a
link only the text counts.
"""

import re
from math import ceil
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
DOCUMENTS = [page for page in PAGES if page.name != "CHANGELOG.md"]
PROSE, TABLE = 100, 160  # characters
README_WORDS = 900
SENTENCE_WORDS = 25  # at the 90th percentile

FENCE = re.compile(r"^ *```.*?^ *```[^\n]*$", re.S | re.M)
NOT_PROSE = re.compile(r"^(#.*| *\|.*|    .*|!\[.*)?$")
ITEM = re.compile(r"^ *([*-]|\d+\.) +")
END = re.compile(r"(?<=[.!?])[)\]\"'*]*\s+(?![a-z])")


def blocks(text):
    """Yield paragraphs and list items of a page, each as one line."""
    lines, in_item = [], False
    for line in [*FENCE.sub("", text).splitlines(), ""]:
        continues = in_item and lines and line.startswith("    ") and line.strip()
        if ITEM.match(line) or (NOT_PROSE.match(line) and not continues):
            if lines:
                yield " ".join(lines)
            lines = []
        if ITEM.match(line):
            in_item, line = True, ITEM.sub("", line)
        elif NOT_PROSE.match(line) and not continues:
            in_item = in_item and (not line or line.startswith("    "))
            continue
        lines.append(line.strip())


def sentences(text):
    """Return the sentences of a page, each as the list of its words."""
    found = []
    for block in blocks(text):
        plain = re.sub(r"`[^`]+`", "`1`", block)
        plain = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", plain)
        for sentence in END.split(plain):
            words = [word for word in sentence.split() if re.search(r"\w", word)]
            if words:
                found.append(words)
    return found


def long_sentence(found):
    """Return the 90th percentile of sentence length [words], by nearest rank."""
    lengths = sorted(map(len, found))
    return lengths[ceil(0.9 * len(lengths)) - 1]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_lines_are_narrow(page):
    """A shell command is broken by a backslash, a table with long cells is a list."""
    wide = {
        number: len(line)
        for number, line in enumerate(page.read_text().splitlines(), 1)
        if len(line) > (TABLE if line.lstrip().startswith("|") else PROSE)
    }
    assert not wide


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda path: path.name)
def test_sentences_of_a_page_are_short(page):
    found = sentences(page.read_text())
    longest = sorted(found, key=len)[-5:]
    assert long_sentence(found) <= SENTENCE_WORDS, [" ".join(s) for s in longest]


def test_sentences_of_all_pages_are_short():
    found = [s for page in DOCUMENTS for s in sentences(page.read_text())]
    assert len(found) > 500
    assert long_sentence(found) <= SENTENCE_WORDS


def test_what_a_sentence_is():
    text = (
        "# A heading. Not counted\n\n"
        "First `code of four words` ends 0.5 mm\nlater. "
        "[A link](away.md) of e.g. six words!\n\n"
        "| a | table |\n|---|---|\n\n"
        "* an item: one; two (three.) Four\n  five\n* six\n\n"
        "    indented code\n\n```bash\ncode\n```\n"
    )
    assert [" ".join(words) for words in sentences(text)] == [
        "First `1` ends 0.5 mm later.",
        "A link of e.g. six words!",
        "an item: one; two (three.",
        "Four five",
        "six",
    ]


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text().split()) <= README_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_to_other_pages_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        if "://" not in link:
            assert (page.parent / link).exists(), link
