"""Covert routes: hidden where they can be, honest about their figures, clear about why there is none."""

import math

import numpy as np
import pytest
from scenes_to_hide_in import GOAL, START, behind_a_wall, eye, flat, plain_visible_share, wall

from planner.covert_kernel import search
from planner.covert_route import BALANCED, LONGEST, CovertPlanner
from planner.hull_exposure import HEADINGS, over_hull
from planner.line_of_sight import views_at, visible_fraction
from planner.no_route import NoRoute
from planner.pace import Pace, course
from scenes.stance import standing_pose
from scenes.terrain import QUALITIES, SURFACES, Heightmap, Quality, Surface


@pytest.fixture(scope="module")
def planner():
    return behind_a_wall()


def test_weight_0_is_the_shortest_way_and_1_the_most_hidden(planner):
    routes = [planner.route(START, GOAL, weight) for weight in (0.0, 0.5, 1.0)]
    assert routes[0].length_m == pytest.approx(math.dist(START, GOAL), rel=0.02)
    exposed = [route.exposed_s for route in routes]
    assert exposed[2] <= exposed[1] + 0.05 <= exposed[0] + 0.1
    assert exposed[2] < 0.6 * exposed[0] and routes[2].length_m > routes[0].length_m


def test_a_route_begins_and_ends_where_it_was_asked_to(planner):
    route = planner.route((-6.41, 1.37), (6.2, 1.61))
    assert tuple(route.points[0]) == (-6.41, 1.37) and tuple(route.points[-1]) == (6.2, 1.61)
    assert route.length_m == pytest.approx(np.hypot(*np.diff(route.points, axis=0).T).sum())


def test_the_bound_is_the_least_exposed_of_those_that_are_not_too_long(planner):
    shortest, bound = planner.route(START, GOAL, 0.0), planner.bound(START, GOAL)
    assert bound.length_m <= LONGEST * shortest.length_m
    for weight in (0.0, BALANCED, 0.8, 1.0):
        other = planner.route(START, GOAL, weight)
        if other.length_m <= LONGEST * shortest.length_m:
            assert bound.exposed_s <= other.exposed_s + 0.15
    short = planner.bound(START, GOAL, longest=1.02)
    assert short.length_m <= 1.02 * shortest.length_m and short.exposed_s >= bound.exposed_s


def test_three_alternatives_from_short_to_hidden(planner):
    shortest, balanced, hidden = planner.alternatives(START, GOAL)
    assert shortest.weight == 0.0 and balanced.weight == BALANCED
    assert hidden.exposed_s <= balanced.exposed_s + 0.1 <= shortest.exposed_s + 0.2
    assert hidden.detection_probability <= shortest.detection_probability + 1e-9
    assert hidden.longest_exposure_s <= hidden.duration_s


def test_a_place_where_a_drive_has_failed_is_led_past():
    planner = behind_a_wall()
    before = planner.route(START, GOAL, 0.0)
    middle = before.points.mean(axis=0) if len(before.points) > 2 else np.mean([START, GOAL], axis=0)
    planner.shun(*middle, 0.8)
    after = planner.route(START, GOAL, 0.0)
    dense = np.concatenate(
        [np.linspace(a, b, 50) for a, b in zip(after.points[:-1], after.points[1:], strict=True)]
    )
    assert np.hypot(*(dense - middle).T).min() > 0.6
    assert after.length_m > before.length_m


def test_the_same_map_gives_the_same_route(planner):
    again = behind_a_wall().route(START, GOAL, 0.7)
    assert np.array_equal(again.points, planner.route(START, GOAL, 0.7).points)


def test_the_field_is_what_is_seen_of_the_hull(planner):
    rng = np.random.default_rng(4)
    free = np.argwhere(~planner.costs.forbidden)
    astray = []
    for row, col in free[rng.choice(len(free), 60)]:
        x, y = planner.costs.centre(row, col)
        axis = int(rng.integers(4))
        plain = plain_visible_share(planner, x, y, HEADINGS[axis])
        astray.append(abs(float(planner.exposure.fraction[axis, row, col]) - plain))
    # Between cells the light is interpolated, so that only a shadow's edge is blurred.
    assert np.mean(astray) < 0.02 and np.median(astray) < 1e-6


def test_the_hull_s_stencil_keeps_a_constant_and_a_slope():
    row, col = np.indices((20, 24)).astype(float)
    light = np.stack([0.0 * row + 1.0, 0.02 * col, 0.5 + 0.0 * row])
    fraction = over_hull(light, 0.25)
    expected = (4.0 * light[0] + 4.0 * light[1] + 4.0 * light[2]) / 12.0
    inner = (slice(None), slice(4, -4), slice(4, -4))
    np.testing.assert_allclose(fraction[inner], np.broadcast_to(expected, fraction.shape)[inner], atol=1e-5)


