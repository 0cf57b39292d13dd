"""One HTML page that needs nothing else: style, tables, figures, facts."""

import base64
import html
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

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
@media (max-width: 40rem) {
  body { margin: 1rem auto; padding: 0 .75rem; }
  .rate { font-size: 1.8rem; display: block; }
  .facts td:first-child { width: 8rem; }
}
@media (prefers-color-scheme: dark) {
  body { color: #e6e1d7; background: #1d1b18; }
  .rate { color: #52c4bd; }
  th, .note, .facts td:first-child { color: #a8a194; }
  th, td { border-color: #3a362f; }
  tr.all td { border-color: #5a5448; }
  pre { background: #2a2722; }
  img { border-color: #3a362f; filter: brightness(.9); }
}
"""


def page(title: str, parts: Sequence[str]) -> str:
    """Return a whole HTML page without a single outside link.

    Args:
        title: Title of the window, plain text.
        parts: HTML of the body, in order.
    """
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{text(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        "<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def table(
    heads: Sequence[object],
    rows: Sequence[Sequence[object]],
    *,
    marked: Collection[int] = (),
) -> str:
    """Return a table of plain text; the first column is on the left.

    Args:
        heads: Names of the columns.
        rows: Cells of each row.
        marked: Numbers of the rows that are emphasised, such as a sum.
    """
    head = "".join(f"<th>{text(name)}</th>" for name in heads)
    lines = []
    for number, row in enumerate(rows):
        mark = ' class="all"' if number in marked else ""
        entries = "".join(f"<td>{text(cell)}</td>" for cell in row)
        lines.append(f"<tr{mark}>{entries}</tr>")
    body = "\n".join(lines)
    return f'<div class="wide"><table>\n<tr>{head}</tr>\n{body}\n</table></div>'


def figure(caption: str, picture: bytes) -> str:
    """Return a headed figure with the picture inside, a PNG or an animated GIF."""
    data, label = base64.b64encode(picture).decode(), text(caption)
    kind = "gif" if picture.startswith(b"GIF8") else "png"
    source = f"data:image/{kind};base64,{data}"
    return f'<h2>{label}</h2>\n<img alt="{label}" src="{source}">'


def facts(title: str, facts: Mapping[str, Any]) -> list[str]:
    """Return a heading and a table of names and values; mappings are flattened."""
    lines = [
        f"<tr><td>{text(name)}</td><td>{text(value)}</td></tr>"
        for name, value in _flat(facts)
    ]
    table = '<table class="facts">\n' + "\n".join(lines) + "\n</table>"
    return [f"<h2>{text(title)}</h2>", table]


def _flat(facts: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    lines: list[tuple[str, Any]] = []
    for name, value in facts.items():
        if isinstance(value, Mapping):
            lines += _flat(value, f"{prefix}{name}.")
        else:
            lines.append((prefix + str(name), value))
    return lines


def finite(value: Any) -> Any:
    """Replace numbers that JSON cannot write by null, at any depth."""
    if isinstance(value, Mapping):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def text(value: object) -> str:
    """Return a value as text that HTML shows as it is."""
    return html.escape(str(value))
