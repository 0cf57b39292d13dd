"""The questions that the experiments answer, written down before the first full run.

Each is a difference between cells of the design and a claim about its sign. The claims
are the paper's where it makes one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from dovetail.reproduce.design import LAWS, MODELS
from dovetail.reproduce.effects import Effect, Measured, contrast

MeasureName = Literal["success", "time", "force", "steps", "own"]


class Scale(NamedTuple):
    """A measure in words, and how it is printed."""

    words: str
    unit: str
    factor: float
    decimals: int
    margin: float
    """Difference that does not matter, in its own unit."""


SCALES: dict[MeasureName, Scale] = {
    "success": Scale("success on the twins", "points", 100.0, 1, 0.05),
    "time": Scale("time of a try, a failed one in full", "s", 0.05, 2, 10.0),
    "force": Scale("peak force of a try", "N", 1.0, 1, 5.0),
    "steps": Scale("training steps to 90 %", "steps", 1.0, 0, 1000.0),
    "own": Scale("success where it was trained", "points", 100.0, 1, 0.02),
}
"""Success is a share, time in policy steps of 50 ms, force in N."""


class CellName(NamedTuple):
    """A cell of policies trained in MuJoCo, tried on twins in MuJoCo."""

    law: str
    model: str


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """A claim about a difference."""

    question: str
    measure: MeasureName
    terms: tuple[tuple[float, CellName], ...]
    """Weights and cells of the difference."""
    difference: str
    """The difference in words."""
    law: str
    """The law of all its cells in words."""
    claim: Literal["more", "less", "no worse"]
    """Sign that the difference is claimed to have. No worse: above minus the margin
    of its measure, for one where more is better."""
    by: Literal["paper", "ours"]
    """Author of the claim."""


def _between(
    question: str,
    measure: MeasureName,
    law: str,
    first: str,
    second: str,
    claim: Literal["more", "less", "no worse"],
    by: Literal["paper", "ours"] = "paper",
) -> Hypothesis:
    terms = ((1.0, CellName(law, first)), (-1.0, CellName(law, second)))
    return Hypothesis(
        question=question,
        measure=measure,
        terms=terms,
        difference=f"{MODELS[first].label} minus {MODELS[second].label}",
        law=LAWS[law].label,
        claim=claim,
        by=by,
    )


def _all() -> tuple[Hypothesis, ...]:
    found: list[Hypothesis] = []
    for law in LAWS:
        found += [
            _between(
                "Does identification improve transfer?",
                *("success", law, "identified", "nominal", "more"),
            ),
            _between(
                "Do the paper's five parameters alone?",
                *("success", law, "identified-paper", "nominal", "more"),
            ),
            _between(
                "Is identification at least as good as randomisation?",
                *("success", law, "identified", "randomised", "no worse"),
            ),
            _between(
                "Does it learn faster than with randomisation?",
                *("steps", law, "identified", "randomised", "less"),
            ),
            _between(
                "Does it end better than with randomisation?",
                *("own", law, "identified", "randomised", "more"),
            ),
            _between(
                "Is it quicker on the twins than with randomisation?",
                *("time", law, "identified", "randomised", "less", "ours"),
            ),
            _between(
                "Does it press less than with randomisation?",
                *("force", law, "identified", "randomised", "less", "ours"),
            ),
            _between(
                "Does randomisation about the identified model add anything?",
                *("success", law, "identified-randomised", "identified"),
                *("more", "ours"),
            ),
            _between(
                "Is the identified model as good as the truth?",
                *("success", law, "identified", "truth", "no worse", "ours"),
            ),
        ]
    pairs = [("ours", 1.0), ("tared", -1.0)]
    gains = tuple(
        term
        for law, sign in pairs
        for term in (
            (sign, CellName(law, "identified")),
            (-sign, CellName(law, "nominal")),
        )
    )
    found.append(
        Hypothesis(
            question="Does identification matter less with a tare?",
            measure="success",
            terms=gains,
            difference="that of the first question: without a tare minus with one",
            law=LAWS["ours"].label,
            claim="more",
            by="ours",
        )
    )
    return tuple(found)


HYPOTHESES = _all()

Verdict = Literal["yes", "no", "open"]


class Answer(NamedTuple):
    """A hypothesis and what the data say of it."""

    hypothesis: Hypothesis
    effect: Effect
    verdict: Verdict

    @property
    def words(self) -> str:
        """The verdict with the difference: "yes, +12 points (+3 to +20)"."""
        return f"{self.verdict}, {amount(self.effect, self.hypothesis.measure)}"


def answer(hypothesis: Hypothesis, cell: Callable[[CellName], Measured]) -> Answer:
    """Say what the data say of a hypothesis.

    Args:
        hypothesis: The claim.
        cell: Gives the hypothesis's measure of a cell.
    """
    effect = contrast([(weight, cell(name)) for weight, name in hypothesis.terms])
    return Answer(hypothesis, effect, judge(effect, hypothesis))


def judge(effect: Effect, hypothesis: Hypothesis) -> Verdict:
    """Say whether a claim holds: only an interval wholly on one side decides."""
    low, high = effect.low, effect.high
    if math.isnan(low):
        return "open"
    if hypothesis.claim == "less":
        low, high = -high, -low
    bound = 0.0
    if hypothesis.claim == "no worse":
        bound = -SCALES[hypothesis.measure].margin
    if low > bound:
        return "yes"
    return "no" if high < bound else "open"


def amount(effect: Effect, measure: MeasureName) -> str:
    """Return a difference with interval and unit: "+12.0 points (+3.1 to +20.4)"."""
    scale = SCALES[measure]

    def number(value: float) -> str:
        rounded = round(scale.factor * value, scale.decimals) + 0.0  # no minus zero
        return f"{rounded:+,.{scale.decimals}f}"

    if math.isnan(effect.value):
        return "nothing yet"
    if math.isnan(effect.low):
        return f"{number(effect.value)} {scale.unit} (too few for an interval)"
    between = f"{number(effect.low)} to {number(effect.high)}"
    return f"{number(effect.value)} {scale.unit} ({between})"


def answers(
    measure: Callable[[CellName, MeasureName], Measured],
    hypotheses: Sequence[Hypothesis] = HYPOTHESES,
) -> list[Answer]:
    """Answer every hypothesis.

    Args:
        measure: Gives a measure of a cell.
        hypotheses: The claims.
    """
    return [answer(h, lambda name, h=h: measure(name, h.measure)) for h in hypotheses]
