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
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import numpy as np

from dovetail.archives import open_zip, read_array
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
from dovetail.reading import read_bytes
from dovetail.settings import in_count

KEPT = 2
_BESIDE = 1_000_000
"""Bytes that a checkpoint's file may have beside its numbers."""


class Counters(NamedTuple):
    """Step and time of a checkpoint."""

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

    Warns:
        UserWarning: An old checkpoint cannot be removed.
    """
    place = folder / f"step-{model.num_timesteps:010d}"
    beside = folder / f".{place.name}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for leftover in folder.glob(".*.part"):
            shutil.rmtree(leftover, ignore_errors=True)
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
        try:
            shutil.rmtree(old)
        except OSError as error:  # the new one is whole: the training goes on
            warnings.warn(
                f"the old checkpoint {old} cannot be removed ({error.strerror}): "
                "remove it by hand when space is short",
                stacklevel=2,
            )
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
        limits = {NETWORKS: 2 * len(_states(model)) + _BESIDE}
        if buffer is not None:
            rooms = buffer_arrays(buffer).values()
            limits[REPLAY] = sum(room.nbytes for room in rooms) + _BESIDE
        check_files(place, facts.digests, limits)
        _set_states(model, read_bytes(place / NETWORKS, limits[NETWORKS]))
        if buffer is not None:
            _set_replay(buffer, place / REPLAY, limits[REPLAY])
    except Exception as error:
        # Damaged or hostile bytes may raise any error here: it is no checkpoint.
        raise ConfigError(
            f"checkpoint {place} cannot be used: {error or type(error).__name__}; "
            "remove it to continue from the one before, or start a new run folder"
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
    env = model.get_env().unwrapped  # which a wrapper of it does not ask
    env._seeds = [derive_seed(seed, step, 2, i) for i in range(env.num_envs)]


def _states(model: SbxModel) -> bytes:
    from flax import serialization

    return serialization.to_bytes(trained_states(model))


def _write(folder: Path, model: SbxModel, wall_time: float) -> None:
    _write_file(folder / NETWORKS, _states(model))
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

    wanted = trained_states(model)
    found = serialization.from_bytes(wanted, content)
    _require_alike(wanted, found)
    put_states(model, found)


def _require_alike(wanted: Mapping[str, Any], found: Mapping[str, Any]) -> None:
    """Refuse states in which a number has another shape or type."""
    import jax

    if jax.tree.structure(found) != jax.tree.structure(wanted):
        raise ConfigError(f"{NETWORKS} is of other networks or optimisers")
    ours_by_path = jax.tree_util.tree_leaves_with_path(wanted)
    leaves = jax.tree.leaves(found)
    for (path, ours), theirs in zip(ours_by_path, leaves, strict=True):
        # A counter is Python's own number before the first step, JAX's after it.
        kinds = [
            leaf.dtype
            if isinstance(leaf, np.ndarray | jax.Array)
            else jax.numpy.result_type(leaf)
            for leaf in (ours, theirs)
        ]
        shapes = [np.shape(leaf) for leaf in (ours, theirs)]
        if kinds[0] != kinds[1] or shapes[0] != shapes[1]:
            raise ConfigError(
                f"{NETWORKS}: {jax.tree_util.keystr(path)} has shape {shapes[1]}, "
                f"{kinds[1]}; this run's has {shapes[0]}, {kinds[0]}"
            )


def _set_replay(buffer: ReplayBuffer, path: Path, limit: int) -> None:
    size = buffer.buffer_size
    with open_zip(path, limit) as archive:
        is_full = bool(_read(archive, "full", (), np.dtype(bool)))
        position = int(_read(archive, "position", (), np.dtype(int)))
        last = size - 1 if is_full else size
        in_count("replay buffer position", position, 0, last, "transitions")
        count = size if is_full else position
        for name, room in buffer_arrays(buffer).items():
            shape = (count, *room.shape[1:])
            room[:count] = _read(archive, name, shape, room.dtype)
            if (bad := ~np.isfinite(room[:count])).any():
                where = int(np.argwhere(bad)[0][0])
                raise ConfigError(
                    f"replay buffer {name} is {room[where][bad[where]][0]} in "
                    f"transition {where}; it must be finite"
                )
    buffer.pos, buffer.full = position, is_full
    if count:  # the environments begin anew: no sum of rewards goes on from here
        arrays = buffer_arrays(buffer)
        open_ends = arrays["dones"][position - 1] == 0
        arrays["timeouts"][position - 1][open_ends] = 1


def _read(
    archive: ZipFile, name: str, shape: tuple[int, ...], kind: np.dtype[Any]
) -> np.ndarray[Any, Any]:
    """Read an array that has the shape and type of this run's."""
    array = read_array(archive, name)
    if (array.shape, array.dtype) != (shape, kind):
        raise ConfigError(
            f"replay buffer {name} has shape {array.shape}, {array.dtype}; this run's "
            f"has {shape}, {kind}"
        )
    return array


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
