"""A checkpoint's JSON may be anybody's: nothing that it names is opened on its word."""

import json
from pathlib import Path

import pytest

from dovetail.errors import ConfigError
from dovetail.learn.checkpoint_facts import read_facts

DIGEST = "0" * 64
FACTS = {
    "version": 1,
    "num_timesteps": 200,
    "_n_updates": 100,
    "_episode_num": 8,
    "wall_time": 12.5,
    "sha256": {"networks.msgpack": DIGEST, "replay.npz": DIGEST},
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A checkpoint's folder of which nothing but the JSON may be read."""
    folder = tmp_path / "step-0000000200"
    folder.mkdir()
    for name in FACTS["sha256"]:
        (folder / name).write_bytes(b"")
    (tmp_path / "outside").write_bytes(b"")
    opened = Path.open

    def open_json(path, *args, **kwargs):
        assert path.name == "checkpoint.json", f"{path} was opened"
        return opened(path, *args, **kwargs)

    monkeypatch.setattr(Path, "open", open_json)
    return folder


def read(place, **changes):
    (place / "checkpoint.json").write_text(json.dumps(FACTS | changes))
    return read_facts(place, has_replay=True)


def test_facts_in_their_ranges_are_taken_as_they_are(place):
    facts = read(place)
    assert facts.counters == {
        name: FACTS[name] for name in ("num_timesteps", "_n_updates", "_episode_num")
    }
    assert facts.wall_time == 12.5
    assert facts.digests == FACTS["sha256"]


@pytest.mark.parametrize("name", ["num_timesteps", "_n_updates", "_episode_num"])
@pytest.mark.parametrize("value", [-5, 10**13, 2.5, "many", True, None, [1]])
def test_a_counter_that_is_no_count_is_named_with_its_range(place, name, value):
    with pytest.raises(
        ConfigError, match=rf"^{name} is .*(allowed|whole number): 0 to"
    ):
        read(place, **{name: value})


@pytest.mark.parametrize("value", [-1.0, 1e10, float("nan"), "long", True, 2**63])
def test_a_training_time_that_is_none_is_refused(place, value):
    with pytest.raises(ConfigError, match=r"^wall_time (is|has|must) "):
        read(place, wall_time=value)


@pytest.mark.parametrize(
    "name",
    ["/dev/zero", "../outside", "step/../networks.msgpack", "checkpoint.json", ""],
)
def test_a_checksum_of_another_file_is_refused_before_it_is_opened(place, name):
    with pytest.raises(ConfigError, match=r"sha256 names .*allowed: networks\.msgpack"):
        read(place, sha256=FACTS["sha256"] | {name: DIGEST})


@pytest.mark.parametrize("target", ["/dev/zero", "../outside"])
def test_a_file_that_is_a_link_is_refused_before_it_is_opened(place, target):
    (place / "replay.npz").unlink()
    (place / "replay.npz").symlink_to(target)
    with pytest.raises(ConfigError, match=r"replay\.npz is a link, a device"):
        read(place)


@pytest.mark.parametrize(
    "sums", [None, [], {}, {"networks.msgpack": DIGEST}, "networks.msgpack"]
)
def test_a_file_without_a_checksum_is_not_read(place, sums):
    with pytest.raises(ConfigError, match="sha256 names"):
        read(place, sha256=sums)


@pytest.mark.parametrize("digest", [7, "abc", DIGEST + "0"])
def test_a_checksum_that_is_none_is_refused(place, digest):
    with pytest.raises(ConfigError, match=r"sha256 of replay\.npz is .*64 digits"):
        read(place, sha256=FACTS["sha256"] | {"replay.npz": digest})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[" * 100_000, "is not JSON"),
        ("[1]", "holds no table"),
        (" " * 2_000_000, "has 2000000 bytes"),
    ],
)
def test_a_json_that_is_no_checkpoints_is_refused(place, content, message):
    (place / "checkpoint.json").write_text(content)
    with pytest.raises((ConfigError, OSError), match=message):
        read_facts(place, has_replay=True)
