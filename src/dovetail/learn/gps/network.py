"""The network that guided policy search trains, and what else it goes on with."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import jax  # noqa: TID253
import jax.numpy as jnp  # noqa: TID253
import numpy as np
import optax
from flax.training.train_state import TrainState
from gymnasium import spaces
from numpy.typing import NDArray
from sbx.common.policies import BaseJaxPolicy  # noqa: TID253
from sbx.td3.policies import Actor  # noqa: TID253

from dovetail.learn.networks import draw

START_STD = 0.5
"""Standard deviation of the first actions [1]."""
START_SHARE = 0.1
"""Share of the usual size of the last layer's first weights [1]: a small start."""


class Transitions(NamedTuple):
    """Steps that the dynamics are fitted to, oldest first."""

    seen: NDArray[Any]
    """Observations before the action, shape (transitions, observation)."""
    state: NDArray[Any]
    """States of the local controllers before it, shape (transitions, states)."""
    action: NDArray[Any]
    """Actions as the arm got them, shape (transitions, actions)."""
    after: NDArray[Any]
    """States after it, shape (transitions, states)."""

    def latest(self, more: Self, count: int) -> "Transitions":
        """Return these and more of them, the last `count`."""
        pairs = zip(self, more, strict=True)
        return Transitions(*(np.concatenate(pair)[-count:] for pair in pairs))


class Lessons(NamedTuple):
    """Lessons for the network: actions of the local controllers."""

    seen: NDArray[Any]
    """Observations, shape (lessons, observation)."""
    action: NDArray[Any]
    """Mean action of the controller, shape (lessons, actions)."""
    precision: NDArray[Any]
    """Weight of each lesson, shape (lessons, actions, actions)."""
    iteration: NDArray[Any]
    """Number of the iteration that it is of, shape (lessons,)."""

    def with_latest(self, more: Self, kept: int) -> "Lessons":
        """Return these and an iteration's, without those before the last `kept`."""
        all_ = Lessons(*(np.concatenate(p) for p in zip(self, more, strict=True)))
        is_kept = all_.iteration > all_.iteration.max() - kept
        return Lessons(*(part[is_kept] for part in all_))


class SearchState(NamedTuple):
    """All but the network that a search goes on with; part of a checkpoint."""

    covariance: NDArray[Any]
    """Of the actions about the network's, shape (actions, actions)."""
    transitions: Transitions
    lessons: Lessons

    @classmethod
    def start(cls, seen: int, states: int, actions: int) -> "SearchState":
        """Return the state before the first step."""
        nothing = Transitions(
            np.zeros((0, seen), np.float32),
            np.zeros((0, states)),
            np.zeros((0, actions)),
            np.zeros((0, states)),
        )
        lessons = Lessons(
            np.zeros((0, seen), np.float32),
            np.zeros((0, actions), np.float32),
            np.zeros((0, actions, actions), np.float32),
            np.zeros(0, np.int64),
        )
        return cls(START_STD**2 * np.eye(actions), nothing, lessons)


class GpsPolicy(BaseJaxPolicy):
    """The network of ddpg, with no critic."""

    search_state: SearchState

    def __init__(
        self,
        observation_space: spaces.Box,
        action_space: spaces.Box,
        net_arch: Sequence[int],
        seed: int,
    ) -> None:
        """Draw the network.

        Args:
            observation_space: What it sees.
            action_space: What it gives.
            net_arch: Width of each hidden layer.
            seed: Of the weights.
        """
        super().__init__(observation_space, action_space, squash_output=True)
        self.net_arch_pi = list(net_arch)
        self.key = jax.random.PRNGKey(seed)
        actor = Actor(self.net_arch_pi, int(np.prod(action_space.shape)))
        seen = jnp.zeros((1, *observation_space.shape))
        params = draw(actor.init, self.key, seen)
        last = params["params"][f"Dense_{len(net_arch)}"]
        last["kernel"] = START_SHARE * last["kernel"]
        adam = optax.inject_hyperparams(optax.adam)(learning_rate=1e-3)
        self.actor_state: Any = TrainState.create(
            apply_fn=jax.jit(actor.apply), params=params, tx=adam
        )

    def forward(self, obs: Any, deterministic: bool = True) -> Any:
        """Return the actions."""
        return self._predict(obs, deterministic)

    def _predict(self, observation: Any, deterministic: bool = False) -> Any:
        return self.actor_state.apply_fn(self.actor_state.params, observation)

    def actions(self, seen: NDArray[Any]) -> NDArray[np.float64]:
        """Return the mean action at each observation."""
        return np.asarray(self._predict(seen.astype(np.float32)), dtype=float)

    def teach(self, lessons: Lessons, rate: float, picks: NDArray[np.int64]) -> float:
        """Make gradient steps towards the local controllers' actions.

        Args:
            lessons: What to learn.
            rate: Step size of Adam [1].
            picks: Lessons of each gradient step, shape (steps, lessons of a step).

        Returns:
            Loss of the last step.
        """
        state, loss = self.actor_state, jnp.zeros(())
        state.opt_state.hyperparams["learning_rate"] = jnp.asarray(rate)
        seen, action, precision, _ = lessons
        for pick in picks:
            state, loss = _step(state, seen[pick], action[pick], precision[pick])
        self.actor_state = state
        return float(loss)

    def go_back(self, before: Any, share: float) -> None:
        """Go back from the weights of now towards those before, by a share of the way.

        Args:
            before: An earlier `actor_state`.
            share: 0 changes nothing [1].
        """
        params = jax.tree_util.tree_map(
            lambda new, old: new + share * (old - new),
            self.actor_state.params,
            before.params,
        )
        self.actor_state = self.actor_state.replace(params=params)


@jax.jit
def _step(state: Any, seen: Any, action: Any, precision: Any) -> tuple[Any, Any]:
    """Make one gradient step; the loss is the KL divergence but for a constant."""

    def loss(params: Any) -> jax.Array:
        apart = state.apply_fn(params, seen) - action
        return jnp.einsum("bi,bij,bj->b", apart, precision, apart).mean()

    value, gradients = jax.value_and_grad(loss)(state.params)
    return state.apply_gradients(grads=gradients), value
