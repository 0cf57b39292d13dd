"""A learner chooses the control period of an arm over gRPC, 2.5 ms as well."""

import gymnasium as gym
import numpy as np
import pytest

from dovetail.arms.address import parse_address
from dovetail.arms.local_address import PlantAddress
from dovetail.control.limits import DeclaredErrors
from dovetail.control.period import PERIODS
from dovetail.errors import ConfigError
from dovetail.plants.plant import COLUMN
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.server import ArmServer

ACTION = np.array([0.2, 0.0, -0.3, 0.5], dtype=np.float32)


def play(**options):
    """Return the log of a few policy steps from the same start."""
    env = gym.make("dovetail/PegInHole-v0", **options)
    env.reset(seed=1)
    log = []
    for _ in range(3):
        env.step(ACTION)
        log.append(env.unwrapped.state.log)
    env.close()
    return np.concatenate(log)


@pytest.mark.parametrize("period", PERIODS)
def test_the_arm_moves_as_one_in_this_process_at_every_period(simulation, period):
    address = f"{simulation.url}&period={1e3 * period:g}ms"
    remote, here = play(arm=address, tare=False), play(period=period, tare=False)
    assert len(remote) == len(here) == round(3 * 0.05 / period)
    columns = slice(COLUMN["time"], COLUMN["q7"] + 1)
    np.testing.assert_allclose(remote[:, columns], here[:, columns], atol=1e-12)


def test_a_service_refuses_a_learner_that_declares_less(cell, news):
    least = DeclaredErrors(delay=0.012, mass_error=0.1)
    arm = OfferedArm(parse_address("mujoco"), cell, least)
    with ArmServer(arm, "127.0.0.1:0", notify=news.append) as server:
        address = server.url
        with pytest.raises(ConfigError) as error:
            play(arm=address)
        assert "delay of the arm at mujoco is up to 12 ms" in str(error.value)
        assert "the learner's limits declare 10 ms" in str(error.value)
        assert "--delay 12ms, or in Python delay=0.012" in str(error.value)
        with pytest.raises(ConfigError, match=r"declare 0 ms.*and no margins=model"):
            play(arm=f"{address}&margins=model")
        assert len(play(arm=address, delay=0.012)) == 30
    assert any("warning: as declared, the loop's delay is 12 ms" in n for n in news)


def test_a_service_that_offers_one_period_refuses_any_other(cell):
    arm = OfferedArm(PlantAddress(text="mujoco", engine="mujoco", period=0.0025), cell)
    with ArmServer(arm, "127.0.0.1:0") as server:
        address = server.url
        with pytest.raises(ConfigError) as error:
            play(arm=address, period=0.001)
        assert "commanded every 2.5 ms, the learner asks for 1 ms" in str(error.value)
        assert "add period=2.5ms to the learner's address" in str(error.value)
        assert len(play(arm=f"{address}&period=2.5ms")) == 60
