"""Stages of a training: the rate falls, tests are made, and a passed one ends it.

Three stages follow one another. While it learns, the rate of learning is the full one.
When nearly all of the latest tries succeed, with their exploring noise, the rate falls:
it settles. Then tests without that noise are made, on tries of their own. Up to the
next test the rate falls again, from half: at the lowest it would stay as good as it is.
If tries fail again, it learns at the full rate again.

The run ends with the first test that proves the success that was asked for, by the
lower end of its interval. Or it ends with the second in a row that shows it, by its
rate alone, and is not better than the first: so good a policy may never prove it, and
more training does not help. A test below that never ends a run; the steps do.

All of this follows from the finished episodes, so that a resumed run, which reads them
back, goes on in the same stage; where that is the last, with a test.

Reference:
    Loshchilov and Hutter 2017, SGDR: stochastic gradient descent with warm restarts.
"""

from collections import deque
from collections.abc import Iterable

from dovetail.evaluation.transfer import wilson_interval
from dovetail.learn.algorithms import derive_seed
from dovetail.learn.config import TrainConfig
from dovetail.learn.progress import WINDOW, EpisodeRow

BEGIN = 0.9
"""Share of the latest tries that must succeed before the rate falls [1]."""
LOST = 0.7
"""Share of them below which the run learns at the full rate again [1]."""
AGAIN = 0.5
"""Share of the rate from which it falls after a test that was not passed [1]."""
PORTION = 50
"""Tries between two looks at whether a test can still be passed."""

_STREAM = 0x57E9


class EarlyStopping:
    """The stage of a run, and the judgement of its tests."""

    def __init__(self, config: TrainConfig) -> None:
        """Begin before the first step.

        Args:
            config: Settings of the run.
        """
        self._config, self._length = config, config
        self._recent: deque[int] = deque(maxlen=WINDOW)
        self._since: int | None = None
        self._tested: int | None = None
        self._shown: int | None = None
        self.said = ""
        """The last test in words; empty before the first."""
        self.end = ""
        """Reason for which a test ended the run, in words; empty where none did."""

    def note(self, row: EpisodeRow) -> None:
        """Take in a finished episode; the first are not the learner's."""
        if not self._is_asked or row.step <= self._config.learning_starts:
            return
        self._recent.append(row.success)
        if len(self._recent) < WINDOW:
            return
        success = sum(self._recent) / WINDOW
        if self._since is None and success >= BEGIN:
            self._since = row.step
        elif success < LOST:
            self._since = self._tested = self._shown = None

    def rate(self, step: int) -> float:
        """Return the share of the learning rate at a step of the run [1]."""
        high, fallen = 1.0, self._settled(step)
        if self._tested is not None:
            high, fallen = AGAIN, min(1.0, (step - self._tested) / self._pause)
        return high - (high - self._config.final_rate) * fallen

    def is_due(self, step: int) -> bool:
        """Say whether a test is to be made now."""
        if self._settled(step) < 1.0:
            return False
        return self._tested is None or step - self._tested >= self._pause

    def seeds(self, step: int) -> list[list[int]]:
        """Return the seeds of a test's tries, other ones at every step, by portions."""
        count, seed = self._length.test_episodes, self._config.seed
        seeds = [derive_seed(_STREAM, seed, step, i) for i in range(count)]
        return [seeds[i : i + PORTION] for i in range(0, count, PORTION)]

    def is_passed(self, step: int, portions: Iterable[list[bool]]) -> bool:
        """Judge a test; stop taking tries when it can show nothing any more.

        Args:
            step: Of the run.
            portions: Success of each try, as many at a time as `seeds` gave.

        Returns:
            True if the run ends with it.
        """
        self._tested, before, self._shown = step, self._shown, None
        asked = self._length.asked_success
        count, done, failed = self._length.test_episodes, 0, 0
        for portion in portions:
            done, failed = done + len(portion), failed + portion.count(False)
            self.said = f"test {done - failed}/{done}"
            if count - failed < asked * count:
                return False
        succeeded = count - failed
        if wilson_interval(succeeded, count)[0] >= asked:
            self.end = f"{self.said} proves {100.0 * asked:g} %"
        elif before is not None and succeeded <= before:
            self.end = (
                f"{self.said} after {before}/{count}, both {100.0 * asked:g} % or "
                "more: more training does not help"
            )
        self._shown = succeeded
        return self.end != ""

    def stage(self, step: int) -> str:
        """Say how far the run is from its end, in words."""
        if not self._is_asked:
            return ""
        if self.said and self._since is not None:
            return self.said
        if (settled := self._settled(step)) > 0.0:
            return f"settling {100 * settled:.0f} %"
        return "learning"

    @property
    def _pause(self) -> float:
        """Steps between two tests."""
        return self._length.settle / 2

    @property
    def _is_asked(self) -> bool:
        return self._length.asked_success < 1.0

    def _settled(self, step: int) -> float:
        """Return how far the rate has fallen, from 0 to 1."""
        if self._since is None:
            return 0.0
        return min(1.0, max(0.0, (step - self._since) / self._length.settle))
