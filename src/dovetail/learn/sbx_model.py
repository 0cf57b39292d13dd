"""Types for the parts of an SBX algorithm that this package uses; SBX has none.

The names are SBX's and Stable-Baselines3's. Which states an algorithm trains is its own
affair: `trained_states` and `put_states` find those that are there.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

_STATES = (
    *("actor_state", "kept_state"),
    *("qf_state", "qf1_state", "qf2_state", "vf_state"),
)
ENTROPY = "ent_coef_state"
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_BUFFER = (
    *("observations", "next_observations", "actions"),
    *("rewards", "dones", "timeouts"),
)


class SbxPolicy(Protocol):
    """An algorithm's networks."""

    key: Any
    """Random key of JAX."""


@runtime_checkable
class NoisyPolicy(Protocol):
    """Networks that explore by noise of their own."""

    def reset_noise(self) -> None:
        """Draw the noise anew, from `key`."""
        ...


class SbxModel(Protocol):
    """An algorithm."""

    num_timesteps: int
    """Environment steps done."""
    policy: SbxPolicy

    def set_random_seed(self, seed: int) -> None:
        """Start the random numbers of Python, NumPy and PyTorch."""
        ...

    def get_env(self) -> Any:
        """Return the vectorised environment."""
        ...


class ReplayBuffer(Protocol):
    """Transitions of an off-policy algorithm, the oldest replaced first."""

    buffer_size: int
    """Transitions per environment that fit."""
    pos: int
    """Row of the next transition."""
    full: bool
    """True once every row is filled and the oldest are replaced."""


Owner: TypeAlias = SbxPolicy | SbxModel


def _owners(model: SbxModel) -> Iterator[tuple[str, Owner]]:
    """Yield the name of each trained state and who holds it."""
    yield from ((name, model.policy) for name in _STATES if name in vars(model.policy))
    if ENTROPY in vars(model):
        yield ENTROPY, model


def trained_states(model: SbxModel) -> dict[str, Any]:
    """Return networks and optimisers by name, as flax has them."""
    return {name: vars(owner)[name] for name, owner in _owners(model)}


def put_states(model: SbxModel, states: Mapping[str, Any]) -> None:
    """Put back what `trained_states` gave, of an algorithm of the same settings."""
    for name, owner in _owners(model):
        setattr(owner, name, states[name])


def counters(model: SbxModel) -> dict[str, int]:
    """Return steps, updates and episodes done, by SBX's names."""
    return {name: int(vars(model)[name]) for name in _COUNTERS}


def num_updates(model: SbxModel) -> int:
    """Return how many gradient steps the algorithm has done."""
    return counters(model)["_n_updates"]


def put_counters(model: SbxModel, counts: Mapping[str, int]) -> None:
    """Put back what `counters` gave."""
    for name in _COUNTERS:
        setattr(model, name, counts[name])


def replay_buffer(model: SbxModel) -> ReplayBuffer | None:
    """Return the algorithm's replay buffer; None of an on-policy one."""
    return vars(model).get("replay_buffer")


def buffer_arrays(buffer: ReplayBuffer) -> dict[str, np.ndarray[Any, Any]]:
    """Return the buffer's arrays by name: (buffer_size, environments, ...) each."""
    return {name: vars(buffer)[name] for name in _BUFFER}
