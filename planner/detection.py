"""Detections in the form of the paper's Listing 1, from a semantic camera's instance mask.

The mask stands in for a segmentation network. What such a network does badly is simulated: confidence falls
with distance, with few pixels and with what is cut off or hidden, and what is hard to see is often missed.
The paper's listing has y_min above y_max, a confidence of 1.0 always and positions in the camera's frame;
here boxes are sorted, 0.85 means something, and positions are in the world.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from planner.frames import Detection
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.pose import Pose
from scenes.rays import Body, BodyKind
from scenes.robot import HUSKY
from scenes.sensors import CameraImage

MIN_PIXELS = 12
SURE_RANGE, PAST = 15.0, 1.5  # metres: places that must show if they are there; how much farther is past them
SAMPLES = 200  # pixels of a mask that its position is taken from, at most

_KINDS = {entry.class_id: entry.kind for entry in CATALOGUE.values()}


@dataclass(frozen=True)
class Sighting:
    """A detection with the size, metres, that its mask and depth give."""

    detection: Detection
    kind: CoverKind
    width: float
    height: float


def detect(
    image: CameraImage, bodies: Sequence[Body], pose_world_base: Pose, frame_id: int, rng: np.random.Generator
) -> tuple[Detection, ...]:
    """The detections of `sight` alone, as in Listing 1."""
    return tuple(s.detection for s in sight(image, bodies, pose_world_base, frame_id, rng))


def sight(
    image: CameraImage, bodies: Sequence[Body], pose_world_base: Pose, frame_id: int, rng: np.random.Generator
) -> tuple[Sighting, ...]:
    """Cover objects in one image, in the order of `bodies`, which the mask's labels index; the robot that
    took it stands at `pose_world_base`.

    Objects that cannot hide the robot by their apparent size or their class are ignored. The position is
    the median of the mask's points, moved on along the view by half of what the object is wide (at most
    half of what its class usually is), for only its near face is seen; z is that of its lowest pixels.
    Each object that is judged draws twice from `rng`, whether it is missed or not.
    """
    found = (
        _sighting(image, body, pixels, pose_world_base, frame_id, rng)
        for body, pixels in _masks(image, bodies)
    )
    return tuple(sighting for sighting in found if sighting is not None)


def looked_through(
    image: CameraImage, places: Sequence[tuple[int, np.ndarray]], pose_world_base: Pose
) -> tuple[int, ...]:
    """Ids of the places (id, world point) that the image looks past, so that what stood there is gone:
    their pixel shows something clearly farther away, or nothing within the camera's range."""
    height, width = image.depth.shape
    lens, camera = image.intrinsics, pose_world_base.compose(image.pose)
    gone = []
    for object_id, point in places:
        ahead, left, up = (point - camera.position) @ camera.rotation
        if not 0.5 < ahead < SURE_RANGE:
            continue
        col, row = round(lens.cx - lens.fx * left / ahead), round(lens.cy - lens.fy * up / ahead)
        if 0 <= col < width and 0 <= row < height and not image.depth[row, col] <= ahead + PAST:
            gone.append(object_id)
    return tuple(gone)


def _masks(image: CameraImage, bodies: Sequence[Body]) -> Iterator[tuple[Body, np.ndarray]]:
    """Each cover object in the image with its pixels, as ascending indices into the flattened image."""
    cover = np.array([*(body.kind is BodyKind.COVER for body in bodies), False])
    labels = image.body.ravel()
    pixels = np.flatnonzero(cover[labels])
    order = np.argsort(labels[pixels].astype(np.uint16), kind="stable")
    pixels = pixels[order]
    borders = np.flatnonzero(np.diff(labels[pixels])) + 1
    for mask in np.split(pixels, borders):
        if len(mask) >= MIN_PIXELS:
            yield bodies[int(labels[mask[0]])], mask


def _sighting(
    image: CameraImage, body: Body, pixels: np.ndarray, pose: Pose, frame_id: int, rng: np.random.Generator
) -> Sighting | None:
    rows, cols = np.divmod(pixels, image.intrinsics.width)
    x_min, x_max, y_min, y_max = int(cols.min()), int(cols.max()), int(rows[0]), int(rows[-1])
    sample = slice(None, None, -(-len(pixels) // SAMPLES))
    rows, cols = rows[sample], cols[sample]
    depth = _median(image.depth[rows, cols])
    width = (x_max - x_min + 1) * depth / image.intrinsics.fx
    height = (y_max - y_min + 1) * depth / image.intrinsics.fy
    cut_wide = x_min == 0 or x_max == image.intrinsics.width - 1
    cut_high = y_min == 0 or y_max == image.intrinsics.height - 1
    # What the image's edge cuts off may be large: a cut side is not held against the object.
    wide, high = max(width, HUSKY.width * cut_wide), max(height, HUSKY.height * cut_high)
    kind = _KINDS[body.class_id]
    if not CATALOGUE[kind].conceals(wide, high, HUSKY.width, HUSKY.height):
        return None
    box = _thinned(y_min, y_max), _thinned(x_min, x_max)
    before = (image.body[box] != body.index) & (image.depth[box] < depth - 0.5)
    hidden = np.count_nonzero(before) / before.size
    confidence = _confidence(depth, len(pixels), cut_wide + cut_high, hidden, rng)
    if confidence is None:
        return None
    x, y = _position(pose.to_world(image.points_body(rows, cols)), kind, width, pose.position)
    lowest = np.divmod(pixels[-5:], image.intrinsics.width)
    z = _median(pose.to_world(image.points_body(*lowest))[:, 2])
    corners = tuple((float(u), float(v)) for u in (x_min, x_max) for v in (y_min, y_max))
    detection = Detection(
        frame_id, body.class_id, body.class_name, confidence,
        float(x_min), float(y_min), float(x_max), float(y_max), body.id, x, y, z, corners,
    )
    return Sighting(detection, kind, width, height)


def _thinned(first: int, last: int) -> slice:
    """About twenty of the pixels from first to last."""
    return slice(first, last + 1, max((last - first) // 20, 1))


def _position(points: np.ndarray, kind: CoverKind, width: float, robot: np.ndarray) -> tuple[float, float]:
    """Where an object is whose near face shows world `points` (n, 3) to a robot at (3,)."""
    middle = np.array([_median(points[:, 0]), _median(points[:, 1])])
    view = middle - robot[:2]
    behind = 0.5 * min(width, CATALOGUE[kind].width.usual)
    middle = middle + behind * view / max(float(np.hypot(*view)), 1e-6)
    return float(middle[0]), float(middle[1])


def _median(values: np.ndarray) -> float:
    """As `numpy.median`, which takes five times as long over the few numbers of a mask."""
    ordered, half = np.sort(values), len(values) // 2
    return float(ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2)


def _confidence(
    depth: float, pixels: int, cuts: int, hidden: float, rng: np.random.Generator
) -> float | None:
    """Simulated confidence, or None for a miss. About 0.96 for a large object in full view within 5 m,
    0.85 at 14 m, less when it is small, cut off or hidden."""
    few = max(1.0 - pixels / 200.0, 0.0)
    quality = 0.97 - 0.012 * max(depth - 5.0, 0.0) - 0.25 * few - 0.03 * cuts - 0.3 * hidden
    noise, chance = 0.025 * rng.standard_normal(), rng.random()
    if chance < 0.01 + 0.5 * max(0.95 - quality, 0.0) ** 1.5:
        return None
    return float(np.clip(quality + noise, 0.05, 0.999))
