"""Algorithm 1, the memory of cover, and the choice among it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.cover import CoverMemory, choose_cover, detect_cover, is_cover_class
from planner.detection import Sighting
from planner.frames import CoverEstimate, Detection
from scenes.catalogue import CATALOGUE, CoverKind

PAPER = ("trees", "bushes", "rocks", "cottage", "building", "houses", "disabled vehicles")
NAMES = (*PAPER, "grass", "fence", "person", "treehouse")

coordinates = st.floats(-15.0, 15.0)
points = st.tuples(coordinates, coordinates, coordinates)
objects = st.lists(
    st.tuples(st.sampled_from(NAMES), points, st.sampled_from([0.0, 0.5, 0.8499, 0.85, 0.9, 1.0])),
    max_size=12,
)


def published(object_classes, object_locations, robot_location, confidences):
    """The paper's Algorithm 1, line by line."""
    cover_distance = float("inf")
    is_cover = False
    n = len(object_classes)
    for i in range(n):
        if object_classes[i] in PAPER and confidences[i] >= 0.85:
            dist = np.linalg.norm(np.asarray(object_locations[i]) - np.asarray(robot_location))
            if dist < cover_distance:
                cover_distance = dist
    if cover_distance <= 10:
        is_cover = True
    return is_cover


@given(objects, points)
def test_it_is_the_published_algorithm(found, robot):
    classes, locations, confidences = ([thing[k] for thing in found] for k in range(3))
    assert detect_cover(classes, locations, robot, confidences) is published(
        classes, locations, robot, confidences
    )


@given(objects, points)
def test_the_order_of_the_objects_does_not_matter(found, robot):
    def answer(things):
        return detect_cover([t[0] for t in things], [t[1] for t in things], robot, [t[2] for t in things])

    assert answer(found) == answer(found[::-1])


@pytest.mark.parametrize(
    ("distance", "confidence", "covered"),
    [(10.0, 0.85, True), (10.001, 1.0, False), (1.0, 0.8499, False), (0.0, 1.0, True)],
)
def test_both_thresholds_include_their_limit(distance, confidence, covered):
    assert detect_cover(["rocks"], [(0.0, 0.0, distance)], (0.0, 0.0, 0.0), [confidence]) is covered


def test_height_counts_as_distance():
    assert not detect_cover(["trees"], [(6.0, 6.0, 6.0)], (0.0, 0.0, 0.0), [1.0])


@pytest.mark.parametrize(
    "name", [*PAPER, "Rock", "rock", "TREE", "Disabled Vehicle", "disabled_vehicle", " house "]
)
def test_the_paper_s_and_the_catalogue_s_spellings_are_cover(name):
    assert is_cover_class(name)


@pytest.mark.parametrize("name", ["fence", "fences", "grass", "treehouse", "", "vehicle", "person"])
def test_other_classes_are_not(name):
    assert not is_cover_class(name)


def test_every_class_of_the_catalogue_but_the_fence_is_cover():
    assert {kind for kind, entry in CATALOGUE.items() if not is_cover_class(entry.class_name)} == {
        CoverKind.FENCE
    }


def test_nothing_seen_is_no_cover():
    assert detect_cover([], [], (0.0, 0.0, 0.0), []) is False


