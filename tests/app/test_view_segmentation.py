"""What a method takes the ground for, as a layer and as a picture beside the view."""

import base64
import io
import re
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from app.view import palette, segmentation
from app.view.segmentation import WORDS, GroupsLayer, groups_surface, inset, legend, picture
from planner.frames import Segmentation
from scenes.catalogue import TraversabilityGroup
from scenes.terrain import Heightmap

UNKNOWN = Segmentation.UNKNOWN
CODES = {group.value: code for code, group in enumerate(TraversabilityGroup)}


@pytest.fixture
def hill() -> Heightmap:
    y, x = np.mgrid[0:81, 0:81]
    cells = np.zeros((81, 81), np.uint8)
    return Heightmap(np.sin(0.1 * x) + 0.02 * y, 0.25, cells, cells)


def seen(label: str = "rough", known: bool = True, image: bool = True) -> Segmentation:
    ground = np.full((21, 31), CODES[label] if known else UNKNOWN, np.uint8)
    rgb = np.full((120, 160, 3), 100, np.uint8) if image else None
    groups = np.full((120, 160), CODES[label], np.uint8) if image else None
    return Segmentation(-3.0, -2.0, 0.2, ground, rgb, groups)


@pytest.mark.parametrize("label", CODES)
def test_the_groups_lie_just_above_the_ground_in_their_colours(hill, label: str) -> None:
    surface = groups_surface(seen(label), hill, 0.5)
    assert surface is not None and surface.colours is not None
    x, y, z = surface.vertices.T
    assert (z > hill.height_at(x, y)).all() and (z < hill.height_at(x, y) + 0.1).all()
    assert (x.min(), x.max(), y.min(), y.max()) == (-3.0, 3.0, -2.0, 2.0)
    assert (surface.colours == (*palette.GROUPS[TraversabilityGroup(label)], 128)).all()


def test_ground_that_was_not_seen_is_left_clear(hill) -> None:
    assert groups_surface(seen(known=False), hill, 1.0) is None
    half = seen()
    half.ground[:, 16:] = UNKNOWN
    surface = groups_surface(half, hill, 1.0)
    assert surface is not None and surface.vertices[:, 0].max() <= 0.5


def test_every_group_has_words_and_a_colour_of_its_own() -> None:
    assert set(WORDS) == set(palette.GROUPS) == set(TraversabilityGroup)
    colours = np.array([palette.GROUPS[group] for group in TraversabilityGroup], int)
    gaps = np.abs(colours[:, None] - colours[None]).sum(axis=2) + 999 * np.eye(len(colours), dtype=int)
    assert gaps.min() > 60
    assert all(word in legend() for word in WORDS.values())


def test_the_picture_is_the_image_tinted_by_its_groups() -> None:
    jpeg = picture(seen("forbidden"))
    assert jpeg is not None
    pixels = np.asarray(Image.open(io.BytesIO(jpeg))).astype(int)
    wanted = (100 + np.array(palette.GROUPS[TraversabilityGroup.FORBIDDEN])) / 2
    assert pixels.shape == (120, 160, 3) and np.abs(pixels - wanted).max() < 6


def test_the_inset_shows_the_picture_and_names_every_colour() -> None:
    page = inset(seen())
    (data,) = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', page)
    assert base64.b64decode(data) == picture(seen())
    assert all(word in page for word in WORDS.values())


def test_without_an_image_the_inset_has_the_colours_alone_and_without_ground_there_is_none() -> None:
    told = inset(seen(image=False))
    assert "<img" not in told and all(word in told for word in WORDS.values())
    assert inset(None) == ""


class Drawn:
    """Stands for the node that would be sent to browsers."""

    def __init__(self, *_: object) -> None:
        self.sent: list[bytes | None] = []

    def show(self, data: bytes | None) -> None:
        self.sent.append(data)


def test_the_layer_is_sent_when_it_changes_and_goes_with_the_method(hill, monkeypatch) -> None:
    monkeypatch.setattr(segmentation, "SwapGlb", Drawn)
    layer = GroupsLayer(SimpleNamespace(), "/groups")  # type: ignore[arg-type]
    node = layer._node

    def frame(time_s: float, what: Segmentation | None):
        return SimpleNamespace(time_s=time_s, decision=SimpleNamespace(segmentation=what))

    layer.draw(frame(0.0, seen()), hill)
    layer.draw(frame(1.0, seen()), hill)  # the same ground
    layer.draw(frame(1.1, seen("smooth")), hill)
    layer.draw(frame(1.2, seen("bumpy")), hill)  # too soon
    layer.draw(frame(1.7, seen("bumpy")), hill)
    assert len(node.sent) == 3 and all(node.sent)
    layer.draw(frame(1.8, None), hill)
    layer.draw(frame(1.9, None), hill)
    assert node.sent[3:] == [None]
