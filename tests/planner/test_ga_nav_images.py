"""The images that GA-Nav learns from: what light does to them, and what their pixels are labelled."""

import math
from dataclasses import replace

import numpy as np
import pytest
from field import field, thing

from planner.ga_nav.groups import GROUP_CODE, GROUPS, pixel_groups, surface_groups
from planner.ga_nav.images import HALF, photograph, samples
from planner.ga_nav.light import Lens, Season, Weather, draw_lens, draw_season, draw_weather
from scenes.catalogue import CATALOGUE, TraversabilityGroup
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import Family, MovingObstacle, Observer
from scenes.sensors import SemanticCamera
from scenes.terrain import SURFACES, Surface

HERE = Pose(0.0, 0.0, 0.0)
THINGS = [(kind, 2.5 + 1.1 * place) for place, kind in enumerate(CATALOGUE)]


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def rays_of(*cover, **fields) -> RayScene:
    scenario = field(goal=(-9.0, 0.0), start=(-11.0, 0.0), cover=cover, **fields)
    return RayScene(scenario.terrain.heightmap(), scenario.cover)


def taken(rays: RayScene, weather: Weather | None = None, lens: Lens | None = None, pose: Pose = HERE):
    return photograph(rays, pose, weather or Weather(), lens or Lens(), rng())


def test_the_groups_are_ga_navs_in_its_order() -> None:
    assert [group.value for group in GROUPS] == [
        "background", "smooth", "rough", "bumpy", "forbidden", "obstacle",
    ]  # fmt: skip


