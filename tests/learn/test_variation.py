"""What differs between the episodes of a training, and is not told."""

import json

import numpy as np
import pytest

from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from extras import need
from facts import about

SEARCH = {
    "task": "XYZ:force ABC:pose",
    "doubt": 0.01,
    "doubt_turn": 0.05,
    "vary": "peg=square,triangle",
    "num_envs": 3,
}


def test_each_environment_has_the_next_value_and_the_policy_the_tasks_own():
    need("sbx")
    from dovetail.learn.algorithms import make_vec_env

    config = TrainConfig(**SEARCH)
    env = make_vec_env(config)
    cores = [require_contact_env(one) for one in env.envs]
    env.close()
    assert [core.task.peg for core in cores] == ["square", "triangle", "square"]
    assert {core.tracker.doubt for core in cores} == {0.01}
    assert {core.tracker.turn for core in cores} == {0.05}
    assert config.env_options()["peg"] == "square"
    assert config.env_options()["tracker"] == "truth"
    assert "--vary peg=square,triangle" in config.command()


def test_of_several_options_every_pair_is_there():
    vary = "peg=square,triangle&clearance=0.001,0.0005,0.0001"
    config = TrainConfig(**{**SEARCH, "vary": vary, "num_envs": 7})
    made = [config.varied_options(i) for i in range(7)]
    pairs = [(options["peg"], options["clearance"]) for options in made]
    assert len(set(pairs[:6])) == 6
    assert pairs[:3] == [("square", 0.001), ("triangle", 0.001), ("square", 0.0005)]
    assert pairs[6] == pairs[0]
    kinds = config.kinds(7)
    np.testing.assert_array_equal(kinds[:6], np.eye(6))
    np.testing.assert_array_equal(kinds[6], kinds[0])
    alike = TrainConfig(doubt=0.01, num_envs=3)
    assert alike.kinds(3).shape == (3, 0)


HEXAGONS = (
    """units = "mm"\noutline = "hexagon {}"\ndepth = 9\ngap = 0.3\nlength = 60\n"""
)


def test_each_environment_has_the_next_part_of_a_folder(tmp_path):
    need("shapely")
    for name, size in (("b", 12), ("a", 10), ("c", 14)):
        (tmp_path / f"{name}.toml").write_text(HEXAGONS.format(size))
    inside = tmp_path / "inside" / "00015"
    inside.mkdir(parents=True)
    (inside / "part.toml").write_text(HEXAGONS.format(16))
    (tmp_path / "note.txt").write_text("no part")
    env = "dovetail/Insert-v0"

    def names(vary, count):
        config = TrainConfig(env=env, vary=vary, num_envs=count)
        parts = [config.varied_options(i)["part"] for i in range(count)]
        assert '"part"' not in config.env_options()["part"]
        return [json.loads(part)["name"] for part in parts]

    assert names(f"part={tmp_path}", 4) == ["a", "b", "c", "a"]
    assert names(f"part={inside.parent}", 1) == ["00015"]
    both = f"part={inside}/part.toml,{tmp_path}/c.toml"
    assert names(both, 2) == ["00015", "c"]
    with pytest.raises(ConfigError, match="3 values of part to 2 environments"):
        TrainConfig(env=env, vary=f"part={tmp_path}", num_envs=2)
    (tmp_path / "none").mkdir()
    with pytest.raises(ConfigError, check=about("part")):
        TrainConfig(env=env, vary=f"part={tmp_path}/none", num_envs=2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"doubt": 0.0}, "doubt_turn is 0.05 rad and doubt 0 m"),
        ({"doubt_turn": 0.6}, "doubt_turn is 0.6 rad; allowed: 0 to 0.5 rad"),
        ({"num_envs": 1}, "2 values of peg to 1 environments"),
        (
            {"vary": "peg=square,triangle&clearance=0.001,0.002"},
            "4 values of clearance and peg to 3 environments",
        ),
        ({"vary": "peg=square&peg=round"}, "names an option twice"),
        (
            {"vary": "pig=square"},
            "needed: NAME=A,B with one of tilt, facing, peg, clearance",
        ),
        ({"vary": "peg"}, "with one of tilt, facing, peg, clearance"),
        ({"vary": "clearance=0.001,wide"}, "could not convert string to float"),
    ],
)
def test_what_cannot_be_varied_is_refused_with_what_to_give(change, words):
    with pytest.raises(ConfigError, match=words):
        TrainConfig(**{**SEARCH, **change})
