"""Curves in a page that one can zoom into, with nothing from outside."""

from typing import TYPE_CHECKING

from dovetail.errors import MissingDependencyError, install_command

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

NOTE = "Drag to zoom, double-click to see all, click a name to hide it."
"""Note on zooming with the mouse; belongs below the last figure of a page."""


def panels(rows: int) -> "Figure":
    """Return empty panels, one below the other, along one axis.

    Args:
        rows: How many.

    Raises:
        MissingDependencyError: The extra `identify` is not installed.
    """
    try:
        from plotly.subplots import make_subplots
    except ImportError as error:
        raise MissingDependencyError(
            f"the report's curves need plotly ({error}): {install_command('identify')}"
        ) from error
    return make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.03)


def zoomable(figure: "Figure", *, with_library: bool) -> str:
    """Return a figure as HTML.

    Args:
        figure: What is drawn.
        with_library: Put plotly.js in, 5 MB, which a page needs once.
    """
    from plotly.io import to_html

    figure.update_layout(
        height=620,
        margin={"l": 60, "r": 10, "t": 10, "b": 50},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        hovermode="x unified",
    )
    return to_html(
        figure,
        full_html=False,
        include_plotlyjs=with_library,
        config={"responsive": True, "displaylogo": False},
    )
