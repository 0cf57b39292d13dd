from hops import trace

CALLS_MAX, FILES_MAX = 24, 12
"""How many there are: the numbers only fall."""


def test_an_action_goes_straight_to_the_torque_and_back():
    calls = trace("dovetail/PegInHole-v0")
    assert calls[0].name == "ContactEnv.step"
    assert len(calls) <= CALLS_MAX, calls
    assert len({call.file for call in calls}) <= FILES_MAX
