"""Figures that a notebook shows; imported where one is made, as it needs matplotlib."""

from __future__ import annotations

from io import BytesIO

from matplotlib.axes import Axes
from matplotlib.figure import Figure


class ShownFigure(Figure):
    """A figure that a notebook shows without ``pyplot``."""

    def _repr_png_(self) -> bytes:
        """Return the picture."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


class ShownAxes(Axes):
    """Axes on a figure of their own, which stand for it in a notebook."""

    def _repr_png_(self) -> bytes:
        """Return the picture of the figure."""
        figure = self.get_figure(root=True)
        assert isinstance(figure, ShownFigure)
        return figure._repr_png_()
