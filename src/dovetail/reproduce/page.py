"""Pieces of an HTML page that needs nothing else: headings, tables, figures."""

import base64
import html
from collections.abc import Iterable, Sequence

_STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; color: #33302b; background: #fbfaf7;
       max-width: 72rem; margin: 2.5rem auto; padding: 0 1.25rem; }
h1 { font-size: 1.5rem; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2.4rem 0 .6rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .35rem .55rem; border-bottom: 1px solid #e4dfd4; }
th:first-child, td:first-child { text-align: left; }
th { font-size: .8rem; font-weight: 600; color: #6c665c; }
td { font-size: .92rem; } td small { color: #6c665c; white-space: nowrap; }
.facts td { text-align: left; overflow-wrap: anywhere; }
.facts td:first-child { color: #6c665c; width: 16rem; }
.wide { overflow-x: auto; }
.missing { background: #fbeaea; border-left: 4px solid #d1495b; padding: .6rem 1rem; }
img { max-width: 100%; background: white; border: 1px solid #e4dfd4; }
pre { background: #f1eee7; padding: .8rem 1rem; overflow-x: auto; font-size: .9rem; }
.note { font-size: .9rem; color: #6c665c; }
"""


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def text(value: object) -> Html:
    """Return a value as HTML; what is HTML already stays."""
    return value if isinstance(value, Html) else Html(html.escape(str(value)))


def heading(title: str) -> Html:
    """Return a section's heading."""
    return Html(f"<h2>{text(title)}</h2>")


def paragraph(words: str, kind: str = "") -> Html:
    """Return a paragraph; `kind` is a class of the style."""
    mark = f' class="{kind}"' if kind else ""
    return Html(f"<p{mark}>{text(words)}</p>")


def bullet_list(lines: Iterable[str], kind: str = "") -> Html:
    """Return a list."""
    items = "".join(f"<li>{text(line)}</li>" for line in lines)
    mark = f' class="{kind}"' if kind else ""
    return Html(f"<div{mark}><ul>{items}</ul></div>")


def table(
    heads: Sequence[str], rows: Iterable[Sequence[object]], kind: str = ""
) -> Html:
    """Return a table; without heads it has none."""
    lines = [f"<tr>{''.join(f'<td>{text(c)}</td>' for c in row)}</tr>" for row in rows]
    if heads:
        lines.insert(0, f"<tr>{''.join(f'<th>{text(h)}</th>' for h in heads)}</tr>")
    mark = f' class="{kind}"' if kind else ""
    body = "\n".join(lines)
    return Html(f'<div class="wide"><table{mark}>\n{body}\n</table></div>')


def figure(png: bytes, label: str) -> Html:
    """Return a PNG as a part of the page."""
    data = base64.b64encode(png).decode()
    return Html(f'<img alt="{text(label)}" src="data:image/png;base64,{data}">')


def page(title: str, parts: Iterable[str]) -> str:
    """Return the page."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f"<title>{text(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{text(title)}</h1>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )
