"""A checkpoint is whole or absent, and a run continues from it."""

import hashlib
import io
import json
import os
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dovetail.errors import ConfigError, LogError
from dovetail.learn.algorithms import make_model, make_vec_env
from dovetail.learn.checkpoint import (
    list_checkpoints,
    load_checkpoint,
    save_checkpoint,
    seed_run,
)
from dovetail.learn.export import actor_layers


class Died(BaseException):
    """Stands for kill -9 at one moment."""


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    from dovetail.learn.config import TrainConfig

    from .conftest import SMALL

    config = TrainConfig(out=tmp_path_factory.mktemp("run"), **SMALL)
    return lambda: make_model(config, make_vec_env(config))


@pytest.fixture(scope="module")
def trained(build):
    model = build()
    seed_run(model, 0, 0)
    model.learn(200)
    return model


def weights(model) -> list[np.ndarray]:
    return [array for layer in actor_layers(model) for array in layer]


def test_a_loaded_checkpoint_has_networks_optimisers_and_replay_buffer(
    trained, build, tmp_path
):
    import jax

    place = save_checkpoint(tmp_path, trained, 12.5)
    model = build()
    counters = load_checkpoint(place, model, 0)
    assert counters == (200, 12.5)
    assert model.num_timesteps == 200
    assert model._n_updates == trained._n_updates > 0
    for name in ("actor_state", "qf_state"):
        old, new = getattr(trained.policy, name), getattr(model.policy, name)
        for part in ("params", "opt_state"):
            jax.tree.map(
                np.testing.assert_array_equal, getattr(old, part), getattr(new, part)
            )
    assert model.replay_buffer.pos == trained.replay_buffer.pos == 100
    for name in ("observations", "actions", "rewards", "dones", "timeouts"):
        np.testing.assert_array_equal(
            getattr(model.replay_buffer, name)[:100],
            getattr(trained.replay_buffer, name)[:100],
        )
    assert trained.replay_buffer.timeouts.any(), "the test needs a truncated episode"


def test_the_same_checkpoint_always_continues_in_the_same_way(trained, build, tmp_path):
    place = save_checkpoint(tmp_path, trained, 0.0)
    results = []
    for _ in range(2):
        model = build()
        load_checkpoint(place, model, 0)
        model.learn(60, reset_num_timesteps=False)
        assert model.num_timesteps == 260
        results.append(weights(model))
    for first, second in zip(*results, strict=True):
        np.testing.assert_array_equal(first, second)
    changed = [
        np.abs(a - b).max() for a, b in zip(results[0], weights(trained), strict=True)
    ]
    assert max(changed) > 0.0


def test_no_return_goes_from_an_episode_that_was_cut_short_into_the_next(
    build, tmp_path
):
    """An insertion right after a resume is no merit of what came before it."""
    first = build()
    seed_run(first, 0, 0)
    first.learn(36)  # fewer than the random steps: no update is compiled
    place = save_checkpoint(tmp_path, first, 0.0)
    model = build()
    load_checkpoint(place, model, 0)
    replay, open_row = model.replay_buffer, 36 // 2 - 1
    shape = (2, replay.observations.shape[-1])
    after = np.full(shape, 7.0, dtype=np.float32)
    for _ in range(5):
        actions = np.zeros((2, replay.actions.shape[-1]), dtype=np.float32)
        replay.add(after, after, actions, np.full(2, 1e6), np.zeros(2), [{}] * 2)
    rows = np.repeat(np.arange(open_row + 1), 20)
    batch = replay._get_samples(rows)
    assert batch.rewards.numpy().max() < 1e6
    assert (batch.next_observations.numpy() != 7.0).any(axis=1).all()
    assert not batch.dones.numpy().any()  # cut short, which is not worth nothing


def test_runs_of_neighbouring_seeds_share_no_episode(build):
    seeds = []
    for seed in range(3):
        model = build()
        for step in (0, 100):
            seed_run(model, seed, step)
            seeds += model.get_env()._seeds
    assert len(set(seeds)) == len(seeds)


