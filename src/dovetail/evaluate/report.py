"""The report of an evaluation: one HTML file that needs nothing else, and JSON."""

import base64
import html
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from dovetail.evaluate.outcome import Outcome
from dovetail.evaluate.transfer import COLUMNS, Row, cells

_STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; color: #33302b; background: #fbfaf7;
       max-width: 62rem; margin: 2.5rem auto; padding: 0 1.25rem; }
h1 { font-size: 1.5rem; margin: 0 0 .25rem; }
h2 { font-size: 1.1rem; margin: 2.2rem 0 .6rem; }
.lead { font-size: 1.1rem; margin: .2rem 0 1.4rem; }
.rate { font-size: 2.4rem; font-weight: 650; color: #0b7a75; margin-right: .6rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .4rem .6rem; border-bottom: 1px solid #e4dfd4; }
th:first-child, td:first-child { text-align: left; }
th { font-size: .82rem; font-weight: 600; color: #6c665c; }
tr.all td { font-weight: 650; border-top: 2px solid #cfc8ba; }
.facts td { text-align: left; font-size: .9rem; overflow-wrap: anywhere; }
.facts td:first-child { color: #6c665c; width: 16rem; }
.wide { overflow-x: auto; }
img { max-width: 100%; background: white; border: 1px solid #e4dfd4; }
pre { background: #f1eee7; padding: .8rem 1rem; overflow-x: auto; font-size: .9rem; }
.note { font-size: .9rem; color: #6c665c; }
"""


@dataclass(frozen=True, kw_only=True)
class Report:
    """Everything that a reader needs to trust, read and repeat an evaluation."""

    title: str
    """What was tried."""
    ground: str
    """Where: "twin medium (mujoco)" or "simulation (mujoco)"; a twin is no robot."""
    rows: Sequence[Row]
    """The transfer table, its last row over all poses."""
    outcomes: Sequence[Outcome]
    """Every try."""
    config: Mapping[str, Any]
    """The evaluation's settings."""
    policy: Mapping[str, Any]
    """The policy's own description, with its provenance."""
    provenance: Mapping[str, Any]
    """Versions, machine and time of this evaluation."""
    command: str
    """The command that makes this report again."""

    def to_json(self) -> str:
        """Return the report as JSON; a number that does not exist is null."""
        content = {
            "title": self.title,
            "ground": self.ground,
            "rows": [asdict(row) for row in self.rows],
            "tries": [outcome.numbers() for outcome in self.outcomes],
            "config": dict(self.config),
            "policy": dict(self.policy),
            "provenance": dict(self.provenance),
            "command": self.command,
        }
        return json.dumps(_finite(content), indent=2, allow_nan=False) + "\n"

    def to_html(self, figures: Mapping[str, bytes]) -> str:
        """Return the report as one HTML page without a single outside link.

        Args:
            figures: PNG files by caption, in the order of the page.
        """
        total = self.rows[-1]
        low, high = total.interval
        lead = (
            f'<p class="lead"><span class="rate">{total.successes}/{total.tries}'
            f"</span>inserted on {_text(self.ground)}; the true rate is between "
            f"{100 * low:.1f} % and {100 * high:.1f} % (Wilson 95 %).</p>"
        )
        parts = [
            f"<h1>{_text(self.title)}</h1>",
            lead,
            _table(self.rows),
            '<p class="note">Steps are policy steps of 50 ms; contact force mean: over '
            "the control cycles in contact; peak: the largest of a try, its 95th "
            "percentile over the tries; 50 ms: the same for the largest mean over a "
            "policy step. Limits broken: control cycles in which a measured value lay "
            "outside its limit. A dash: this arm does not measure contact force.</p>",
            *(_figure(caption, png) for caption, png in figures.items()),
            "<h2>Make it again</h2>",
            f"<pre>{_text(self.command)}</pre>",
            *_facts("Settings", self.config),
            *_facts("Policy", self.policy),
            *_facts("Where this was measured", self.provenance),
        ]
        return (
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width">\n'
            f"<title>{_text(self.title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
            "<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
        )


def _table(rows: Sequence[Row]) -> str:
    heads = "".join(f"<th>{_text(name)}</th>" for name in COLUMNS)
    lines = []
    for row in rows:
        mark = ' class="all"' if row is rows[-1] else ""
        entries = "".join(f"<td>{_text(cell)}</td>" for cell in cells(row))
        lines.append(f"<tr{mark}>{entries}</tr>")
    body = "\n".join(lines)
    return f'<div class="wide"><table>\n<tr>{heads}</tr>\n{body}\n</table></div>'


def _figure(caption: str, png: bytes) -> str:
    data = base64.b64encode(png).decode()
    label = _text(caption)
    return f'<h2>{label}</h2>\n<img alt="{label}" src="data:image/png;base64,{data}">'


def _facts(title: str, facts: Mapping[str, Any]) -> list[str]:
    lines = [
        f"<tr><td>{_text(name)}</td><td>{_text(value)}</td></tr>"
        for name, value in _flat(facts)
    ]
    table = '<table class="facts">\n' + "\n".join(lines) + "\n</table>"
    return [f"<h2>{_text(title)}</h2>", table]


def _flat(facts: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    lines: list[tuple[str, Any]] = []
    for name, value in facts.items():
        if isinstance(value, Mapping):
            lines += _flat(value, f"{prefix}{name}.")
        else:
            lines.append((prefix + str(name), value))
    return lines


def _finite(value: Any) -> Any:
    """Replace numbers that JSON cannot write by null, at any depth."""
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def _text(value: object) -> str:
    return html.escape(str(value))
