"""Lines about being seen: from each observer to the robot, to a place that is explained, and the routes that
are compared."""

from __future__ import annotations

import numpy as np
import viser

from app.route_process import Comparison
from app.view import palette
from app.view.nodes import Lines, draped, polyline, resampled
from planner.covert_route import CovertRoute
from planner.exposure import SightProfile, views_at
from planner.exposure_log import NOTICEABLE
from planner.frames import Frame
from planner.vantage import EYE_HEIGHT, Vantage
from scenes.robot import HUSKY
from scenes.scenario import Observer
from scenes.terrain import Heightmap

DASH = 0.5  # metres
ROUTE_LIFT = 0.16


class SightLines:
    """From every observer in whose field of view the robot is: orange when it is seen, blue-green while
    something hides it; dashed from those whom the robot does not know."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._seen = Lines(scene, f"{root}/seen", 0.07)
        self._hidden = Lines(scene, f"{root}/hidden", 0.03)

    def clear(self) -> None:
        self._seen.hide()
        self._hidden.hide()

    def draw(self, frame: Frame, observers: tuple[Observer, ...], heightmap: Heightmap) -> None:
        pose = frame.pose
        target = np.array([pose.x, pose.y, pose.z + 0.6 * HUSKY.height])
        fractions = {watch.observer_id: watch.fraction for watch in frame.exposure.watches}
        found = frame.percept.known_observers if frame.percept is not None else ()
        seen, hidden = [], []
        for observer, view in zip(observers, views_at(observers, heightmap, frame.time_s), strict=True):
            fraction = fractions.get(observer.id, 0.0)
            if fraction <= NOTICEABLE and not view.holds(target[None])[0]:
                continue
            line = np.stack([view.eye, target])[None]
            known = observer.known or observer.id in found
            (seen if fraction > NOTICEABLE else hidden).append(line if known else dashed(line[0]))
        self._seen.show(_together(seen), palette.SEEN)
        self._hidden.show(_together(hidden), palette.HIDDEN)


class ExplainedLines:
    """From each observer to a place: orange where it is seen; else blue-green as far as what hides it, and
    grey beyond."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._seen = Lines(scene, f"{root}/seen", 0.06)
        self._hidden = Lines(scene, f"{root}/hidden", 0.06)
        self._beyond = Lines(scene, f"{root}/beyond", 0.025)
        self._spots = scene.add_point_cloud(
            f"{root}/spots", np.zeros((1, 3)), palette.HIDDEN, point_size=0.3, point_shape="circle",
            point_shading="flat", visible=False,
        )  # fmt: skip

    def clear(self) -> None:
        self._seen.hide()
        self._hidden.hide()
        self._beyond.hide()
        self._spots.visible = False

    def draw(self, profiles: tuple[SightProfile, ...]) -> None:
        seen, hidden, beyond, spots = [], [], [], []
        for profile in profiles:
            if profile.seen:
                seen.append((profile.eye, profile.target))
            elif profile.point is not None:
                hidden.append((profile.eye, profile.point))
                beyond.append(dashed(np.stack([profile.point, profile.target])))
                spots.append(profile.point)
        self._seen.show(np.array(seen).reshape(-1, 2, 3), palette.SEEN)
        self._hidden.show(np.array(hidden).reshape(-1, 2, 3), palette.HIDDEN)
        self._beyond.show(_together(beyond), palette.UNKNOWN)
        self._spots.visible = bool(spots)
        if spots:
            self._spots.position = spots[0]  # half precision on the wire: offsets keep millimetres
            self._spots.points = (np.array(spots) - spots[0]).astype(np.float16)


class RouteLines:
    """The compared routes, each in its colour with discs where it waits, the way to the nearest hiding place,
    the best places of watchers, and where there is no way through."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._edges = {
            name: Lines(scene, f"{root}/{name}_edge", 0.15) for name in palette.ROUTES
        }  # so that they read on any ground
        self._routes = {name: Lines(scene, f"{root}/{name}", 0.085) for name in palette.ROUTES}
        self._waits = Lines(scene, f"{root}/waits", 0.06)
        self._refuge = Lines(scene, f"{root}/refuge", 0.1)
        self._posts = Lines(scene, f"{root}/posts", 0.1)
        self._blocked = Lines(scene, f"{root}/blocked", 0.14)

    def draw(self, comparison: Comparison | None, heightmap: Heightmap) -> None:
        routes = comparison.routes if comparison is not None else {}
        waits = []
        for order, (name, lines) in enumerate(self._routes.items()):
            if name not in routes:
                lines.hide()
                self._edges[name].hide()
                continue
            way = _laid(routes[name].points, heightmap, ROUTE_LIFT + 0.02 * order)
            lines.show(way, palette.ROUTES[name])
            self._edges[name].show(way - np.array([0.0, 0.0, 0.012]), (24, 26, 30))
            waits += [ring(place, 0.45, heightmap) for place, _, _ in routes[name].waits]
        self._waits.show(_together(waits), palette.ROUTES["route"])
        where = comparison.where if comparison is not None else None
        self._blocked.show(_together([] if where is None else [cross(where, heightmap)]), palette.BLOCKED)

    def draw_refuge(self, way: CovertRoute | None, heightmap: Heightmap) -> None:
        if way is None:
            self._refuge.hide()
            return
        there = float(way.points[-1, 0]), float(way.points[-1, 1])
        line = _laid(way.points, heightmap, ROUTE_LIFT + 0.08)
        self._refuge.show(np.concatenate([line, ring(there, 0.6, heightmap)]), palette.REFUGE)

    def draw_posts(self, posts: tuple[Vantage, ...], heightmap: Heightmap) -> None:
        segments = []
        for post in posts:
            ground = float(heightmap.height_at(post.x, post.y))
            foot, eye = (np.array([post.x, post.y, ground + lift]) for lift in (0.0, EYE_HEIGHT))
            ahead = eye + 1.2 * np.array([np.cos(post.yaw), np.sin(post.yaw), 0.0])
            segments += [np.array([[foot, eye], [eye, ahead]]), ring((post.x, post.y), 0.5, heightmap)]
        self._posts.show(_together(segments), palette.POST)


def dashed(ends: np.ndarray) -> np.ndarray:
    """(n, 2, 3) dashes along the line between two points (2, 3)."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    count = max(int(length / DASH), 2)
    share = np.linspace(0.0, 1.0, count + 1)[:, None]
    return polyline(ends[0] + share * (ends[1] - ends[0]))[::2]


def ring(place: tuple[float, float], radius: float, heightmap: Heightmap) -> np.ndarray:
    """(n, 2, 3) a circle on the ground."""
    angle = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = np.array(place) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return polyline(draped(heightmap, circle, ROUTE_LIFT))


def cross(place: tuple[float, float], heightmap: Heightmap) -> np.ndarray:
    """(2, 2, 3) a cross on the ground."""
    arms = 0.7 * np.array([[(-1, -1), (1, 1)], [(-1, 1), (1, -1)]])
    return draped(heightmap, np.array(place) + arms, ROUTE_LIFT + 0.1)


def _laid(points: np.ndarray, heightmap: Heightmap, lift: float) -> np.ndarray:
    return polyline(draped(heightmap, resampled(np.asarray(points, float), 0.3), lift))


def _together(segments: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(segments) if segments else np.zeros((0, 2, 3))
