"""Checkpoints of a training: NPZ files, whole or absent, resumable after a kill.

`step-<n>.npz` holds networks and optimisers (flax's msgpack), replay buffer, counters
and training time; the CRC-32 of each part finds damage. It is written beside its place,
flushed to the disk and renamed. The last two are kept. Random generators are not
stored: a resumed run seeds them anew from its seed and step (`seed_run`), so the same
checkpoint always continues in the same way.
"""

import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.errors import ConfigError, LogError
from dovetail.learn.algorithms import derive_seed

KEPT = 2
_STATES = (
    *("actor_state", "kept_state", "search_state"),
    *("qf_state", "qf1_state", "qf2_state", "vf_state"),
)
_ENTROPY = "ent_coef_state"
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_TRANSITIONS = (
    *("observations", "next_observations", "actions"),
    *("rewards", "dones", "timeouts"),
)


def save_checkpoint(folder: Path, model: Any, wall_time: float) -> Path:
    """Write a checkpoint of an SBX algorithm, then remove all but the last two.

    Args:
        folder: Folder of checkpoints; created.
        model: The algorithm.
        wall_time: Training time so far [s].

    Returns:
        The checkpoint's file.

    Raises:
        LogError: The disk is full or not writable; older checkpoints are kept.

    Warns:
        UserWarning: An old checkpoint cannot be removed.
    """
    place, beside = folder / f"step-{model.num_timesteps:010d}.npz", folder / ".part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            np.savez(file, **_arrays(model), wall_time=wall_time)
            file.flush()
            os.fsync(file.fileno())
        beside.rename(place)
        _sync(folder)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        kept = ", ".join(path.name for path in list_checkpoints(folder)) or "none"
        raise LogError(
            f"cannot write the checkpoint {place}: {error.strerror}; kept: {kept}; "
            "free some space and continue with --resume"
        ) from error
    for old in list_checkpoints(folder)[:-KEPT]:
        try:
            old.unlink()
        except OSError as error:  # the new one is whole: the training goes on
            warnings.warn(
                f"the old checkpoint {old} cannot be removed ({error.strerror}): "
                "remove it by hand when space is short",
                stacklevel=2,
            )
    return place


def list_checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints, oldest first."""
    return sorted(folder.glob("step-*.npz"))


def load_checkpoint(place: Path, model: Any, seed: int) -> float:
    """Put a freshly built algorithm of the same settings into a checkpoint's state.

    Args:
        place: The checkpoint's file.
        model: The algorithm; its environments start new episodes.
        seed: The run's seed.

    Returns:
        Training time so far [s].

    Raises:
        ConfigError: The checkpoint is damaged, or of other settings.
    """
    try:
        with np.load(place, allow_pickle=False) as arrays:
            wall_time = float(arrays["wall_time"])
            _restore(model, arrays)
    except Exception as error:  # NumPy and flax raise any on damage
        raise ConfigError(
            f"checkpoint {place} cannot be used: {error or type(error).__name__}; "
            "remove it to continue from the one before, or start a new run folder"
        ) from error
    seed_run(model, seed, model.num_timesteps)
    return wall_time


def seed_run(model: Any, seed: int, step: int) -> None:
    """Start every random number of a run from its seed and step.

    The environments' next `reset` uses seeds of their own, far from those of other runs
    and other steps: Stable-Baselines3 alone would give runs with neighbouring seeds the
    same episodes.
    """
    import jax

    model.set_random_seed(derive_seed(seed, step, 0))
    model.policy.key = jax.random.PRNGKey(derive_seed(seed, step, 1))
    if "reset_noise" in dir(model.policy):  # not td3 and ddpg
        model.policy.reset_noise()
    env = model.get_env().unwrapped  # a wrapper's own seeds are not used
    env._seeds = [derive_seed(seed, step, 2, i) for i in range(env.num_envs)]


def trained_states(model: Any) -> dict[str, Any]:
    """Return an SBX algorithm's networks and optimisers by name, as flax has them."""
    return {name: vars(owner)[name] for name, owner in _owners(model)}


def _owners(model: Any) -> Iterator[tuple[str, Any]]:
    """Yield the name of each trained state and the object that holds it."""
    yield from ((name, model.policy) for name in _STATES if name in vars(model.policy))
    if _ENTROPY in vars(model):
        yield _ENTROPY, model


def _arrays(model: Any) -> dict[str, Any]:
    """Return everything of an algorithm that a checkpoint stores, by name."""
    from flax import serialization

    networks = serialization.to_bytes(trained_states(model))
    arrays: dict[str, Any] = {name: vars(model)[name] for name in _COUNTERS}
    arrays["networks"] = np.frombuffer(networks, dtype=np.uint8)
    if (buffer := vars(model).get("replay_buffer")) is not None:
        count = buffer.size()
        arrays |= {name: vars(buffer)[name][:count] for name in _TRANSITIONS}
        arrays |= {"position": buffer.pos, "full": buffer.full}
    return arrays


def _restore(model: Any, arrays: Mapping[str, Any]) -> None:
    """Put back what `_arrays` gave."""
    from flax import serialization

    networks = arrays["networks"].tobytes()
    states = serialization.from_bytes(trained_states(model), networks)
    for name, owner in _owners(model):
        setattr(owner, name, states[name])
    for name in _COUNTERS:
        setattr(model, name, int(arrays[name]))
    if (buffer := vars(model).get("replay_buffer")) is None:
        return
    buffer.pos, buffer.full = int(arrays["position"]), bool(arrays["full"])
    count = buffer.size()
    for name in _TRANSITIONS:
        vars(buffer)[name][:count] = arrays[name]
    if count:  # the environments begin anew: no sum of rewards goes on from here
        last = buffer.pos - 1
        buffer.timeouts[last][buffer.dones[last] == 0] = 1


def _sync(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
