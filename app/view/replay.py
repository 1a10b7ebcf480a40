"""Replayed drives in the scene: a ghost and a path for each, the same for everybody who looks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from app.results_replay import Replay, ReplayService
from app.studio import Studio
from app.view import palette
from app.view.exposure_lines import ring
from app.view.ghost import Ghost
from app.view.layers import Layer
from app.view.nodes import Lines, draped, polyline
from planner.exposure_log import NOTICEABLE
from scenes.terrain import Heightmap

LIFT = 0.14
AHEAD, BEHIND = 0.35, 1.0
"""How strong the colour of the way is that is still to come, and of the way that was driven."""

DARK = np.array((40, 44, 48))


class ReplayShow:
    """Lives on the studio's loop. `refresh` is called when panels have something new to show."""

    def __init__(
        self, studio: Studio, scene: viser.SceneApi, service: ReplayService, refresh: Callable[[], None]
    ) -> None:
        self.service = service
        self._studio, self._scene, self._refresh = studio, scene, refresh
        self._drawn: Replay | None = None
        self._ghosts: list[Ghost] = []
        root = f"/{Layer.REPLAY.value}"
        # the first is wider, so that it is seen where both went the same way
        self._lines = Lines(scene, f"{root}/way0", 0.14), Lines(scene, f"{root}/way1", 0.07)
        self._goal = Lines(scene, f"{root}/goal", 0.08)
        self._ways: list[np.ndarray] = []
        self._driven: list[int] = []
        self._leave = service.watch(self._hear)

    def close(self) -> None:
        self._leave()

    def _hear(self) -> None:
        replay = self.service.replay
        if replay is not self._drawn:
            self._clear()
            if replay is not None:
                self._stand(replay)
        if replay is not None:
            self._move(replay)
        self._refresh()

    def _clear(self) -> None:
        for ghost in self._ghosts:
            ghost.remove()
        for lines in (*self._lines, self._goal):
            lines.hide()
        self._ghosts, self._ways, self._driven, self._drawn = [], [], [], None

    def _stand(self, replay: Replay) -> None:
        heightmap, goal = self._studio.heightmap, replay.scenario.goal
        self._drawn = replay
        self._goal.show(ring((goal.x, goal.y), 0.5, heightmap), palette.GOAL)
        for number, actor in enumerate(replay.actors):
            name = f"/{Layer.REPLAY.value}/ghost{number}"
            self._ghosts.append(Ghost(self._scene, name, actor.colour, label_at=1.1 + 0.5 * number))
            self._ways.append(_draped_way(actor.way.x, actor.way.y, heightmap, LIFT + 0.03 * number))
            self._driven.append(-1)

    def _move(self, replay: Replay) -> None:
        time_s = self.service.time_s
        for number, (actor, pose) in enumerate(zip(replay.actors, self.service.poses(), strict=True)):
            ghost, way = self._ghosts[number], actor.way
            seen = float(np.interp(time_s, way.time_s, way.seen))
            over = time_s >= way.duration_s
            state = actor.outcome if over else _in_view(seen)
            ghost.place(pose)
            ghost.show(f"{actor.method}: {state}")
            self._colour(number, int(np.searchsorted(way.time_s, time_s)), actor.colour)

    def _colour(self, number: int, driven: int, colour: palette.RGB) -> None:
        """The way that was driven brighter than what is to come; sent again only when a sample was passed."""
        if driven == self._driven[number]:
            return
        self._driven[number] = driven
        segments = self._ways[number]
        share = np.where(np.arange(len(segments)) < driven, BEHIND, AHEAD)[:, None]
        colours = np.round(share * np.array(colour) + (1.0 - share) * DARK).astype(np.uint8)
        self._lines[number].show(segments, colours)


def _in_view(seen: float) -> str:
    return f"{100.0 * seen:.0f} % seen" if seen > NOTICEABLE else "hidden"


def _draped_way(x: np.ndarray, y: np.ndarray, heightmap: Heightmap, lift: float) -> np.ndarray:
    """(n - 1, 2, 3) one segment for each pair of samples."""
    return polyline(draped(heightmap, np.column_stack([x, y]), lift))
