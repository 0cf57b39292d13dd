"""Every Python program in the training page runs as it stands."""

import re
from pathlib import Path

import pytest

from extras import need

PAGE = Path(__file__).parent.parent / "docs" / "training.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_a_program_in_the_page_runs(block, tmp_path, monkeypatch):
    if "stable_baselines3" in block:
        need("sbx")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(block, PAGE.name, "exec"), names)
    if env := names.get("env"):
        env.close()


def test_there_are_programs():
    assert len(BLOCKS) >= 2
