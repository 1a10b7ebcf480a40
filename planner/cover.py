"""Cover: the paper's test whether the robot is in cover, what the robot remembers of the cover it has seen,
and which piece of it to make for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from planner.detection import Sighting
from planner.frames import CoverEstimate, Percept
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.robot import HUSKY

COVER_DISTANCE = 10.0
CONFIDENCE_THRESHOLD = 0.85

Place = tuple[float, float]
Eye = tuple[float, float, float]

_PAPER_CLASSES = frozenset(
    {"tree", "bush", "rock", "cottage", "building", "house", "disabled vehicle"}
    | {"trees", "bushes", "rocks", "cottages", "buildings", "houses", "disabled vehicles"}
)


@lru_cache(maxsize=256)
def is_cover_class(name: str) -> bool:
    """Whether Algorithm 1 counts this class: the paper's spellings, the catalogue's, in any case."""
    return " ".join(name.replace("_", " ").lower().split()) in _PAPER_CLASSES


def detect_cover(
    object_classes: Sequence[str],
    object_locations: Sequence[Sequence[float]],
    robot_location: Sequence[float],
    confidences: Sequence[float],
) -> bool:
    """Algorithm 1 of the paper: whether the nearest object of a cover class, detected with a confidence of
    at least 0.85, is within 10 m of the robot. O(N).

    object_classes : N names; object_locations : (N, 3) and robot_location : (3,) metres in one frame;
    confidences : N from 0 to 1
    Raises ValueError where lengths do not match or a number is not finite.
    """
    count = len(object_classes)
    if not count == len(object_locations) == len(confidences):
        raise ValueError(
            f"one location and one confidence for each object: got {count} classes, "
            f"{len(object_locations)} locations and {len(confidences)} confidences"
        )
    robot = _point(robot_location, "robot_location")
    cover_distance = math.inf
    for index in range(count):
        location = _point(object_locations[index], f"object_locations[{index}]")
        confidence = float(confidences[index])
        if not math.isfinite(confidence):
            raise ValueError(f"confidences[{index}] is {confidence}; it must be a number from 0 to 1")
        if not isinstance(object_classes[index], str):
            raise ValueError(f"object_classes[{index}] is {object_classes[index]!r}; it must be a class name")
        if is_cover_class(object_classes[index]) and confidence >= CONFIDENCE_THRESHOLD:
            cover_distance = min(cover_distance, math.dist(location, robot))
    return cover_distance <= COVER_DISTANCE


def _point(values: Sequence[float], name: str) -> tuple[float, ...]:
    point = tuple(float(value) for value in values)
    if len(point) != 3 or not all(math.isfinite(value) for value in point):
        raise ValueError(f"{name} is {point}; it must be three finite numbers: x, y, z in metres")
    return point


@dataclass
class CoverMemory:
    """Cover objects as the camera has shown them so far, by object id.

    A sighting moves an estimate the more, the surer it is; what should be in view but is looked through
    fades, and is forgotten below `forget`.
    """

    forget: float = 0.3
    _known: dict[int, CoverEstimate] = field(default_factory=dict)

    @property
    def estimates(self) -> tuple[CoverEstimate, ...]:
        return tuple(self._known[object_id] for object_id in sorted(self._known))

    def update(self, sightings: Iterable[Sighting], looked_through: Iterable[int] = ()) -> None:
        """Fuse the sightings of one image; `looked_through` are ids that the image shows to be gone."""
        for sighting in sightings:
            object_id = sighting.detection.object_id
            known = self._known.get(object_id)
            self._known[object_id] = _first(sighting) if known is None else _fused(known, sighting)
        for object_id in looked_through:
            known = self._known.get(object_id)
            if known is None:
                continue
            faded = 0.7 * known.confidence
            if faded < self.forget:
                del self._known[object_id]
            else:
                self._known[object_id] = _with_confidence(known, faded)


def _first(sighting: Sighting) -> CoverEstimate:
    seen = sighting.detection
    return CoverEstimate(
        seen.object_id, sighting.kind, seen.x_pos, seen.y_pos, seen.z_pos,
        sighting.width, sighting.height, seen.confidence,
    )


def _fused(known: CoverEstimate, sighting: Sighting) -> CoverEstimate:
    """Nearer is surer: the share that the new sighting gets grows with its confidence. Sizes only grow, for
    what hides or cuts off a part of an object makes it look smaller, never larger."""
    seen = sighting.detection
    share = 0.5 * seen.confidence**2

    def blend(old: float, new: float) -> float:
        return old + share * (new - old)

    return CoverEstimate(
        known.object_id, sighting.kind,
        blend(known.x, seen.x_pos), blend(known.y, seen.y_pos), blend(known.z, seen.z_pos),
        max(known.width, sighting.width), max(known.height, sighting.height),
        blend(known.confidence, seen.confidence),
    )


def _with_confidence(known: CoverEstimate, confidence: float) -> CoverEstimate:
    return CoverEstimate(
        known.object_id, known.kind, known.x, known.y, known.z, known.width, known.height, confidence
    )


@dataclass(frozen=True)
class CoverChoice:
    """A piece of cover to make for: `spot` (x, y) is where to stand, `hidden_from` counts the eyes that
    cannot see a robot there, `score` is higher for better."""

    cover: CoverEstimate
    spot: Place
    hidden_from: int
    score: float


def choose_cover(
    cover: Sequence[CoverEstimate],
    robot: Place,
    goal: Place,
    eyes: Sequence[Eye] = (),
    *,
    max_distance: float = 15.0,
) -> CoverChoice | None:
    """The best cover by distance, size and visibility; None where none within `max_distance` can hide the
    robot with enough confidence.

    cover : what is known; robot, goal : world x, y; eyes : world x, y, z of the observers that are known

    The spot lies behind the cover as the nearest eye sees it, at a body's distance; with no eye known, on
    the side of the robot. The score sums a term each, from 0 to 1, for nearness, for being on the way, for
    the width that the cover hides against the robot's, and, doubled, for the share of eyes it hides from.
    """
    best: CoverChoice | None = None
    for candidate in cover:
        distance = math.dist(robot, (candidate.x, candidate.y))
        if candidate.confidence < CONFIDENCE_THRESHOLD or distance > max_distance:
            continue
        entry = CATALOGUE[candidate.kind]
        if not entry.conceals(candidate.width, candidate.height, HUSKY.width, HUSKY.height):
            continue
        choice = _rated(candidate, robot, goal, eyes, max_distance)
        if best is None or choice.score > best.score:
            best = choice
    return best


def best_cover(percept: Percept) -> int | None:
    """Id of the cover that `choose_cover` picks for what the robot knows; None where there is none."""
    robot = (percept.pose.x, percept.pose.y)
    choice = choose_cover(percept.cover, robot, percept.goal, percept.observer_eyes)
    return None if choice is None else choice.cover.object_id


def _rated(
    candidate: CoverEstimate, robot: Place, goal: Place, eyes: Sequence[Eye], max_distance: float
) -> CoverChoice:
    centre = (candidate.x, candidate.y)
    spot = _spot_behind(candidate, robot, eyes)
    hidden = sum(_hides(candidate, eye, spot) for eye in eyes)
    visibility = hidden / len(eyes) if eyes else 0.0
    detour = math.dist(robot, spot) + math.dist(spot, goal) - math.dist(robot, goal)
    nearness = max(1.0 - math.dist(robot, centre) / max_distance, 0.0)
    on_the_way = 1.0 / (1.0 + detour / 3.0)
    size = min(candidate.width / (3.0 * HUSKY.length), 1.0)
    return CoverChoice(candidate, spot, hidden, nearness + on_the_way + size + 2.0 * visibility)


def _spot_behind(candidate: CoverEstimate, robot: Place, eyes: Sequence[Eye]) -> Place:
    centre = (candidate.x, candidate.y)
    stand_off = 0.5 * candidate.width + HUSKY.length
    if candidate.kind is CoverKind.TREE:
        stand_off = 2.0 * HUSKY.length  # the crown is above: under it, behind the trunk
    source = min(eyes, key=lambda eye: math.dist(eye[:2], centre)) if eyes else None
    dx, dy = (
        (centre[0] - source[0], centre[1] - source[1])
        if source is not None
        else (robot[0] - centre[0], robot[1] - centre[1])
    )
    length = math.hypot(dx, dy) or 1.0
    return centre[0] + stand_off * dx / length, centre[1] + stand_off * dy / length


def _hides(candidate: CoverEstimate, eye: Eye, spot: Place) -> bool:
    """Whether the cover, taken as an upright screen, stands between the eye and a robot at the spot."""
    to_cover = math.dist(eye[:2], (candidate.x, candidate.y))
    to_spot = math.dist(eye[:2], spot)
    if to_cover < 1e-6 or to_spot <= to_cover:
        return False
    direction = ((spot[0] - eye[0]) / to_spot, (spot[1] - eye[1]) / to_spot)
    offset = (candidate.x - eye[0], candidate.y - eye[1])
    aside = abs(direction[0] * offset[1] - direction[1] * offset[0])
    shadow = eye[2] + (candidate.z + candidate.height - eye[2]) * to_spot / to_cover
    covered = aside + 0.5 * HUSKY.width * to_cover / to_spot <= 0.5 * candidate.width
    return covered and shadow >= candidate.z + HUSKY.height
