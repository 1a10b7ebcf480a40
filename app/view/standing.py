"""What stands until somebody edits it: cover objects, start and goal, the mark of the selection."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable

import numpy as np
import viser

from app.view import palette
from app.view.glb import Surface, glb, merged
from app.view.nodes import Lines, SwapGlb, draped, polyline, yaw_wxyz
from scenes.catalogue import CATALOGUE
from scenes.meshes import cover_mesh, cover_pose
from scenes.scenario import CoverObject, MovingObstacle, Observer, Point, Scenario, Start
from scenes.terrain import Heightmap

CHUNK = 24


class CoverLayer:
    """Cover objects of a kind, merged by two dozen: few draws for a forest, little to send for an edit.
    The selected one is a node of its own, so that dragging it moves a pose and sends no mesh."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._scene, self._root = scene, root
        self._nodes: dict[tuple[str, int], SwapGlb] = {}
        self._drawn: dict[tuple[str, int], tuple[CoverObject, ...] | None] = {}
        self._single: viser.GlbHandle | None = None
        self._single_shape: tuple | None = None
        self._heightmap: Heightmap | None = None
        self._ready: dict[tuple[CoverObject, ...], bytes] = {}

    def adopt(self, meshes: dict[tuple[CoverObject, ...], bytes]) -> None:
        """Chunks made beforehand by `cover_chunks`, for the next edit."""
        self._ready = meshes

    def edit(self, scenario: Scenario, heightmap: Heightmap, selected: int | None) -> None:
        if heightmap is not self._heightmap:
            self._drawn = dict.fromkeys(self._drawn)  # all of it stands elsewhere now
            self._heightmap = heightmap
        chunks = _chunks(scenario.cover)
        for key in {*chunks, *self._drawn}:
            things = tuple(thing for thing in chunks.get(key, ()) if thing.id != selected)
            if things == self._drawn.get(key):
                continue
            node = self._nodes.setdefault(key, SwapGlb(self._scene, f"{self._root}/{key[0]}_{key[1]}"))
            ready = self._ready.get(things)
            node.show(ready or (_chunk_glb(things, heightmap) if things else None))
            self._drawn[key] = things
        self._ready = {}
        self._draw_single(next((thing for thing in scenario.cover if thing.id == selected), None), heightmap)

    def clear(self) -> None:
        """Draw nothing until the next edit."""
        for node in self._nodes.values():
            node.show(None)
        self._drawn = dict.fromkeys(self._drawn)

    def _draw_single(self, thing: CoverObject | None, heightmap: Heightmap) -> None:
        shape = None if thing is None else (thing.kind, thing.id, thing.length, thing.width, thing.height)
        if shape != self._single_shape:
            if self._single is not None:
                self._single.remove()
            self._single_shape = shape
            self._single = (
                None
                if thing is None
                else self._scene.add_glb(
                    f"{self._root}/selected", glb(Surface.from_trimesh(cover_mesh(thing)))
                )
            )
        if self._single is not None and thing is not None:
            pose = cover_pose(heightmap, thing)
            self._single.position = (pose.x, pose.y, pose.z)
            self._single.wxyz = yaw_wxyz(pose.yaw)


def cover_chunks(scenario: Scenario, heightmap: Heightmap) -> dict[tuple[CoverObject, ...], bytes]:
    """The meshes that a whole scenario's cover is drawn with; a forest takes a second, on any thread."""
    return {
        tuple(things): _chunk_glb(tuple(things), heightmap) for things in _chunks(scenario.cover).values()
    }