def test_the_figures_are_those_that_a_drive_along_the_route_would_log(planner):
    route = planner.route(START, GOAL, 0.5)
    drive = course(route.points, Pace(), planner._clearance_at)
    views = views_at(planner.observers, planner.heightmap, 0.0)
    logged = sum(
        seconds
        * visible_fraction(
            planner.rays, views, standing_pose(planner.heightmap, float(x), float(y), float(yaw))
        ).united
        for (x, y), yaw, seconds in zip(drive.positions, drive.yaw, drive.seconds, strict=True)
    )
    assert route.exposed_s == pytest.approx(logged, abs=1e-4)
    assert route.duration_s == pytest.approx(drive.seconds.sum())


def test_without_observers_nobody_sees_it():
    route = CovertPlanner(flat(), [], []).route(START, GOAL, 1.0)
    assert route.exposed_s == 0.0 and route.detection_probability == 0.0
    assert route.length_m == pytest.approx(math.dist(START, GOAL), rel=0.01)


@pytest.mark.parametrize("fields", [{"range": 0.0}, {"fov_horizontal": 0.0}, {"fov_vertical": 0.0}])
def test_observers_who_see_nothing_do_not_bend_the_way(fields):
    route = CovertPlanner(flat(), [], [eye(**fields)]).route(START, GOAL, 1.0)
    assert route.exposed_s == 0.0 and route.length_m == pytest.approx(math.dist(START, GOAL), rel=0.01)


def test_a_goal_in_full_view_of_all_is_still_reached(planner):
    route = planner.route(START, (0.0, 8.0), 1.0)
    assert tuple(route.points[-1]) == (0.0, 8.0) and route.exposed_s > 0.0


@pytest.mark.parametrize("weight", [-0.1, 1.1, math.nan])
def test_a_weight_outside_0_to_1_is_refused(planner, weight):
    with pytest.raises(ValueError, match="0 to 1"):
        planner.route(START, GOAL, weight)


# --- no way ------------------------------------------------------------------------------------------


def across(size: float = 24.0, **codes) -> Heightmap:
    """Flat ground with a band of 2 m across its middle, from south to north."""
    ground = flat(size)
    arrays = {name: getattr(ground, name).copy() for name in ("heights", "surface", "quality")}
    middle = ground.shape[1] // 2
    for name, value in codes.items():
        arrays[name][:, middle - 4 : middle + 4] = value
    return Heightmap(arrays["heights"], ground.resolution, arrays["surface"], arrays["quality"])


@pytest.mark.parametrize(
    ("ground", "cover", "words"),
    [
        (across(surface=SURFACES.index(Surface.WATER)), [], "water"),
        (across(quality=QUALITIES.index(Quality.MISSING)), [], "the survey has no data"),
        (across(heights=2.0), [], "a step|steeper"),
        (flat(), [wall(7, 0.0, 0.0, 24.0, yaw=90.0)], "building 7"),
    ],
)
def test_no_way_says_what_blocks_it_and_where(ground, cover, words):
    with pytest.raises(NoRoute, match=words) as caught:
        CovertPlanner(ground, cover, []).route((-6.0, 0.0), (6.0, 0.0))
    assert "every way to the goal is blocked" in caught.value.reason
    x, y = caught.value.where
    assert abs(x) < 3.0 and abs(y) < 6.0


def test_a_goal_inside_a_thing_is_named():
    with pytest.raises(NoRoute, match="the goal cannot be driven to: building 7"):
        CovertPlanner(flat(), [wall(7, 6.0, 0.0, 4.0)], []).route((-6.0, 0.0), (6.0, 0.0))


def test_off_the_map_is_said_of_the_end_that_is():
    with pytest.raises(NoRoute, match="the goal is off the map"):
        CovertPlanner(flat(), [], []).route((0.0, 0.0), (80.0, 0.0))


def test_the_route_never_enters_forbidden_cells(planner):
    route = planner.route(START, GOAL, 1.0)
    drive = course(route.points, Pace(), planner._clearance_at)
    row, col = planner.heightmap.cells(*drive.positions.T)
    # A straight line may pass a forbidden cell's corner by less than half a cell.
    assert planner.clearance[row, col].min() > planner.config.cost.rim - planner.costs.resolution


def test_the_search_over_the_real_costs_is_the_least(planner):
    seconds, begin, end = planner._seconds(START, GOAL)
    cost = planner._cost(seconds, 1.0)
    _, one_way = search(cost, planner.costs.resolution, begin, end)
    _, back = search(cost, planner.costs.resolution, end, begin)
    assert one_way[end] == pytest.approx(back[begin], rel=1e-9)
