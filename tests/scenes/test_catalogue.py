"""Cover classes and their outlines on the ground."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.catalogue import CATALOGUE, CoverKind, Footprint, footprint
from scenes.robot import HUSKY

outlines = st.builds(
    Footprint,
    x=st.floats(-5.0, 5.0),
    y=st.floats(-5.0, 5.0),
    yaw=st.floats(-math.pi, math.pi),
    length=st.floats(0.1, 6.0),
    width=st.floats(0.1, 6.0),
    round=st.booleans(),
)


def test_every_kind_has_a_class_with_a_label_of_its_own():
    assert set(CATALOGUE) == set(CoverKind)
    assert len({entry.class_id for entry in CATALOGUE.values()}) == len(CATALOGUE)
    for entry in CATALOGUE.values():
        for span in (entry.length, entry.width, entry.height):
            assert 0.0 < span.low <= span.usual <= span.high


@pytest.mark.parametrize(
    ("kind", "hides"),
    [(CoverKind.HOUSE, True), (CoverKind.BUSH, True), (CoverKind.FENCE, False)],
)
def test_what_hides_a_husky(kind, hides):
    entry = CATALOGUE[kind]
    assert entry.conceals(entry.length.usual, entry.height.usual, HUSKY.width, HUSKY.height) is hides
    assert not entry.conceals(0.3, 0.3, HUSKY.width, HUSKY.height)


def test_a_tree_blocks_with_its_trunk_alone():
    assert footprint(CoverKind.TREE, 0.0, 0.0, 0.0, 3.0, 3.0).radius == pytest.approx(0.18)


@pytest.mark.parametrize(
    ("point", "distance"),
    [((2.0, 1.0), -1.0), ((2.0, 3.5), 0.5), ((5.0, 1.0), 2.0), ((3.4, 4.3), math.hypot(0.4, 1.3))],
)
def test_distance_to_a_rectangle(point, distance):
    outline = Footprint(2.0, 1.0, math.pi / 2, 4.0, 2.0, round=False)
    assert outline.distance(np.array([point]))[0] == pytest.approx(distance)


@given(outlines, st.floats(-8.0, 8.0), st.floats(-8.0, 8.0))
def test_distance_never_changes_faster_than_one_walks(outline, x, y):
    here, there = outline.distance(np.array([(x, y), (x + 0.3, y - 0.4)]))
    assert abs(here - there) <= 0.5 + 1e-9


@given(outlines)
def test_corners_lie_on_the_outline_and_the_lattice_within(outline):
    if not outline.round:
        assert np.allclose(outline.distance(outline.corners), 0.0, atol=1e-9)
        assert (outline.distance(outline.lattice(0.5)) <= 1e-9).all()
    assert np.allclose(outline.corners.mean(axis=0), (outline.x, outline.y))


@given(outlines, outlines)
def test_the_gap_between_two_outlines_is_what_sampling_them_finds(a, b):
    gap = a.gap(b)
    assert gap == pytest.approx(b.gap(a), abs=1e-9)
    sampled = min(b.distance(rim(a)).min(), a.distance(rim(b)).min())
    overlap = min(b.distance(rim(a)).min(), a.distance(rim(b)).min(),
                  *b.distance(np.array([[a.x, a.y]])), *a.distance(np.array([[b.x, b.y]])))  # fmt: skip
    if gap > 0.0:
        assert gap <= sampled + 1e-9 and sampled <= gap + 0.1
    elif gap < -0.1:
        assert overlap < 0.0


def rim(outline: Footprint) -> np.ndarray:
    """Points a few centimetres apart along an outline."""
    share = np.linspace(0.0, 1.0, 101)[:, None]
    if outline.round:
        angle = 2.0 * np.pi * share
        ring = np.hstack([np.cos(angle), np.sin(angle)])
        return (outline.x, outline.y) + 0.5 * outline.length * ring
    corners = outline.corners
    return np.vstack(
        [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
