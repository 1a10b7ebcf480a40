"""Those who watch and those who move: figures, what the observers look at, and the beats they walk."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np
import viser

from app.view import palette
from app.view.glb import Surface, glb, merged
from app.view.nodes import OVERLAY_PARSE_S, Lines, SwapGlb, draped, polyline, resampled, yaw_wxyz
from planner.frames import Frame, WalkerPose
from scenes.meshes import walker_mesh
from scenes.scenario import Observer, ObstacleKind, Scenario, Walker
from scenes.terrain import Heightmap

EYE_OF_FIGURE = 1.6
SIGHT_LIFT = 0.1
SIGHT_FADE, FAINTEST = 5.0, 0.08
SIGHT_PERIOD_S = 0.3


class Figures:
    """Walkers of one look, all in one node whose instances move cheaply."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        kind: Literal["person", "vehicle", "observer"],
        tint: palette.RGB | None = None,
    ) -> None:
        self._scene, self._name = scene, name
        surface = Surface.from_trimesh(walker_mesh(kind))
        if tint is not None and surface.colours is not None:
            grey = surface.colours.mean(axis=1, keepdims=True) / 255.0
            shade = (np.array(tint) * (0.35 + 0.9 * grey)).clip(0, 255).astype(np.uint8)
            surface = Surface(surface.vertices, surface.faces, shade)
        self._glb = glb(surface)
        self._handle: viser.BatchedGlbHandle | None = None
        self._count = 0

    def place(self, positions: Sequence[tuple[float, float, float]], yaws: Sequence[float]) -> None:
        """Stand the figures at world positions, facing yaw in radians."""
        where = np.array(positions, np.float32).reshape(-1, 3)
        turned = np.array([yaw_wxyz(yaw) for yaw in yaws], np.float32).reshape(-1, 4)
        if len(where) != self._count:
            if self._handle is not None:
                self._handle.remove()
            self._count, self._handle = len(where), None
            if self._count:
                self._handle = self._scene.add_batched_glb(self._name, self._glb, turned, where, lod="off")
        elif self._handle is not None:
            self._handle.batched_positions = where
            self._handle.batched_wxyzs = turned


