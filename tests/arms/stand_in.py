"""libfranka's stand-in, for this process and those that it starts."""

import os
from pathlib import Path

FOLDER = str(Path(__file__).parent / "fake_franka")


def use_stand_in(monkeypatch):
    """Let `import pylibfranka` find the stand-in until the test ends."""
    monkeypatch.setenv("PYTHONPATH", FOLDER, prepend=os.pathsep)
    monkeypatch.syspath_prepend(FOLDER)
