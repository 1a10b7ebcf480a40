"""The paper's four terrains: what each is like, and that every seed gives a drive worth having."""

import math
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from scenes.catalogue import CoverKind
from scenes.families import MAX_SIZE, PASSAGE, RECIPES, generate
from scenes.placement import within_half_turn
from scenes.scenario import MAX_COVER, Family, Scenario, ScenarioError
from scenes.terrain import SURFACE_CODE, Heightmap, Surface
from scenes.traversability import blocked_cells, reachable

SEEDS = range(5)
EVERY = [(family, seed) for family in Family for seed in SEEDS]
BUILDINGS = {CoverKind.COTTAGE, CoverKind.BUILDING, CoverKind.HOUSE}


@cache
def drawn(family: Family, seed: int) -> tuple[Scenario, Heightmap]:
    scenario = generate(family, seed)
    return scenario, scenario.terrain.heightmap()


def test_every_family_has_a_recipe():
    assert set(RECIPES) == set(Family)


@pytest.mark.parametrize("family", Family)
def test_a_seed_gives_one_document(family):
    assert generate(family, 3).to_json() == drawn(family, 3)[0].to_json()
    assert generate(family, 4).to_json() != drawn(family, 3)[0].to_json()


@pytest.mark.parametrize(
    ("family", "low", "high"),
    [
        (Family.NORMAL, 0.1, 5.0),
        (Family.LOW, 0.3, 1.0),
        (Family.LOW_HIGH, 1.0, 3.0),
        (Family.FOREST, 4.0, 7.0),
    ],
)
def test_relief_is_the_family_s(family, low, high):
    for seed in SEEDS:
        assert low <= drawn(family, seed)[1].relief <= high


def test_normal_ground_is_flat_or_gently_sloping():
    for seed in SEEDS:
        assert np.quantile(drawn(Family.NORMAL, seed)[1].slope, 0.95) < math.radians(6.0)


def test_low_ground_has_buildings_and_fences():
    for seed in SEEDS:
        kinds = {thing.kind for thing in drawn(Family.LOW, seed)[0].cover}
        assert kinds & BUILDINGS and CoverKind.FENCE in kinds


def test_a_forest_has_many_trees_and_bushes_a_trail_and_water():
    for seed in SEEDS:
        scenario, ground = drawn(Family.FOREST, seed)
        kinds = [thing.kind for thing in scenario.cover]
        assert kinds.count(CoverKind.TREE) > 60 and kinds.count(CoverKind.BUSH) > 30
        for surface in (Surface.GRASS, Surface.TRAIL, Surface.WATER):
            assert (ground.surface == SURFACE_CODE[surface]).mean() > 0.005


@pytest.mark.parametrize(("family", "seed"), EVERY)
def test_the_goal_is_twelve_metres_away_and_reachable(family, seed):
    scenario, ground = drawn(family, seed)
    start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    assert math.dist(start, goal) == pytest.approx(12.0, abs=0.05)
    assert reachable(ground, scenario.cover, start, goal, clearance=0.5 * PASSAGE)


@pytest.mark.parametrize(("family", "seed"), EVERY)
def test_the_robot_has_room_and_gentle_ground_where_it_starts_and_arrives(family, seed):
    scenario, ground = drawn(family, seed)
    x, y = ground.xy()
    for point, room in ((scenario.start, 1.2), (scenario.goal, 0.9)):
        at = np.array([(point.x, point.y)])
        assert all(thing.footprint.distance(at)[0] >= room for thing in scenario.cover)
        near = np.hypot(x - point.x, y - point.y) < 0.6
        assert np.median(ground.slope[near]) < math.radians(10.0)


@pytest.mark.parametrize(("family", "seed"), EVERY)
def test_nothing_overlaps_or_stands_in_water(family, seed):
    scenario, ground = drawn(family, seed)
    outlines = [thing.footprint for thing in scenario.cover]
    for a, b in combinations(outlines, 2):
        if math.dist((a.x, a.y), (b.x, b.y)) < a.radius + b.radius:
            assert a.gap(b) > 0.0
    for outline in outlines:
        assert (ground.surface[ground.cells(*outline.lattice(0.3).T)] != SURFACE_CODE[Surface.WATER]).all()


