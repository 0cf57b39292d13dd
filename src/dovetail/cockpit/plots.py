"""Curves in the browser, for one name or for several over one common time."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dovetail.types import Array

if TYPE_CHECKING:
    import viser

_COLOURS = ("#d9261f", "#1a5abe", "#f0961a", "#0b7a75", "#8a4fbf", "#7a8087")
_HIGH, _LOW = 122, 92
"""Heights of a plot with a legend, and without [pixels]."""
_AROUND = (9, 12, 0, 0)
"""Room above, right, below and left of a plot [pixels]: half a number of an axis."""
_NUMBERS = 64
"""Room for the numbers at the left [pixels]: -0.00025, a small reward, is not cut."""


class LivePlots:
    """Plots below one another over a common time."""

    def __init__(
        self,
        gui: "viser.GuiApi",
        plots: Mapping[str, Sequence[str]],
        columns: Sequence[str],
        *,
        names: Sequence[str] = ("",),
        every: int = 4,
    ) -> None:
        """Add the plots where the panel now is.

        Args:
            gui: The browser's panels.
            plots: Title of each plot, and its columns.
            columns: Names of the rows' columns, the time first.
            names: Sources of the curves; each label begins with its source's name.
            every: One of this many rows is drawn.
        """
        from viser import uplot

        self._every = every
        self._plots = []
        for title, chosen in plots.items():
            labels = [f"{who} {c}".strip() for who in names for c in chosen]
            lines = [
                uplot.Series(label=label, stroke=colour, width=1.5)
                for label, colour in zip(labels, _COLOURS, strict=False)
            ]
            plot = gui.add_uplot(
                tuple(np.zeros(2) for _ in (None, *lines)),
                (uplot.Series(label="time [s]"), *lines),
                title=title,
                scales={"x": uplot.Scale(time=False, auto=True)},
                axes=(
                    uplot.Axis(ticks=uplot.Axis_Ticks(show=False)),
                    uplot.Axis(size=_NUMBERS, ticks=uplot.Axis_Ticks(show=False)),
                ),
                legend=uplot.Legend(show=len(lines) > 1, live=False),
                height=_HIGH if len(lines) > 1 else _LOW,
                padding=_AROUND,
            )
            self._plots.append((plot, [columns.index(column) for column in chosen]))

    def show(self, *rows: Array) -> None:
        """Draw rows, shape (moments, columns), one array for each name."""
        thinned = [part[:: self._every] for part in rows]
        if min(map(len, thinned)) < 2:
            return
        time = max(thinned, key=lambda part: part[-1, 0])[:, 0]
        for plot, columns in self._plots:
            curves = [
                np.interp(time, part[:, 0], part[:, c], right=np.nan)
                for part in thinned
                for c in columns
            ]
            plot.data = (time, *curves)
