"""The distribution: one name and version, and extras that install without a build."""

import importlib.metadata
import importlib.util
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import dovetail
from dovetail import distribution
from dovetail.doctor import installation
from dovetail.errors import install_command

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]


def packages(extra):
    """Return what pyproject.toml lists for an extra on this Python."""
    for requirement in map(Requirement, EXTRAS[extra]):
        if requirement.name == PROJECT["name"]:
            for other in requirement.extras:
                yield from packages(other)
        elif requirement.marker is None or requirement.marker.evaluate():
            yield requirement.name, requirement.specifier


@pytest.mark.parametrize("extra", EXTRAS)
def test_a_command_names_exactly_the_packages_of_an_extra(extra):
    expected = set(packages(extra))
    words = shlex.split(install_command(extra))
    if not expected:  # such as PyBullet's, beyond Python 3.11
        assert {"no", "packages", extra} <= {word.strip(",") for word in words}
        return
    named = map(Requirement, words[words.index("install") + 1 :])
    assert {(r.name, r.specifier) for r in named} == expected


def test_one_command_installs_two_extras():
    words = shlex.split(install_command("rpc", "log"))
    named = {Requirement(w).name for w in words[words.index("install") + 1 :]}
    assert named == {name for extra in ("rpc", "log") for name, _ in packages(extra)}


def test_the_command_installs_into_this_python_also_without_pip(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("sys.executable", str(ROOT / ".venv" / "bin" / "python"))
    assert shlex.split(install_command("log"))[0] == ".venv/bin/python"
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    words = shlex.split(install_command("log"))
    assert words[:5] == ["uv", "pip", "install", "--python", ".venv/bin/python"]


def test_an_extra_for_another_python_names_no_command(monkeypatch):
    needs = ["pybullet==3.2.7; python_version < '3' and extra == 'bullet'"]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: needs)
    assert distribution.requirements_of("bullet") == []
    assert "install" not in install_command("bullet")


def test_an_unknown_extra_is_refused():
    with pytest.raises(ValueError, match="learning"):
        install_command("learning")


def test_all_has_every_extra_for_users():
    [requirement] = map(Requirement, EXTRAS["all"])
    assert requirement.name == PROJECT["name"]
    assert requirement.extras == set(installation.EXTRAS)


def test_every_extra_that_a_message_names_is_for_users():
    """So what any command asks for is in `all`."""
    call = re.compile(r'install_command\((["\'])(\w+)\1')
    named = {
        found[2]
        for path in (ROOT / "src" / "dovetail").rglob("*.py")
        for found in call.finditer(path.read_text())
    }
    assert {"learn", "view", "rpc"} < named <= set(installation.EXTRAS)


def test_name_and_version_are_those_of_pyproject():
    assert PROJECT["name"] == distribution.DISTRIBUTION
    assert dovetail.__version__ == PROJECT["version"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^version: (.+)$", citation, re.M)[1] == PROJECT["version"]
