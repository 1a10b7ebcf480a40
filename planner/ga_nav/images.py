"""Images of generated scenes with the group of each pixel: what the network learns from.

The camera is the Husky's at half its resolution. Each image is rendered from the ray scene under a light,
season and lens of its own; a share of them under the plain light that the robot's camera has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from planner.ga_nav.groups import GROUPS, pixel_groups
from planner.ga_nav.light import PLAIN_SHARE, Lens, Weather, draw_lens, draw_weather
from scenes.catalogue import CATALOGUE, CoverKind, TraversabilityGroup
from scenes.families import generate
from scenes.pose import Pose
from scenes.rays import Hits, RayScene
from scenes.scenario import Family, MovingObstacle, ObstacleKind, Scenario, ScenarioError
from scenes.sensors import CameraConfig, SemanticCamera
from scenes.stance import standing_pose
from scenes.terrain import SURFACE_GROUP, SURFACES, Heightmap
from scenes.traversability import near_cover

HALF = CameraConfig(width=160, height=120)
AIMED = 0.7
"""Share of the images that look at something in particular: each group as often, and in it each kind."""

NEAR, FAR_THINGS, FAR_GROUND, ASIDE = 1.2, 9.0, 5.0, math.radians(30.0)
TILT = math.radians(2.5)  # standard deviation of how the robot nods and sways besides the ground's slope
USUAL_LIGHT = Weather().level  # that a camera which adapts makes any other look like
LEAVES = (CoverKind.TREE.value, CoverKind.BUSH.value)


@dataclass(frozen=True, eq=False)
class Sample:
    """rgb : (120, 160, 3) uint8; groups : (120, 160) uint8 labels, as in `planner.ga_nav.groups`"""

    rgb: np.ndarray
    groups: np.ndarray


def samples(terrain: Family, seed: int, count: int = 10) -> list[Sample]:
    """`count` images of the scene of a seed; the same arguments give the same images.

    Raises ScenarioError where the terrain gives none.
    """
    rng = np.random.default_rng([seed, list(Family).index(terrain), 61])
    scenario = generate(terrain, seed, observers=2)
    heightmap = scenario.terrain.heightmap()
    rays = RayScene(heightmap, scenario.cover)
    free = ~near_cover(heightmap, scenario.cover, 0.6)
    targets = _targets(scenario, heightmap)
    taken = []
    for _ in range(count):
        pose = _place(rng, heightmap, free, targets)
        rays.set_walkers(_passers_by(rng, heightmap, pose), scenario.observers)
        plain = rng.random() < PLAIN_SHARE
        weather, lens = (Weather(), Lens()) if plain else (draw_weather(rng), draw_lens(rng))
        taken.append(photograph(rays, pose, weather, lens, rng))
    return taken


def photograph(rays: RayScene, pose: Pose, weather: Weather, lens: Lens, rng: np.random.Generator) -> Sample:
    """What the camera of a robot at `pose` (of the base, in the world) sees in that light by that lens."""
    camera = SemanticCamera(HALF)
    shape = HALF.height, HALF.width
    origin = pose.to_world(HALF.mount.position)
    directions = camera.directions @ pose.rows.astype(np.float32)
    ahead = HALF.mount.rotation[:, 0].astype(np.float32)
    hits = rays.cast(origin, directions, HALF.max_range / float((camera.directions @ ahead).min()))
    rgb, surface = render(rays, hits, origin, directions, weather, rng)
    groups = pixel_groups(hits.body, surface, rays.bodies)
    return Sample(_exposed(rgb.reshape(*shape, 3), weather, lens, rng), groups.reshape(shape))


def render(
    rays: RayScene, hits: Hits, origin: np.ndarray, directions: np.ndarray, weather: Weather, rng
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (n, 3) float, 0 to 255 and more, and surface codes (n,) int of what rays have hit.

    Lambert's law with coloured sun and sky, cast shadows, haze; a plain `Weather` gives what
    `scenes.shading` does.
    """
    met = hits.body >= 0
    points = origin + np.where(met, hits.distance, 0.0)[:, None] * directions
    surface = rays.heightmap.surface[rays.heightmap.cells(points[:, 0], points[:, 1])].astype(int)
    rgb = _sky(weather, directions)
    normal = hits.normal[met] / np.maximum(np.linalg.norm(hits.normal[met], axis=1, keepdims=True), 1e-9)
    normal *= -np.sign(np.einsum("ij,ij->i", normal, directions[met]))[:, None]
    facing = np.clip(normal @ weather.sun, 0.0, 1.0)
    if weather.shadows:
        facing *= _in_the_sun(rays, points[met] + 0.02 * normal, weather.sun)
    light = weather.skylight + facing[:, None] * weather.sunlight
    lit = _colours(rays, hits, met, surface[met], points[met], weather, rng) * light
    left = np.exp(-hits.distance[met] / weather.haze)[:, None]
    rgb[met] = left * lit + (1.0 - left) * weather.horizon
    return rgb, surface


