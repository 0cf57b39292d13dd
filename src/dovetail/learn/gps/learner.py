"""Guided policy search as an algorithm of Stable-Baselines3.

An iteration: the network acts, with noise, until so many rollouts have ended. Local
controllers about them improve on the network within a KL divergence (`improvement`),
and the network learns what they do, within that divergence from what it was.

There are no samples of one start: a linear model is fitted to what was seen nearby in
any rollout. So every rollout starts where its episode does, as other algorithms'
episodes, and is a condition of its own.

Reference:
    Montgomery and Levine 2016, Guided policy search via approximate mirror descent;
    Montgomery, Ajay, Finn, Abbeel, Levine 2017, Reset-free guided policy search.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm  # noqa: TID253
from stable_baselines3.common.callbacks import BaseCallback  # noqa: TID253

from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.learn.gps.cost import WEIGHTS
from dovetail.learn.gps.improvement import Goal, Network, Rollout, teach
from dovetail.learn.gps.lqr import Floats, gaussian_divergence
from dovetail.learn.gps.network import START_STD, GpsPolicy, SearchState

LEAST_STD = 0.1
"""Least standard deviation of an action while it learns [1]."""
MEMORY = 6000
"""Latest transitions that the dynamics are fitted to [1]."""
KEPT = 4
"""Iterations whose lessons are learned: one alone has too much noise [1]."""
HOLD = 4.0
"""KL steps that the network may go at once [1]: this divergence is of what it truly
does, the controllers' of the network made linear. With 1 it needs more steps."""
_HALVINGS = 10


class GpsSettings(NamedTuple):
    """Settings of the search; see `LearnerConfig`."""

    conditions: int
    horizon: int
    kl_step: float
    updates_per_step: float
    batch_size: int
    net: tuple[int, ...]


