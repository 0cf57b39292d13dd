"""A short recording of a planted arm: three sequences of ten steps, without noise."""

from dataclasses import replace

import pytest
from rich.console import Console

from dovetail.identify.parameters import nominal_model
from dovetail.identify.recorder import RecordConfig, record

PLANTED = {
    "gravity_residual": (0.2, -0.1, 0.15),
    "mass_scale": (1.04,) * 7,
    "damping": (0.8,) * 7,
}


@pytest.fixture(scope="session")
def quiet() -> Console:
    return Console(quiet=True)


@pytest.fixture(scope="session")
def planted_file(tmp_path_factory):
    """Twin file of the nominal model with other gravity, masses and damping."""
    file = tmp_path_factory.mktemp("planted") / "planted.toml"
    file.write_text(replace(nominal_model(), **PLANTED).to_toml())
    return file


@pytest.fixture(scope="session")
def settings(planted_file):
    """Settings of a short recording, its folder aside."""
    return {"arm": f"twin:{planted_file}", "sequences": 3, "steps": 10}


@pytest.fixture(scope="session")
def folder(tmp_path_factory, settings, quiet):
    """Folder of the short recording."""
    out = tmp_path_factory.mktemp("recording") / "log"
    record(RecordConfig(out=out, **settings), quiet)
    return out