@pytest.mark.parametrize(("kind", "group"), [
    ("rock", "bumpy"), ("tree", "obstacle"), ("bush", "obstacle"), ("fence", "obstacle"),
    ("house", "obstacle"), ("disabled_vehicle", "obstacle"),
])  # fmt: skip
def test_cover_has_its_classes_group(kind: str, group: str) -> None:
    sample = taken(rays_of(thing(1, kind, x=6.0, y=0.0)))
    assert sample.groups[HALF.height // 2 + 8, HALF.width // 2] == GROUP_CODE[TraversabilityGroup(group)]


def test_persons_vehicles_and_observers_are_obstacles_and_nothing_is_background() -> None:
    rays = rays_of()
    walkers = [
        MovingObstacle(id=1, kind="person", x=4.0, y=1.5),
        MovingObstacle(id=2, kind="vehicle", x=6.0, y=-2.0),
    ]
    rays.set_walkers(walkers, [Observer(id=1, x=4.0, y=3.0)])
    body = np.arange(-1, 4)
    labels = pixel_groups(body, np.zeros(5, int), rays.bodies)
    names = [GROUPS[label].value for label in labels]
    assert names == ["background", "rough", "obstacle", "obstacle", "obstacle"]


def test_ground_has_its_surfaces_group() -> None:
    codes = np.arange(len(SURFACES))
    named = dict(zip(SURFACES, (GROUPS[code].value for code in surface_groups(codes)), strict=True))
    assert named[Surface.WATER] == "forbidden" and named[Surface.ROCK] == "bumpy"
    assert {named[Surface.TRAIL], named[Surface.ASPHALT]} == {"smooth"}
    assert {named[each] for each in (Surface.GRASS, Surface.GRAVEL, Surface.MUD, Surface.SAND)} == {"rough"}


def test_in_plain_light_it_is_the_robots_own_camera() -> None:
    rays = rays_of(*(thing(i, kind, x=x, y=0.4 * i - 1.5) for i, (kind, x) in enumerate(THINGS, 1)))
    pose = Pose(0.0, 0.0, 0.1, 0.05, -0.04, 0.2)
    image = SemanticCamera(HALF).capture(rays, pose, rng())
    sample = taken(rays, pose=pose)
    np.testing.assert_array_equal(sample.rgb, image.rgb)
    ground = image.surface >= 0
    np.testing.assert_array_equal(sample.groups[ground], surface_groups(image.surface[ground]))


def test_a_face_to_the_sun_is_lighter_than_one_turned_away() -> None:
    rays = rays_of(thing(1, "building", x=6.0, y=0.0))
    middle = (HALF.height // 2 - 20, HALF.width // 2)
    before, behind = (
        taken(rays, Weather(sun=np.array([side, 0.0, 0.6]) / math.hypot(side, 0.6)))
        for side in (-0.8, 0.8)
    )  # fmt: skip
    assert before.rgb[middle].sum() > 1.3 * behind.rgb[middle].sum()


def test_things_cast_shadows_away_from_the_sun() -> None:
    rays = rays_of(thing(1, "building", x=8.0, y=5.0))
    light = Weather(sun=np.array([0.0, 0.8, 0.6]))
    bright, shaded = taken(rays, light), taken(rays, replace(light, shadows=True))
    darker = bright.rgb.astype(int).sum(2) > shaded.rgb.astype(int).sum(2)
    ground = bright.groups == GROUP_CODE[TraversabilityGroup.ROUGH]
    assert 0.02 < np.mean(darker[ground]) < 0.9
    np.testing.assert_array_equal(bright.groups, shaded.groups)


def test_autumn_turns_leaves_and_leaves_trunks_and_trucks_alone() -> None:
    rays = rays_of(thing(1, "bush", x=3.0, y=0.0), thing(2, "disabled_vehicle", x=5.0, y=4.0))
    autumn = Weather(season=Season((176.0, 124.0, 52.0), 0.9))
    summer, turned = taken(rays).rgb.astype(int), taken(rays, autumn).rgb.astype(int)
    changed = np.any(summer != turned, axis=2)
    bodies = SemanticCamera(HALF).capture(rays, HERE, rng()).body
    assert set(np.unique(bodies[changed])) == {1}
    bush = bodies == 1
    redder = (turned[bush][:, 0] - turned[bush][:, 1]) > (summer[bush][:, 0] - summer[bush][:, 1])
    assert redder.all()


@pytest.mark.parametrize(("lens", "moved"), [
    (Lens(exposure=0.6), "darker"), (Lens(exposure=1.4), "lighter"), (Lens(gamma=1.4), "darker"),
])  # fmt: skip
def test_the_lens_changes_how_bright_an_image_is(lens: Lens, moved: str) -> None:
    rays = rays_of(thing(1, "bush", x=3.0, y=0.0))
    plain, other = taken(rays).rgb.mean(), taken(rays, lens=lens).rgb.mean()
    assert bool(other < plain) is (moved == "darker")


def test_noise_is_of_its_size_and_blur_softens_edges() -> None:
    rays = rays_of(thing(1, "rock", x=3.0, y=0.0))
    plain = taken(rays).rgb.astype(float)
    noisy = taken(rays, lens=Lens(grain=0.02)).rgb - plain
    assert np.std(noisy) == pytest.approx(0.02 * 255, rel=0.1)
    blurred = taken(rays, lens=Lens(blur=1.0)).rgb.astype(float)
    assert np.abs(np.diff(blurred, axis=1)).max() < 0.7 * np.abs(np.diff(plain, axis=1)).max()


def test_a_camera_that_adapts_makes_up_for_dim_and_coloured_light() -> None:
    rays = rays_of()
    red = Weather(skylight=np.array([0.2, 0.15, 0.1]), sunlight=np.array([0.3, 0.2, 0.1]))
    dim, adapted, usual = taken(rays, red), taken(rays, red, Lens(adapting=1.0)), taken(rays)
    ground = usual.groups == GROUP_CODE[TraversabilityGroup.ROUGH]
    assert dim.rgb[ground].mean() < 0.6 * usual.rgb[ground].mean()
    np.testing.assert_allclose(adapted.rgb[ground].mean(0), usual.rgb[ground].mean(0), atol=2.0)


def test_drawn_light_is_light_that_there_is() -> None:
    for seed in range(60):
        weather, lens = draw_weather(rng(seed)), draw_lens(rng(seed))
        assert np.linalg.norm(weather.sun) == pytest.approx(1.0) and weather.sun[2] > 0.2
        for colours in (weather.ground, weather.horizon, weather.zenith):
            assert np.isfinite(colours).all() and (colours >= 0.0).all() and (colours <= 255.0).all()
        assert (weather.sunlight > 0.0).all() and (weather.skylight > 0.0).all() and weather.haze > 0.0
        assert 0.7 <= lens.adapting <= 1.0 and lens.exposure > 0.0 and lens.blur >= 0.0


def test_all_four_seasons_come() -> None:
    seasons = [draw_season(rng(seed)) for seed in range(40)]
    assert len({season.hue for season in seasons}) == 4
    assert any(season.frost for season in seasons)
    green = np.array([[112.0, 132.0, 84.0]])
    for season in seasons:
        assert season.tinted(green).mean() == pytest.approx(
            (1.0 - season.frost) * green.mean() + season.frost * 232.0, abs=1.0
        )


def test_the_same_seed_gives_the_same_images_and_another_others() -> None:
    one, same, other = (samples(Family.LOW_HIGH, seed, 3) for seed in (11, 11, 12))
    for a, b in zip(one, same, strict=True):
        np.testing.assert_array_equal(a.rgb, b.rgb)
        np.testing.assert_array_equal(a.groups, b.groups)
    assert any((a.rgb != c.rgb).any() for a, c in zip(one, other, strict=True))
    assert one[0].rgb.shape == (120, 160, 3) and one[0].groups.max() < len(GROUPS)
