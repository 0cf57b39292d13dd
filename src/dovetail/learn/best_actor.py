"""Keep the actor whose episodes went best, and go back to it when they go badly.

The critics of a run that starts from a policy are new: what they say of actions that
the policy does not take is noise for a long time, and Adam makes a full step of any
gradient, noise included. So the actor is judged by the episodes that it plays anyway:
while it stays as it was, they say how good it is; later groups of them decide whether
it has become better, and is kept, or so bad that the run goes back to the one kept.
What it did wrong stays in the replay buffer, where the critics learn from it.
"""

import math
from typing import Any, NamedTuple

import numpy as np

GROUP = 5
"""Episodes by which an actor is judged."""
TOLERANCE = 2.0
"""A group is bad this many standard deviations of an episode below the one kept [1]."""


class Kept(NamedTuple):
    """An actor, and how its episodes went; part of a checkpoint."""

    actor: Any
    """Its weights and its optimiser, as SBX has them."""
    reward: float
    """Mean over its episodes; nan before it is judged."""
    spread: float
    """Standard deviation of an episode's reward."""


class BestActor:
    """The actor kept, and the judgement of the one that learns."""

    def __init__(self, model: Any, frozen_until: int) -> None:
        """Keep the model's actor as it is.

        Args:
            model: SBX algorithm; its policy gets a `kept_state`, a checkpoint's part.
            frozen_until: Before this step of the run the actor stays as it is.
        """
        self._policy = model.policy
        self._frozen_until = frozen_until
        self._rewards: list[float] = []
        self._is_frozen = True
        model.policy.kept_state = Kept(model.policy.actor_state, math.nan, 0.0)

    @property
    def kept(self) -> Kept:
        """The actor kept."""
        return self._policy.kept_state

    @property
    def chosen(self) -> Any:
        """The actor that the run would end with now."""
        is_judged = not math.isnan(self.kept.reward)
        return self.kept.actor if is_judged else self._policy.actor_state

    def add(self, reward: float) -> None:
        """Note the sum of rewards of a finished episode."""
        self._rewards.append(reward)

    def judge(self, step: int) -> None:
        """Keep the actor, go back to the one kept, or wait; call it between updates.

        Args:
            step: Environment steps of the run.
        """
        if step <= self._frozen_until:
            self._policy.actor_state = self.kept.actor
            if len(self._rewards) > 1:
                self._keep(self.kept.actor, float(np.std(self._rewards)))
            return
        if self._is_frozen:
            self._is_frozen = False
            self._rewards.clear()
        _, reward, spread = self.kept
        if self._is_bad(reward, TOLERANCE * spread):
            self._policy.actor_state = self.kept.actor
            self._rewards.clear()
        elif len(self._rewards) >= GROUP:
            if math.isnan(reward):
                self._keep(self._policy.actor_state, float(np.std(self._rewards)))
            elif np.mean(self._rewards) >= reward:
                self._keep(self._policy.actor_state, spread)
            self._rewards.clear()

    def finish(self) -> None:
        """Make the actor kept the policy's, if its episodes were ever judged."""
        self._policy.actor_state = self.chosen

    def _is_bad(self, reward: float, tolerance: float) -> bool:
        """Say whether this group cannot be as good as the bound, even if it goes on."""
        to_come = max(0, GROUP - len(self._rewards))
        best = sum(self._rewards) + to_come * (reward + tolerance)
        return best < (len(self._rewards) + to_come) * (reward - tolerance)

    def _keep(self, actor: Any, spread: float) -> None:
        self._policy.kept_state = Kept(actor, float(np.mean(self._rewards)), spread)
