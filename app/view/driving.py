"""What the robot senses, weighs and does: the layers that change with every frame."""

from __future__ import annotations

import numpy as np
import viser

from app.view import palette
from app.view.glb import Surface, glb
from app.view.ground import coarsened
from app.view.nodes import OVERLAY_PARSE_S, Lines, SwapGlb, draped, polyline, resampled
from planner.frames import Arcs, CostPatch, Decision, Frame, Rejection
from scenes.terrain import Heightmap

MAX_ARCS = 110
ARC_POINTS = 8
SHORTEST_ARC = 0.08
COST_PERIOD_S = 0.5
PATH_STEP = 0.12
MAX_PATH = 1200
BRACKET = 0.18
SMALL = (0.6, 0.6)
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


class ScanLayer:
    """The newest lidar turn, lighter where it is higher above the robot's feet."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._handle = scene.add_point_cloud(
            f"{root}/points",
            np.zeros((1, 3)),
            palette.SCAN_LOW,
            point_size=0.035,
            point_shape="circle",
            point_shading="flat",
            visible=False,
        )

    def clear(self) -> None:
        self._handle.visible = False

    def draw(self, frame: Frame) -> None:
        points = frame.scan_points
        self._handle.visible = len(points) > 0
        if len(points) == 0:
            return
        # half precision on the wire: offsets from the robot keep millimetres that map coordinates would lose
        offsets = points - np.asarray(frame.pose.position, np.float32)
        share = np.clip((offsets[:, 2:] + 0.3) / 2.5, 0.0, 1.0)
        low, high = np.array(palette.SCAN_LOW), np.array(palette.SCAN_HIGH)
        self._handle.position = frame.pose.position
        self._handle.points = offsets.astype(np.float16)
        self._handle.colors = ((1.0 - share) * low + share * high).astype(np.uint8)


class CostLayer:
    """The method's cost map laid over the ground it speaks of."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._node = SwapGlb(scene, f"{root}/cost", OVERLAY_PARSE_S)
        self._ground: Heightmap | None = None
        self._source: Heightmap | None = None
        self._drawn: CostPatch | None = None
        self._time_s = -np.inf
        self._opacity = 0.7

    def set_opacity(self, opacity: float) -> None:
        self._opacity = opacity
        self._time_s = -np.inf

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        patch = frame.decision.cost if frame.decision is not None else None
        if patch is None:
            self.clear()
            return
        if patch is self._drawn or abs(frame.time_s - self._time_s) < COST_PERIOD_S:
            return
        if heightmap is not self._source:
            self._source, self._ground = heightmap, coarsened(heightmap)
        assert self._ground is not None
        surface = cost_surface(patch, self._ground, self._opacity)
        self._node.show(None if surface is None else glb(surface))
        self._drawn, self._time_s = patch, frame.time_s

    def clear(self) -> None:
        if self._drawn is not None:
            self._node.show(None)
        self._drawn, self._time_s = None, -np.inf


def cost_surface(patch: CostPatch, ground: Heightmap, opacity: float) -> Surface | None:
    """The part of the drawn ground under the patch, just above it, in the colours of the costs; None where
    nothing is known."""
    colours = palette.cost_colours(patch.cost)
    colours[..., 3] = np.round(colours[..., 3] * opacity)
    return laid(colours, (patch.x_min, patch.y_min), patch.resolution, ground, 0.045)


