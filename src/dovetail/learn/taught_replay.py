"""A replay buffer that keeps its teacher, or demonstrations, in every batch."""

from typing import Any

import numpy as np
from stable_baselines3.common.buffers import NStepReplayBuffer  # noqa: TID253


class TaughtReplay(NStepReplayBuffer):
    """Draws a share of each batch from the first transitions, which were another's.

    Reference:
        Ball et al. 2023, Efficient online reinforcement learning with offline data:
        half of every batch.
    """

    def __init__(self, *args: Any, taught: int, share: float, **kwargs: Any) -> None:
        """Reserve the memory.

        Args:
            *args: Of the buffer.
            taught: How many transitions of each environment are demonstrations or the
                teacher's.
            share: Of a batch that is drawn from them alone [1].
            **kwargs: Of the buffer.
        """
        super().__init__(*args, **kwargs)
        self._taught, self._share = taught, share

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Store a step of each environment; once full, the oldest of its own goes."""
        super().add(*args, **kwargs)
        if self.pos == 0:
            # What follows these rows is another episode from now on.
            for row in (-1, self._taught - 1):
                self.timeouts[row][self.dones[row] == 0] = 1
            self.pos = self._taught

    def sample(self, batch_size: int, env: Any = None) -> Any:
        """Draw a batch with replacement."""
        stored = self.buffer_size if self.full else self.pos
        indices = np.random.randint(0, stored, batch_size)  # noqa: NPY002 (as the base)
        from_teacher = np.random.random(batch_size) < self._share  # noqa: NPY002
        most = min(self._taught, stored)
        count = int(from_teacher.sum())
        indices[from_teacher] = np.random.randint(0, most, count)  # noqa: NPY002
        return self._get_samples(indices, env)
