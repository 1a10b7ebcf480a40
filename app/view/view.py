"""The 3D view of one studio: draws its state for everybody who looks, and turns what they do into commands.

Draws on the studio's loop, at most `DRAW_HZ` times a second and always the newest frame, so a slow browser
costs nobody else anything. viser's callbacks come on other threads; they only post.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import viser

from app.changes import Change
from app.exposure_service import ExposureService
from app.results_replay import ReplayService
from app.studio import Studio
from app.training_service import TrainingService
from app.view.camera import FIELD_OF_VIEW, Viewpoint, opening_view
from app.view.exposure import ExposureShow
from app.view.keys import bind_keys
from app.view.layers import Layer, LayerState
from app.view.picking import Picker
from app.view.replay import ReplayShow
from app.view.scene import MapMeshes, Scene
from app.view.training import TrainingShow
from app.view.viewer import Viewer
from scenes.rays import RayScene

log = logging.getLogger(__name__)

DRAW_HZ = 15.0
PANEL_HZ = 4.0


class StudioView:
    """Owns the scene of a viser server and one `Viewer` for each browser that is connected."""

    def __init__(
        self,
        studio: Studio,
        server: viser.ViserServer,
        exposures: ExposureService | None = None,
        trainings: TrainingService | None = None,
        replays: ReplayService | None = None,
    ) -> None:
        self.studio, self.server = studio, server
        self.layers = LayerState()
        self.picker = Picker()
        self._viewers: dict[int, Viewer] = {}
        self._opened = 0
        self._drawn_map = studio.heightmap
        self._draw_due: asyncio.TimerHandle | None = None
        self._drawn_at = self._panels_at = 0.0
        self._tasks: set[asyncio.Task] = set()
        _dress(server)
        self.scene = Scene(server, self.layers)
        self.exposure = ExposureShow(
            studio, server.scene, self.layers, exposures or ExposureService(studio)
        )
        self.training = TrainingShow(
            studio, server.scene, self.layers, trainings or TrainingService(studio), self._training_changed
        )
        self.replay = ReplayShow(
            studio, server.scene, replays or ReplayService(studio), self._replay_changed
        )
        self._frame_camera()
        meshes = MapMeshes.of(studio.scenario, studio.heightmap)
        self.scene.open(meshes)
        self.exposure.open(meshes.paper)
        self._edit()
        self._unsubscribe = studio.subscribe(self._changed)
        bind_keys(self)
        self._listen()

    def start(self) -> None:
        """Follow the exposure; on the studio's loop."""
        self.exposure.show_layer(Layer.EXPOSURE)

    def close(self) -> None:
        """Stop drawing."""
        self._unsubscribe()
        self.exposure.close()
        self.training.close()
        self.replay.close()
        if self._draw_due is not None:
            self._draw_due.cancel()

    # people

    def viewer(self, client_id: int | None) -> Viewer | None:
        return self._viewers.get(client_id) if client_id is not None else None

    def for_viewer(self, client_id: int | None, action: Callable[[Viewer], None]) -> None:
        """From any thread: let `action` run on the loop for one person, who is told of a refusal."""
        self.studio.post(
            self._act, client_id, action, on_error=lambda reason: self._refuse(client_id, reason)
        )

    def _act(self, client_id: int | None, action: Callable[[Viewer], None]) -> None:
        viewer = self.viewer(client_id)
        if viewer is not None:
            action(viewer)

    def _refuse(self, client_id: int | None, reason: str) -> None:
        viewer = self.viewer(client_id)
        if viewer is not None:
            viewer.refuse(reason)

    def _listen(self) -> None:
        @self.server.scene.on_click()  # pyright: ignore[reportArgumentType] - viser awaits coroutines too
        async def _(event: viser.SceneClickEvent) -> None:
            origin, direction = event.ray_origin, event.ray_direction
            self.for_viewer(event.client_id, lambda viewer: viewer.click(origin, direction))

        @self.server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            self.studio.post(self._welcome, client)

        @self.server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            self.studio.post(self._part, client.client_id)

    def _welcome(self, client: viser.ClientHandle) -> None:
        self._viewers[client.client_id] = Viewer(self, client)

    def _part(self, client_id: int) -> None:
        self._viewers.pop(client_id, None)

    # drawing

    def _changed(self, change: Change) -> None:
        match change:
            case Change.OPENED:
                task = asyncio.ensure_future(self._open())
                self._tasks.add(task)
                task.add_done_callback(self._opening_over)
            case Change.EDITED | Change.SELECTED:
                self._edit()
            case Change.FRAME:
                self._schedule_draw()
            case Change.STATUS if self.studio.frame is None:
                self._edit()
        self.exposure.hear(change)
        self.training.hear(change)
        if change not in (Change.FRAME, Change.TRAINING):
            for viewer in self._viewers.values():
                viewer.refresh(change)

    async def _open(self) -> None:
        self._opened += 1
        mine, scenario, heightmap = self._opened, self.studio.scenario, self.studio.heightmap
        meshes = await asyncio.to_thread(MapMeshes.of, scenario, heightmap)
        rays = await asyncio.to_thread(RayScene, heightmap, scenario.cover)
        if mine != self._opened:
            return  # a newer scenario is on its way
        self._drawn_map = heightmap
        self.picker.adopt(rays, heightmap, scenario.cover)
        self.scene.open(meshes)
        self.exposure.open(meshes.paper)
        self._edit()
        self._frame_camera()
        for viewer in self._viewers.values():
            viewer.eye.opening(self.opening_view())

    def _opening_over(self, task: asyncio.Task) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            log.error("the scenario could not be drawn", exc_info=task.exception())

    def _edit(self) -> None:
        studio = self.studio
        if studio.heightmap is not self._drawn_map:
            return  # another map is being made ready
        with self.server.atomic():
            self.scene.edit(studio.scenario, studio.heightmap, studio.selection, studio.frame)

    def _schedule_draw(self) -> None:
        if self._draw_due is None:
            loop = asyncio.get_running_loop()
            wait = max(self._drawn_at + 1.0 / DRAW_HZ - loop.time(), 0.0)
            self._draw_due = loop.call_later(wait, self._draw)

    def _draw(self) -> None:
        self._draw_due = None
        self._drawn_at = asyncio.get_running_loop().time()
        studio = self.studio
        if studio.frame is None or studio.heightmap is not self._drawn_map:
            return
        with self.server.atomic():
            self.scene.draw(studio.frame, studio.heightmap)
        panels = self._drawn_at - self._panels_at >= 1.0 / PANEL_HZ
        if panels:
            self._panels_at = self._drawn_at
        for viewer in tuple(self._viewers.values()):
            viewer.eye.keep_up(studio.frame.pose)
            if panels:
                viewer.refresh(Change.FRAME)

    def show_layer(self, layer: Layer, visible: bool) -> None:
        """Show or hide a layer for everybody."""
        self.layers.visible[layer] = visible
        self.scene.show_layer(layer, visible)
        self.exposure.show_layer(layer)
        self.training.show_layer(layer)
        if visible and self.studio.frame is not None:
            self._schedule_draw()
        self._layers_changed()

    def set_opacity(self, layer: Layer, opacity: float) -> None:
        """How strongly a layer is drawn, 0 to 1. Raises ValueError."""
        if not 0.0 <= opacity <= 1.0:
            raise ValueError(f"opacity must be 0 to 1, got {opacity}")
        self.layers.opacity[layer] = opacity
        self.scene.set_opacity(layer, opacity, self.studio.heightmap)
        self.exposure.show_layer(layer)
        self.training.show_layer(layer)
        if self.studio.frame is not None:
            self._schedule_draw()
        self._layers_changed()

    def _training_changed(self) -> None:
        for viewer in self._viewers.values():
            viewer.refresh(Change.TRAINING)

    def _replay_changed(self) -> None:
        for viewer in self._viewers.values():
            viewer.panel.replay.refresh()

    def _layers_changed(self) -> None:
        for viewer in self._viewers.values():
            viewer.refresh_layers()

    def opening_view(self) -> Viewpoint:
        scenario, heightmap = self.studio.scenario, self.studio.heightmap
        return opening_view(scenario, heightmap, self.picker.rays(scenario, heightmap))

    def _frame_camera(self) -> None:
        view = self.opening_view()
        camera = self.server.initial_camera
        camera.position, camera.look_at = view.position, view.look_at
        camera.fov, camera.near, camera.far = FIELD_OF_VIEW, 0.1, 3000.0


def _dress(server: viser.ViserServer) -> None:
    server.gui.configure_theme(
        dark_mode=True,
        show_logo=False,
        show_share_button=False,
        brand_color=(38, 160, 150),
        control_width="medium",
    )
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(376)