def test_the_last_two_checkpoints_are_kept(trained, tmp_path):
    (tmp_path / ".step-0000000001.part").mkdir()
    for step in (200, 201, 202):
        trained.num_timesteps = step
        save_checkpoint(tmp_path, trained, 0.0)
    trained.num_timesteps = 200
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["step-0000000201", "step-0000000202"]


def test_an_old_checkpoint_that_cannot_be_removed_ends_nothing(
    trained, tmp_path, monkeypatch
):
    remove = shutil.rmtree

    def refuse(path, **more):
        if path.name == "step-0000000200":
            raise PermissionError(13, "Permission denied")
        remove(path, **more)

    monkeypatch.setattr(shutil, "rmtree", refuse)
    for step in (200, 201, 202, 203):
        trained.num_timesteps = step
        if step < 202:
            save_checkpoint(tmp_path, trained, 0.0)
            continue
        with pytest.warns(UserWarning, match=r"step-0000000200 cannot .*Permission"):
            save_checkpoint(tmp_path, trained, 0.0)
    trained.num_timesteps = 200
    names = [path.name[-3:] for path in list_checkpoints(tmp_path)]
    assert names == ["200", "202", "203"]


@pytest.mark.parametrize("moment", range(7))
def test_a_death_at_any_moment_of_writing_leaves_the_one_before(
    trained, build, tmp_path, monkeypatch, moment
):
    first = save_checkpoint(tmp_path, trained, 1.0)
    calls = 0

    def step_or_die(function):
        def call(*args, **kwargs):
            nonlocal calls
            calls += 1
            if calls > moment:
                raise Died
            return function(*args, **kwargs)

        return call

    monkeypatch.setattr(os, "fsync", step_or_die(os.fsync))
    monkeypatch.setattr(Path, "rename", step_or_die(Path.rename))
    trained.num_timesteps = 210
    try:
        save_checkpoint(tmp_path, trained, 2.0)
    except Died:
        pass
    finally:
        trained.num_timesteps = 200
        monkeypatch.undo()
    newest = list_checkpoints(tmp_path)[-1]
    was_complete = moment >= 5
    assert (newest != first) == was_complete
    assert load_checkpoint(newest, build(), 0).step == (210 if was_complete else 200)