def laid(
    colours: np.ndarray, corner: tuple[float, float], resolution: float, ground: Heightmap, lift: float
) -> Surface | None:
    """The part of the drawn ground under a grid's colours (rows, cols, 4), `lift` metres above it; None where
    all of it is clear. It shares the ground's own triangles, so it never dips below them.

    corner : world x and y of cell [0, 0]; resolution : metres a cell
    """
    rows = _span(ground.y_min, ground.resolution, ground.shape[0], corner[1], resolution, colours.shape[0])
    cols = _span(ground.x_min, ground.resolution, ground.shape[1], corner[0], resolution, colours.shape[1])
    if len(rows) < 2 or len(cols) < 2:
        return None
    x = ground.x_min + ground.resolution * cols
    y = ground.y_min + ground.resolution * rows
    row = np.clip(np.rint((y - corner[1]) / resolution).astype(int), 0, colours.shape[0] - 1)
    col = np.clip(np.rint((x - corner[0]) / resolution).astype(int), 0, colours.shape[1] - 1)
    colours = colours[np.ix_(row, col)].reshape(-1, 4)
    grid_x, grid_y = np.meshgrid(x, y)
    vertices = np.column_stack(
        [grid_x.ravel(), grid_y.ravel(), ground.heights[np.ix_(rows, cols)].ravel() + lift]
    )
    index = np.arange(len(vertices)).reshape(len(rows), len(cols))
    near, east = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    north, far = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.column_stack([near, east, north]), np.column_stack([east, far, north])])
    faces = faces[(colours[faces, 3] > 0).any(axis=1)]
    if len(faces) == 0:
        return None
    used, faces = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3), colours[used], unlit=True, blended=True)


def _span(low: float, step: float, count: int, grid_low: float, grid_step: float, cells: int) -> np.ndarray:
    """Indices of the ground's samples that lie over a grid, along one axis."""
    grid_high = grid_low + (cells - 1) * grid_step
    first = max(int(np.ceil((grid_low - low) / step)), 0)
    last = min(int(np.floor((grid_high - low) / step)), count - 1)
    return np.arange(first, last + 1)


class ArcsLayer:
    """The dynamic window: candidates faint, rejected ones coloured by reason, the chosen one bright."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._candidates = Lines(scene, f"{root}/candidates", 0.016)
        self._rejected = Lines(scene, f"{root}/rejected", 0.012)
        self._chosen = Lines(scene, f"{root}/chosen", 0.1)

    def clear(self) -> None:
        for lines in (self._candidates, self._rejected, self._chosen):
            lines.hide()

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        arcs = frame.decision.arcs if frame.decision is not None else None
        if arcs is None or len(arcs.v) == 0:
            self.clear()
            return
        shown = thinned(arcs)
        admissible = arcs.rejection[shown] == Rejection.NONE
        for lines, group in ((self._candidates, shown[admissible]), (self._rejected, shown[~admissible])):
            segments, owner = _arc_segments(arcs.poses[group], heightmap, 0.07)
            table = np.array(
                [palette.REJECTED.get(Rejection(r), palette.CANDIDATE_ARC) for r in arcs.rejection[group]]
            )
            lines.show(segments, table[owner] if len(segments) else palette.CANDIDATE_ARC)
        best = np.array([arcs.chosen] if arcs.chosen >= 0 else [], int)
        self._chosen.show(_arc_segments(arcs.poses[best], heightmap, 0.12)[0], palette.CHOSEN_ARC)


def thinned(arcs: Arcs) -> np.ndarray:
    """Indices of at most `MAX_ARCS` candidates that go somewhere, spread evenly; never the chosen one."""
    length = np.hypot(*np.diff(arcs.poses[:, :, :2], axis=1).transpose(2, 0, 1)).sum(axis=1)
    moving = np.flatnonzero((length >= SHORTEST_ARC) & (np.arange(len(length)) != arcs.chosen))
    if len(moving) <= MAX_ARCS:
        return moving
    return moving[np.linspace(0, len(moving) - 1, MAX_ARCS).astype(int)]


def _arc_segments(poses: np.ndarray, heightmap: Heightmap, lift: float) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2, 3) segments of arcs (k, steps, 3), and the arc (n,) that each belongs to."""
    if len(poses) == 0:
        return np.zeros((0, 2, 3)), np.zeros(0, int)
    steps = np.unique(np.linspace(0, poses.shape[1] - 1, ARC_POINTS).astype(int))
    points = draped(heightmap, poses[:, steps, :2], lift)
    segments = np.stack([points[:, :-1], points[:, 1:]], axis=2)
    return segments.reshape(-1, 2, 3), np.repeat(np.arange(len(poses)), len(steps) - 1)


