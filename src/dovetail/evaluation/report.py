"""The report of an evaluation: one HTML file that needs nothing else, and JSON."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dovetail.evaluation.origin import Origin
from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.transfer import COLUMNS, Row, cells
from dovetail.page import facts, figure, finite, page, table, text
from dovetail.tasks.task import Task


@dataclass(frozen=True, kw_only=True)
class Report:
    """Everything that a reader needs to trust, read and repeat an evaluation."""

    title: str
    """Title: policy, task, disturbances, place and control period."""
    ground: str
    """Place of the tries, "twin medium (mujoco)" or "simulation (mujoco)"; a twin is no
    robot."""
    period: float
    """Control period of the arm [s]."""
    rows: Sequence[Row]
    """The transfer table, its last row over all poses."""
    outcomes: Sequence[Outcome]
    """Every try."""
    notes: Sequence[str] = ()
    """Notes for the reader of the table."""
    done_word: str = Task.done_word
    """Word for a success, as "inserted"."""
    origin: Origin
    """Origin of the numbers."""

    def to_json(self) -> str:
        """Return the report as JSON; a number that does not exist is null."""
        content = {
            "title": self.title,
            "ground": self.ground,
            "control period [s]": self.period,
            "notes": list(self.notes),
            "rows": [row.numbers() for row in self.rows],
            "tries": [outcome.numbers() for outcome in self.outcomes],
            "config": dict(self.origin.config),
            "policy": dict(self.origin.policy),
            "provenance": dict(self.origin.provenance),
            "command": self.origin.command,
        }
        return json.dumps(finite(content), indent=2, allow_nan=False) + "\n"

    def to_html(self, figures: Mapping[str, bytes]) -> str:
        """Return the report as one HTML page without a single outside link.

        Args:
            figures: PNG and GIF files by caption, in the order of the page.
        """
        total = self.rows[-1]
        low, high = total.interval
        lead = (
            f'<p class="lead"><span class="rate">{total.successes}/{total.tries}'
            f"</span>{text(self.done_word)} on {text(self.ground)} at a control period "
            f"of {1e3 * self.period:g} ms; the true rate is between "
            f"{100 * low:.1f} % and {100 * high:.1f} % (Wilson 95 %).</p>"
        )
        parts = [
            f"<h1>{text(self.title)}</h1>",
            lead,
            *(f'<p class="note">Note: {text(note)}.</p>' for note in self.notes),
            _table(self.rows),
            '<p class="note">Steps are policy steps of 50 ms; contact force mean: over '
            "the control cycles in contact; peak: the largest of a try, its 95th "
            "percentile over the tries; 50 ms: the same for the largest mean over a "
            "policy step. Limits broken: control cycles in which a measured value lay "
            "outside its limit. A dash: this arm does not measure contact force.</p>",
            *(figure(caption, picture) for caption, picture in figures.items()),
            "<h2>Make it again</h2>",
            f"<pre>{text(self.origin.command)}</pre>",
            *facts("Settings", self.origin.config),
            *facts("Policy", self.origin.policy),
            *facts("Where this was measured", self.origin.provenance),
        ]
        return page(self.title, parts)


def _table(rows: Sequence[Row]) -> str:
    marked = [i for i, row in enumerate(rows) if row is rows[-1]]
    return table(COLUMNS, [cells(row) for row in rows], marked=marked)
