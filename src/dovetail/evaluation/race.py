"""Tries of several policies from the same starts, and what they tell so far."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.paired_test import Pairs, Verdict, difference_interval, judge
from dovetail.evaluation.transfer import Interval, Row, summarise


@dataclass(frozen=True, kw_only=True)
class PairResult:
    """Two policies beside each other."""

    first: str
    second: str
    pairs: Pairs
    """Counts of the tries that both made."""
    verdict: Verdict
    interval: Interval
    """95 % interval of the difference, first less second, as for a fixed number of
    tries."""

    def numbers(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "first": self.first,
            "second": self.second,
            **self.pairs._asdict(),
            "difference": self.pairs.difference,
            "interval": self.interval,
            "verdict": self.verdict,
        }

    def sentence(self) -> str:
        """Say what the tries tell."""
        better, other = self.first, self.second
        difference, (low, high) = self.pairs.difference, self.interval
        if self.verdict == "second":
            better, other = other, better
            difference, low, high = -difference, -high, -low
        found = (
            f"{100 * difference:+.1f} % (95 % interval {100 * low:+.1f} to "
            f"{100 * high:+.1f}) over {self.pairs.tries} tries of each"
        )
        if self.verdict in ("first", "second"):
            return f"{better} succeeds more often than {other}: {found}"
        return f"open whether {better} or {other} is better: {found}"


class Race:
    """The tries of all policies so far, and what they tell."""

    def __init__(self, names: Sequence[str], tries: int, error_rate: float) -> None:
        self._names, self._tries = names, tries
        self._couples = list(itertools.combinations(range(len(names)), 2))
        self._error_rate = error_rate / len(self._couples)
        self.outcomes: list[list[Outcome]] = [[] for _ in names]
        self.course: dict[tuple[int, int], list[Pairs]] = {c: [] for c in self._couples}
        self._verdicts: dict[tuple[int, int], Verdict] = dict.fromkeys(
            self._couples, "undecided"
        )

    def is_open(self, index: int) -> bool:
        """Return True if more tries of a policy can tell something."""
        return any(
            self._verdicts[couple] == "undecided"
            for couple in self._couples
            if index in couple
        )

    def add(self, index: int, outcomes: Sequence[Outcome]) -> None:
        """Take new tries of a policy."""
        self.outcomes[index] += outcomes
        for couple in self._couples:
            if index in couple:
                self._judge(couple)

    def _judge(self, couple: tuple[int, int]) -> None:
        """Judge a couple after each try that both have made."""
        course = self.course[couple]
        one, other = (self.outcomes[index] for index in couple)
        pairs = course[-1] if course else Pairs()
        for a, b in itertools.islice(zip(one, other, strict=False), len(course), None):
            if self._verdicts[couple] != "undecided":
                return
            pairs = pairs.add(a.success, b.success)
            course.append(pairs)
            self._verdicts[couple] = judge(pairs, self._tries, self._error_rate)

    def has_all(self) -> bool:
        """Return True if every policy has a try."""
        return all(self.outcomes)

    def rows(self) -> list[Row]:
        """Return each policy's row of the table."""
        rows = []
        for name, outcomes in zip(self._names, self.outcomes, strict=True):
            rows.append(replace(summarise(outcomes, ())[-1], label=name))
        return rows

    def results(self) -> list[PairResult]:
        """Return what is known of every two policies."""
        return [
            PairResult(
                first=self._names[couple[0]],
                second=self._names[couple[1]],
                pairs=course[-1],
                verdict=self._verdicts[couple],
                interval=difference_interval(course[-1]),
            )
            for couple, course in self.course.items()
        ]
