"""One improvement: from rollouts to the actions of controllers that are better.

The controllers are local. Each rollout is the nominal trajectory of one; dynamics and
network are made linear about it, by fits to all transitions near it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dovetail.learn.gps.cost import expand
from dovetail.learn.gps.local_models import Linear, fit, neighbour_weights
from dovetail.learn.gps.lqr import Controller, Dynamics, Floats, improve
from dovetail.learn.gps.network import Lessons, Transitions

NEIGHBOURS = 80
"""Transitions that a local model is of [1]."""
SHOWN = 10
"""Lessons of a controller at a step: states among those that its model is of [1]."""
LARGEST_ACTION = 0.98
"""The network's output is a tanh: it is taught no more than this [1]."""


class Rollout(NamedTuple):
    """An episode, or the part of one within the horizon."""

    seen: Floats
    """Observations, the last one included, shape (steps + 1, observation)."""
    state: Floats
    """States of the local controllers, shape (steps + 1, states)."""
    action: Floats
    """Actions as the arm got them, shape (steps, actions)."""

    def transitions(self) -> Transitions:
        """Return its steps."""
        seen = self.seen[:-1].astype(np.float32)
        return Transitions(seen, self.state[:-1], self.action, self.state[1:])


class Network(NamedTuple):
    """The network as a linear-Gaussian policy is made of it."""

    actions: Callable[[Floats], Floats]
    """Gives the mean action at each observation."""
    covariance: Floats
    """Of the actions about it, shape (actions, actions)."""


class Goal(NamedTuple):
    """Goal of the controllers, and how far they may go from the network."""

    weight: Floats
    """Weight of each state's distance from 0, shape (states,)."""
    smooth: Floats
    """Distance below which its cost is a parabola, shape (states,)."""
    kl_step: float
    """Largest KL divergence of a controller from the network, per step [nat]."""


class _Steps:
    """The steps of rollouts of different length, as rows and as padded tables."""

    def __init__(self, rollouts: list[Rollout]) -> None:
        lengths = np.array([len(rollout.action) for rollout in rollouts])
        self.longest = int(lengths.max())
        self.is_step = np.arange(self.longest) < lengths[:, None]
        self.state = np.stack([_padded(r.state, self.longest + 1) for r in rollouts])
        self.action = np.stack([_padded(r.action, self.longest) for r in rollouts])

    def table(self, rows: Floats, empty: Floats) -> Floats:
        """Return rows by rollout and step, `empty` after a rollout's end."""
        table = np.broadcast_to(empty, (*self.is_step.shape, *empty.shape)).copy()
        table[self.is_step] = rows
        return table


def _padded(rows: Floats, length: int) -> Floats:
    """Return rows, the last one repeated."""
    return np.concatenate([rows, np.repeat(rows[-1:], length - len(rows), axis=0)])


def teach(
    rollouts: list[Rollout],
    memory: Transitions,
    features: Floats,
    network: Network,
    goal: Goal,
    rng: np.random.Generator,
) -> Lessons:
    """Improve on the network about each rollout; return what it can learn from that.

    Args:
        rollouts: At least one; their steps are the last of `memory`.
        memory: Transitions, at least as many as the rollouts have.
        features: By which transitions are neighbours, shape (transitions, features).
        network: The network that acted.
        goal: What is wanted.
        rng: Draws the neighbours that are lessons.
    """
    steps = _Steps(rollouts)
    is_step = steps.is_step
    count = int(is_step.sum())
    x, u = steps.state[:, :-1][is_step], steps.action[is_step]
    weights = neighbour_weights(features, features[-count:], NEIGHBOURS)
    local = _controllers(steps, memory, weights, network, goal)
    # States among the neighbours, as likely as they count in the fit:
    summed = np.cumsum(weights, axis=1)
    draws = rng.random((count, SHOWN)) * summed[:, -1:]
    picked = np.array(
        [np.searchsorted(row, d) for row, d in zip(summed, draws, strict=True)]
    )
    picked = np.minimum(picked, weights.shape[1] - 1)
    away = memory.state[picked] - x[:, None]
    action = (u + local.offset[is_step])[:, None]
    action = action + np.einsum("pik,pjk->pji", local.gain[is_step], away)
    action = np.clip(action, -LARGEST_ACTION, LARGEST_ACTION)
    precision = np.linalg.inv(local.covariance[is_step])
    return Lessons(
        memory.seen[picked.reshape(-1)],
        action.reshape(-1, u.shape[1]).astype(np.float32),
        np.repeat(precision, SHOWN, axis=0).astype(np.float32),
        np.zeros(picked.size, np.int64),
    )


def _controllers(
    steps: _Steps, memory: Transitions, weights: Floats, network: Network, goal: Goal
) -> Controller:
    """Return the controllers of least cost within a KL divergence from the network."""
    is_step = steps.is_step
    x, u = steps.state[:, :-1][is_step], steps.action[is_step]
    states, actions = x.shape[1], u.shape[1]
    moved = fit(
        np.column_stack([memory.state, memory.action]),
        memory.after - memory.state,
        np.column_stack([x, u]),
        weights,
    )
    stays = np.eye(states, states + actions)
    after = steps.state[:, 1:][is_step]
    dynamics = Dynamics(
        steps.table(moved.slope + stays, stays),
        steps.table(x + moved.value - after, np.zeros(states)),
        steps.table(moved.covariance, np.zeros((states, states))),
    )
    acted: Linear = fit(memory.state, network.actions(memory.seen), x, weights)
    policy = Controller(
        steps.table(acted.slope, np.zeros((actions, states))),
        steps.table(acted.value - u, np.zeros(actions)),
        steps.table(
            np.broadcast_to(network.covariance, (len(u), actions, actions)),
            network.covariance,
        ),
    )
    wanted = goal.weight, goal.smooth
    cost = expand(steps.state, steps.action, *wanted, is_step.astype(float))
    return improve(dynamics, cost, policy, goal.kl_step * is_step.sum(axis=1))