def test_arrays_do_as_well_as_lists():
    locations = np.array([[3.0, 0.0, 0.0], [50.0, 0.0, 0.0]])
    assert detect_cover(np.array(["trees", "rocks"]), locations, np.zeros(3), np.array([0.9, 1.0])) is True


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((["rock"], [], (0, 0, 0), [1.0]), "1 classes, 0 locations and 1 confidences"),
        ((["rock"], [(0, 0, 0)], (0, 0, 0), []), "0 confidences"),
        ((["rock"], [(0, math.nan, 0)], (0, 0, 0), [1.0]), r"object_locations\[0\]"),
        ((["rock"], [(0, 0)], (0, 0, 0), [1.0]), "three finite numbers"),
        ((["rock"], [(0, 0, 0)], (0, math.inf, 0), [1.0]), "robot_location"),
        (([], [], (0, math.nan, 0), []), "robot_location"),
        ((["rock"], [(0, 0, 0)], (0, 0, 0), [math.nan]), r"confidences\[0\]"),
        (([7], [(0, 0, 0)], (0, 0, 0), [1.0]), r"object_classes\[0\]"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(arguments, message):
    with pytest.raises(ValueError, match=message):
        detect_cover(*arguments)


def sighting(object_id=1, x=5.0, confidence=0.9, width=1.5, height=1.0, kind=CoverKind.BUSH):
    entry = CATALOGUE[kind]
    detection = Detection(0, entry.class_id, entry.class_name, confidence, 0, 0, 9, 9, object_id, x, 0.0, 0.0)
    return Sighting(detection, kind, width, height)


def test_memory_begins_with_what_was_seen():
    memory = CoverMemory()
    memory.update([sighting(2), sighting(1)])
    assert [estimate.object_id for estimate in memory.estimates] == [1, 2]
    assert memory.estimates[0] == CoverEstimate(1, CoverKind.BUSH, 5.0, 0.0, 0.0, 1.5, 1.0, 0.9)


def test_memory_settles_on_what_is_seen_again_and_again():
    memory = CoverMemory()
    memory.update([sighting(x=5.0, confidence=0.5)])
    for _ in range(20):
        memory.update([sighting(x=6.0, confidence=0.95)])
    (estimate,) = memory.estimates
    assert estimate.x == pytest.approx(6.0, abs=0.01)
    assert estimate.confidence == pytest.approx(0.95, abs=0.01)


def test_a_sure_sighting_moves_an_estimate_more_than_an_unsure_one():
    def moved(confidence):
        memory = CoverMemory()
        memory.update([sighting(x=5.0)])
        memory.update([sighting(x=6.0, confidence=confidence)])
        return memory.estimates[0].x

    assert moved(0.4) < moved(0.9) < 6.0


def test_half_a_view_does_not_make_an_object_smaller():
    memory = CoverMemory()
    memory.update([sighting(width=4.0, height=2.0)])
    memory.update([sighting(width=1.0, height=0.5)])
    assert (memory.estimates[0].width, memory.estimates[0].height) == (4.0, 2.0)


def test_what_is_looked_through_fades_and_is_forgotten():
    memory = CoverMemory()
    memory.update([sighting(1), sighting(2)])
    memory.update([], looked_through=[1])
    assert memory.estimates[0].confidence < 0.85
    for _ in range(4):
        memory.update([], looked_through=[1])
    assert [estimate.object_id for estimate in memory.estimates] == [2]


BUSH = CoverEstimate(1, CoverKind.BUSH, 5.0, 0.0, 0.0, 2.0, 1.5, 0.95)
ROBOT, GOAL = (0.0, 0.0), (12.0, 0.0)
EYE = (20.0, 0.0, 1.7)


def chosen(*cover, eyes=(), **options):
    choice = choose_cover(cover, ROBOT, GOAL, eyes, **options)
    return None if choice is None else choice.cover.object_id


def test_of_two_alike_the_nearer_is_chosen():
    assert chosen(BUSH, replace(BUSH, object_id=2, x=8.0)) == 1


def test_of_two_alike_the_larger_is_chosen():
    assert chosen(replace(BUSH, width=0.9), replace(BUSH, object_id=2)) == 2


def test_of_two_alike_the_one_on_the_way_is_chosen():
    assert chosen(replace(BUSH, x=-5.0), replace(BUSH, object_id=2)) == 2


def test_cover_that_hides_goes_before_nearer_cover_that_does_not():
    low = replace(BUSH, x=3.0, height=0.5)
    tall = replace(BUSH, object_id=2, x=8.0, height=3.0)
    assert chosen(low, tall) == 1
    assert chosen(low, tall, eyes=[(14.0, 0.0, 3.0)]) == 2


@pytest.mark.parametrize(
    "change",
    [{"kind": CoverKind.FENCE}, {"width": 0.5}, {"height": 0.3}, {"confidence": 0.84}, {"x": 16.0}],
    ids=["see-through", "too narrow", "too low", "unsure", "too far"],
)
def test_what_cannot_hide_the_robot_is_not_chosen(change):
    assert chosen(replace(BUSH, **change)) is None


@given(st.floats(-math.pi, math.pi), st.floats(8.0, 40.0))
def test_the_spot_is_behind_the_cover_as_the_eye_sees_it(bearing, distance):
    eye = (5.0 + distance * math.cos(bearing), distance * math.sin(bearing), 1.7)
    choice = choose_cover([BUSH], ROBOT, GOAL, [eye])
    away = np.subtract(choice.spot, (BUSH.x, BUSH.y))
    toward = np.subtract((BUSH.x, BUSH.y), eye[:2])
    assert np.dot(away, toward) == pytest.approx(np.hypot(*away) * np.hypot(*toward))
    assert choice.hidden_from == 1


def test_an_eye_high_above_looks_over_low_cover():
    assert choose_cover([BUSH], ROBOT, GOAL, [(8.0, 0.0, 30.0)]).hidden_from == 0


def test_an_eye_in_the_cover_is_not_hidden_from():
    assert choose_cover([BUSH], ROBOT, GOAL, [(5.0, 0.0, 1.7)]).hidden_from == 0


def test_with_no_cover_there_is_no_choice():
    assert choose_cover([], ROBOT, GOAL, [EYE]) is None
