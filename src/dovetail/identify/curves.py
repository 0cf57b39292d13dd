"""Measured and simulated motion as curves that one can zoom into, in a page."""

from collections.abc import Sequence

import numpy as np

from dovetail.types import Array
from dovetail.zoomable import panels, zoomable

_SPACING = 0.02
"""Time between two points that are drawn [s]: hands and eyes are slower."""
_COLOURS = {"measured": "#8a857c", "before": "#d1495b", "after": "#0b7a75"}


def curves(
    runs: dict[str, Sequence[Array]], *, period: float, with_library: bool
) -> str:
    """Return HTML of the TCP over time, the sequences one after the other.

    Args:
        runs: TCP [m] by name: measured, before, after; each one array of shape
            (cycles, 3) per sequence, of the same lengths.
        period: Time between two rows [s].
        with_library: Put plotly.js in, 5 MB, which a page needs once.

    Raises:
        MissingDependencyError: The extra `identify` is not installed.
    """
    every = max(1, round(_SPACING / period))
    figure = panels(3)
    for name, sequences in runs.items():
        rows = np.concatenate(sequences)
        time = (period * np.arange(len(rows)))[::every]
        for axis in range(3):
            figure.add_scatter(
                x=np.round(time, 3).tolist(),
                y=np.round(1e3 * rows[::every, axis], 3).tolist(),
                name=name,
                legendgroup=name,
                showlegend=axis == 0,
                line={"color": _COLOURS[name], "width": 1.5},
                row=axis + 1,
                col=1,
            )
            figure.update_yaxes(title_text=f"{'xyz'[axis]} [mm]", row=axis + 1, col=1)
    figure.update_xaxes(title_text="time [s]", row=3, col=1)
    return zoomable(figure, with_library=with_library)
