"""Figures of an evaluation, for the page, for download and for the report: matplotlib without a screen.

Dark on the page, light on paper; the same data give the same SVG.
"""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from app.results_map import Ground
from app.results_style import colour_of, marker_of
from planner.evaluation_table import Row, measured
from planner.trajectory import Trajectory

MEASURES = {
    "exposed_s": "exposed seconds",
    "execution_time_s": "mission seconds",
    "length_ratio": "length ÷ straight line",
}
"""What distributions are shown of, over successes."""

MOST_DOTS = 400
_drawing = threading.Lock()  # matplotlib's settings are the process's


class Theme(StrEnum):
    DARK = "dark"
    LIGHT = "light"


@dataclass(frozen=True)
class _Inks:
    paper: str
    text: str
    quiet: str
    line: str


_INKS = {
    Theme.DARK: _Inks("#1a1b1e", "#e4e7ea", "#9aa2aa", "#35383c"),
    Theme.LIGHT: _Inks("#ffffff", "#1c1f22", "#5a626a", "#d5d9dd"),
}


def render(draw: Callable[[Theme], Figure], theme: Theme, kind: str) -> bytes:
    """A figure as `svg` or `png`."""
    inks = _INKS[theme]
    settings: Any = {
        "font.size": 9.5, "svg.hashsalt": "covernav", "svg.fonttype": "path", "text.color": inks.text,
        "axes.edgecolor": inks.line, "axes.labelcolor": inks.quiet, "axes.titlecolor": inks.text,
        "xtick.color": inks.quiet, "ytick.color": inks.quiet, "axes.facecolor": inks.paper,
        "figure.facecolor": inks.paper, "savefig.facecolor": inks.paper, "grid.color": inks.line,
        "legend.frameon": False, "axes.spines.top": False, "axes.spines.right": False, "grid.linewidth": 0.6,
        "text.parse_math": False,  # a name may hold what would be a formula
    }  # fmt: skip
    with _drawing, matplotlib.rc_context(settings), io.BytesIO() as buffer:
        metadata = {"Date": None} if kind == "svg" else {}
        draw(theme).savefig(buffer, format=kind, dpi=160, metadata=metadata)
        return buffer.getvalue()


def success_against_exposure(rows: Sequence[Row], bounds: Sequence[Row], theme: Theme) -> Figure:
    """One panel a terrain: each method's success rate over its mean exposed seconds, with 95 % intervals; a
    dashed line where the least exposed route lies."""
    terrains = list(dict.fromkeys(row["terrain"] for row in rows))
    figure = Figure(figsize=(2.9 * len(terrains) + 1.7, 3.5), layout="constrained")
    panels = figure.subplots(1, len(terrains), sharey=True, squeeze=False)[0]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    for panel, terrain in zip(panels, terrains, strict=True):
        for row in rows:
            if row["terrain"] == terrain and row["exposed_s"] is not None:
                _point(panel, row, methods, theme)
        for bound in bounds:
            if bound["terrain"] == terrain and bound["bound_s"] is not None:
                panel.axvline(bound["bound_s"], color=_INKS[theme].quiet, ls="--", lw=1.0)
        panel.set(title=terrain.replace("_", "-"), xlabel="exposed seconds")
        panel.grid(True)
        panel.set_xlim(left=0.0)
    panels[0].set_ylabel("success, %")
    panels[0].set_ylim(min(panels[0].get_ylim()[0], 60.0), 103.0)
    _legend(figure, panels, _INKS[theme].quiet if any(b["bound_s"] is not None for b in bounds) else None)
    return figure


