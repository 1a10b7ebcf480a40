"""Detections from the camera's mask: what is reported, where, how surely, and what is ignored or missed."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vlp16 import ground, standing, thing

from planner.detection import detect, looked_through, sight
from planner.mask_kernel import masks, medians
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import MovingObstacle, Observer, ObstacleKind
from scenes.sensors import SemanticCamera

CONCEALING = [kind for kind in CoverKind if kind is not CoverKind.FENCE]


class Scene:
    """A camera on a robot at the origin that looks along x over flat ground."""

    def __init__(self, *cover, pose=None, **walkers):
        heightmap = ground()
        self.rays = RayScene(heightmap, cover)
        self.rays.set_walkers(**walkers)
        self.pose = pose or standing(heightmap, 0.0, 0.0)
        self.image = SemanticCamera().capture(self.rays, self.pose, np.random.default_rng(0))

    def detect(self, seed=0):
        return detect(self.image, self.rays.bodies, self.pose, 7, np.random.default_rng(seed))

    def often(self, times=60):
        """Detections over many draws of what the simulated network makes of one image."""
        rng = np.random.default_rng(1)
        return [detect(self.image, self.rays.bodies, self.pose, 0, rng) for _ in range(times)]


@pytest.mark.parametrize("kind", CONCEALING)
def test_every_kind_of_cover_is_reported_as_the_listing_has_it(kind):
    (found,) = Scene(thing(kind, 9.0, 1.0, id=42)).detect()
    assert (found.frame_id, found.object_id) == (7, 42)
    assert (found.class_id, found.class_name) == (CATALOGUE[kind].class_id, CATALOGUE[kind].class_name)
    assert 0 <= found.x_min < found.x_max < 320
    assert 0 <= found.y_min < found.y_max < 240
    assert set(found.kpts) == {(u, v) for u in (found.x_min, found.x_max) for v in (found.y_min, found.y_max)}
    assert all(math.isfinite(value) for value in (found.x_pos, found.y_pos, found.z_pos))
    assert 0.0 < found.confidence < 1.0


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
@pytest.mark.parametrize(
    ("kind", "within"), [("bush", 0.4), ("tree", 0.8), ("rock", 0.5), ("disabled_vehicle", 1.5)]
)
def test_positions_are_in_the_world(kind, within, yaw):
    x, y = 3.0 + 8.0 * math.cos(yaw), -2.0 + 8.0 * math.sin(yaw)
    (found,) = Scene(thing(kind, x, y), pose=Pose(3.0, -2.0, 0.0, yaw=yaw)).detect()
    assert math.hypot(found.x_pos - x, found.y_pos - y) < within
    assert abs(found.z_pos) < 0.6


def test_what_cannot_hide_the_robot_is_ignored():
    small = thing("rock", 5.0, 0.0, length=0.4, width=0.4, height=0.25)
    assert not any(Scene(small).often(20))


def test_a_fence_hides_nothing_and_is_ignored():
    assert not any(Scene(thing("fence", 6.0, 0.0, yaw=90.0)).often(20))


def test_people_and_the_ground_are_no_cover():
    person = MovingObstacle(id=3, kind=ObstacleKind.PERSON, x=5.0, y=0.0)
    observer = Observer(id=4, x=6.0, y=1.0)
    assert Scene(obstacles=[person], observers=[observer]).detect() == ()


def test_behind_the_robot_nothing_is_seen():
    assert Scene(thing("house", -12.0, 0.0)).detect() == ()


def mean_confidence(scene):
    return np.mean([found.confidence for image in scene.often() for found in image])


def test_confidence_falls_with_distance_across_the_threshold():
    near, middle, far = (mean_confidence(Scene(thing("house", x, 0.0))) for x in (10.0, 14.0, 20.0))
    assert near > middle > far
    assert near > 0.88
    assert far < 0.85


def test_confidence_falls_with_few_pixels():
    assert mean_confidence(Scene(thing("bush", 15.0, 0.0))) < mean_confidence(
        Scene(thing("house", 15.0, 0.0))
    )


def test_confidence_falls_when_something_stands_before_it():
    hidden = Scene(
        thing("cottage", 12.0, 0.0), thing("rock", 6.0, 0.0, id=2, length=2.0, width=2.0, height=2.0)
    )
    of_cottage = [f.confidence for image in hidden.often() for f in image if f.object_id == 1]
    assert np.mean(of_cottage) < mean_confidence(Scene(thing("cottage", 12.0, 0.0))) - 0.02


def test_what_is_hard_to_see_is_missed_more_often():
    def misses(scene):
        return np.mean([not found for found in scene.often()])

    assert misses(Scene(thing("bush", 6.0, 0.0))) < 0.05
    assert misses(Scene(thing("bush", 18.0, 0.0))) > 0.05


def test_the_same_draws_give_the_same_detections():
    scene = Scene(thing("bush", 6.0, 1.0), thing("rock", 9.0, -2.0, id=2))
    assert scene.detect(seed=5) == scene.detect(seed=5) != scene.detect(seed=6)


def test_the_size_is_what_mask_and_depth_give():
    bush = thing("bush", 8.0, 0.0, length=2.0, width=2.0, height=1.4)
    scene = Scene(bush)
    (seen,) = sight(scene.image, scene.rays.bodies, scene.pose, 0, np.random.default_rng(0))
    assert seen.width == pytest.approx(2.0, abs=0.35)
    assert seen.height == pytest.approx(1.4, abs=0.35)


def test_a_place_is_looked_through_only_when_something_farther_shows_there():
    scene = Scene(thing("house", 14.0, 0.0))
    places = {
        1: (6.0, 0.0, 0.5),  # before the house: gone
        2: (14.0, 0.0, 1.0),  # the house itself
        3: (19.0, 0.0, 1.0),  # behind the house
        4: (-6.0, 0.0, 0.5),  # behind the robot
        7: (0.4, 0.0, 0.6),  # too near to tell
        5: (6.0, 20.0, 0.5),  # beside the image
        6: (6.0, 0.0, 30.0),  # above the image
    }
    found = looked_through(scene.image, [(k, np.array(p)) for k, p in places.items()], scene.pose)
    assert found == (1,)


def test_an_empty_view_looks_past_near_places_and_says_nothing_of_far_ones():
    scene = Scene()
    blank = replace(scene.image, depth=np.full_like(scene.image.depth, np.nan))
    places = [(1, np.array([6.0, 0.0, 0.5])), (2, np.array([19.0, 0.0, 0.5]))]
    assert looked_through(blank, places, scene.pose) == (1,)


def plain_masks(body, depth, wanted, min_pixels, samples):
    """The kernel's answers, mask by mask."""
    for label in np.flatnonzero(wanted):
        pixels = np.flatnonzero(body.ravel() == label)
        if len(pixels) < min_pixels:
            continue
        rows, cols = np.divmod(pixels, body.shape[1])
        chosen = pixels[:: math.ceil(len(pixels) / samples)]
        middle = float(np.median(depth.ravel()[chosen]))
        box = (label, cols.min(), cols.max(), rows.min(), rows.max())
        thinned = tuple(slice(a, b + 1, max((b - a) // 20, 1)) for a, b in (box[3:], box[1:3]))
        before = (body[thinned] != label) & (depth[thinned] < np.float32(middle - 0.5))
        yield box, len(pixels), middle, before.mean(), chosen, pixels[-5:]


@given(st.integers(0, 10_000), st.integers(5, 60), st.integers(4, 50))
def test_the_masks_are_measured_as_their_plain_twin_has_it(seed, blocks, samples):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(-1, 6, (blocks // 4 + 1, blocks // 3 + 1))
    body = np.repeat(np.repeat(coarse, 5, axis=0), 7, axis=1).astype(np.int32)
    body[rng.random(body.shape) < 0.2] = rng.integers(-1, 6)
    depth = rng.uniform(1.0, 9.0, body.shape).astype(np.float32)
    depth[body < 0] = np.nan
    wanted = rng.random(6) < 0.8
    boxes, counts, middles, hidden, pixels, begins, lowest = masks(body, depth, wanted, 12, samples)
    plain = list(plain_masks(body, depth, wanted, 12, samples))
    assert len(boxes) == len(plain)
    for m, (box, count, middle, before, chosen, last) in enumerate(plain):
        assert (tuple(boxes[m]), counts[m], middles[m], hidden[m]) == (box, count, middle, before)
        np.testing.assert_array_equal(pixels[begins[m] : begins[m + 1]], chosen)
        np.testing.assert_array_equal(lowest[m], last)


@given(st.integers(0, 10_000), st.lists(st.integers(1, 30), min_size=1, max_size=6))
def test_medians_of_stretches_are_those_of_numpy(seed, lengths):
    begins = np.cumsum([0, *lengths])
    values = np.random.default_rng(seed).normal(size=(begins[-1], 3))
    plain = [np.median(part, axis=0) for part in np.split(values, begins[1:-1])]
    np.testing.assert_array_equal(medians(values, begins), plain)
