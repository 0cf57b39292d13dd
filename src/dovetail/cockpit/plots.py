"""Live curves in the browser: force, limits used, reward, the policy's step."""

from typing import TYPE_CHECKING

import numpy as np

from dovetail.cockpit.snapshot import USED
from dovetail.cockpit.trace import COLUMNS
from dovetail.types import Array

if TYPE_CHECKING:
    import viser

_COLOURS = ("#d9261f", "#f0961a", "#1a5abe", "#0b7a75", "#8a4fbf", "#7a8087")
_PLOTS: dict[str, tuple[str, ...]] = {
    "force [N]": ("force", "pull"),
    "limits used [%]": USED,
    "reward": ("reward",),
    "time to compute 10 ms [ms]": ("work",),
}
"""Title of each plot, and its columns."""
_EVERY = 4  # of the trace's rows one is drawn


class LivePlots:
    """Curves over the last seconds."""

    def __init__(self, gui: "viser.GuiApi", names: tuple[str, ...] = ("",)) -> None:
        """Add the plots where the panel now is.

        Args:
            gui: The browser's panels.
            names: Whose curves are drawn; more than one are told apart by a name.
        """
        from viser import uplot

        nothing = np.zeros(2)
        self._plots = []
        for title, columns in _PLOTS.items():
            series = [uplot.Series(label="time [s]")]
            for who, name in enumerate(names):
                for i, column in enumerate(columns):
                    colour = _COLOURS[(i + who * len(columns)) % len(_COLOURS)]
                    label = f"{name} {column}".strip()
                    line = uplot.Series(
                        label=label, stroke=colour, width=1.5, spanGaps=False
                    )
                    series.append(line)
            plot = gui.add_uplot(
                tuple(nothing for _ in series),
                tuple(series),
                title=title,
                scales={"x": uplot.Scale(time=False, auto=True)},
                legend=uplot.Legend(show=len(series) > 2, live=False),
                height=104 if len(series) == 2 else 138,
            )
            self._plots.append((plot, [COLUMNS.index(name) for name in columns]))

    def show(self, *rows: Array) -> None:
        """Draw the rows of a trace, one array for each name, over one common time."""
        thinned = [part[::_EVERY] for part in rows]
        if len(thinned[0]) < 2:
            return
        time = thinned[0][:, 0]
        for plot, columns in self._plots:
            curves = [
                np.interp(time, part[:, 0], part[:, c])
                for part in thinned
                for c in columns
            ]
            plot.data = (time, *curves)