class RouteLayer:
    """The planned route and the waypoint that is driven to."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._lines = Lines(scene, f"{root}/line", 0.05)
        self._waypoint = scene.add_icosphere(
            f"{root}/waypoint", 0.09, palette.WAYPOINT, subdivisions=2, visible=False, cast_shadow=False
        )

    def clear(self) -> None:
        self._lines.hide()
        self._waypoint.visible = False

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        decision = frame.decision or Decision(frame.twist)
        if decision.route is not None and len(decision.route) > 1:
            line = resampled(np.asarray(decision.route, float)[:, :2], 0.3)
            self._lines.show(polyline(draped(heightmap, line, 0.1)), palette.ROUTE)
        else:
            self._lines.hide()
        self._waypoint.visible = decision.waypoint is not None
        if decision.waypoint is not None:
            x, y = decision.waypoint
            self._waypoint.position = (x, y, float(heightmap.height_at(x, y)) + 0.25)


class PathLayer:
    """Where the robot has been since the mission began."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._lines = Lines(scene, f"{root}/line", 0.05)
        self._points: list[tuple[float, float, float]] = []
        self._tick = -1

    def draw(self, frame: Frame) -> None:
        here = (frame.pose.x, frame.pose.y, frame.pose.z + 0.06)
        if frame.tick < self._tick or (
            self._points and np.hypot(*np.subtract(here, self._points[-1])[:2]) > 2.0
        ):
            self.clear()
        self._tick = frame.tick
        if self._points and np.hypot(*np.subtract(here, self._points[-1])[:2]) < PATH_STEP:
            return
        self._points.append(here)
        if len(self._points) > MAX_PATH:
            self._points = self._points[::2]
        if len(self._points) > 1:
            self._lines.show(polyline(np.array(self._points)), palette.TRAVELLED)

    def clear(self) -> None:
        self._points.clear()
        self._tick = -1
        self._lines.hide()


class DetectionsLayer:
    """Brackets about what the camera sees now, and about the cover that the method has chosen."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._seen = Lines(scene, f"{root}/seen", 0.03)
        self._chosen = Lines(scene, f"{root}/chosen", 0.07)
        self._drawn: tuple[object, object] | None = None

    def clear(self) -> None:
        self._seen.hide()
        self._chosen.hide()
        self._drawn = None

    def draw(self, frame: Frame) -> None:
        percept, decision = frame.percept, frame.decision
        chosen = decision.cover_id if decision is not None else None
        if percept is None:
            self.clear()
        elif self._drawn is None or percept.detections is not self._drawn[0] or chosen != self._drawn[1]:
            self._drawn = percept.detections, chosen
            sizes = {cover.object_id: (cover.width, cover.height) for cover in percept.cover}
            boxes = [
                _brackets((seen.x_pos, seen.y_pos, seen.z_pos), *sizes.get(seen.object_id, SMALL))
                for seen in percept.detections
                if seen.object_id != chosen
            ]
            best = [
                _brackets((cover.x, cover.y, cover.z), cover.width, cover.height)
                for cover in percept.cover
                if cover.object_id == chosen
            ]
            self._seen.show(np.array(boxes).reshape(-1, 2, 3), palette.DETECTION)
            self._chosen.show(np.array(best).reshape(-1, 2, 3), palette.CHOSEN_COVER)


def _brackets(base: tuple[float, float, float], width: float, height: float) -> np.ndarray:
    """(24, 2, 3) short segments at the corners of an upright box, along its edges."""
    size = np.array([width, width, height])
    corners = base + np.array([0.0, 0.0, 0.5 * height]) + 0.5 * size * _CORNERS
    arms = -_CORNERS[:, None] * np.eye(3) * size * BRACKET
    return np.stack([np.repeat(corners, 3, axis=0), (corners[:, None] + arms).reshape(-1, 3)], axis=1)
