"""A checkpoint is whole or absent, and a run continues from it."""

import os
from pathlib import Path
from zipfile import ZipFile

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
    assert load_checkpoint(place, model, 0) == 12.5
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
    (tmp_path / ".part").write_text("left by a kill")
    for step in (200, 201, 202):
        trained.num_timesteps = step
        save_checkpoint(tmp_path, trained, 0.0)
    trained.num_timesteps = 200
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["step-0000000201.npz", "step-0000000202.npz"]


def test_an_old_checkpoint_that_cannot_be_removed_ends_nothing(
    trained, tmp_path, monkeypatch
):
    remove = Path.unlink

    def refuse(path, **more):
        if path.stem == "step-0000000200":
            raise PermissionError(13, "Permission denied")
        remove(path, **more)

    monkeypatch.setattr(Path, "unlink", refuse)
    for step in (200, 201, 202, 203):
        trained.num_timesteps = step
        if step < 202:
            save_checkpoint(tmp_path, trained, 0.0)
            continue
        with pytest.warns(UserWarning, match=r"step-0000000200.npz cannot .*Perm"):
            save_checkpoint(tmp_path, trained, 0.0)
    trained.num_timesteps = 200
    names = [path.stem[-3:] for path in list_checkpoints(tmp_path)]
    assert names == ["200", "202", "203"]


@pytest.mark.parametrize("moment", range(5))
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

    monkeypatch.setattr(np, "savez", step_or_die(np.savez))
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
    was_complete = moment >= 3
    assert (newest != first) == was_complete
    model = build()
    load_checkpoint(newest, model, 0)
    assert model.num_timesteps == (210 if was_complete else 200)


@pytest.mark.parametrize("part", ["networks", "rewards", "wall_time"])
def test_a_damaged_number_is_found(trained, build, tmp_path, part):
    place = save_checkpoint(tmp_path, trained, 0.0)
    with ZipFile(place) as archive:
        info = archive.getinfo(f"{part}.npy")
    content = bytearray(place.read_bytes())
    begin = info.header_offset
    extra = int.from_bytes(content[begin + 28 : begin + 30], "little")
    content[begin + 30 + len(info.filename) + extra + info.file_size - 1] ^= 1
    place.write_bytes(content)
    with pytest.raises(ConfigError, match=rf"{place} cannot be used: .*CRC"):
        load_checkpoint(place, build(), 0)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_checkpoint_cut_short_is_named(trained, build, tmp_path, share):
    place = save_checkpoint(tmp_path, trained, 0.0)
    content = place.read_bytes()
    place.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ConfigError, match=f"checkpoint {place} cannot be used"):
        load_checkpoint(place, build(), 0)


def test_a_checkpoint_is_never_unpickled(trained, build, tmp_path):
    class Harm:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "run",))

    place = save_checkpoint(tmp_path, trained, 0.0)
    with np.load(place) as arrays:
        content = dict(arrays)
    pickled = np.array([Harm()], dtype=object)
    for name in ("networks", "rewards", "wall_time"):
        np.savez(place, **content | {name: pickled})
        with pytest.raises(ConfigError, match="cannot be used"):
            load_checkpoint(place, build(), 0)
    assert not (tmp_path / "run").exists()


def test_a_full_disk_keeps_the_checkpoint_before(trained, tmp_path, monkeypatch):
    save_checkpoint(tmp_path, trained, 0.0)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    trained.num_timesteps = 220
    with pytest.raises(LogError, match=r"No space left.*kept: step-0000000200"):
        save_checkpoint(tmp_path, trained, 0.0)
    trained.num_timesteps = 200
    assert [path.name for path in tmp_path.iterdir()] == ["step-0000000200.npz"]
