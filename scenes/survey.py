"""Import real measurements as a scenario: GeoTIFF elevation models, LAS and LAZ laser surveys."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from scenes.georeference import RESOLUTION_LIMITS
from scenes.geotiff import read_geotiff
from scenes.ground import MISSING, SurveyGround, connected
from scenes.lidar_survey import ground_from_points
from scenes.point_cloud import read_points
from scenes.robot import HUSKY
from scenes.scenario import (
    MAX_COVER,
    CoverObject,
    Point,
    Scenario,
    ScenarioError,
    Start,
    SurveySource,
    Terrain,
    first_message,
)
from scenes.terrain import MAX_HEIGHT, QUALITIES, SURFACES, Heightmap, Quality, Surface
from scenes.traversability import DRIVING_CLEARANCE, blocked_cells, reachable
from scenes.tree_tops import standing_objects

TIFF_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
MAX_FILE_BYTES = 2 * 2**30
VERTICAL_SCALES = (0.01, 100.0)
GOAL_DISTANCES = (12.0, 15.0)
GENTLE_SLOPE = math.radians(14.0)
ROOM_TO_TURN = HUSKY.circumscribed_radius + 0.1
MAX_STARTS = 400
HEADINGS = 24


def import_survey(
    path: str | os.PathLike[str],
    *,
    crop: tuple[float, float, float] | None = None,
    resolution: float | None = None,
    vertical_scale: float = 1.0,
    name: str | None = None,
    seed: int = 0,
) -> Scenario:
    """A scenario with the survey's ground, water, plants and buildings, and a reachable start and goal.

    path : GeoTIFF, LAS or LAZ, told apart by content
    crop : (x, y, size): the square of `size` metres about (x, y); x and y are the survey's easting and
        northing (its own units; local UTM for geographic systems), or its native longitude and latitude,
        or, where neither lies in the survey, metres east and north of its middle
    resolution : metres between samples; by default what the measurements deserve, 0.25 to 2 m
    vertical_scale : factor on every height, of the ground and of what stands on it
    seed : breaks ties between equally good starts
    Raises ScenarioError with one line that names the file and what would be right.
    """
    path = Path(path)
    try:
        _check_wishes(crop, resolution, vertical_scale)
        ground, cover = _read(path, crop, resolution)
        return _scenario(path, ground, cover, vertical_scale, name, np.random.default_rng(seed))
    except ScenarioError as error:
        raise ScenarioError(f"{path.name}: {error}") from error.__cause__
    except ValidationError as error:
        raise ScenarioError(f"{path.name}: {first_message(error)}") from None
    except OSError as error:
        raise ScenarioError(f"{path.name}: cannot be read: {error.strerror or error}") from None


def _check_wishes(crop, resolution, vertical_scale) -> None:
    low, high = RESOLUTION_LIMITS
    if resolution is not None and not low <= resolution <= high:
        raise ScenarioError(f"the resolution must be {low:g} to {high:g} m, not {resolution:g}")
    low, high = VERTICAL_SCALES
    if not low <= vertical_scale <= high:
        raise ScenarioError(f"the vertical scale must be {low:g} to {high:g}, not {vertical_scale:g}")
    if crop is not None and not (all(map(math.isfinite, crop)) and crop[2] > 0.0):
        raise ScenarioError("the crop must be three finite numbers, x, y and a size in metres above zero")


def _read(path: Path, crop, resolution) -> tuple[SurveyGround, list[CoverObject]]:
    size = path.stat().st_size
    if not path.is_file():
        raise ScenarioError("is not a file")
    if size > MAX_FILE_BYTES:
        raise ScenarioError(f"is {size / 2**30:.1f} GiB; at most {MAX_FILE_BYTES >> 30} GiB can be imported")
    with path.open("rb") as stream:
        magic = stream.read(4)
    if magic in TIFF_MAGIC:
        return read_geotiff(path, crop, resolution), []
    if magic == b"LASF":
        cloud = read_points(path, crop)
        ground = ground_from_points(cloud, resolution)
        return ground, standing_objects(cloud, ground)
    raise ScenarioError("is neither GeoTIFF nor LAS/LAZ, going by its first bytes")


def _scenario(
    path: Path,
    ground: SurveyGround,
    cover: list[CoverObject],
    vertical_scale: float,
    name: str | None,
    rng: np.random.Generator,
) -> Scenario:
    known = ground.heights[ground.quality != MISSING]
    if not known.size:
        raise ScenarioError(
            "has no ground that is known: what was measured lies too far apart to tell what is between;"
            " choose a part with more returns of the ground"
        )
    zero = float(known.min())
    heights = np.round((ground.heights - zero) * vertical_scale, 3)
    if float(heights.max()) > MAX_HEIGHT:
        raise ScenarioError(
            f"its relief is {heights.max():.0f} m, over {MAX_HEIGHT:.0f} m: lower the vertical scale"
        )
    heightmap = Heightmap(heights, ground.grid.resolution, ground.surface, ground.quality)
    left_out = max(0, len(cover) - MAX_COVER)
    scaled = tuple(_raised(thing, vertical_scale) for thing in cover[:MAX_COVER])
    start, goal = start_and_goal(heightmap, scaled, rng)
    return Scenario(
        version=1,
        name=_plain(name or path.stem)[:80] or "survey",
        description=_description(path, heightmap, scaled, left_out),
        terrain=Terrain(
            resolution=ground.grid.resolution,
            heights=heights,
            surface=heightmap.surface_symbols(),
            quality=heightmap.quality_symbols(),
            source=SurveySource(
                file=_plain(path.name)[:80] or "survey",
                crs=ground.reference.label,
                easting=float(ground.grid.easting),
                northing=float(ground.grid.northing),
                elevation=zero,
                vertical_scale=float(vertical_scale),
            ),
        ),
        start=start,
        goal=goal,
        cover=scaled,
    )


def _raised(thing: CoverObject, vertical_scale: float) -> CoverObject:
    if vertical_scale == 1.0:
        return thing
    height = min(max(thing.height * vertical_scale, 0.05), 60.0)
    return thing.model_copy(update={"height": round(height, 2)})


def _plain(text: str) -> str:
    """Without the characters that a scenario's names may not hold."""
    return "".join(c for c in text if c not in "<>" and ord(c) >= 32).encode("utf-8", "ignore").decode()


