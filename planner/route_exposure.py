"""What would be seen of a robot that drives a given course: the figures that its drive would log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from planner.detection_model import probability
from planner.exposure_log import NOTICEABLE
from planner.line_of_sight import View, views_at
from planner.pace import Course
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Observer
from scenes.stance import standing_poses
from scenes.terrain import Heightmap

MOMENT = 0.5
"""Seconds for which one who walks is taken to stand still."""


@dataclass(frozen=True, eq=False)
class CourseExposure:
    """united : (n,) visible fraction at each place of a course, for all observers together
    exposed_s, longest_exposure_s, detection_probability : of the whole, as `planner.exposure_log` has them
    """

    united: np.ndarray
    exposed_s: float
    longest_exposure_s: float
    detection_probability: float


def course_exposure(
    rays: RayScene,
    heightmap: Heightmap,
    observers: Sequence[Observer],
    course: Course,
    begun_s: float = 0.0,
) -> CourseExposure:
    """The exposure of a drive that begins at `begun_s` of the patrols' clock: the hull as it stands on the
    ground at each place, seen by the observers where they are by then."""
    hull, middles = _hulls(heightmap, course)
    light = np.zeros((len(observers), *hull.shape[:2]))
    hazard = np.zeros(len(middles))
    for index, observer in enumerate(observers):
        for places, view in _views(observer, heightmap, course, begun_s):
            light[index, places] = seen = _light(rays, view, hull[places])
            distance = np.linalg.norm(middles[places] - view.eye, axis=1)
            hazard[places] += view.detection.hazard(seen.mean(axis=1), distance)
    united = light.max(axis=0, initial=0.0).mean(axis=1)
    return CourseExposure(
        united,
        float(united @ course.seconds),
        _longest(united > NOTICEABLE, course.seconds),
        probability(float(hazard @ course.seconds)),
    )


def _hulls(heightmap: Heightmap, course: Course) -> tuple[np.ndarray, np.ndarray]:
    """World points of the hull (n, 12, 3) and of the body's middle (n, 3) at each place."""
    poses = standing_poses(heightmap, course.positions[:, 0], course.positions[:, 1], course.yaw)
    points = HUSKY.hull_points()
    hull = np.array([pose.to_world(points) for pose in poses]).reshape(-1, *points.shape)
    middles = np.array([pose.position for pose in poses]).reshape(-1, 3)
    return hull, middles + np.array([0.0, 0.0, 0.5 * HUSKY.height])


def _views(
    observer: Observer, heightmap: Heightmap, course: Course, begun_s: float
) -> Iterator[tuple[slice, View]]:
    """(places, view) for all places of the course: one for them all unless the observer walks, else one for
    those of each `MOMENT`."""
    if observer.patrol is None:
        yield slice(None), views_at([observer], heightmap, 0.0)[0]
        return
    moments = np.floor(course.times / MOMENT)
    firsts = np.flatnonzero(np.diff(moments, prepend=-1.0))
    for first, after in pairwise([*firsts.tolist(), len(moments)]):
        time_s = begun_s + float(course.times[first:after].mean())
        yield slice(first, after), views_at([observer], heightmap, time_s)[0]


def _light(rays: RayScene, view: View, hull: np.ndarray) -> np.ndarray:
    """(n, 12) share of light from hull points (n, 12, 3) to the view."""
    points = hull.reshape(-1, 3)
    light = np.zeros(len(points))
    held = view.holds(points)
    if held.any():
        light[held] = rays.visible(view.eye, points[held])
    return light.reshape(hull.shape[:2])


def _longest(seen: np.ndarray, seconds: np.ndarray) -> float:
    longest = unbroken = 0.0
    for now, duration in zip(seen, seconds, strict=True):
        unbroken = unbroken + float(duration) if now else 0.0
        longest = max(longest, unbroken)
    return longest
