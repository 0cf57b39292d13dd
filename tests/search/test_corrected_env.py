"""An action that corrects a script: what is done, what is seen, and who has the say."""

import copy

import numpy as np
import pytest

from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.registered import make, make_batch, make_env
from dovetail.envs.teleop import TeleopWrapper
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.search.corner import SEARCH_AXES, CornerSearch
from dovetail.search.corrected_env import (
    CORRECTED_STEPS,
    CorrectedEnv,
    NoCorrection,
)
from dovetail.tasks.peg_in_hole.task import PegInHole

SETTINGS = {
    "task": SEARCH_AXES,
    "theta_range": 0.3,
    "near_speed": 0.05,
    "max_steps": 400,
    "recall": (4, 8),
}
NOTHING = np.zeros(6, dtype=np.float32)


def made(**settings):
    return make_env(PegInHole, **{**SETTINGS, "script": "corner", **settings})


def script_of(observation):
    return observation[-7:-1]


def test_without_a_correction_it_is_the_script_and_it_inserts():
    env, plain = made(), make_env(PegInHole, **SETTINGS)
    assert isinstance(env, CorrectedEnv)
    assert not isinstance(plain, CorrectedEnv)
    still = NoCorrection(6)
    still.reset()
    seen, _ = env.reset(seed=3)
    plain.reset(seed=3)
    script = CornerSearch(plain)
    done, info = False, {}
    while not done:
        wanted = script(seen)
        np.testing.assert_array_equal(script_of(seen), wanted)
        seen, reward, ended, cut, info = env.step(still(seen))
        _, plain_reward, *_ = plain.step(wanted)
        assert reward == plain_reward
        done = ended or cut
    assert info["success"]


def test_a_correction_is_added_in_its_share_and_clipped():
    env = made(correction=0.25)
    seen, _ = env.reset(seed=0)
    asked = np.array([1.0, -1.0, 0.5, -0.5, 0.2, 0.0], dtype=np.float32)
    wanted = np.clip(script_of(seen) + 0.25 * asked, -1.0, 1.0)
    seen, *_ = env.step(asked)
    last = [c.name for c in env.columns].index("last_action_0")
    np.testing.assert_allclose(seen[last : last + 6], wanted, atol=1e-6)


def test_corrections_fade_away_so_that_the_script_is_alone_in_the_end():
    env = made()
    seen, _ = env.reset(seed=1)
    shares = []
    for step in range(2 * CORRECTED_STEPS + 3):
        env.steps = step
        seen = env.remember(env.scaling.scale(np.zeros(len(env.scaling))))
        shares.append(float(seen[-1]))
    assert shares[0] == shares[CORRECTED_STEPS] == 1.0
    assert 0.0 < shares[CORRECTED_STEPS + 20] < 1.0
    assert shares[-1] == 0.0
    script = script_of(seen)
    seen, *_ = env.step(np.full(6, 0.7, dtype=np.float32))
    last = [c.name for c in env.columns].index("last_action_0")
    np.testing.assert_array_equal(seen[last : last + 6], script)


def test_columns_and_space_say_what_is_seen():
    env = made(also=("tilt",))
    seen, _ = env.reset(seed=0)
    names = [column.name for column in env.columns]
    assert len(names) == len(seen)
    assert names[-7:] == [*(f"script_{i}" for i in range(6)), "correction_left"]
    assert env.observation_space.shape == seen.shape
    assert env.observation_space.contains(seen)
    seen, *_ = env.step(NOTHING)
    assert env.observation_space.contains(seen)


def test_a_person_who_leads_has_the_whole_say():
    led = np.array([0.0, 0.1, 0.2, 0.0, 0.0, 0.0], dtype=np.float32)
    turn = iter([None, led, None])
    env = TeleopWrapper(made(), lambda core: next(turn))
    seen, _ = env.reset(seed=0)
    core = require_contact_env(env)
    for is_led in (False, True, False):
        script = script_of(seen)
        seen, *_ = env.step(NOTHING)
        last = [c.name for c in core.columns].index("last_action_0")
        wanted = led if is_led else script
        np.testing.assert_array_equal(seen[last : last + 6], wanted)


def test_a_batch_gives_the_numbers_of_each_alone():
    batch = make_batch(PegInHole, 2, threads=1, **SETTINGS, script="corner")
    alone = [made(), made()]
    rng = np.random.default_rng(5)
    try:
        seen, _ = batch.reset(seed=7)
        for i, env in enumerate(alone):
            np.testing.assert_array_equal(seen[i], env.reset(seed=7 + i)[0])
        for _ in range(12):
            actions = rng.uniform(-1.0, 1.0, (2, 6)).astype(np.float32)
            seen, *_ = batch.step(actions)
            for i, env in enumerate(alone):
                np.testing.assert_array_equal(seen[i], env.step(actions[i])[0])
    finally:
        batch.close()


def test_begin_and_step_take_the_same_action():
    env = made()
    env.reset(seed=0)
    env.begin_step(NOTHING)
    with pytest.raises(ConfigError, match="ended with"):
        env.step(np.full(6, 0.5, dtype=np.float32))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"script": "spiral"}, "script 'spiral' is unknown; known: corner"),
        ({"correction": 1.5}, "correction is 1.5; allowed: 0 to 1"),
        ({"task": "XYZ:force A:pose BC:hold"}, "corner search needs the axes"),
    ],
)
def test_what_cannot_be_corrected_is_refused(change, words):
    with pytest.raises(ConfigError, match=words):
        made(**change)


def test_a_copy_corrects_as_well():
    env = made(correction=0.4)
    twin = copy.deepcopy(env)
    assert isinstance(twin, CorrectedEnv)
    np.testing.assert_array_equal(env.reset(seed=2)[0], twin.reset(seed=2)[0])
    assert twin.config.correction == 0.4


def test_it_is_made_by_its_name():
    env = make("dovetail/PegInHole-v0", script="corner", **SETTINGS)
    assert isinstance(require_contact_env(env), CorrectedEnv)
    plain = make("dovetail/PegInHole-v0", **SETTINGS)
    assert type(require_contact_env(plain)) is ContactEnv
