"""What the robot's own map says of who sees it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maps import grid_map, percept
from scipy.ndimage import label

from planner.frames import CoverEstimate
from planner.sensed_exposure import STRIDE, exposure_on_arrival, sensed_exposure
from planner.sensed_exposure_kernel import DARK, FIGURE, free_above, identify, light_from
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.pose import Pose
from scenes.scenario import Observer, Patrol, Point

HERE = Pose(0.0, 0.0, 0.2)
EAST = Observer(
    id=1, x=7.0, y=0.0, yaw=180.0, eye_height=1.7, fov_horizontal=360.0, fov_vertical=180.0, range=50.0
)


def known(grid, *observers: Observer, cover=()):
    eyes = tuple((o.x, o.y, o.eye_height) for o in observers)
    seen = percept(grid, HERE)
    return replace(
        seen, observers=observers, observer_eyes=eyes, cover=tuple(cover),
        known_observers=tuple(o.id for o in observers),
    )  # fmt: skip


def standing(grid, where, low=-np.inf, high=3.0, blocks=True):
    """The map with a thing between two heights in the cells where `where`(x, y)."""
    y, x = np.indices(grid.shape) * grid.resolution + np.array([grid.y_min, grid.x_min])[:, None, None]
    there = where(x, y)
    span = np.stack([np.where(there, low, np.inf), np.where(there, high, -np.inf)]).astype(np.float32)
    return replace(grid, obstacle=there & blocks, span=span)


def at(exposure, grid, x, y) -> float:
    return float(exposure[grid.cell(x, y)])


def test_open_ground_is_in_full_view_and_without_observers_none_is() -> None:
    grid = grid_map()
    assert sensed_exposure(known(grid, EAST)).min() == pytest.approx(1.0)
    assert not sensed_exposure(known(grid)).any()


def test_behind_a_wall_it_is_hidden_and_beside_its_shadow_seen() -> None:
    grid = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 0.15) & (abs(y) < 1.5))
    exposure = sensed_exposure(known(grid, EAST))
    assert at(exposure, grid, 0.0, 0.0) == 0.0
    assert at(exposure, grid, 0.0, 6.0) == 1.0
    assert at(exposure, grid, 5.0, 0.0) == pytest.approx(1.0, abs=0.05)


def test_what_hangs_high_hides_nothing_from_an_eye_below_it() -> None:
    crown = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 1.0) & (abs(y) < 3.0), low=2.0, blocks=False)
    assert at(sensed_exposure(known(crown, EAST)), crown, 0.0, 0.0) == 1.0


def test_a_hill_hides_and_unknown_ground_does_not() -> None:
    hill = grid_map(height=lambda x, y: 2.5 * np.exp(-((x - 3.0) ** 2)))
    gone = grid_map(
        height=lambda x, y: 2.5 * np.exp(-((x - 3.0) ** 2)), unknown=lambda x, y: abs(x - 3.0) < 2.5
    )
    assert at(sensed_exposure(known(hill, EAST)), hill, -1.0, 0.0) == 0.0
    assert at(sensed_exposure(known(gone, EAST)), gone, -1.0, 0.0) == 1.0


def test_a_bush_that_the_camera_knows_lets_its_share_of_light_through() -> None:
    grid = standing(grid_map(), lambda x, y: np.hypot(x - 3.0, y) < 1.4)
    bush = CoverEstimate(1, CoverKind.BUSH, 3.0, 0.0, 0.0, 2.8, 3.0, 0.9)
    through = at(sensed_exposure(known(grid, EAST, cover=[bush])), grid, 0.0, 0.0)
    assert through == pytest.approx(1.0 - CATALOGUE[CoverKind.BUSH].opacity, abs=1e-6)


def test_a_vehicle_of_which_only_the_face_is_mapped_has_a_back() -> None:
    north = EAST.model_copy(update={"x": 3.0, "y": 7.0})
    grid = standing(grid_map(), lambda x, y: (abs(x - 1.9) < 0.15) & (abs(y) < 2.0))
    vehicle = CoverEstimate(1, CoverKind.DISABLED_VEHICLE, 3.0, 0.0, 0.0, 4.0, 1.7, 0.9)
    seen, faced = (sensed_exposure(known(grid, north, cover=cover)) for cover in ([vehicle], []))
    assert at(faced, grid, 3.2, -1.8) == pytest.approx(1.0, abs=0.05)
    assert at(seen, grid, 3.2, -1.8) < 0.2
    assert at(seen, grid, 6.0, -1.8) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("kind", [CoverKind.TREE, CoverKind.FENCE])
def test_trees_and_fences_are_where_they_are_mapped_alone(kind: CoverKind) -> None:
    thing = CoverEstimate(1, kind, 3.0, 0.0, 0.0, 4.0, 1.7, 0.9)
    grid = grid_map()
    assert at(sensed_exposure(known(grid, EAST, cover=[thing])), grid, 0.0, 0.0) == 1.0


def test_out_of_range_and_out_of_the_field_of_view_nothing_is_seen() -> None:
    grid = grid_map()
    near = sensed_exposure(known(grid, EAST.model_copy(update={"range": 5.0})))
    assert at(near, grid, 4.0, 0.0) == 1.0 and at(near, grid, -2.0, 0.0) == 0.0
    away = sensed_exposure(known(grid, EAST.model_copy(update={"yaw": 0.0, "fov_horizontal": 90.0})))
    assert at(away, grid, 0.0, 0.0) == 0.0


def test_the_best_placed_observer_counts() -> None:
    grid = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 0.15) & (abs(y) < 1.5))
    west = EAST.model_copy(update={"id": 2, "x": -7.0, "yaw": 0.0})
    both, one = (sensed_exposure(known(grid, *group)) for group in ((EAST, west), (EAST,)))
    assert (both >= one - 1e-6).all() and at(both, grid, 0.0, 0.0) == 1.0


def test_a_patrol_counts_with_the_mean_over_its_beat() -> None:
    grid = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 0.15) & (abs(y) < 1.5))
    beat = Patrol(waypoints=(Point(x=7.0, y=7.5), Point(x=7.0, y=-7.5)), speed=1.5)
    walker = EAST.model_copy(update={"patrol": beat, "fov_horizontal": 360.0})
    some = at(sensed_exposure(known(grid, walker)), grid, 1.0, 0.0)
    assert 0.0 < some < 1.0


def test_on_arrival_a_patrol_is_where_it_will_be_then() -> None:
    grid = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 0.15) & (abs(y) < 1.5))
    beat = Patrol(waypoints=(Point(x=7.0, y=7.5),), speed=1.5, loop=False)  # up in 5 s, and back
    walker = EAST.model_copy(update={"patrol": beat})
    seen, mean = exposure_on_arrival(known(grid, walker)), sensed_exposure(known(grid, walker))
    # Behind the wall from where it is now, and when it will be back, not from where it is in between.
    assert at(seen, grid, 0.5, 0.0) < 0.5 * at(mean, grid, 0.5, 0.0)
    assert seen.min() >= 0.0 and seen.max() <= 1.0 + 1e-6


def test_on_arrival_those_who_stand_count_as_ever() -> None:
    grid = standing(grid_map(), lambda x, y: (abs(x - 3.0) < 0.15) & (abs(y) < 1.5))
    np.testing.assert_array_equal(
        exposure_on_arrival(known(grid, EAST)), sensed_exposure(known(grid, EAST))
    )


def test_the_grid_is_covered_to_its_last_cell() -> None:
    grid = grid_map()
    assert sensed_exposure(known(grid, EAST)).shape == grid.shape
    assert grid.shape[0] % STRIDE == 1


def plain_light(ground, stops, low, high, free, opacity, heights, rows, cols, eye, resolution, own):
    light = np.ones((len(rows), len(heights)))
    for i, (row, col) in enumerate(zip(rows, cols, strict=True)):
        away = np.array([eye[1] - row, eye[0] - col])
        steps, distance = np.abs(away).max(), np.hypot(*away) * resolution
        if steps < 1.0:
            continue
        for j, height in enumerate(heights):
            inside, start = False, ground[row, col] + height
            for k in range(1, (int(steps * (1.0 - FIGURE / distance)) if distance > FIGURE else 0) + 1):
                r, c = (round(v) for v in (row, col) + k / steps * away)
                if not (0 <= r < ground.shape[0] and 0 <= c < ground.shape[1]) or light[i, j] == 0.0:
                    break
                z = start + k / steps * (eye[2] - start)
                enters = k > own / distance * steps and low[r, c] <= z < high[r, c]
                if z < stops[r, c]:
                    light[i, j] = 0.0
                elif enters and not inside:
                    light[i, j] *= 1.0 - opacity[r, c]
                inside = enters
                light[i, j] = light[i, j] if light[i, j] > DARK else 0.0
    return light


@given(st.integers(0, 2**32 - 1))
def test_light_follows_its_plain_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (14, 17)
    ground = rng.uniform(0.0, 0.4, shape)
    stops = np.where(rng.random(shape) < 0.3, -np.inf, ground)
    low = np.where(rng.random(shape) < 0.2, rng.choice([-np.inf, 0.8], shape), np.inf)
    high = np.where(np.isfinite(low) | (low < 0), rng.uniform(0.5, 2.5, shape), -np.inf)
    rows, cols = rng.integers(0, 14, 12), rng.integers(0, 17, 12)
    opacity = rng.choice([1.0, 0.8, 0.35], shape)
    eye = np.array([rng.uniform(-5, 22), rng.uniform(-5, 19), rng.uniform(0.8, 3.0)])
    arguments = (
        ground, stops, low, high, free_above(stops, low, high), opacity, np.array([0.1, 0.25, 0.39]), rows,
        cols, eye, 0.2, 0.3,
    )  # fmt: skip
    np.testing.assert_allclose(light_from(*arguments), plain_light(*arguments), atol=1e-6)


def plain_identify(low, high, blobs, count, things, resolution):
    y, x = np.indices(blobs.shape) * resolution
    of_blob, share = np.ones(count + 1), np.ones(blobs.shape)
    for to_east, to_north, own, solid, top, opacity in things:
        away = (to_north - y) ** 2 + (to_east - x) ** 2
        its = (away <= own**2) & (blobs > 0)
        high[its] = np.maximum(high[its], top)
        if its.any():
            most = np.bincount(blobs[its]).argmax()
            of_blob[most] = min(of_blob[most], opacity)
        inside = away <= solid
        new = inside & ~(high > low)
        share[new], high[new] = opacity, -np.inf
        high[inside], low[inside] = np.maximum(high[inside], top), -np.inf
    return np.where(blobs > 0, of_blob[blobs], share)


@given(st.integers(0, 2**32 - 1))
def test_what_stands_on_the_map_follows_its_plain_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (19, 23)
    there = rng.random(shape) < rng.choice([0.1, 0.4])
    low = np.where(there, rng.choice([-np.inf, 0.8], shape), np.inf)
    high = np.where(there, rng.uniform(1.0, 2.5, shape), -np.inf)
    blobs = np.zeros(shape, np.int32)
    count = label(there, structure=np.ones((3, 3)), output=blobs)
    own = rng.uniform(0.3, 2.0, 6)  # some of the middles lie off the map
    solid = np.where(rng.random(6) < 0.5, -1.0, rng.uniform(0.0, 1.0, 6) * own) * own
    things = np.column_stack(
        [rng.uniform(-1, 5, 6), rng.uniform(-1, 5, 6), own, solid, rng.uniform(0.5, 4.0, 6), rng.random(6)]
    )
    plain = low.copy(), high.copy()
    expected = plain_identify(*plain, blobs, count, things, 0.2)
    np.testing.assert_array_equal(identify(low, high, blobs, count, things, 0.2), expected)
    np.testing.assert_array_equal((low, high), plain)


def test_a_robot_on_the_observers_own_cell_is_seen() -> None:
    grid = grid_map()
    assert at(sensed_exposure(known(grid, EAST)), grid, EAST.x, EAST.y) == 1.0
    assert math.isfinite(sensed_exposure(known(grid, EAST)).sum())