def _description(
    path: Path, heightmap: Heightmap, cover: tuple[CoverObject, ...], left_out: int
) -> str:
    share = {q: 100.0 * float((heightmap.quality == i).mean()) for i, q in enumerate(QUALITIES)}
    water = 100.0 * float((heightmap.surface == SURFACES.index(Surface.WATER)).mean())
    kinds = {kind: sum(c.kind == kind for c in cover) for kind in sorted({c.kind for c in cover})}
    found = ", ".join(f"{count} {kind}{'es' if kind == 'bush' and count > 1 else 's' * (count > 1)}"
                       for kind, count in kinds.items())  # fmt: skip
    text = (
        f"Imported from {_plain(path.name)[:120]}. Ground measured in {share[Quality.MEASURED]:.0f} % of the "
        f"cells, interpolated in {share[Quality.INTERPOLATED]:.0f} %, missing in "
        f"{share[Quality.MISSING]:.0f} %; water on {water:.0f} %. "
        f"Standing on it: {found or 'nothing'}."
    )
    if left_out:
        text += f" The {left_out} lowest objects were left out: a scenario holds the {MAX_COVER} tallest."
    return text


def start_and_goal(
    heightmap: Heightmap, cover: tuple[CoverObject, ...], rng: np.random.Generator
) -> tuple[Start, Point]:
    """A start near the middle and a goal 12 to 15 m away that the Husky can reach, both on gentle, dry
    ground that is not missing, with room to turn on the way if there is such a way.
    Raises ScenarioError where there is no such pair."""
    for clearance in (ROOM_TO_TURN, DRIVING_CLEARANCE):
        pair = _reachable_pair(heightmap, cover, clearance, rng)
        if pair is not None:
            return pair
    raise ScenarioError(
        f"has no start and goal {GOAL_DISTANCES[0]:g} m apart that a Husky could drive between on dry, "
        "known ground: choose another or a larger part of the survey"
    )


def _reachable_pair(
    heightmap: Heightmap, cover: tuple[CoverObject, ...], clearance: float, rng: np.random.Generator
) -> tuple[Start, Point] | None:
    open_ground = ~blocked_cells(heightmap, cover, clearance)
    patches, _ = connected(open_ground, corners=False)
    free = open_ground & (heightmap.slope <= GENTLE_SLOPE) & (heightmap.quality != MISSING)
    free &= heightmap.surface != SURFACES.index(Surface.WATER)
    x, y = heightmap.xy()
    rows, cols = np.nonzero(free)
    order = np.argsort(np.hypot(x[rows, cols], y[rows, cols]), kind="stable")
    order = order[:: max(1, len(rows) // MAX_STARTS)]
    first = float(rng.uniform(-math.pi, math.pi))
    for index in order:
        sx, sy = float(x[rows[index], cols[index]]), float(y[rows[index], cols[index]])
        for distance in GOAL_DISTANCES:
            for heading in first + 2.0 * math.pi * np.arange(HEADINGS) / HEADINGS:
                gx, gy = sx + distance * math.cos(heading), sy + distance * math.sin(heading)
                if not (heightmap.contains(gx, gy) and free[heightmap.cell(gx, gy)]):
                    continue
                row, col = heightmap.cell(gx, gy)
                if patches[row, col] != patches[rows[index], cols[index]]:
                    continue
                gx, gy = float(x[row, col]), float(y[row, col])
                if reachable(heightmap, cover, (sx, sy), (gx, gy), clearance):
                    yaw = math.degrees(math.atan2(gy - sy, gx - sx))
                    return Start(x=sx, y=sy, yaw=round(yaw, 1)), Point(x=gx, y=gy)
    return None