class GPS(BaseAlgorithm):
    """Guided policy search by mirror descent."""

    policy: Any  # Stable-Baselines3 declares one of PyTorch
    env: Any

    def __init__(
        self,
        env: Any,
        settings: GpsSettings,
        learning_rate: Callable[[float], float],
        seed: int,
    ) -> None:
        """Draw the network.

        Args:
            env: Vectorised environment.
            settings: Of the search.
            learning_rate: Step size of Adam for the share that remains.
            seed: Of everything random.

        Raises:
            ConfigError: The task shows no position, by which a state has a cost.
        """
        super().__init__(
            GpsPolicy, env, learning_rate, seed=seed, support_multi_env=True
        )
        self.settings = settings
        self._setup_model()

    def _setup_model(self) -> None:
        self._setup_lr_schedule()
        seed = int(self.seed or 0)
        self.set_random_seed(seed)
        spaces: list[Any] = [self.observation_space, self.action_space]
        policy = GpsPolicy(spaces[0], spaces[1], self.settings.net, seed)
        self.policy = policy
        layout = require_contact_env(self.env.envs[0]).scaling
        if "position" not in layout.places:
            raise ConfigError(
                "algorithm is gps, but the task does not show the tool's position, by "
                f"which gps judges a state (it shows {', '.join(layout.places)}): "
                "give --algorithm sac"
            )
        numbers = np.arange(len(layout))
        places = {
            name: np.atleast_1d(numbers[place])
            for name, place in layout.places.items()
            if name != "joints"  # they follow from the tool's pose
        }
        self._columns = np.concatenate(list(places.values()))
        each = [WEIGHTS.get(name, (0.0, 1.0)) for name in places for _ in places[name]]
        weight, smooth = np.array(each).T
        self._goal = Goal(weight, smooth, self.settings.kl_step)
        seen, actions = (int(space.shape[0]) for space in spaces)
        policy.search_state = SearchState.start(seen, len(self._columns), actions)

    def set_random_seed(self, seed: int | None = None) -> None:
        """Start every random number again."""
        super().set_random_seed(seed)
        self._rng = np.random.default_rng(seed)

    def learn(
        self,
        total_timesteps: int,
        callback: Any = None,
        log_interval: int = 1,
        tb_log_name: str = "GPS",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> "GPS":
        """Train for so many more steps, or until the callback ends it."""
        total, told = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        told.on_training_start(locals(), globals())
        collector = _Collector(self, self.settings.horizon, self._columns)
        is_on = True
        while is_on and self.num_timesteps < total:
            rollouts: list[Rollout] = []
            told.on_rollout_start()
            while len(rollouts) < self.settings.conditions and is_on:
                more, is_on = collector.step(self._rng, told)
                rollouts += more
                is_on = is_on and self.num_timesteps < total
            told.on_rollout_end()
            if rollouts:
                self._update_current_progress_remaining(self.num_timesteps, total)
                self._improve(rollouts)
        told.on_training_end()
        return self

    def _improve(self, rollouts: list[Rollout]) -> None:
        """Let local controllers improve on the network, and teach it what they do."""
        policy, search = self.policy, self.policy.search_state
        memory, count = search.transitions, sum(len(r.action) for r in rollouts)
        for rollout in rollouts:
            memory = memory.latest(rollout.transitions(), max(MEMORY, count))
        before, covariance = policy.actor_state, search.covariance
        acted = policy.actions(memory.seen[-count:])
        lessons = teach(
            rollouts,
            memory,
            memory.seen[:, self._columns].astype(float),
            Network(policy.actions, covariance),
            self._goal,
            self._rng,
        )
        learned = search.lessons
        number = int(learned.iteration.max(initial=0)) + 1
        spread = _spread(lessons.precision)
        size = np.trace(lessons.precision, axis1=1, axis2=2).mean() / len(spread)
        lessons = lessons._replace(
            precision=lessons.precision / size,
            iteration=np.full(len(lessons.iteration), number),
        )
        learned = learned.with_latest(lessons, KEPT)
        updates = max(1, round(count * self.settings.updates_per_step))
        shape = updates, self.settings.batch_size
        picks = self._rng.integers(len(learned.seen), size=shape)
        rate = self.lr_schedule(self._current_progress_remaining)
        loss = policy.teach(learned, rate, picks)
        self._n_updates += updates
        moved = self._hold_back(before, memory.seen[-count:], acted, spread)
        policy.search_state = SearchState(spread, memory, learned)
        self.logger.record("train/loss", loss)
        self.logger.record("train/kl", moved)
        self.logger.record("train/std", float(np.sqrt(np.trace(spread) / len(spread))))
        self.logger.record("train/n_updates", self._n_updates)
        self.logger.dump(self.num_timesteps)

    def _hold_back(
        self, before: Any, seen: Floats, acted: Floats, spread: Floats
    ) -> float:
        """Keep the network within `HOLD` KL steps of what it was.

        Returns:
            The mean divergence at the states of the rollouts [nat].
        """
        policy, old = self.policy, self.policy.search_state.covariance
        mean = 0.0
        for _ in range(_HALVINGS):
            moved = policy.actions(seen) - acted
            mean = float(gaussian_divergence(moved, spread, old).mean())
            if mean <= HOLD * self.settings.kl_step:
                return mean
            policy.go_back(before, 0.5)
        return mean


def _spread(precision: Floats) -> Floats:
    """Return the covariance of the network's actions: of the mean precision, bounded.

    Args:
        precision: Of the controllers, shape (lessons, actions, actions).
    """
    values, vectors = np.linalg.eigh(np.linalg.inv(precision.mean(axis=0)))
    values = np.clip(values, LEAST_STD**2, START_STD**2)
    return (vectors * values) @ vectors.T


class _Collector:
    """Steps the environments and cuts what they do into rollouts."""

    def __init__(self, model: GPS, horizon: int, columns: Any) -> None:
        self._model, self._env = model, model.env
        self._horizon, self._columns = horizon, columns
        self._seen = self._env.reset()
        self._paths = [self._begin(i) for i in range(self._env.num_envs)]

    def _state(self, info: dict[str, Any]) -> Floats:
        return info["observation_raw"][self._columns]

    def _begin(self, index: int) -> tuple[list[Floats], list[Floats], list[Floats]]:
        """Begin the rollout of an environment where it is."""
        state = self._state(self._env.reset_infos[index])
        return [self._seen[index]], [state], []

    def step(
        self, rng: np.random.Generator, told: BaseCallback
    ) -> tuple[list[Rollout], bool]:
        """Step every environment once.

        Returns:
            The rollouts that ended, and whether the callback lets the run go on.
        """
        model, env = self._model, self._env
        mean = model.policy.actions(self._seen)
        root = np.linalg.cholesky(model.policy.search_state.covariance)
        noisy = mean + rng.standard_normal(mean.shape) @ root.T
        actions = np.clip(noisy, -1.0, 1.0).astype(np.float32)
        seen, rewards, dones, infos = env.step(actions)
        model.num_timesteps += env.num_envs
        ended = []
        self._seen = seen
        for i, (observed, state, acted) in enumerate(self._paths):
            acted.append(actions[i].astype(float))
            state.append(self._state(infos[i]))
            is_cut = not dones[i] and len(acted) >= self._horizon
            observed.append(infos[i]["terminal_observation"] if dones[i] else seen[i])
            if is_cut:
                infos[i] |= {"episode": self._cut(i)}
                dones[i] = True
            if dones[i]:
                ended.append(Rollout(*map(np.array, (observed, state, acted))))
                self._paths[i] = self._begin(i)
        told.update_locals(locals())
        return ended, told.on_step()

    def _cut(self, index: int) -> dict[str, Any]:
        """End an episode at the horizon; return what Monitor says of one."""
        env = self._env
        (rewards,) = env.get_attr("rewards", [index])
        episode = {"r": sum(rewards), "l": len(rewards)}
        ((seen, info),) = env.env_method("reset", indices=[index])
        self._seen[index], env.reset_infos[index] = seen, info
        return episode
