"""Learning curves of several trainings as a figure on white paper: one column a reward, for returns under
different rewards share no axis; bands are 95 % intervals over the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from app.results_figures import Theme, render
from planner.checkpoint import write_file

SHARES = {"success": ("arrived", "#2f8f4e"), "collided": ("collided", "#b4493a")}
RETURN = "#3b6fb6"


def write_figure(path: Path, document: Mapping[str, Any]) -> None:
    """The document of `planner.training_curves.summarise` as `.png` or `.svg`.

    Raises ValueError for another suffix, OSError where it cannot be written."""
    kind = path.suffix.lstrip(".")
    if kind not in ("png", "svg"):
        raise ValueError(f"{path} must end in .png or .svg")
    write_file(path, render(lambda _: learning_curves(document), Theme.LIGHT, kind))


def learning_curves(document: Mapping[str, Any]) -> Figure:
    """Return above, shares of episodes that arrived and that collided below."""
    groups, block = document["groups"], document["block"]
    figure = Figure(figsize=(0.6 + 3.6 * len(groups), 4.2), layout="constrained")
    panels = figure.subplots(2, len(groups), sharex=True, squeeze=False)
    for (above, below), group in zip(panels.T, groups, strict=True):
        reward, seeds = group["options"].get("reward", "reward"), len(group["seeds"])
        above.set_title(f"{reward} reward, {seeds} seed{'s' if seeds > 1 else ''}")
        _band(above, group["curves"]["return"], block, "return", RETURN)
        for name, (words, colour) in SHARES.items():
            _band(below, group["curves"][name], block, words, colour)
        below.set_ylim(-0.03, 1.03)
        below.yaxis.set_major_formatter(PercentFormatter(1.0))
        below.set_xlabel("episodes")
        for panel in (above, below):
            panel.grid(True)
    panels[0, 0].set_ylabel("return of an episode")
    panels[1, 0].set_ylabel("share of episodes")
    panels[1, -1].legend(loc="upper right")
    return figure


def _band(panel: Axes, curve: Mapping[str, Sequence[float]], block: int, label: str, colour: str) -> None:
    middles = [block * (index + 0.5) for index in range(len(curve["mean"]))]
    panel.fill_between(middles, curve["low"], curve["high"], color=colour, alpha=0.2, lw=0.0)
    panel.plot(middles, curve["mean"], color=colour, marker="o", ms=3.0, lw=1.4, label=label)
