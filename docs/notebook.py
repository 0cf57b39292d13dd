"""Write docs/tutorial.ipynb, the tutorial as a notebook, from docs/tutorial.md.

A block of commands becomes a cell that runs them, a block of Python a cell of Python.
What a command printed stays text. A command that serves a page until it is ended would
keep the notebook waiting, so it stays text, too.
"""

import json
import re
from pathlib import Path

PAGE = Path(__file__).parent / "tutorial.md"
NOTEBOOK = PAGE.with_suffix(".ipynb")
BLOCK = re.compile(r"^```(bash|python)\n(.*?)^```$\n?", re.S | re.M)
FIRST_LINE = re.compile(r"^(?<!\\\n)(?=.)", re.M)
"""Where a command begins: a line that none before it continues with a backslash."""
WAITS = ("dovetail cockpit", "dovetail replay")
INTRODUCTION = """\
This notebook is made from `tutorial.md` by `python docs/notebook.py`. Start it in a
folder of its own, in the environment where dovetail is installed.
"""


def lines(text: str) -> list[str]:
    """Return text as a notebook keeps it: its lines, each with its end."""
    return text.strip("\n").splitlines(keepends=True)


def cell(number: int, text: str, *, is_code: bool) -> dict[str, object]:
    """Return one cell of a notebook."""
    common = {"id": f"cell-{number}", "metadata": {}, "source": lines(text)}
    if is_code:
        return {"cell_type": "code", "execution_count": None, "outputs": [], **common}
    return {"cell_type": "markdown", **common}


def cells(page: str) -> list[dict[str, object]]:
    """Return the cells of a page: text, and the blocks in it that can be run."""
    found: list[tuple[str, bool]] = []
    end = 0
    for block in BLOCK.finditer(page):
        language, code = block.groups()
        if code.startswith(WAITS):
            continue
        found.append((page[end : block.start()], False))
        if language == "bash":
            code = FIRST_LINE.sub("!", code)
        found.append((code, True))
        end = block.end()
    found.append((page[end:], False))
    title, _, rest = found[0][0].partition("\n")
    found[0] = (f"{title}\n\n{INTRODUCTION}{rest}", False)
    return [cell(i, text, is_code=code) for i, (text, code) in enumerate(found)]


def notebook() -> str:
    """Return the notebook's file."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    content = {
        "cells": cells(PAGE.read_text()),
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    NOTEBOOK.write_text(notebook())