def _colours(rays, hits: Hits, met, surface, points, weather: Weather, rng) -> np.ndarray:
    """(n, 3) colours of what was met before any light falls on it."""
    starts, table = rays.colours
    body, triangle = hits.body[met], hits.triangle[met]
    ground = body == 0
    colours = np.empty((len(body), 3))
    colours[ground] = weather.ground[surface[ground]]
    things = ~ground
    faces = table[starts[body[things]] + triangle[things]].astype(float)
    leafy = np.array([each.class_name in LEAVES for each in rays.bodies])[body[things]]
    leafy &= faces[:, 1] >= faces[:, 0]  # trunks are not
    faces[leafy] = weather.season.tinted(faces[leafy])
    differing = 1.0 + weather.variety * rng.standard_normal((len(rays.bodies), 1))
    differing = differing + 0.3 * weather.variety * rng.standard_normal((len(rays.bodies), 3))
    colours[things] = faces * differing[body[things]]
    if weather.mottle:
        colours[ground] *= 1.0 + weather.mottle * _mottle(points[ground], rng)[:, None]
    return colours


def _mottle(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) about -1 to 1, smooth over the ground in patches of half a metre to two."""
    total = np.zeros(len(points))
    for cell, weight in ((2.0, 0.6), (0.5, 0.4)):
        lattice = rng.uniform(-1.0, 1.0, (64, 64))
        place = (points[:, :2] / cell).T % 64
        total += weight * ndimage.map_coordinates(lattice, place, order=1, mode="grid-wrap")
    return total


def _in_the_sun(rays: RayScene, points: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """(n,) bool: whether nothing lies between points and the sun."""
    return rays.cast(points, np.tile(sun.astype(np.float32), (len(points), 1)), 60.0).body < 0


def _sky(weather: Weather, directions: np.ndarray) -> np.ndarray:
    up = np.clip(directions[:, 2:], 0.0, 1.0)
    return weather.horizon + (weather.zenith - weather.horizon) * np.sqrt(up)


def _exposed(rgb: np.ndarray, weather: Weather, lens: Lens, rng: np.random.Generator) -> np.ndarray:
    """(h, w, 3) uint8 of what the lens and its sensor make of colours, 0 to 255 and more, in that light."""
    balance = lens.exposure * np.array([1.0 + lens.warmth, 1.0, 1.0 - lens.warmth])
    balance *= (USUAL_LIGHT / weather.level) ** lens.adapting
    share = np.clip(rgb * balance / 255.0, 0.0, 1.0) ** lens.gamma
    if lens.blur:
        share = ndimage.gaussian_filter(share, (lens.blur, lens.blur, 0.0))
    if lens.grain or lens.shot:
        share = share + rng.standard_normal(share.shape) * np.hypot(lens.grain, lens.shot * np.sqrt(share))
    return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def _targets(scenario: Scenario, heightmap: Heightmap) -> list[list[tuple[np.ndarray, float]]]:
    """By group and, in it, by kind of cover or surface that there is: where it is, (k, 2) world points, and
    from how far it is looked at, metres."""
    found: dict[TraversabilityGroup, list[tuple[np.ndarray, float]]] = {}
    for kind in sorted({thing.kind for thing in scenario.cover}):
        places = np.array([(thing.x, thing.y) for thing in scenario.cover if thing.kind is kind])
        found.setdefault(CATALOGUE[kind].group, []).append((places, FAR_THINGS))
    x, y = heightmap.xy()
    for code, surface in enumerate(SURFACES):
        there = heightmap.surface == code
        if there.any():
            places = np.column_stack([x[there], y[there]])
            found.setdefault(SURFACE_GROUP[surface], []).append((places, FAR_GROUND))
    return [found[group] for group in GROUPS if group in found]


def _place(
    rng: np.random.Generator,
    heightmap: Heightmap,
    free: np.ndarray,
    targets: list[list[tuple[np.ndarray, float]]],
) -> Pose:
    """Somewhere free to stand: anywhere, or before one of the targets."""
    west, east, south, north = heightmap.bounds
    for _ in range(200):
        x, y = rng.uniform(west, east), rng.uniform(south, north)
        yaw = rng.uniform(-math.pi, math.pi)
        if rng.random() < AIMED:
            group = targets[rng.integers(len(targets))]
            places, far = group[rng.integers(len(group))]
            away = rng.uniform(NEAR, far)
            x, y = places[rng.integers(len(places))] - away * np.array([math.cos(yaw), math.sin(yaw)])
            yaw += rng.uniform(-ASIDE, ASIDE)
        inside = west + 1.0 < x < east - 1.0 and south + 1.0 < y < north - 1.0
        if inside and free[heightmap.cell(x, y)]:
            break
    else:
        raise ScenarioError("there is nowhere to stand on this ground")
    pose = standing_pose(heightmap, x, y, yaw)
    roll, pitch = rng.normal(0.0, TILT, 2)
    return replace(pose, roll=pose.roll + roll, pitch=pose.pitch + pitch)


def _passers_by(rng: np.random.Generator, heightmap: Heightmap, pose: Pose) -> list[MovingObstacle]:
    """Now and then a person or a vehicle before the camera."""
    west, east, south, north = heightmap.bounds
    passing = []
    for kind, chance in ((ObstacleKind.PERSON, 0.25), (ObstacleKind.VEHICLE, 0.15)):
        if rng.random() < chance:
            away, aside = rng.uniform(3.0, 14.0), pose.yaw + rng.uniform(-0.7, 0.7)
            x = float(np.clip(pose.x + away * math.cos(aside), west, east))
            y = float(np.clip(pose.y + away * math.sin(aside), south, north))
            fields = {"id": len(passing) + 1, "kind": kind, "x": x, "y": y, "yaw": rng.uniform(-180.0, 180.0)}
            passing.append(MovingObstacle.model_validate(fields))
    return passing
