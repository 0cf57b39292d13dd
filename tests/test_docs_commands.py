"""Every `dovetail` command in the docs exists, with every option that is given."""

import importlib
import re
import shlex
from pathlib import Path

import pytest
import tyro

from dovetail.arms.address import parse_address
from dovetail.cli import COMMANDS

DOCS = Path(__file__).parent.parent / "docs"
BLOCK = re.compile(r"```bash\n(.*?)```", re.S)


def commands():
    for path in sorted(DOCS.glob("*.md")):
        for block in BLOCK.findall(path.read_text()):
            for line in block.splitlines():
                if line.strip().startswith("dovetail "):
                    yield pytest.param(line.strip(), id=f"{path.stem}: {line.strip()}")


@pytest.mark.parametrize("line", list(commands()))
def test_a_command_in_the_docs_is_understood(line):
    name, *words = shlex.split(line)[1:]
    assert name in COMMANDS
    module = importlib.import_module(f"dovetail.commands.{name}")
    settings = tyro.cli(getattr(module, COMMANDS[name][0]), args=words)
    if getattr(settings, "arm", None):
        parse_address(settings.arm)
