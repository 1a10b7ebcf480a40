"""Detections in the form of the paper's Listing 1, from a semantic camera's instance mask.

The mask stands in for a segmentation network. What such a network does badly is simulated: confidence falls
with distance, with few pixels and with what is cut off or hidden, and what is hard to see is often missed.
The paper's listing has y_min above y_max, a confidence of 1.0 always and positions in the camera's frame;
here boxes are sorted, 0.85 means something, and positions are in the world.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from planner.frames import Detection
from planner.mask_kernel import masks, medians
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
    """The detections of `sight` that Listing 1 has."""
    return listed(sight(image, bodies, pose_world_base, frame_id, rng))


def listed(sightings: Iterable[Sighting]) -> tuple[Detection, ...]:
    """The detections of cover that can hide the robot; one sees through a fence."""
    return tuple(s.detection for s in sightings if CATALOGUE[s.kind].opaque)


def sight(
    image: CameraImage, bodies: Sequence[Body], pose_world_base: Pose, frame_id: int, rng: np.random.Generator
) -> tuple[Sighting, ...]:
    """Cover objects in one image, in the order of `bodies`, which the mask's labels index; the robot that
    took it stands at `pose_world_base`.

    Objects too small, as they appear, to hide the robot are ignored. The position is
    the median of the mask's points, moved on along the view by half of what the object is wide (at most
    half of what its class usually is), for only its near face is seen; z is that of its lowest pixels.
    Each object that is judged draws twice from `rng`, whether it is missed or not.
    """
    cover = np.array([body.kind is BodyKind.COVER for body in bodies])
    boxes, counts, depths, hidden, pixels, begins, lowest = masks(
        image.body, image.depth, cover, MIN_PIXELS, SAMPLES
    )
    found, places = [], []
    measured = zip(boxes.tolist(), counts.tolist(), depths.tolist(), hidden.tolist(), strict=True)
    for index, ((label, left, right, top, bottom), count, depth, share) in enumerate(measured):
        mask = _Mask(bodies[label], (left, right), (top, bottom), count, depth, share)
        confidence = _judged(image, mask, rng)
        if confidence is not None:
            found.append((mask, confidence))
            places += [pixels[begins[index] : begins[index + 1]], lowest[index]]
    if not found:
        return ()
    points = pose_world_base.to_world(
        image.points_body(*np.divmod(np.concatenate(places), image.intrinsics.width))
    )
    middles = medians(points, np.cumsum([0, *map(len, places)]))
    return tuple(
        _sighting(image, mask, confidence, face[:2], float(foot[2]), pose_world_base, frame_id)
        for (mask, confidence), face, foot in zip(found, middles[::2], middles[1::2], strict=True)
    )


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


@dataclass(frozen=True)
class _Mask:
    """An object's pixels in the image: their first and last column and row, how many they are, their median
    depth in metres, and the share of the box where something stands before it."""

    body: Body
    across: tuple[int, int]
    down: tuple[int, int]
    pixels: int
    depth: float
    hidden: float

    def size(self, image: CameraImage) -> tuple[float, float]:
        """Width and height in metres."""
        return (
            (self.across[1] - self.across[0] + 1) * self.depth / image.intrinsics.fx,
            (self.down[1] - self.down[0] + 1) * self.depth / image.intrinsics.fy,
        )

    def cuts(self, image: CameraImage) -> tuple[bool, bool]:
        """Whether the image's edge cuts it off in width and in height."""
        return (
            self.across[0] == 0 or self.across[1] == image.intrinsics.width - 1,
            self.down[0] == 0 or self.down[1] == image.intrinsics.height - 1,
        )


def _judged(image: CameraImage, mask: _Mask, rng: np.random.Generator) -> float | None:
    """The confidence in an object, None where it is ignored or missed."""
    (width, height), (cut_wide, cut_high) = mask.size(image), mask.cuts(image)
    # What the image's edge cuts off may be large: a cut side is not held against the object.
    wide, high = max(width, HUSKY.width * cut_wide), max(height, HUSKY.height * cut_high)
    if wide < HUSKY.width or high < HUSKY.height:
        return None
    return _confidence(mask.depth, mask.pixels, cut_wide + cut_high, mask.hidden, rng)


def _sighting(
    image: CameraImage,
    mask: _Mask,
    confidence: float,
    middle: np.ndarray,
    z: float,
    pose: Pose,
    frame_id: int,
) -> Sighting:
    """middle : (2,) of the near face that shows, in the world; z : of its lowest pixels"""
    body, kind = mask.body, _KINDS[mask.body.class_id]
    width, height = mask.size(image)
    x, y = _position(middle, kind, width, pose.position)
    across, down = mask.across, mask.down
    corners = tuple((float(u), float(v)) for u in across for v in down)
    detection = Detection(
        frame_id, body.class_id, body.class_name, confidence,
        float(across[0]), float(down[0]), float(across[1]), float(down[1]), body.id, x, y, z, corners,
    )  # fmt: skip
    return Sighting(detection, kind, width, height)


def _position(middle: np.ndarray, kind: CoverKind, width: float, robot: np.ndarray) -> tuple[float, float]:
    """Where an object is whose near face has its middle (2,) there, to a robot at (3,)."""
    view = middle - robot[:2]
    behind = 0.5 * min(width, CATALOGUE[kind].width.usual)
    middle = middle + behind * view / max(float(np.hypot(*view)), 1e-6)
    return float(middle[0]), float(middle[1])


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