@pytest.mark.parametrize(("family", "seed"), EVERY)
def test_water_lies_level_with_mud_or_way_about_it(family, seed):
    _, ground = drawn(family, seed)
    water = ground.surface == SURFACE_CODE[Surface.WATER]
    levels = np.unique(ground.heights[water])
    assert len(levels) <= RECIPES[family].ponds[1]


@pytest.mark.parametrize(("family", "seed"), EVERY)
def test_buildings_stand_on_level_pads(family, seed):
    scenario, ground = drawn(family, seed)
    for thing in scenario.cover:
        if thing.kind in BUILDINGS:
            assert np.ptp(ground.height_at(*thing.footprint.lattice(0.5).T)) < 0.35


@pytest.mark.parametrize("family", Family)
def test_the_straight_line_is_mostly_barred(family):
    barred = []
    for seed in SEEDS:
        scenario, ground = drawn(family, seed)
        start, goal = scenario.start, scenario.goal
        line = np.linspace((start.x, start.y), (goal.x, goal.y), 100)
        barred.append(blocked_cells(ground, scenario.cover)[ground.cells(*line.T)].any())
    assert np.mean(barred) >= 0.6


@pytest.mark.parametrize(("family", "seed"), EVERY)
def test_no_spikes_and_bumps_of_a_few_centimetres(family, seed):
    _, ground = drawn(family, seed)
    dry = ground.surface != SURFACE_CODE[Surface.WATER]
    for axis in (0, 1):
        bend = np.abs(np.diff(ground.heights, n=2, axis=axis))
        inner = dry[1:-1] if axis == 0 else dry[:, 1:-1]
        assert np.quantile(bend[inner], 0.999) < 0.15


@pytest.mark.parametrize("family", Family)
def test_the_robot_starts_more_or_less_toward_the_goal(family):
    turns = []
    for seed in SEEDS:
        scenario, _ = drawn(family, seed)
        bearing = math.atan2(scenario.goal.y - scenario.start.y, scenario.goal.x - scenario.start.x)
        turns.append(abs(within_half_turn(math.degrees(bearing) - scenario.start.yaw)))
    assert max(turns) <= 120.1 and np.median(turns) <= 45.0


@pytest.mark.parametrize("family", Family)
@pytest.mark.parametrize(
    ("size_m", "resolution", "goal_distance", "observers"),
    [(24.0, 0.25, 4.0, 0), (24.0, 0.25, 18.0, 2), (64.0, 0.5, 50.0, 3), (128.0, 0.5, 30.0, 1)],
)
def test_any_size_and_distance(family, size_m, resolution, goal_distance, observers):
    scenario = generate(
        family, 1, size_m=size_m, resolution=resolution, goal_distance=goal_distance, observers=observers
    )
    ground = scenario.terrain.heightmap()
    assert ground.bounds[1] == pytest.approx(0.5 * size_m)
    start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    assert math.dist(start, goal) == pytest.approx(goal_distance, abs=0.05)
    assert len(scenario.observers) == observers
    low, high = RECIPES[family].relief
    assert low - 0.01 <= ground.relief <= high + 0.01


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"family": "moon"}, "terrain 'moon' is none of normal, low, low_high, forest"),
        ({"seed": -1}, "seed is -1; it must be 0 to"),
        ({"size_m": 5.0}, "size is 5 m at 0.25 m a cell; it must be 12 to 255.75"),
        ({"size_m": float("nan")}, "size is nan m"),
        ({"goal_distance": 45.0}, "goal distance is 45 m on a map of 48 m; it must be 3 to 43"),
        ({"resolution": 0.0}, "resolution is 0 m; it must be 0.05 to 1 m"),
        ({"observers": 21}, "number of observers is 21; it must be 0 to 20"),
    ],
)
def test_what_cannot_be_generated_is_refused_in_words(changes, message):
    arguments = {"family": "normal", "seed": 1} | changes
    with pytest.raises(ScenarioError) as caught:
        generate(**arguments)
    assert message in str(caught.value)


def test_the_largest_forest_is_thinned_to_what_a_scenario_holds():
    scenario = generate(Family.FOREST, 3, size_m=MAX_SIZE)
    assert 0.8 * MAX_COVER < len(scenario.cover) <= MAX_COVER
