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


class Question(NamedTuple):
    """A claim about two models, asked of each law."""

    text: str
    measure: MeasureName
    first: str
    second: str
    claim: Literal["more", "less", "no worse"]
    by: Literal["paper", "ours"]

    def with_law(self, law: str) -> Hypothesis:
        """Return the claim about the policies of one law."""
        first, second = MODELS[self.first].label, MODELS[self.second].label
        return Hypothesis(
            question=self.text,
            measure=self.measure,
            terms=(
                (1.0, CellName(law, self.first)),
                (-1.0, CellName(law, self.second)),
            ),
            difference=f"{first} minus {second}",
            law=LAWS[law].label,
            claim=self.claim,
            by=self.by,
        )


_PAIR = ("identified", "randomised")
QUESTIONS = (
    Question(
        "Does identification improve transfer?",
        *("success", "identified", "nominal", "more", "paper"),
    ),
    Question(
        "Do the paper's five parameters alone?",
        *("success", "identified-paper", "nominal", "more", "paper"),
    ),
    Question(
        "Is identification at least as good as randomisation?",
        *("success", *_PAIR, "no worse", "paper"),
    ),
    Question(
        "Does it learn faster than with randomisation?",
        *("steps", *_PAIR, "less", "paper"),
    ),
    Question(
        "Does it end better than with randomisation?",
        *("own", *_PAIR, "more", "paper"),
    ),
    Question(
        "Is it quicker on the twins than with randomisation?",
        *("time", *_PAIR, "less", "ours"),
    ),
    Question(
        "Does it press less than with randomisation?",
        *("force", *_PAIR, "less", "ours"),
    ),
    Question(
        "Does randomisation about the identified model add anything?",
        *("success", "identified-randomised", "identified", "more", "ours"),
    ),
    Question(
        "Is the identified model as good as the truth?",
        *("success", "identified", "truth", "no worse", "ours"),
    ),
)
TARE_HELPS = Hypothesis(
    question="Does identification matter less with a tare?",
    measure="success",
    terms=(
        (1.0, CellName("ours", "identified")),
        (-1.0, CellName("ours", "nominal")),
        (-1.0, CellName("tared", "identified")),
        (1.0, CellName("tared", "nominal")),
    ),
    difference="that of the first question: without a tare minus with one",
    law=LAWS["ours"].label,
    claim="more",
    by="ours",
)
HYPOTHESES = (*(q.with_law(law) for law in LAWS for q in QUESTIONS), TARE_HELPS)

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
