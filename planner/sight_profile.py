"""The line from an observer's eye to a robot in a cell, and why it is seen or not."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.line_of_sight import SEEN, View
from scenes.pose import wrap_angle
from scenes.rays import Body, BodyKind, RayScene
from scenes.robot import HUSKY
from scenes.scenario import off_the_map
from scenes.terrain import Heightmap, Quality

SPACING = 0.5
"""Distance of a profile's samples, in cells."""

_SKY = 100.0  # metres above the ground from which the tops of things are looked for, farther than any is wide


@dataclass(frozen=True, eq=False)
class SightProfile:
    """A section from the foot of the eye to the cell: k samples, evenly spaced.

    distance : (k,) along the ground from the eye, metres
    ground : (k,) height of the ground
    cover : (k,) height of the top of what stands there, NaN where nothing does
    sight : (k,) height of the line of sight
    eye, target : (3,) its two ends
    light : share of it that comes through, from 0 to 1; 0 outside the field of view
    seen : whether the cell counts as seen
    blocker, point : what hides it, and where (3,); None where it is not hidden by anything
    reason : in words
    """

    observer_id: int
    distance: np.ndarray
    ground: np.ndarray
    cover: np.ndarray
    sight: np.ndarray
    eye: np.ndarray
    target: np.ndarray
    light: float
    seen: bool
    blocker: Body | None
    point: np.ndarray | None
    reason: str


def sight_profile(
    rays: RayScene, heightmap: Heightmap, view: View, x: float, y: float, *, height: float = HUSKY.height
) -> SightProfile:
    """The line from the view's eye to `height` above the ground at (x, y), with what it meets.

    Raises ValueError where (x, y) is off the map.
    """
    if not heightmap.contains(x, y):
        raise ValueError(f"the place {off_the_map(heightmap, x, y)}")
    target = np.array([x, y, float(heightmap.height_at(x, y)) + height])
    eye = view.eye
    span = math.dist(eye[:2], target[:2])
    count = max(2, math.ceil(span / (SPACING * heightmap.resolution)) + 1)
    share = np.linspace(0.0, 1.0, count)
    places = eye[:2] + share[:, None] * (target[:2] - eye[:2])
    ground = heightmap.height_at(places[:, 0], places[:, 1])
    light, blocker, point, reason = _explain(rays, heightmap, view, target)
    return SightProfile(
        view.observer_id, share * span, ground, _tops(rays, places, ground),
        eye[2] + share * (target[2] - eye[2]), eye, target, light,
        light >= SEEN and heightmap.quality_at(x, y) is not Quality.MISSING,
        blocker, point, reason,
    )  # fmt: skip


def _explain(
    rays: RayScene, heightmap: Heightmap, view: View, target: np.ndarray
) -> tuple[float, Body | None, np.ndarray | None, str]:
    """Light, what hides the target and where, and the reason in words."""
    outside = _why_outside(view, target)
    if outside:
        return 0.0, None, None, outside
    light, through, along = 1.0, [], target - view.eye
    length = float(np.linalg.norm(along))
    for crossing in rays.crossings(view.eye, target):
        body, distance = crossing.body, crossing.distance
        light *= 1.0 - body.opacity
        through.append(name_of(body))
        if light < SEEN:
            rest = float(rays.visible(view.eye, target)[0])
            where = view.eye + along * (distance / length)
            if _inside(rays, view.eye, along / length) == body:
                return rest, body, where, f"hidden: the observer's eye is inside {name_of(body)}"
            stops = "" if body.opacity >= 1.0 else f", which stops {body.opacity:.0%} of the light"
            before = f" (after {', '.join(through[:-1])})" if len(through) > 1 else ""
            place = f"{distance:.1f} m from the eye"
            return rest, body, where, f"hidden by {name_of(body)}{stops}, {place}{before}"
    if heightmap.quality_at(target[0], target[1]) is Quality.MISSING:
        return light, None, None, "unknown: the survey has no data here"
    if through:
        return light, None, None, f"seen through {', '.join(through)}: {light:.0%} of the light comes through"
    return light, None, None, f"seen: nothing stands between, {length:.1f} m away"


def _inside(rays: RayScene, eye: np.ndarray, ahead: np.ndarray) -> Body | None:
    """What the eye is inside of: the line ahead leaves it through the first face it meets."""
    hit = rays.cast(eye, ahead[None], _SKY)
    return rays.bodies[int(hit.body[0])] if float(hit.normal[0] @ ahead) > 0.0 else None


def _why_outside(view: View, target: np.ndarray) -> str:
    """Why the target lies outside what the view holds, empty where it does not."""
    if view.holds(target[None])[0]:
        return ""
    if view.range <= 0.0:
        return "not seen: the observer's range is 0 m"
    if min(view.fov_horizontal, view.fov_vertical) <= 0.0:
        return "not seen: the observer's field of view is 0°"
    offset = target - view.eye
    distance = float(np.linalg.norm(offset))
    if distance > view.range:
        return f"out of range: {distance:.1f} m away, the observer sees {view.range:g} m"
    aside = abs(math.degrees(wrap_angle(math.atan2(offset[1], offset[0]) - view.yaw)))
    half = 0.5 * math.degrees(view.fov_horizontal)
    if aside > half:
        return f"outside the field of view: {aside:.0f}° off the facing, it reaches {half:.0f}° to each side"
    rise = math.degrees(math.asin(abs(offset[2]) / distance))
    half = 0.5 * math.degrees(view.fov_vertical)
    side = "above" if offset[2] > 0.0 else "below"
    return f"outside the field of view: {rise:.0f}° {side} the horizon, it reaches {half:.0f}°"


def name_of(body: Body) -> str:
    """What a person calls it: the ground, rock 3, person 1."""
    return "the ground" if body.kind is BodyKind.TERRAIN else f"{body.class_name} {body.id}"


def _tops(rays: RayScene, places: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """(k,) height of the top of the cover at places (k, 2), NaN where there is none."""
    above = float(ground.max()) + _SKY
    origins = np.column_stack([places, np.full(len(places), above)])
    hits = rays.cast(origins, np.tile((0.0, 0.0, -1.0), (len(places), 1)), 2.0 * _SKY + float(np.ptp(ground)))
    cover = np.array([body.kind is BodyKind.COVER for body in rays.bodies] + [False])
    return np.where(cover[hits.body], above - hits.distance, np.nan)