def _chunks(cover: Iterable[CoverObject]) -> dict[tuple[str, int], list[CoverObject]]:
    chunks: dict[tuple[str, int], list[CoverObject]] = defaultdict(list)
    for thing in cover:
        chunks[thing.kind.value, thing.id // CHUNK].append(thing)
    return chunks


def _chunk_glb(things: tuple[CoverObject, ...], heightmap: Heightmap) -> bytes:
    return glb(merged([_placed(thing, heightmap) for thing in things]))


def _placed(thing: CoverObject, heightmap: Heightmap) -> Surface:
    pose = cover_pose(heightmap, thing)
    return Surface.from_trimesh(cover_mesh(thing)).moved(pose.rotation, pose.position)


class Markers:
    """Start and goal: an arrowhead on the ground and a pennant with a label."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._start = scene.add_glb("/start", glb(_arrowhead()), cast_shadow=False)
        self._goal = scene.add_glb(
            "/goal", glb(_ring(0.36, 0.5, palette.GOAL), *_pennant()), cast_shadow=False
        )
        self._label = scene.add_label(
            "/goal/label", "Goal", position=(0.0, 0.0, 2.15), anchor="bottom-center", font_screen_scale=1.1
        )

    def edit(self, scenario: Scenario, heightmap: Heightmap) -> None:
        start, goal = scenario.start, scenario.goal
        self._start.position = (start.x, start.y, float(heightmap.height_at(start.x, start.y)) + 0.06)
        self._start.wxyz = yaw_wxyz(math.radians(start.yaw))
        self._goal.position = (goal.x, goal.y, float(heightmap.height_at(goal.x, goal.y)) + 0.05)


class SelectionMark:
    """A white ring about what is selected, and its name."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._ring = Lines(scene, "/selection", 0.06)
        self._label: viser.LabelHandle | None = None

    def show(self, at: tuple[float, float] | None, radius: float, text: str, heightmap: Heightmap) -> None:
        """Draw the ring about the world point `at`, draped on the ground; None takes it away."""
        if self._label is not None and (at is None or text != self._label.text):
            self._label.remove()
            self._label = None
        if at is None:
            self._ring.hide()
            return
        angle = np.linspace(0.0, 2.0 * math.pi, 73)
        circle = at + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        self._ring.show(polyline(draped(heightmap, circle, 0.08)), palette.SELECTED)
        if text:
            if self._label is None:
                self._label = self._scene.add_label("/selection_label", text, anchor="top-center")
            self._label.position = (at[0], at[1] - radius - 0.2, float(heightmap.height_at(*at)) + 0.1)


def thing_label(thing: Start | Point | CoverObject | Observer | MovingObstacle) -> str:
    """What a selected thing is called; the goal and named observers carry labels of their own."""
    match thing:
        case CoverObject():
            return thing.name or f"{CATALOGUE[thing.kind].class_name} {thing.id}"
        case Observer():
            return "" if thing.name else f"observer {thing.id}"
        case MovingObstacle():
            return thing.name or f"{thing.kind.value} {thing.id}"
        case Start():
            return "start"
    return ""


def _annulus(inner: float, outer: float, steps: int = 40) -> tuple[np.ndarray, np.ndarray]:
    angle = np.linspace(0.0, 2.0 * math.pi, steps, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    n = np.arange(steps)
    following = np.roll(n, -1)
    faces = np.concatenate([
        np.column_stack([n, n + steps, following + steps]), np.column_stack([n, following + steps, following])
    ])  # fmt: skip
    return np.concatenate([inner * circle, outer * circle]), faces


def _ring(inner: float, outer: float, colour: palette.RGB) -> Surface:
    xy, faces = _annulus(inner, outer)
    vertices = np.column_stack([xy, np.zeros(len(xy))])
    return Surface(vertices, faces, _plain(colour, len(xy)), unlit=True, double_sided=True)


def _arrowhead() -> Surface:
    outline = np.array([(0.75, 0.0), (-0.45, 0.5), (-0.2, 0.0), (-0.45, -0.5)])
    vertices = np.column_stack([outline, np.zeros(4)])
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    return Surface(vertices, faces, _plain(palette.START, 4), unlit=True, double_sided=True)


def _pennant() -> tuple[Surface, Surface]:
    pole = np.array(
        [
            (x, y, z)
            for z in (0.0, 2.0)
            for x, y in ((-0.03, -0.03), (0.03, -0.03), (0.03, 0.03), (-0.03, 0.03))
        ]
    )
    sides = np.array(
        [(i, (i + 1) % 4, (i + 1) % 4 + 4) for i in range(4)]
        + [(i, (i + 1) % 4 + 4, i + 4) for i in range(4)]
    )
    flag = np.array([(0.0, 0.0, 1.98), (0.0, 0.0, 1.4), (0.85, 0.0, 1.69)])
    return (
        Surface(pole, sides, _plain((236, 236, 230), 8), double_sided=True),
        Surface(flag, np.array([(0, 1, 2)]), _plain(palette.GOAL, 3), unlit=True, double_sided=True),
    )


def _plain(colour: palette.RGB, count: int) -> np.ndarray:
    return np.tile(np.array(colour, np.uint8), (count, 1))
