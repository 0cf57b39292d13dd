"""Every `dovetail` command in README and docs exists, with every option given."""

import importlib
import re
import shlex
import shutil
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.cli import COMMANDS
from dovetail.commands.command_line import parse
from dovetail.commands.evaluate import Evaluate
from dovetail.commands.serve import Serve
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.plants.twin import TWIN_FOLDER
from robots.arm_files import urdf

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
                yield line.partition(" > ")[0].strip()
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
    monkeypatch.syspath_prepend(tmp_path)
    for name in CERTIFICATES:
        Path(name).touch()
    for example in ("06_ring_over_post", "09_open_a_drawer"):
        shutil.copy(ROOT / "examples" / f"{example}.py", f"{example[3:]}.py")
    Path("parts/knob").mkdir(parents=True)
    for part in ("hexagon.toml", "part.toml", "parts/knob/part.toml"):
        shutil.copy(ROOT / "examples" / "hexagon.toml", part)
    Path("examples").mkdir()
    for folder in ("pairs", "held"):
        Path(folder).mkdir()
        shutil.copy("hexagon.toml", folder)
    for name in ("cell.toml", "examples/cell.toml"):
        shutil.copy(ROOT / "examples" / "cell.toml", name)
    Path("my_arm.py").write_text(program("your-own-robot"))
    Path("arm.urdf").write_text(urdf())
    name, *words = shlex.split(line, comments=True)[1:]
    assert name in COMMANDS
    module = importlib.import_module(f"dovetail.commands.{name}")
    kind = getattr(module, COMMANDS[name][0])
    try:
        settings = parse(kind, words)
    except SystemExit:  # help, or a name whose options the text leaves out
        assert "--help" in words or " -" not in line
        assert "Unrecognized" not in capsys.readouterr().err
        return
    if arm := vars(settings).get("arm"):
        parse_address(arm)


def served_learners():
    """Yield each command of a service with each learner's that follows on the page."""
    for path in sorted((ROOT / "docs").glob("*.md")):
        service = ""
        for line in lines(path.read_text()):
            if line.startswith("dovetail serve "):
                service = line
            elif "grpc://" in line and line.startswith("dovetail evaluate "):
                yield pytest.param(service, line, id=f"{path.stem}: {line}")


@pytest.mark.parametrize(("service", "learner"), list(served_learners()))
def test_a_learner_in_the_docs_fits_its_service(
    service, learner, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for name in CERTIFICATES:
        Path(name).touch()
    words = shlex.split(service, comments=True)[2:]
    offered = parse_address(parse(Serve, words).arm)
    asked = parse(Evaluate, shlex.split(learner, comments=True)[2:])
    arm = parse_address(asked.arm)
    period = arm.control_period(asked.period, DEFAULT_PERIOD)
    assert offered.period in (None, period)
    assert offered.places_fixture or asked.fixture is not None


def program(page):
    """Return the Python block of a page."""
    text = (ROOT / "docs" / f"{page}.md").read_text()
    return "\n".join(re.findall(r"```python\n(.*?)```", text, re.S))


def test_the_robot_of_the_docs_does_the_task(tmp_path, monkeypatch):
    pytest.importorskip("pybullet_data")
    (tmp_path / "docs_arm.py").write_text(program("your-own-robot"))
    monkeypatch.syspath_prepend(tmp_path)
    env = gym.make("dovetail/PegInHole-v0", robot="docs_arm:light_arm")
    env.reset(seed=0)
    *_, info = env.step(np.array([0.0, 0.0, -0.5, 0.0], dtype=np.float32))
    assert info["limit_violations"] == 0
    env.close()


def test_the_part_of_the_docs_is_a_part():
    names = {}
    exec(program("your-own-part"), names)
    np.testing.assert_allclose(names["cup"].corners[:, 2].max(), 0.0, atol=1e-12)
    assert [piece.joint.column for piece in names["door"].moving] == ["hinge_door"]


def test_commands_are_found_in_the_readme_and_in_every_guide():
    found = {param.id.partition(":")[0] for param in commands()}
    guides = {"README", "cabinet", "experiments", "identification", "real-robot"}
    assert found >= guides | {"remote-arm", "robustness", "tare", "training"}
