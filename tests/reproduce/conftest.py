"""Stages that take a moment: a module of toys on the path of the stages' processes."""

import pytest

from dovetail.reproduce.stage import Stage

TOYS = '''
import json, os, signal, time
from pathlib import Path


def count(sitting):
    """Notes that it ran, and gives the sum of what it needs."""
    with (sitting.folder / "ran").open("a") as file:
        file.write("x")
    total = sitting.settings.get("value", 0)
    for name in sitting.settings.get("of", []):
        done = json.loads((sitting.of(name) / "done.json").read_text())
        total += done["result"]["sum"]
    return {"sum": total}


def wait(sitting):
    """Says where it is, then waits until a file is there."""
    (sitting.folder / "pid").write_text(str(os.getpid()))
    with (sitting.folder / "ran").open("a") as file:
        file.write("x")
    print("waiting for go", flush=True)
    while not (sitting.root / "go").exists():
        time.sleep(0.02)
    return {"sum": 0}


def refuse(sitting):
    from dovetail.errors import ConfigError
    raise ConfigError("the toy is broken; take another")


def crash(sitting):
    raise RuntimeError("a bolt came off")


def die(sitting):
    os.kill(os.getpid(), signal.SIGKILL)


def fail_once(sitting):
    if not (sitting.folder / "tried").exists():
        (sitting.folder / "tried").touch()
        raise RuntimeError("not yet")
    return {"sum": 1}
'''


@pytest.fixture
def toys(tmp_path_factory, monkeypatch):
    """Makes stages that run a function of the toys."""
    folder = tmp_path_factory.mktemp("toys")
    (folder / "toy_stages.py").write_text(TOYS)
    monkeypatch.setenv("PYTHONPATH", str(folder))

    def make(name, function="count", needs=(), expected=1.0, **settings):
        return Stage(
            name=name,
            run=f"toy_stages:{function}",
            settings=settings,
            needs=tuple(needs),
            expected=expected,
        )

    return make


class Notes:
    """A display that keeps what it is told."""

    def __init__(self):
        self.order = []
        self.done = []
        self.lost = {}

    def started(self, stage):
        self.order.append(stage.name)

    def finished(self, stage, seconds):
        self.done.append(stage.name)

    def failed(self, stage, reason):
        self.lost[stage.name] = reason

    def tick(self):
        pass


@pytest.fixture
def notes():
    return Notes()
