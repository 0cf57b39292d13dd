"""Every `dovetail` command in README and docs exists, with every option given."""

import importlib
import re
import shlex
from pathlib import Path

import pytest
import tyro

from dovetail.arms.address import parse_address
from dovetail.cli import COMMANDS
from dovetail.plants.twin import TWIN_FOLDER

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"```bash\n(.*?)```", re.S)
CONTINUED = re.compile(r"\\\n\s*")
FENCED = re.compile(r"^ *```.*?^ *```", re.S | re.M)
SPAN = re.compile(r"`(dovetail [^`]+)`")
STANDS_FOR = {"POLICY": "peg_square", "model.toml": str(TWIN_FOLDER / "easy.toml")}
CERTIFICATES = ("ca.pem", "learner.pem", "learner.key")
PLACEHOLDER = re.compile(r"\.\.\.|\b[A-Z]{3,}\b")


def lines(text):
    """Yield the commands of bash blocks, and those in the text between code spans."""
    for block in BLOCK.findall(text):
        for line in CONTINUED.sub(" ", block).splitlines():
            if line.strip().startswith("dovetail "):
                yield line.strip()
    for line in SPAN.findall(FENCED.sub("", text)):
        for word, value in STANDS_FOR.items():
            line = re.sub(rf"(?<=\s){re.escape(word)}\b", value, line)
        if not PLACEHOLDER.search(line):
            yield " ".join(line.partition(" > ")[0].split())


def commands():
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for line in dict.fromkeys(lines(path.read_text())):
            yield pytest.param(line, id=f"{path.stem}: {line}")


@pytest.mark.parametrize("line", list(commands()))
def test_a_command_in_the_docs_is_understood(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in CERTIFICATES:
        Path(name).touch()
    name, *words = shlex.split(line, comments=True)[1:]
    assert name in COMMANDS
    module = importlib.import_module(f"dovetail.commands.{name}")
    kind = getattr(module, COMMANDS[name][0])
    try:
        settings = tyro.cli(kind, args=words)
    except SystemExit:  # help, or a name whose options the text leaves out
        assert "--help" in words or " -" not in line
        assert "Unrecognized" not in capsys.readouterr().err
        return
    if getattr(settings, "arm", None):
        parse_address(settings.arm)


def test_commands_are_found_in_the_readme_and_in_every_guide():
    found = {param.id.partition(":")[0] for param in commands()}
    guides = {"README", "cabinet", "experiments", "identification", "real-robot"}
    assert found >= guides | {"remote-arm", "robustness", "tare", "training"}