class Observers:
    """Observers as figures, on a mast where their eye is high, and what they look at: orange for those the
    robot knows of, grey for those it has yet to find."""

    def __init__(self, scene: viser.SceneApi, figures: str, sight: str) -> None:
        self._scene, self._labels_root = scene, figures
        self._known = Figures(scene, f"{figures}/known", "observer")
        self._unknown = Figures(scene, f"{figures}/unknown", "observer", palette.UNKNOWN)
        self._masts = Lines(scene, f"{figures}/masts", 0.08)
        self._fans = scene.add_frame(f"{sight}/fans", show_axes=False)
        self._still = SwapGlb(scene, f"{sight}/fans/still", OVERLAY_PARSE_S)
        self._moving = SwapGlb(scene, f"{sight}/fans/moving", OVERLAY_PARSE_S)
        self._outlines = Lines(scene, f"{sight}/outlines", 0.05)
        self._labels: dict[int, viser.LabelHandle] = {}
        self._observers: dict[int, Observer] = {}
        self._poses: dict[int, WalkerPose] = {}
        self._ground: Heightmap | None = None
        self._outline_of: dict[int, tuple[object, np.ndarray]] = {}
        self._still_key: object = None
        self._sight_time = -math.inf
        self._opacity = 0.6
        self._filled = True
        self._found: frozenset[int] = frozenset()

    def edit(self, scenario: Scenario, heightmap: Heightmap, time_s: float) -> None:
        before = self._observers if heightmap is self._ground else {}
        self._ground = heightmap
        self._observers = {observer.id: observer for observer in scenario.observers}
        self._poses = {
            number: self._poses[number]
            if observer is before.get(number) and observer.patrol is None
            else _walker_pose(observer, heightmap, time_s)
            for number, observer in self._observers.items()
        }
        self._sight_time = -math.inf
        self._relabel()
        self._place()
        self._draw_sight(heightmap, time_s)

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        truth = {pose.id: pose for pose in frame.observers if pose.id in self._observers}
        self._find(frame, heightmap)
        if not any(self._observers[number].patrol for number in truth):
            return
        self._poses |= truth
        self._place()
        if abs(frame.time_s - self._sight_time) >= SIGHT_PERIOD_S:
            self._draw_sight(heightmap, frame.time_s)

    def _find(self, frame: Frame, heightmap: Heightmap) -> None:
        """Those whom the robot's sensors have found meanwhile are drawn as known."""
        found = frozenset(frame.percept.known_observers) if frame.percept is not None else frozenset()
        if found != self._found:
            self._found = found
            self._still_key = None
            self._place()
            self._draw_sight(heightmap, frame.time_s)

    def _knows(self, observer: Observer) -> bool:
        return observer.known or observer.id in self._found

    def fill(self, filled: bool) -> None:
        """Whether fields of view are filled, or only outlined where the exposure itself is shown."""
        if filled != self._filled:
            self._filled = self._fans.visible = filled
            self._still_key = None

    def set_opacity(self, opacity: float, heightmap: Heightmap) -> None:
        self._opacity = opacity
        self._still_key = None
        self._draw_sight(heightmap, self._sight_time)

    def _relabel(self) -> None:
        named = {number: observer.name for number, observer in self._observers.items() if observer.name}
        for number in set(self._labels) - set(named):
            self._labels.pop(number).remove()
        for number, name in named.items():
            if number in self._labels:
                self._labels[number].text = name
            else:
                self._labels[number] = self._scene.add_label(
                    f"{self._labels_root}/label_{number}", name, anchor="bottom-center"
                )

    def _place(self) -> None:
        masts = []
        standing: dict[bool, list[tuple[tuple[float, float, float], float]]] = {True: [], False: []}
        for number, observer in self._observers.items():
            pose = self._poses[number]
            ground = pose.z
            feet = ground + max(observer.eye_height - EYE_OF_FIGURE, 0.0)
            standing[self._knows(observer)].append(((pose.x, pose.y, feet), pose.yaw))
            if feet > ground + 0.3:
                masts.append([(pose.x, pose.y, ground), (pose.x, pose.y, feet)])
            if number in self._labels:
                self._labels[number].position = (pose.x, pose.y, feet + 2.0)
        for figures, known in ((self._known, True), (self._unknown, False)):
            figures.place([place for place, _ in standing[known]], [yaw for _, yaw in standing[known]])
        self._masts.show(np.array(masts).reshape(-1, 2, 3), (70, 66, 60))

    def _draw_sight(self, heightmap: Heightmap, time_s: float) -> None:
        still = [o for o in self._observers.values() if o.patrol is None]
        moving = [o for o in self._observers.values() if o.patrol is not None]
        key = (tuple(still), id(heightmap), self._filled)
        if key != self._still_key:
            self._still.show(self._sectors(still, heightmap))
            self._still_key = key
        if moving or self._sight_time == -math.inf:
            self._moving.show(self._sectors(moving, heightmap))
        self._draw_outlines(heightmap)
        self._sight_time = time_s

    def _sectors(self, observers: Iterable[Observer], heightmap: Heightmap) -> bytes | None:
        if not self._filled:
            return None
        surfaces = [
            sight_sector(o, self._poses[o.id], heightmap, self._opacity, self._knows(o)) for o in observers
        ]
        return glb(merged(surfaces)) if surfaces else None

    def _draw_outlines(self, heightmap: Heightmap) -> None:
        segments, colours = [], []
        for observer in self._observers.values():
            pieces = self._outline(observer, heightmap)
            segments.append(pieces)
            colours.append(np.tile(np.array(sight_colour(self._knows(observer)), np.uint8), (len(pieces), 1)))
        self._outline_of = {number: self._outline_of[number] for number in self._observers}
        if segments:
            self._outlines.show(np.concatenate(segments), np.concatenate(colours))
        else:
            self._outlines.hide()


    def _outline(self, observer: Observer, heightmap: Heightmap) -> np.ndarray:
        """Made anew only for those who have moved: there may be two hundred."""
        pose = self._poses[observer.id]
        question = (observer, pose, id(heightmap))
        kept = self._outline_of.get(observer.id)
        if kept is None or kept[0] != question:
            kept = question, _inside(sight_outline(observer, pose, heightmap), heightmap)
            self._outline_of[observer.id] = kept
        return kept[1]


class Obstacles:
    """People and vehicles that move."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._figures = {
            ObstacleKind.PERSON: Figures(scene, f"{root}/people", "person"),
            ObstacleKind.VEHICLE: Figures(scene, f"{root}/vehicles", "vehicle"),
        }
        self._kinds: dict[int, ObstacleKind] = {}

    def edit(self, scenario: Scenario, heightmap: Heightmap, time_s: float) -> None:
        self._kinds = {obstacle.id: obstacle.kind for obstacle in scenario.obstacles}
        self._place([_walker_pose(obstacle, heightmap, time_s) for obstacle in scenario.obstacles], heightmap)

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        if {pose.id for pose in frame.obstacles} == set(self._kinds):
            self._place(frame.obstacles, heightmap)

    def _place(self, poses: Sequence[WalkerPose], heightmap: Heightmap) -> None:
        for kind, figures in self._figures.items():
            own = [pose for pose in poses if self._kinds[pose.id] is kind]
            figures.place(
                [(p.x, p.y, float(heightmap.height_at(p.x, p.y))) for p in own], [p.yaw for p in own]
            )


class Patrols:
    """The beats of observers and moving obstacles, drawn on the ground with a mark at each waypoint."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._lines = Lines(scene, f"{root}/beats", 0.06)

    def edit(self, scenario: Scenario, heightmap: Heightmap) -> None:
        segments, colours = [], []
        for walker, colour in (
            *((o, palette.SEEN if o.known else palette.UNKNOWN) for o in scenario.observers),
            *((o, (228, 190, 150)) for o in scenario.obstacles),
        ):
            if walker.patrol is None:
                continue
            beat = _beat(walker)
            pieces = polyline(draped(heightmap, resampled(beat, 0.5), 0.09))[::2]
            marks = _crosses(beat, heightmap)
            segments += [pieces, marks]
            colours.append(np.tile(np.array(colour, np.uint8), (len(pieces) + len(marks), 1)))
        if segments:
            self._lines.show(np.concatenate(segments), np.concatenate(colours))
        else:
            self._lines.hide()


