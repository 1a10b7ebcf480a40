"""A training's curves as plots that a browser draws: return with its terms, success, exposure, losses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser

from app.view import palette

WINDOW = 20  # episodes that a rate is of
MOST_POINTS = 300
HEIGHT = 120
WHOLE = tuple(float(step * 10**power) for power in range(5) for step in (1, 2, 5))
_AXIS = "#9aa2aa"

Rows = Sequence[dict[str, Any]]
Curve = tuple[np.ndarray, dict[str, np.ndarray]]
"""Episode numbers (n,) and curves (n,) by name."""


def return_curve(rows: Rows) -> Curve:
    """The return and the sum of each of its terms, as means over a few episodes where there are many."""
    names = dict.fromkeys(name for row in rows for name in row["terms"])
    curves = {"return": np.array([row["total"] for row in rows], float)}
    curves |= {name: np.array([row["terms"].get(name, 0.0) for row in rows], float) for name in names}
    return numbers(rows), curves


def success_curve(rows: Rows) -> Curve:
    """Share of successes among the last `WINDOW` episodes."""
    reached = np.array([row["success"] for row in rows], float)
    return numbers(rows), {f"success, of the last {WINDOW}": _trailing(reached)}


def exposure_curve(rows: Rows) -> Curve:
    """Exposed seconds of each episode, and their mean over the last `WINDOW`."""
    exposed = np.array([row["exposed_s"] for row in rows], float)
    return numbers(rows), {"exposed s": exposed, f"mean of {WINDOW}": _trailing(exposed)}


def loss_curve(rows: Rows) -> Curve:
    """The losses' means over the updates of an episode, from the first one with updates on."""
    rows = [row for row in rows if row["losses"]]
    names = dict.fromkeys(name for row in rows for name in row["losses"])
    return numbers(rows), {name: np.array([row["losses"][name] for row in rows], float) for name in names}


def numbers(rows: Rows) -> np.ndarray:
    return np.array([row["number"] + 1 for row in rows], float)


def _trailing(values: np.ndarray) -> np.ndarray:
    """Means over the last `WINDOW` values at each."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    count = np.arange(1, len(values) + 1)
    first = np.maximum(count - WINDOW, 0)
    return (total[count] - total[first]) / np.maximum(count - first, 1)


def thinned(curve: Curve, most: int = MOST_POINTS) -> Curve:
    """The curve as means over stretches, at most `most` of them."""
    x, curves = curve
    if len(x) <= most:
        return curve
    edges = np.linspace(0, len(x), most + 1).astype(int)[:-1]
    count = np.diff(np.append(edges, len(x)))

    def means(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, edges) / count

    return x[np.append(edges[1:], len(x)) - 1], {name: means(values) for name, values in curves.items()}


class CurvePlot:
    """One plot; made anew when it has other curves than before, else given new numbers."""

    def __init__(
        self,
        gui: viser.GuiApi,
        title: str,
        curve: Callable[[Rows], Curve],
        *,
        scale: tuple[float, float] | None = None,
        opened: bool = True,
    ) -> None:
        self._gui, self._curve, self._scale = gui, curve, scale
        self._folder = gui.add_folder(title, expand_by_default=opened, visible=False)
        self._plot: viser.GuiUplotHandle | None = None
        self._names: tuple[str, ...] = ()
        self._shown: tuple[int, float] | None = None

    def show(self, training: int, rows: Rows) -> None:
        """Show the curves of these episodes."""
        mark = training, len(rows)
        if mark == self._shown:
            return
        self._shown = mark
        x, curves = thinned(self._curve(rows))
        self._folder.visible = len(x) > 0
        if len(x) == 0:
            return
        data = (x, *curves.values())
        if self._plot is not None and tuple(curves) == self._names:
            self._plot.data = data
            return
        if self._plot is not None:
            self._plot.remove()
        self._names = tuple(curves)
        scales: dict[str, Any] = {"x": {"time": False}}
        if self._scale is not None:
            scales["y"] = {"range": self._scale}
        with self._folder:
            self._plot = self._gui.add_uplot(
                data,
                ({"label": "episode"}, *(_series(name, order) for order, name in enumerate(curves))),
                scales=scales,
                axes=(_axis(incrs=WHOLE), _axis()),
                legend={"show": True, "live": False},
                height=HEIGHT + 11 * len(curves),
                padding=(6, 10, 0, 0),
            )


def _series(name: str, order: int) -> Any:
    colour = palette.css(palette.CURVES[order % len(palette.CURVES)])
    return {"label": name, "stroke": colour, "width": 2.0 if order == 0 else 1.2, "points": {"show": False}}


def _axis(**more: Any) -> Any:
    lines = {"stroke": "#3a3f45", "width": 1}
    return {"stroke": _AXIS, "grid": lines, "ticks": lines, "font": "10px system-ui", "size": 34, **more}
