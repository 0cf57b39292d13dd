"""Checkpoints of a training run: no pickle, whole or absent, resumable after a kill.

A checkpoint is a folder `step-<n>`: networks and optimisers (msgpack through flax), the
replay buffer (NPZ), counters and checksums (JSON). It is written beside its place,
flushed to the disk and renamed, so that a folder of that name is complete. The last two
are kept. Random generators are not stored: a resumed run seeds them anew from its seed
and step (`seed_run`), so the same checkpoint always continues in the same way.
"""

import hashlib
import json
import os
import shutil
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from dovetail.control.ranges import in_count
from dovetail.errors import ConfigError, LogError
from dovetail.learn.algorithms import derive_seed
from dovetail.learn.checkpoint_facts import (
    FACTS,
    NETWORKS,
    REPLAY,
    VERSION,
    check_files,
    read_facts,
)
from dovetail.learn.sbx_model import (
    NoisyPolicy,
    ReplayBuffer,
    SbxModel,
    buffer_arrays,
    counters,
    put_counters,
    put_states,
    replay_buffer,
    trained_states,
)

KEPT = 2


class Counters(NamedTuple):
    """What a checkpoint knows beside the model."""

    step: int
    """Environment steps done."""
    wall_time: float
    """Training time so far [s]."""


def save_checkpoint(folder: Path, model: SbxModel, wall_time: float) -> Path:
    """Write a checkpoint of an SBX algorithm, then remove all but the last two.

    Args:
        folder: Folder of checkpoints; created.
        model: The algorithm.
        wall_time: Training time so far [s].

    Returns:
        The checkpoint's folder.

    Raises:
        LogError: The disk is full or not writable; older checkpoints are kept.
    """
    place = folder / f"step-{model.num_timesteps:010d}"
    beside = folder / f".{place.name}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for leftover in folder.glob(".*.part"):
            shutil.rmtree(leftover)
        beside.mkdir()
        _write(beside, model, wall_time)
        if place.exists():
            shutil.rmtree(place)
        beside.rename(place)
        _sync(folder)
    except OSError as error:
        shutil.rmtree(beside, ignore_errors=True)
        kept = ", ".join(path.name for path in list_checkpoints(folder)) or "none"
        raise LogError(
            f"cannot write the checkpoint {place}: {error.strerror}; kept: {kept}; "
            "free some space and continue with --resume"
        ) from error
    for old in list_checkpoints(folder)[:-KEPT]:
        shutil.rmtree(old)
    return place


def list_checkpoints(folder: Path) -> list[Path]:
    """Return the complete checkpoints, oldest first."""
    return sorted(path for path in folder.glob("step-*") if path.is_dir())


def load_checkpoint(place: Path, model: SbxModel, seed: int) -> Counters:
    """Put a freshly built algorithm of the same settings into a checkpoint's state.

    Args:
        place: The checkpoint's folder.
        model: The algorithm; its environments start new episodes.
        seed: The run's seed.

    Raises:
        ConfigError: The checkpoint is damaged, or of other settings.
    """
    buffer = replay_buffer(model)
    try:
        facts = read_facts(place, has_replay=buffer is not None)
        check_files(place, facts.digests)
        _set_states(model, (place / NETWORKS).read_bytes())
        if buffer is not None:
            _set_replay(buffer, place / REPLAY)
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise ConfigError(
            f"checkpoint {place} cannot be used: {error}; remove it to continue "
            "from the one before, or start a new run folder"
        ) from error
    put_counters(model, facts.counters)
    seed_run(model, seed, model.num_timesteps)
    return Counters(model.num_timesteps, facts.wall_time)


def seed_run(model: SbxModel, seed: int, step: int) -> None:
    """Start every random number of a run from its seed and step.

    The environments' next `reset` uses seeds of their own, far from those of other runs
    and other steps: Stable-Baselines3 alone would give runs with neighbouring seeds the
    same episodes.
    """
    import jax

    model.set_random_seed(derive_seed(seed, step, 0))
    model.policy.key = jax.random.PRNGKey(derive_seed(seed, step, 1))
    if isinstance(model.policy, NoisyPolicy):
        model.policy.reset_noise()
    env = model.get_env()
    env._seeds = [derive_seed(seed, step, 2, i) for i in range(env.num_envs)]


def _write(folder: Path, model: SbxModel, wall_time: float) -> None:
    from flax import serialization

    _write_file(folder / NETWORKS, serialization.to_bytes(trained_states(model)))
    if (buffer := replay_buffer(model)) is not None:
        count = buffer.buffer_size if buffer.full else buffer.pos
        arrays: dict[str, Any] = {"position": buffer.pos, "full": buffer.full}
        for name, room in buffer_arrays(buffer).items():
            arrays[name] = room[:count]
        with (folder / REPLAY).open("wb") as file:
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
    facts = {
        "version": VERSION,
        **counters(model),
        "wall_time": wall_time,
        "sha256": {
            path.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(folder.iterdir())
        },
    }
    _write_file(folder / FACTS, json.dumps(facts, indent=2).encode())
    _sync(folder)


def _set_states(model: SbxModel, content: bytes) -> None:
    from flax import serialization

    put_states(model, serialization.from_bytes(trained_states(model), content))


def _set_replay(buffer: ReplayBuffer, path: Path) -> None:
    size = buffer.buffer_size
    with np.load(path, allow_pickle=False) as arrays:
        is_full, position = (arrays[name].item() for name in ("full", "position"))
        last = size - 1 if is_full else size
        buffer.pos = in_count(
            "replay buffer position", position, 0, last, "transitions"
        )
        buffer.full = bool(is_full)
        count = size if is_full else position
        for name, room in buffer_arrays(buffer).items():
            content, wanted = arrays[name], (count, *room.shape[1:])
            if content.shape != wanted:
                raise ValueError(
                    f"replay buffer {name} has shape {content.shape}; this run's, at "
                    f"position {position}, has {wanted}"
                )
            room[:count] = content


def _write_file(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
