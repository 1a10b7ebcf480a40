"""The robot of a training as it drives: a ghost of the Husky with its trail, its goal and who watches it, on
the open map where it learns there, else on its own ground beside it."""

from __future__ import annotations

import asyncio
import math

import numpy as np
import viser

from app.view import palette
from app.view.exposure_lines import ring
from app.view.ghost import Ghost
from app.view.glb import glb
from app.view.ground import painted, terrain_glb
from app.view.nodes import OVERLAY_PARSE_S, Lines, SwapGlb, polyline
from app.view.patches import patch_surface
from app.view.standing import CoverLayer, cover_chunks
from scenes.pose import Pose
from scenes.scenario import Observer, Scenario
from scenes.terrain import Heightmap

GAP = 6.0  # metres between the open map and the ground beside it
LIFTED = np.array([0.0, 0.0, 0.1])
EYE_POST = 0.05


class LearnerGround:
    """Where the training's robot drives. `offset` is how far its world lies east of the open map's.

    root, overlay_root : names of the layers' frames under which it is drawn
    """

    def __init__(self, scene: viser.SceneApi, root: str, overlay_root: str) -> None:
        self.offset = 0.0
        self.heightmap: Heightmap | None = None
        self._place = scene.add_frame(f"{root}/place", show_axes=False)
        self._overlay_place = scene.add_frame(f"{overlay_root}/place", show_axes=False)
        self._terrain = SwapGlb(scene, f"{root}/place/ground")
        self._cover = CoverLayer(scene, f"{root}/place/cover")
        self._ghost = Ghost(scene, f"{root}/place/robot", palette.GHOST, "learning")
        self._trail = Lines(scene, f"{root}/place/trail", 0.06)
        self._goal = Lines(scene, f"{root}/place/goal", 0.08)
        self._posts = Lines(scene, f"{root}/place/posts", EYE_POST)
        self._overlay = SwapGlb(scene, f"{overlay_root}/place/patch", OVERLAY_PARSE_S)
        self._points: list[np.ndarray] = []
        self._beside = False
        self._wanted = 0

    async def stand(self, scenario: Scenario, episode: int, open_map: Heightmap) -> None:
        """Begin an episode on a scenario's ground."""
        self._wanted += 1
        mine = self._wanted
        heightmap = await asyncio.to_thread(scenario.terrain.heightmap)
        same = _same(heightmap, open_map)
        drawn = self.heightmap if self._beside else None
        if not same and (drawn is None or not _same(heightmap, drawn)):
            made = await asyncio.to_thread(_ground_and_cover, scenario, heightmap)
            if mine != self._wanted:
                return  # the next episode is on its way
            self._terrain.show(made[0])
            self._cover.adopt(made[1])
            self._cover.edit(scenario, heightmap, None)
        elif same and self._beside:
            self._clear_ground()
        self._beside, self.heightmap = not same, heightmap
        self.offset = 0.0 if same else open_map.bounds[1] - heightmap.bounds[0] + GAP
        for frame in (self._place, self._overlay_place):
            frame.position = (self.offset, 0.0, 0.0)
        self._begin(scenario, episode, heightmap)

    def _begin(self, scenario: Scenario, episode: int, heightmap: Heightmap) -> None:
        start, goal = scenario.start, scenario.goal
        self._points = []
        self._trail.hide()
        self._overlay.show(None)
        self._goal.show(ring((goal.x, goal.y), 0.5, heightmap), palette.GOAL)
        posts = [_post(observer, heightmap) for observer in scenario.observers] if self._beside else []
        self._posts.show(np.concatenate(posts) if posts else np.zeros((0, 2, 3)), palette.POST)
        ground = float(heightmap.height_at(start.x, start.y))
        self._ghost.show(f"learning, episode {episode + 1}")
        self.move((Pose(start.x, start.y, ground, yaw=math.radians(start.yaw)),))

    def move(self, poses: tuple[Pose, ...]) -> None:
        """Drive on through some poses."""
        if self.heightmap is None:
            return
        self._ghost.place(poses[-1])
        self._points += [pose.position + LIFTED for pose in poses]
        if len(self._points) > 1:
            self._trail.show(polyline(np.array(self._points)), palette.GHOST)

    @property
    def here(self) -> np.ndarray | None:
        """(3,) where the robot is drawn now, in the scene; None while nobody learns."""
        return None if not self._points else self._points[-1] + np.array([self.offset, 0.0, 0.0])

    def lay(self, colours: np.ndarray | None, pose: Pose, opacity: float) -> None:
        """Draw a patch's colours about a pose, or none."""
        surface = None
        if colours is not None and self.heightmap is not None:
            surface = patch_surface(colours, pose, self.heightmap, opacity)
        self._overlay.show(None if surface is None else glb(surface))

    def clear(self) -> None:
        """Nobody learns any more."""
        self._wanted += 1
        self._ghost.hide()
        for lines in (self._trail, self._goal, self._posts):
            lines.hide()
        self._overlay.show(None)
        if self._beside:
            self._clear_ground()
        self._beside, self.heightmap, self._points = False, None, []

    def _clear_ground(self) -> None:
        self._terrain.show(None)
        self._cover.clear()


def _ground_and_cover(scenario: Scenario, heightmap: Heightmap) -> tuple[bytes, dict]:
    return terrain_glb(heightmap, painted(heightmap)), cover_chunks(scenario, heightmap)


def _same(one: Heightmap, other: Heightmap) -> bool:
    return one is other or (
        one.resolution == other.resolution
        and one.shape == other.shape
        and bool(np.array_equal(one.heights, other.heights))
    )


def _post(observer: Observer, heightmap: Heightmap) -> np.ndarray:
    """(n, 2, 3) an observer's eye over the ring on which it stands, looking ahead."""
    foot = np.array([observer.x, observer.y, float(heightmap.height_at(observer.x, observer.y))])
    eye = foot + np.array([0.0, 0.0, observer.eye_height])
    yaw = math.radians(observer.yaw)
    ahead = eye + 1.2 * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    return np.concatenate(
        [np.array([[foot, eye], [eye, ahead]]), ring((observer.x, observer.y), 0.5, heightmap)]
    )
