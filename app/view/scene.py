"""The drawn scene: every layer once, redrawn when what it shows has changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from app.changes import Kind, Selection
from app.view import palette
from app.view.driving import (
    ArcsLayer,
    CostLayer,
    DetectionsLayer,
    PathLayer,
    RouteLayer,
    ScanLayer,
)
from app.view.exposure_lines import SightLines
from app.view.exposure_paint import Paper
from app.view.ground import painted, terrain_glb, water_glb
from app.view.layers import STYLES, Layer, LayerState
from app.view.nodes import SwapGlb
from app.view.robot import RobotNode
from app.view.segmentation import GroupsLayer
from app.view.standing import CoverLayer, Markers, SelectionMark, cover_chunks, thing_label
from app.view.walkers import Observers, Obstacles, Patrols
from planner.frames import Frame
from scenes.scenario import CoverObject, Observer, ObstacleSpec, Scenario
from scenes.terrain import Heightmap

FIGURES = "/figures"


@dataclass(frozen=True)
class MapMeshes:
    """What takes long to make of a scenario, made on any thread."""

    ground: bytes
    water: bytes | None
    cover: dict[tuple[CoverObject, ...], bytes]
    paper: Paper

    @classmethod
    def of(cls, scenario: Scenario, heightmap: Heightmap) -> MapMeshes:
        picture = painted(heightmap)
        return cls(
            terrain_glb(heightmap, picture),
            water_glb(heightmap),
            cover_chunks(scenario, heightmap),
            Paper.of(heightmap, picture),
        )


class Scene:
    """`open` and `edit` draw what stands, `draw` what moves. One thread at a time."""

    def __init__(self, server: viser.ViserServer, layers: LayerState) -> None:
        scene = server.scene
        self._layers = layers
        self._roots = {layer: scene.add_frame(f"/{layer.value}", show_axes=False) for layer in STYLES}
        scene.add_frame(FIGURES, show_axes=False)
        _light(scene)
        self._terrain = SwapGlb(scene, f"/{Layer.TERRAIN.value}/ground")
        self._water = SwapGlb(scene, f"/{Layer.WATER.value}/sheets")
        self._cover = CoverLayer(scene, f"/{Layer.COVER.value}")
        self._observers = Observers(scene, f"{FIGURES}/observers", f"/{Layer.SIGHT.value}")
        self._obstacles = Obstacles(scene, FIGURES)
        self._patrols = Patrols(scene, f"/{Layer.PATROLS.value}")
        self._markers = Markers(scene)
        self._mark = SelectionMark(scene)
        self._robot = RobotNode(scene, "/robot")
        self._scan = ScanLayer(scene, f"/{Layer.SCAN.value}")
        self._cost = CostLayer(scene, f"/{Layer.COST.value}")
        self._groups = GroupsLayer(scene, f"/{Layer.GROUPS.value}")
        self._arcs = ArcsLayer(scene, f"/{Layer.ARCS.value}")
        self._route = RouteLayer(scene, f"/{Layer.ROUTE.value}")
        self._path = PathLayer(scene, f"/{Layer.PATH.value}")
        self._sight_lines = SightLines(scene, f"/{Layer.SIGHT_LINES.value}")
        self._watched: tuple[Observer, ...] = ()
        self._detections = DetectionsLayer(scene, f"/{Layer.DETECTIONS.value}")
        for layer, visible in layers.visible.items():
            self.show_layer(layer, visible)

    def open(self, meshes: MapMeshes) -> None:
        """Another map: its meshes instead of the last one's. Follow with `edit`."""
        self._terrain.show(meshes.ground)
        self._water.show(meshes.water)
        self._cover.adopt(meshes.cover)
        self._clear_drive()

    def edit(
        self, scenario: Scenario, heightmap: Heightmap, selection: Selection | None, frame: Frame | None
    ) -> None:
        """Draw what stands and who walks, as the document has it now."""
        time_s = frame.time_s if frame is not None else 0.0
        chosen = selection.id if selection is not None and selection.kind is Kind.COVER else None
        self._cover.edit(scenario, heightmap, chosen)
        self._observers.edit(scenario, heightmap, time_s)
        self._watched = scenario.observers
        self._obstacles.edit(scenario, heightmap, time_s)
        self._patrols.edit(scenario, heightmap)
        self._markers.edit(scenario, heightmap)
        self.mark(scenario, heightmap, selection)
        if frame is None:
            self._robot.stand(scenario.start, heightmap)
            self._clear_drive()

    def _clear_drive(self) -> None:
        for layer in (
            self._scan,
            self._cost,
            self._groups,
            self._arcs,
            self._route,
            self._path,
            self._detections,
            self._sight_lines,
        ):
            layer.clear()

    def mark(self, scenario: Scenario, heightmap: Heightmap, selection: Selection | None) -> None:
        """The ring about what is selected."""
        thing = None if selection is None else _find(scenario, selection)
        if selection is None or thing is None:
            self._mark.show(None, 0.0, "", heightmap)
            return
        radius = 0.75
        if isinstance(thing, CoverObject):
            radius = 0.5 * float(np.hypot(thing.length or 1.0, thing.width or 1.0)) + 0.25
        elif isinstance(thing, ObstacleSpec):
            radius = 0.5 * float(np.hypot(*thing.size[:2])) + 0.25
        self._mark.show((thing.x, thing.y), radius, thing_label(thing), heightmap)

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        """Everything that a frame speaks of; hidden layers are left as they are."""
        self._robot.draw(frame)
        self._observers.draw(frame, heightmap)
        self._obstacles.draw(frame, heightmap)
        self._path.draw(frame)
        drawings: dict[Layer, Callable[[], None]] = {
            Layer.SIGHT_LINES: lambda: self._sight_lines.draw(frame, self._watched, heightmap),
            Layer.SCAN: lambda: self._scan.draw(frame),
            Layer.COST: lambda: self._cost.draw(frame, heightmap),
            Layer.GROUPS: lambda: self._groups.draw(frame, heightmap),
            Layer.ARCS: lambda: self._arcs.draw(frame, heightmap),
            Layer.ROUTE: lambda: self._route.draw(frame, heightmap),
            Layer.DETECTIONS: lambda: self._detections.draw(frame),
        }
        for layer, draw in drawings.items():
            if self._layers.visible[layer]:
                draw()

    def show_layer(self, layer: Layer, visible: bool) -> None:
        self._roots[layer].visible = visible
        if layer is Layer.EXPOSURE:
            self._observers.fill(not visible)

    def set_opacity(self, layer: Layer, opacity: float, heightmap: Heightmap) -> None:
        if layer is Layer.SIGHT:
            self._observers.set_opacity(opacity, heightmap)
        elif layer is Layer.COST:
            self._cost.set_opacity(opacity)
        elif layer is Layer.GROUPS:
            self._groups.set_opacity(opacity)


def _find(scenario: Scenario, selection: Selection):
    match selection.kind:
        case Kind.START | Kind.GOAL:
            return getattr(scenario, selection.kind.value)
        case Kind.COVER:
            things = scenario.cover
        case Kind.OBSERVER:
            things = scenario.observers
        case Kind.OBSTACLE:
            things = scenario.obstacles
    return next((thing for thing in things if thing.id == selection.id), None)


def _light(scene: viser.SceneApi) -> None:
    """A low sun from the north-west like the hill shade's, sky light, and a quiet backdrop."""
    scene.world_axes.visible = False
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_directional(
        "/light/sun", color=(255, 244, 226), intensity=2.5, position=(-30.0, 36.0, 42.0)
    )
    scene.add_light_hemisphere(
        "/light/sky", sky_color=(214, 226, 240), ground_color=(140, 132, 116), intensity=2.1
    )
    share = np.linspace(0.0, 1.0, 64)[:, None, None]
    top, bottom = np.array(palette.BACKDROP_TOP), np.array(palette.BACKDROP_BOTTOM)
    backdrop = ((1.0 - share) * top + share * bottom).repeat(4, axis=1)
    scene.set_background_image(backdrop.astype(np.uint8), format="png")