@pytest.mark.parametrize("name", ["checkpoint.json", "networks.msgpack", "replay.npz"])
def test_a_damaged_checkpoint_is_named(trained, build, tmp_path, name):
    place = save_checkpoint(tmp_path, trained, 0.0)
    content = (place / name).read_bytes()
    (place / name).write_bytes(content[: len(content) // 2])
    with pytest.raises(ConfigError, match=f"checkpoint {place} cannot be used"):
        load_checkpoint(place, build(), 0)


def test_counters_of_a_stranger_leave_the_algorithm_as_it_is(trained, build, tmp_path):
    place = save_checkpoint(tmp_path, trained, 0.0)
    path = place / "checkpoint.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"num_timesteps": -5}))
    model = build()
    with pytest.raises(ConfigError, match=r"num_timesteps is -5; allowed.*; remove it"):
        load_checkpoint(place, model, 0)
    assert model.num_timesteps == 0


def vouch_for(place, name):
    """Write the checksum of a file that was changed, as whoever changed it would."""
    path = place / "checkpoint.json"
    facts = json.loads(path.read_text())
    facts["sha256"][name] = hashlib.sha256((place / name).read_bytes()).hexdigest()
    path.write_text(json.dumps(facts))


@pytest.mark.parametrize(
    ("position", "message"),
    [
        (-5, "position is -5; allowed: 0 to"),
        (7, r"observations has shape \(100, .*; this run's has \(7, "),
        (7.0, r"position has shape \(\), float64; this run's has \(\), int64"),
    ],
)
def test_a_replay_buffer_whose_position_is_none_is_refused(
    trained, build, tmp_path, position, message
):
    place = save_checkpoint(tmp_path, trained, 0.0)
    with np.load(place / "replay.npz") as arrays:
        content = {**arrays, "position": position}
    np.savez(place / "replay.npz", **content)
    vouch_for(place, "replay.npz")
    with pytest.raises(ConfigError, match=message):
        load_checkpoint(place, build(), 0)


@pytest.mark.parametrize("name", ["rewards", "observations", "actions"])
@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_a_replay_buffer_with_numbers_that_are_none_is_refused(
    trained, build, tmp_path, name, value
):
    place = save_checkpoint(tmp_path, trained, 0.0)
    with np.load(place / "replay.npz") as arrays:
        content = dict(arrays)
    content[name][17, ..., -1] = value
    np.savez(place / "replay.npz", **content)
    vouch_for(place, "replay.npz")
    with pytest.raises(ConfigError, match=f"{name} is {value} in transition 17"):
        load_checkpoint(place, build(), 0)


def flagged(content):
    """The same archive, of which each entry says that it is encrypted."""
    parts = content.split(b"PK\x01\x02")
    return b"PK\x01\x02".join(
        [parts[0], *(p[:4] + bytes([p[4] | 1]) + p[5:] for p in parts[1:])]
    )


def giant(content):
    """An archive whose first array says of itself that it has 8 PB."""
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(made, "w") as new:
        for name in old.namelist():
            entry = old.read(name)
            if name == "observations.npy":
                entry = io.BytesIO()
                head = {"descr": "<f4", "fortran_order": False, "shape": (10**15, 2)}
                np.lib.format.write_array_header_1_0(entry, head)
                entry = entry.getvalue()
            new.writestr(name, entry)
    return made.getvalue()


def one_array(content):
    """An NPY in place of an NPZ."""
    made = io.BytesIO()
    np.save(made, np.zeros(3))
    return made.getvalue()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (flagged, "encrypted"),
        (giant, r"shape \(1000000000000000, 2\)"),
        (one_array, "not a zip file"),
    ],
)
def test_a_replay_buffer_made_to_do_harm_is_one_message(
    trained, build, tmp_path, spoil, message
):
    place = save_checkpoint(tmp_path, trained, 0.0)
    path = place / "replay.npz"
    path.write_bytes(spoil(path.read_bytes()))
    vouch_for(place, path.name)
    with pytest.raises(ConfigError, match=rf"{place} cannot be used: .*{message}"):
        load_checkpoint(place, build(), 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda leaf: leaf[..., :-1],
            r"bias'\] has shape \(15,\), float32; .* \(16,\)",
        ),
        (lambda leaf: leaf.astype("f2"), r"has shape \(16,\), float16; this run's"),
        (lambda leaf: leaf.astype("f8"), "float64; this run's has .*float32"),
        (lambda leaf: {"more": leaf}, "other networks or optimisers"),
        (lambda leaf: "x", "'x'"),
    ],
)
def test_networks_of_another_shape_are_refused(
    trained, build, tmp_path, change, message
):
    from flax import serialization

    place = save_checkpoint(tmp_path, trained, 0.0)
    path = place / "networks.msgpack"
    states = serialization.msgpack_restore(path.read_bytes())
    layer = states["actor_state"]["params"]["params"]["Dense_0"]
    layer["bias"] = change(layer["bias"])
    path.write_bytes(serialization.msgpack_serialize(states))
    vouch_for(place, path.name)
    with pytest.raises(ConfigError, match=message):
        load_checkpoint(place, build(), 0)


def test_a_full_disk_keeps_the_checkpoint_before(trained, tmp_path, monkeypatch):
    save_checkpoint(tmp_path, trained, 0.0)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    trained.num_timesteps = 220
    with pytest.raises(LogError, match=r"No space left.*kept: step-0000000200"):
        save_checkpoint(tmp_path, trained, 0.0)
    trained.num_timesteps = 200
    assert [path.name for path in tmp_path.iterdir()] == ["step-0000000200"]
