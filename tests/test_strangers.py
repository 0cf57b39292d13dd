"""What a file may not choose: which module is imported."""

import subprocess
import sys

import pytest

from dovetail.errors import ConfigError
from dovetail.plugins import TRUSTED, require_trusted, trust, trust_typed


@pytest.fixture(autouse=True)
def nothing_trusted(monkeypatch):
    monkeypatch.setenv(TRUSTED, "")


def test_a_name_of_dovetail_needs_no_trust():
    assert require_trusted("file", "robot", "iiwa14") == "iiwa14"


def test_a_module_is_run_only_if_somebody_says_so():
    with pytest.raises(ConfigError, match=f"runs the module 'mine'.*{TRUSTED}=mine"):
        require_trusted("file", "robot", "mine:arm")
    trust("mine")
    assert require_trusted("file", "robot", "mine:arm") == "mine:arm"
    with pytest.raises(ConfigError, match="'os'"):
        require_trusted("file", "robot", "os:abort")


@pytest.mark.parametrize("value", [None, 1, [1], {}])
def test_what_is_no_text_is_no_name(value):
    with pytest.raises(ConfigError, match="is no name"):
        require_trusted("file", "env_id", value)


@pytest.mark.parametrize("words", [["--env", "a.b:C-v0"], ["--tracker=a.b:C?x=1"]])
def test_what_is_typed_is_trusted(words):
    trust_typed(words)
    assert require_trusted("file", "env", "a.b:Other-v0") == "a.b:Other-v0"


@pytest.mark.parametrize("key", ["env", "env_id", "tracker"])
@pytest.mark.parametrize("value", ["mine:x.xml", "mine:x.urdf", "menagerie:x"])
def test_only_a_robot_is_a_file(key, value):
    with pytest.raises(ConfigError, match="runs the module"):
        require_trusted("file", key, value)


def test_a_robot_of_menagerie_is_no_module():
    trust_typed(["--robot", "menagerie:panda"])
    with pytest.raises(ConfigError, match="'menagerie'"):
        require_trusted("file", "env", "menagerie:Task-v0")


def test_an_address_is_no_module():
    trust_typed(["--arm", "twin:medium", "--out", "x:y"])
    with pytest.raises(ConfigError, match="'twin'"):
        require_trusted("file", "robot", "twin:medium")


@pytest.mark.parametrize("key", ["robot", "env", "tracker"])
def test_a_run_that_names_code_does_not_run_it(tmp_path, key):
    (tmp_path / "payload.py").write_text("print('it ran')\n")
    (tmp_path / "config.toml").write_text(f"{key} = 'payload:pwn'")
    done = subprocess.run(
        [sys.executable, "-m", "dovetail", "train", "--resume", "--out", "."],
        cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert "payload" in done.stderr
    assert "it ran" not in done.stdout + done.stderr
