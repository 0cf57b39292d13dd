"""The doctor finds what is broken, and says how to mend it."""

import importlib.util
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.doctor import installation
from dovetail.doctor.check import Check
from dovetail.doctor.installation import run_checks
from dovetail.errors import install_command
from dovetail.plants.find import make_plant

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def checks():
    return {check.name: check for check in run_checks()}


def test_model_and_mujoco_agree(checks):
    check = checks["model and mujoco agree"]
    assert check.status == "ok", check.detail
    for word in ("um", "Nm", "%"):
        assert word in check.detail


@pytest.mark.bullet
def test_model_and_bullet_agree(checks):
    if importlib.util.find_spec("pybullet") is None:
        pytest.skip(f"needs PyBullet: {install_command('bullet')}")
    check = checks["model and bullet agree"]
    assert check.status == "ok", check.detail


@pytest.mark.parametrize("scheme", ["qp", "paper"])
def test_cycle_time_is_reported(checks, scheme):
    check = checks[f"control cycle, {scheme}"]
    assert check.status == "ok", check.detail
    assert "p50" in check.detail
    assert "p99" in check.detail


def test_essential_parts_are_found(checks):
    for name in ("python", "control core (C++)", "mujoco", "shipped twins"):
        assert checks[name].status == "ok", checks[name].detail


def test_every_extra_for_users_is_looked_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    others = {"all", "docs", "lint", "test"}
    assert set(installation.EXTRAS) == set(project["optional-dependencies"]) - others


def test_a_missing_extra_names_the_command_that_brings_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    check = installation._check_extra("learn")
    assert check.status == "missing"
    assert not check.is_essential
    assert install_command("learn") in check.detail


def test_an_arm_heavier_than_the_model_is_found(monkeypatch):
    def make_heavier(name, cell, dynamics):
        return make_plant(name, cell, replace(dynamics, mass_scale=(1.05,) * 7))

    monkeypatch.setattr("dovetail.plants.find.make_plant", make_heavier)
    check = installation._guard(
        "agreement", lambda: installation._check_agreement("mujoco")
    )
    assert check.status == "broken"
    assert "allowed" in check.detail


def test_the_command_fails_when_something_essential_is_broken(monkeypatch, capsys):
    broken = Check("mujoco", "broken", "version 4.0.0 is installed")
    extra = Check("sbx", "missing", "training", is_essential=False)
    monkeypatch.setattr(
        "dovetail.commands.doctor.run_checks", lambda: iter([broken, extra])
    )
    assert run(["doctor"]) == 1
    assert "version 4.0.0 is installed" in capsys.readouterr().out


def test_the_command_succeeds_when_only_an_extra_is_missing(monkeypatch, capsys):
    extra = Check("sbx", "missing", "pip install sbx-rl", False)
    monkeypatch.setattr("dovetail.commands.doctor.run_checks", lambda: iter([extra]))
    assert run(["doctor"]) == 0
    assert "pip install sbx-rl" in capsys.readouterr().out


def test_any_failure_of_a_check_is_a_finding_not_a_crash():
    check = installation._guard("x", lambda: 1 / np.array(0).item())
    assert check.status == "broken"
    assert "ZeroDivisionError" in check.detail


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--period", "1ms"], "--period would be ignored: .* give --arm"),
        (["--delay", "5ms"], "--delay would be ignored: .* give --arm"),
        (["--arm", "fri://127.0.0.1", "--period", "1ms"], "ignored: .*period=1ms"),
        (["--tracker", "a.toml", "--payload-error", "0.5"], "without --tracker"),
    ],
)
def test_an_option_that_the_checks_do_not_use_is_refused(words, said, capsys):
    assert run(["doctor", *words]) == 2
    assert re.search(said, capsys.readouterr().err)
