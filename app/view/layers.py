"""What can be shown and hidden, the same for everybody who looks."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from app.view import palette


class Layer(StrEnum):
    TERRAIN = "terrain"
    WATER = "water"
    COVER = "cover"
    EXPOSURE = "exposure"
    SIGHT_LINES = "sight_lines"
    COMPARED = "compared"
    EXPLAINED = "explained"
    SIGHT = "sight"
    PATROLS = "patrols"
    SCAN = "scan"
    COST = "cost"
    GROUPS = "groups"
    ARCS = "arcs"
    ROUTE = "route"
    PATH = "path"
    DETECTIONS = "detections"
    LEARNER = "learner"
    LEARNED = "learned"
    TRIALS = "trials"
    REPLAY = "replay"


@dataclass(frozen=True)
class LayerStyle:
    """title : as people read it; key : toggles it; swatch : its colour in lists; shown : at first"""

    title: str
    key: str | None
    swatch: palette.RGB
    opacity: float | None = None
    shown: bool = True


STYLES: dict[Layer, LayerStyle] = {
    Layer.EXPOSURE: LayerStyle("Exposure: who sees what", "V", palette.SEEN, 0.6),
    Layer.SIGHT_LINES: LayerStyle("Sight lines to the robot", "L", palette.SEEN),
    Layer.COMPARED: LayerStyle("Compared routes, watchers' posts", None, palette.ROUTES["route"]),
    Layer.EXPLAINED: LayerStyle("Explained place", None, palette.HIDDEN),
    Layer.COVER: LayerStyle("Cover objects", "1", (88, 124, 70)),
    Layer.SIGHT: LayerStyle("Observers' sight", "2", palette.SEEN, 0.6),
    Layer.PATROLS: LayerStyle("Patrols", "3", (228, 190, 150)),
    Layer.SCAN: LayerStyle("Lidar points", "4", palette.SCAN_LOW),
    Layer.COST: LayerStyle("Cost map", "5", (164, 122, 200), 0.7),
    Layer.GROUPS: LayerStyle("Ground by its looks (GA-Nav)", None, (158, 190, 96), 0.75),
    Layer.ARCS: LayerStyle("Candidate arcs", "6", palette.CHOSEN_ARC),
    Layer.ROUTE: LayerStyle("Planned route", "7", palette.ROUTE),
    Layer.PATH: LayerStyle("Travelled path", "8", palette.TRAVELLED),
    Layer.DETECTIONS: LayerStyle("Detections", "9", palette.HIDDEN),
    Layer.LEARNER: LayerStyle("Robot that learns", None, palette.GHOST),
    Layer.LEARNED: LayerStyle("What it sees about it", None, (70, 156, 226), 0.75),
    Layer.TRIALS: LayerStyle("Drives before and after learning", None, palette.TRIALS[1]),
    Layer.REPLAY: LayerStyle("Replayed drives", None, palette.GHOST),
    Layer.TERRAIN: LayerStyle("Terrain", None, (111, 121, 82)),
    Layer.WATER: LayerStyle("Water", None, palette.WATER),
}


@dataclass
class LayerState:
    """Which layers are drawn, and how strongly those with an opacity."""

    visible: dict[Layer, bool] = field(default_factory=lambda: {k: s.shown for k, s in STYLES.items()})
    opacity: dict[Layer, float] = field(
        default_factory=lambda: {k: s.opacity for k, s in STYLES.items() if s.opacity is not None}
    )
