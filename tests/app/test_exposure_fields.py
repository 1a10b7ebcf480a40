"""Fields that are kept while nothing that they depend on moves, and the colours they are shown in."""

from dataclasses import replace

import numpy as np
import pytest
from meadows import meadow_scene

from app.exposure_fields import ExposureFields, Moment, Search
from app.view import palette
from app.view.exposure_paint import Paper, Show, Wish, painted_exposure
from app.view.ground import painted
from planner.exposure import SEEN, exposure_field, views_at
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import CoverObject, Observer, Patrol, Point
from scenes.terrain import QUALITIES, Quality


@pytest.fixture
def moment() -> Moment:
    scene = meadow_scene()
    second = Observer(id=2, x=-8.0, y=-8.0, yaw=45.0, known=False)
    observers = (*scene.observers, second)
    return Moment(scene.terrain.heightmap(), scene.cover, (), observers, 0.0)


def afresh(moment: Moment, stride: int = 1):
    rays = RayScene(moment.heightmap, moment.cover)
    views = views_at(moment.observers, moment.heightmap, moment.time_s)
    return exposure_field(rays, moment.heightmap, views, stride=stride)


@pytest.fixture
def counted(monkeypatch) -> list[int]:
    """Ids of the observers whose field was computed, as they were."""
    seen = []

    def count(rays, heightmap, views, **named):
        seen.extend(view.observer_id for view in views)
        return exposure_field(rays, heightmap, views, **named)

    monkeypatch.setattr("app.exposure_fields.exposure_field", count)
    return seen


@pytest.mark.parametrize("stride", [1, 3])
def test_a_field_is_that_of_the_planner(moment, stride):
    field, plain = ExposureFields().now(moment, stride), afresh(moment, stride)
    assert field is not None and np.array_equal(field.seen, plain.seen)
    assert (field.x_min, field.resolution, field.observer_ids) == (plain.x_min, plain.resolution, (1, 2))


def test_only_who_has_moved_is_computed_anew(moment, counted):
    fields = ExposureFields()
    fields.now(moment, 1)
    moved = moment.observers[1].model_copy(update={"x": -7.0})
    after = replace(moment, observers=(moment.observers[0], moved))
    field = fields.now(after, 1)
    assert counted == [1, 2, 2]
    assert field is not None and np.array_equal(field.seen, afresh(after).seen)


def test_cover_that_moves_changes_every_field(moment, counted):
    fields = ExposureFields()
    fields.now(moment, 1)
    house = CoverObject(id=9, kind="cottage", x=0.0, y=0.0, length=4.0, width=3.0)
    after = replace(moment, cover=(*moment.cover, house))
    field = fields.now(after, 1)
    assert counted == [1, 2, 1, 2]
    assert field is not None and np.array_equal(field.seen, afresh(after).seen)


def test_an_overtaken_field_is_given_up(moment):
    assert ExposureFields().now(moment, 1, overtaken=lambda: True) is None


def test_many_observers_come_coarse_first_and_one_who_is_dragged_sharp_at_once(moment):
    crowd = tuple(Observer(id=n, x=0.09 * n - 9.0, y=5.0, range=8.0) for n in range(1, 201))
    fields, full = ExposureFields(), replace(moment, observers=crowd)
    coarse, sharp = fields.strides(full)
    assert coarse > sharp == 1
    fields.now(full, 1)
    dragged = replace(full, observers=(crowd[0].model_copy(update={"x": 3.0}), *crowd[1:]))
    assert fields.strides(dragged) == (1,)


def test_without_observers_nothing_is_seen_and_the_mean_over_no_beat_is_the_moment(moment):
    fields = ExposureFields()
    nobody = fields.now(replace(moment, observers=()), 1)
    assert nobody is not None and not nobody.united.any()
    now = fields.now(moment, 1)
    assert now is not None and np.array_equal(fields.averaged(moment, 1).united, now.united)


