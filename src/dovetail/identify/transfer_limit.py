"""Go or no go: is a model close enough to the arm for a policy to carry over?"""

from dataclasses import dataclass
from typing import Literal

TRANSFER_LIMIT = 0.060
"""Error of the model on a log of the standard excitation [m RMS] up to which transfer
is expected. Measured, not derived: `benchmarks/transfer_threshold.py` tries the shipped
policy on twins at graded distances from the model, and this is below every grade on
which it failed. docs/identification.md has the table."""


Answer = Literal["go", "no go", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The go / no-go line."""

    answer: Answer
    sentence: str
    limit: float
    """The limit it was held against [m RMS]."""


def judge_transfer(
    held_out: float | None, fitting: float, *, standard: bool
) -> Verdict:
    """Hold the error of a model on a held-out log against the limit.

    Args:
        held_out: Error on a log that was not fitted [m RMS]; None without one.
        fitting: Error on the log that was fitted [m RMS].
        standard: The held-out log is of the standard excitation, of which the limit was
            measured.
    """
    limit = f"{1e3 * TRANSFER_LIMIT:g} mm"
    origin = (
        "the limit is where the shipped policy begins to fail on twins at graded "
        "distances (docs/identification.md)"
    )
    if held_out is None:
        return Verdict(
            answer="unknown",
            sentence=(
                "no verdict: without a held-out log nobody knows the error on motions "
                "that were not fitted; record one with another --seed and give it with "
                "--held-out"
            ),
            limit=TRANSFER_LIMIT,
        )
    if not standard:
        origin += (
            "; this log is of another excitation or controller than those twins' logs, "
            "so the limit is only a rough guide here"
        )
    found = f"{1e3 * held_out:.2f} mm RMS on the held-out log is"
    answer: Answer = "go" if held_out <= TRANSFER_LIMIT else "no go"
    if answer == "go":
        text = (
            f"go: {found} within {limit}, so transfer is expected as far as free "
            f"motion decides it; {origin}"
        )
    else:
        text = f"no go: {found} above {limit}, so transfer is not expected; {origin}"
    if held_out > 2.0 * fitting:
        text += (
            f". The fitting log is met {held_out / fitting:.1f} times better than the "
            "held-out one: the fit follows its log more than the arm; record more "
            "sequences"
        )
    return Verdict(answer=answer, sentence=text, limit=TRANSFER_LIMIT)
