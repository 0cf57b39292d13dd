"""Trainings as curves that one can zoom into: each seed, not their mean alone."""

from collections.abc import Mapping, Sequence

import numpy as np

from dovetail.learn.progress import EpisodeRow
from dovetail.reproduce.design import LAWS, MODELS
from dovetail.reproduce.figures import COLOURS, curve
from dovetail.zoomable import panels, zoomable

_PANELS = (
    ("success", "success [%]", 100.0, 1),
    ("reward", "reward", 1.0, 2),
    ("length", "policy steps", 1.0, 1),
)
"""Field of an episode, name, factor and decimals of what each panel shows."""


def curves(
    trainings: Mapping[tuple[str, str], Sequence[Sequence[EpisodeRow]]],
) -> str:
    """Return HTML of success, reward and length over the training steps.

    A line for each policy, moving averages as in the figure. Plotly.js is in it, 5 MB.

    Args:
        trainings: Episodes of each policy, by law and model; at least one episode.

    Raises:
        MissingDependencyError: The extra `identify` is not installed.
    """
    figure = panels(len(_PANELS))
    for row, (field, title, factor, decimals) in enumerate(_PANELS, start=1):
        figure.update_yaxes(title_text=title, row=row, col=1)
        for (law, model), runs in trainings.items():
            for number, run in enumerate(runs):
                if not run:
                    continue
                steps, (line,) = curve([run], field)
                name = f"{MODELS[model].label}, {LAWS[law].label}"
                figure.add_scatter(
                    x=np.round(steps).tolist(),
                    y=np.round(factor * line, decimals).tolist(),
                    name=name,
                    legendgroup=name,
                    showlegend=row == 1 and number == 0,
                    line={"color": COLOURS[model], "width": 1.2},
                    row=row,
                    col=1,
                )
    figure.update_xaxes(title_text="environment steps", row=len(_PANELS), col=1)
    return zoomable(figure, with_library=True)