def _point(panel: Axes, row: Row, methods: Sequence[str], theme: Theme) -> None:
    x, y = row["exposed_s"], 100.0 * row["success_rate"]
    low, high = row["ci95"]["exposed_s"] or (x, x)
    across = [[max(x - max(low, 0.0), 0.0)], [max(high - x, 0.0)]]
    bottom, top = (100.0 * edge for edge in row["success_ci95"])
    along = [[max(y - bottom, 0.0)], [max(top - y, 0.0)]]
    panel.errorbar(
        x, y, xerr=across, yerr=along, color=colour_of(row["method"], theme == Theme.LIGHT), capsize=2.5,
        marker=marker_of(row["method"], methods), ms=7, lw=1.3, label=row["method"],
    )  # fmt: skip


def _legend(figure: Figure, panels: Sequence[Axes], bound: str | None) -> None:
    found: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if bound is not None:
        found["bound"] = Line2D([], [], color=bound, ls="--", lw=1.0)
    if found:
        figure.legend(found.values(), found.keys(), loc="outside right center")


def distributions(missions: Sequence[dict[str, Any]], methods: Sequence[str], theme: Theme) -> Figure:
    """Exposed seconds, mission seconds and length ratio of each method's successes: every drive a dot
    (of each method at most `MOST_DOTS`, evenly from all), the middle half a bar, the median a tick."""
    shown = [name for name in methods if any(m["method"] == name and m["success"] for m in missions)]
    figure = Figure(figsize=(11.0, 0.42 * max(len(shown), 2) + 1.1), layout="constrained")
    panels = figure.subplots(1, len(MEASURES), sharey=True)
    for panel, (measure, words) in zip(panels, MEASURES.items(), strict=True):
        for place, name in enumerate(shown):
            values = [measured(m, measure) for m in missions if m["method"] == name and m["success"]]
            numbers = np.array([value for value in values if value is not None])
            if len(numbers):
                _strip(panel, place, numbers, colour_of(name, theme == Theme.LIGHT), _INKS[theme].text)
        panel.set(xlabel=words)
        panel.grid(True, axis="x")
    panels[0].set_yticks(range(len(shown)), shown)
    panels[0].set_ylim(len(shown) - 0.4, -0.6)
    return figure


def _strip(panel: Axes, place: int, values: np.ndarray, colour: str, ink: str) -> None:
    low, middle, high = np.percentile(values, [25, 50, 75])
    evenly = np.linspace(0, len(values) - 1, MOST_DOTS).astype(int)
    dots = values[np.unique(evenly)]
    spread = np.random.default_rng(place).uniform(-0.27, 0.27, len(dots))
    panel.plot([low, high], [place, place], lw=7, color=colour, alpha=0.55, solid_capstyle="butt")
    panel.plot(dots, place + spread, ".", ms=6, color=colour, alpha=0.75, mew=0)
    panel.plot([middle, middle], [place - 0.3, place + 0.3], lw=2, color=ink)


def trajectories(ground: Ground, drives: Sequence[tuple[str, Trajectory]], theme: Theme) -> Figure:
    """All methods' ways over the map of one mission; observers, start and goal."""
    figure = Figure(figsize=(7.6, 6.2), layout="constrained")
    panel = figure.subplots()
    west, east, south, north = ground.bounds
    near = ground.view([way for _, way in drives])
    panel.imshow(ground.picture, extent=(west, east, south, north), origin="lower", interpolation="bilinear")
    for watcher in ground.watchers:
        panel.fill(*np.array(watcher.sector).T, color="#f09128", alpha=0.12, lw=0)
        panel.plot(watcher.x, watcher.y, "^", color="#f09128", mec="#1a1b1e", ms=9)
    for name, way in drives:
        panel.plot(way.x, way.y, lw=2.4, color="#101214", alpha=0.5)
        panel.plot(way.x, way.y, lw=1.6, color=colour_of(name, False), label=name)
    panel.plot(*ground.start, "o", color="#c4ced6", mec="#1a1b1e", ms=8)
    panel.plot(*ground.goal, "*", color="#f4ce42", mec="#1a1b1e", ms=14)
    panel.set(xlim=near[:2], ylim=near[2:], xlabel="x east, m", ylabel="y north, m", aspect="equal")
    figure.legend(loc="outside right center")
    return figure