def _beat(walker: Walker) -> np.ndarray:
    assert walker.patrol is not None
    points = [(walker.x, walker.y), *((p.x, p.y) for p in walker.patrol.waypoints)]
    return np.array(points + points[:1] if walker.patrol.loop else points, float)


def _crosses(points: np.ndarray, heightmap: Heightmap) -> np.ndarray:
    arms = 0.22 * np.array([[(-1, -1), (1, 1)], [(-1, 1), (1, -1)]])
    return draped(heightmap, (points[:, None, None] + arms).reshape(-1, 2, 2), 0.1)


def _walker_pose(walker: Walker, heightmap: Heightmap, time_s: float) -> WalkerPose:
    x, y, yaw = walker.pose_at(time_s)
    return WalkerPose(getattr(walker, "id", 0), x, y, float(heightmap.height_at(x, y)), yaw)


def sight_colour(known: bool) -> palette.RGB:
    """Orange for an observer that the robot knows of, grey for one it has yet to find."""
    return palette.SEEN if known else palette.UNKNOWN


def sight_sector(
    observer: Observer, pose: WalkerPose, heightmap: Heightmap, opacity: float, known: bool = True
) -> Surface:
    """Field of view and range as a fan laid on the ground, strong about the observer, faint
    farther out so that the ground stays readable, clear beyond the map."""
    angles = _angles(observer, pose)
    radii = np.concatenate([np.linspace(0.4, 1.0, 3), np.linspace(1.6, max(observer.range, 1.7), 30)])
    xy = np.stack([
        pose.x + radii[:, None] * np.cos(angles), pose.y + radii[:, None] * np.sin(angles)
    ], axis=-1).reshape(-1, 2)  # fmt: skip
    vertices = draped(heightmap, xy, SIGHT_LIFT)
    west, east, south, north = heightmap.bounds
    inside = (xy[:, 0] >= west) & (xy[:, 0] <= east) & (xy[:, 1] >= south) & (xy[:, 1] <= north)
    fade = np.repeat(FAINTEST + (1.0 - FAINTEST) * np.exp(-radii / SIGHT_FADE), len(angles))
    colours = np.empty((len(xy), 4), np.uint8)
    colours[:, :3] = sight_colour(known)
    colours[:, 3] = np.round(210 * opacity * fade * inside)
    row, col = np.mgrid[0 : len(radii) - 1, 0 : len(angles) - 1]
    near = (row * len(angles) + col).ravel()
    far = near + len(angles)
    faces = np.concatenate(
        [np.column_stack([near, far, far + 1]), np.column_stack([near, far + 1, near + 1])]
    )
    faces = faces[inside[faces].any(axis=1)]
    return Surface(vertices, faces, colours, unlit=True, blended=True, double_sided=True)


def sight_outline(observer: Observer, pose: WalkerPose, heightmap: Heightmap) -> np.ndarray:
    """(n, 2, 3) segments along the edge of the field of view and the arc of the range."""
    angles = _angles(observer, pose)
    centre = np.array([pose.x, pose.y])
    rim = centre + observer.range * np.column_stack([np.cos(angles), np.sin(angles)])
    lines = [rim]
    if observer.fov_horizontal < 360.0:
        lines += [resampled(np.array([centre, rim[0]]), 1.0), resampled(np.array([centre, rim[-1]]), 1.0)]
    return np.concatenate([polyline(draped(heightmap, line, SIGHT_LIFT + 0.02)) for line in lines])


def _angles(observer: Observer, pose: WalkerPose) -> np.ndarray:
    half = math.radians(0.5 * observer.fov_horizontal)
    return pose.yaw + np.linspace(-half, half, max(int(math.degrees(2 * half) / 4), 2) + 1)


def _inside(segments: np.ndarray, heightmap: Heightmap) -> np.ndarray:
    west, east, south, north = heightmap.bounds
    x, y = segments[..., 0], segments[..., 1]
    return segments[((x >= west) & (x <= east) & (y >= south) & (y <= north)).all(axis=1)]