def test_a_patrol_moves_with_the_time(moment):
    patrol = Patrol(waypoints=(Point(x=8.0, y=8.0),), speed=1.0)
    beat = moment.observers[0].model_copy(update={"patrol": patrol})
    fields = ExposureFields()
    walking = replace(moment, observers=(beat,))
    first, later = fields.now(walking, 1), fields.now(replace(walking, time_s=6.0), 1)
    assert first is not None and later is not None and not np.array_equal(first.seen, later.seen)


def test_what_the_robot_has_looked_at_drops_out_of_the_belief(moment):
    fields, way = ExposureFields(), ((-3.0, 0.0), (3.0, 0.0))
    before = fields.believed(moment, 2, Search(*way, ()))
    after = fields.believed(moment, 2, Search(*way, (Pose(0.0, 0.0, 0.0),)))
    assert before.united.max() > 0.0 and after.united.mean() < before.united.mean()
    again = fields.believed(moment, 2, Search(*way, ()))
    assert np.array_equal(again.united, before.united)


# the picture


def near(picture: np.ndarray, colour: palette.RGB) -> np.ndarray:
    """(height, width) bool: nearer in hue to a colour than to the other two that matter."""
    candidates = np.array([palette.HIDDEN, palette.SEEN, palette.UNKNOWN], float)
    direction = picture / np.maximum(np.linalg.norm(picture, axis=2, keepdims=True), 1.0)
    candidates /= np.linalg.norm(candidates, axis=1, keepdims=True)
    best = (direction @ candidates.T).argmax(axis=2)
    return best == [palette.HIDDEN, palette.SEEN, palette.UNKNOWN].index(colour)


def pictured(moment: Moment, wish: Wish = Wish(opacity=1.0)):  # noqa: B008
    paper = Paper.of(moment.heightmap, painted(moment.heightmap))
    field = ExposureFields().now(moment, 1)
    assert field is not None
    return field, painted_exposure(field, wish, paper)


def at_cells(picture: np.ndarray, shape: tuple[int, int]) -> tuple[slice, slice]:
    step = picture.shape[0] // shape[0]
    return slice(step // 2, None, step), slice(step // 2, None, step)


def test_seen_is_orange_and_hidden_blue_green(moment):
    house = CoverObject(id=9, kind="cottage", x=0.0, y=0.0, length=8.0, width=5.0)
    field, picture = pictured(replace(moment, cover=(house,), observers=moment.observers[:1]))
    cells = at_cells(picture, field.unknown.shape)
    seen, hidden = field.united >= SEEN, field.united == 0.0
    assert near(picture, palette.SEEN)[cells][seen].mean() > 0.9
    assert near(picture, palette.HIDDEN)[cells][hidden].mean() > 0.9


def test_one_observer_alone_is_less_than_all(moment):
    _, all_of_them = pictured(moment)
    _, alone = pictured(moment, Wish(observer=2, opacity=1.0))
    assert near(alone, palette.SEEN).mean() < near(all_of_them, palette.SEEN).mean()


def test_ground_without_data_is_grey_and_never_hidden(moment):
    quality = np.zeros(moment.heightmap.shape, np.uint8)
    quality[:10] = QUALITIES.index(Quality.MISSING)
    blind = replace(moment, heightmap=replace(moment.heightmap, quality=quality))
    field, picture = pictured(blind)
    south = picture[: picture.shape[0] // 41 * 8]
    assert field.unknown[:10].all() and not near(south, palette.HIDDEN).any()


def test_the_opacity_lets_the_ground_through(moment):
    _, clear = pictured(moment, Wish(opacity=0.0))
    _, full = pictured(moment, Wish(opacity=1.0))
    paper = Paper.of(moment.heightmap, painted(moment.heightmap))
    assert np.abs(clear.astype(int) - paper.picture).max() <= 1 and not np.array_equal(clear, full)


@pytest.mark.parametrize("show", [Show.COUNT, Show.AVERAGED, Show.BELIEF])
def test_every_kind_of_picture_can_be_painted_coarsely(moment, show):
    paper = Paper.of(moment.heightmap, painted(moment.heightmap))
    field = ExposureFields().now(moment, 7)
    assert field is not None and paper.rough is not None
    assert painted_exposure(field, Wish(show), paper.rough).dtype == np.uint8
