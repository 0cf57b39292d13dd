import importlib.util
from pathlib import Path

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "hops.py"
CALLS_MAX, FILES_MAX = 24, 12
"""How many there are: the numbers only fall."""


def test_an_action_goes_straight_to_the_torque_and_back():
    spec = importlib.util.spec_from_file_location("hops", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    hops = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hops)
    calls = hops.trace("dovetail/PegInHole-v0")
    assert calls[0].name == "ContactEnv.step"
    assert len(calls) <= CALLS_MAX, calls
    assert len({call.file for call in calls}) <= FILES_MAX
