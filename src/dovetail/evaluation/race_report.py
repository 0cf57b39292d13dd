"""Files of a comparison: JSON, one HTML page, and the figure in it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dovetail.evaluation.figures import draw_differences
from dovetail.evaluation.paired_test import difference_interval
from dovetail.evaluation.race import Race
from dovetail.evaluation.transfer import COLUMNS, cells
from dovetail.files import write_atomic
from dovetail.page import facts, figure, finite, page, table, text


def write_comparison(
    race: Race,
    title: str,
    settings: Mapping[str, Any],
    about: Mapping[str, Any],
    folder: Path,
) -> list[Path]:
    """Write figure, JSON and HTML, the HTML last.

    Args:
        race: The tries of all policies.
        title: Policies and place.
        settings: Those of the comparison.
        about: Versions, machine and time.
        folder: Where to.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    results, rows = race.results(), race.rows()
    settings = {name: value for name, value in settings.items() if value is not None}
    content = {
        "title": title,
        "policies": {row.label: row.numbers() for row in rows},
        "pairs": [result.numbers() for result in results],
        "tries": {
            row.label: [outcome.numbers() for outcome in outcomes]
            for row, outcomes in zip(rows, race.outcomes, strict=True)
        },
        "config": settings,
        "provenance": about,
    }
    lines = {
        f"{result.first} less {result.second}": [
            (pairs.difference, *difference_interval(pairs)) for pairs in course
        ]
        for result, course in zip(results, race.course.values(), strict=True)
    }
    picture = draw_differences(lines)
    parts = [
        f"<h1>{text(title)}</h1>",
        *(f'<p class="lead">{text(result.sentence())}.</p>' for result in results),
        table(("policy", *COLUMNS[1:]), [cells(row) for row in rows]),
        '<p class="note">Every policy began each try from the same start, with the '
        "same noise. Where all are equally good, one is called better in at most "
        f"{100 * settings['error_rate']:g} % of such comparisons; the intervals of the "
        "differences are those of a fixed number of tries.</p>",
        figure("Difference of the success rates, with its 95 % interval", picture),
        *facts("Settings", settings),
        *facts("Where this was measured", about),
    ]
    written = json.dumps(finite(content), indent=2, allow_nan=False) + "\n"
    return [
        write_atomic(folder / "difference.png", picture),
        write_atomic(folder / "compare.json", written),
        write_atomic(folder / "compare.html", page(title, parts)),
    ]
