"""RUGD and RELLIS-3D, in small files of their own layout."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from planner.ga_nav.datasets import (
    RELLIS_CLASSES,
    RUGD_CLASSES,
    RUGD_IMAGES,
    RUGD_LABELS,
    RUGD_SEQUENCES,
    DataSet,
    Part,
    pairs,
    read_groups,
    read_image,
    read_part,
)
from planner.ga_nav.groups import GROUPS
from planner.learning_errors import TrainingRefusal

RUGD, RELLIS = DataSet.RUGD, DataSet.RELLIS


def stripes(values: np.ndarray) -> np.ndarray:
    """(240, 320, ...) with a stripe of each value side by side."""
    which = np.arange(320) * len(values) // 320
    return np.repeat(values[which][None], 240, axis=0)


def picture(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def rugd(folder: Path, *sequences: str, colours=((0, 102, 0), (255, 128, 0))) -> Path:
    for sequence in sequences:
        for number in (1, 2):
            name = f"{sequence}_{number:05d}.png"
            picture(folder / RUGD_IMAGES / sequence / name, np.full((55, 68, 3), 40 * number, np.uint8))
            picture(folder / RUGD_LABELS / sequence / name, stripes(np.array(colours, np.uint8)))
    return folder


def rellis(folder: Path, numbers=(3, 31)) -> Path:
    for part in Part:
        names = [f"0000{place}/pylon_camera_node" for place in range(2)]
        lines = []
        for name in names:
            image, label = f"{name}/{part.value}.jpg", f"{name}_label_id/{part.value}.png"
            picture(folder / image, np.full((60, 96, 3), 90, np.uint8))
            picture(folder / label, stripes(np.array(numbers, np.uint8)))
            lines.append(f"{image} {label}")
        (folder / f"{part.value}.lst").write_text("\n".join(lines) + "\n\n")
    return folder


def test_rugd_is_split_by_its_sequences(tmp_path) -> None:
    rugd(tmp_path, "park-2", "village", "trail-5", "creek")
    found = {part: [label.parent.name for _, label in pairs(RUGD, tmp_path, part)] for part in Part}
    assert found == {
        Part.TRAIN: ["park-2"] * 2 + ["village"] * 2,
        Part.VALIDATION: ["trail-5"] * 2,
        Part.TEST: ["creek"] * 2,
    }
    sequences = [name for part in Part for name in RUGD_SEQUENCES[part]]
    assert len(sequences) == len(set(sequences)) == 18


def test_a_part_comes_as_images_and_labels_of_one_size(tmp_path) -> None:
    rgb, groups = read_part(RUGD, rugd(tmp_path, "park-1"), Part.TEST)
    assert rgb.shape == (2, 120, 160, 3) and groups.shape == (2, 120, 160)
    assert (rgb[0] == 40).all() and (rgb[1] == 80).all()
    assert {GROUPS[label].value for label in np.unique(groups)} == {"rough"}


def test_rellis_is_split_by_its_lists(tmp_path) -> None:
    found = pairs(RELLIS, rellis(tmp_path), Part.VALIDATION)
    assert [image.name for image, _ in found] == ["val.jpg", "val.jpg"]
    _, groups = read_part(RELLIS, tmp_path, Part.TRAIN)
    assert [GROUPS[label].value for label in (groups[0, 60, 10], groups[0, 60, 150])] == [
        "rough",
        "forbidden",
    ]


@pytest.mark.parametrize(("data_set", "classes"), [(RUGD, RUGD_CLASSES), (RELLIS, RELLIS_CLASSES)])
def test_every_class_is_read_as_its_group(tmp_path, data_set: DataSet, classes) -> None:
    keys = [each.colour if data_set is RUGD else each.number for each in classes.values()]
    picture(tmp_path / "all.png", stripes(np.array(keys, np.uint8)))
    groups = read_groups(data_set, tmp_path / "all.png")
    columns = ((np.arange(len(keys)) + 0.5) * 160 / len(keys)).astype(int)
    assert [GROUPS[label] for label in groups[60, columns]] == [each.group for each in classes.values()]


def test_bushes_are_forbidden_in_rellis_and_obstacles_in_rugd() -> None:
    assert (
        RELLIS_CLASSES["bush"].group.value == "forbidden" and RUGD_CLASSES["bush"].group.value == "obstacle"
    )
    assert RUGD_CLASSES["rock"].group.value == "bumpy" and RELLIS_CLASSES["mud"].group.value == "bumpy"
    assert RUGD_CLASSES["sign"].group.value == "background"


KNOWN = {each.colour for each in RUGD_CLASSES.values()}


@given(st.tuples(*[st.integers(0, 255)] * 3).filter(lambda colour: colour not in KNOWN))
def test_a_colour_of_no_class_is_refused_with_the_files_name(tmp_path_factory, colour) -> None:
    path = tmp_path_factory.mktemp("rugd") / "creek_00001.png"
    picture(path, stripes(np.array([(0, 102, 0), colour], np.uint8)))
    with pytest.raises(TrainingRefusal) as refused:
        read_groups(RUGD, path)
    assert str(colour) in str(refused.value) and str(path) in str(refused.value)


def test_a_number_of_no_class_is_refused_with_the_files_name(tmp_path) -> None:
    picture(tmp_path / "a.png", stripes(np.array([3, 2], np.uint8)))
    with pytest.raises(TrainingRefusal, match=r"a\.png holds the number 2,"):
        read_groups(RELLIS, tmp_path / "a.png")


def test_rellis_annotations_in_colours_are_refused(tmp_path) -> None:
    picture(tmp_path / "a.png", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(TrainingRefusal, match="by id are numbers"):
        read_groups(RELLIS, tmp_path / "a.png")


def without_a_folder(folder: Path) -> None:
    (folder / RUGD_LABELS).rename(folder / "elsewhere")


def without_an_image(folder: Path) -> None:
    (folder / RUGD_IMAGES / "creek" / "creek_00002.png").unlink()


def with_no_sequence(folder: Path) -> None:
    (folder / RUGD_LABELS / "creek").rename(folder / RUGD_LABELS / "brook")


@pytest.mark.parametrize(("harm", "words"), [
    (without_a_folder, "holds no folder RUGD_annotations"),
    (without_an_image, "creek_00002.png is missing"),
    (with_no_sequence, "holds no annotated image of rugd's part test"),
])  # fmt: skip
def test_what_is_missing_of_rugd_is_said(tmp_path, harm, words: str) -> None:
    harm(rugd(tmp_path, "creek"))
    with pytest.raises(TrainingRefusal, match=words):
        pairs(RUGD, tmp_path, Part.TEST)


def test_what_is_wrong_with_rellis_lists_is_said(tmp_path) -> None:
    with pytest.raises(TrainingRefusal, match=r"train\.lst cannot be read"):
        pairs(RELLIS, tmp_path, Part.TRAIN)
    rellis(tmp_path)
    (tmp_path / "train.lst").write_text("one two three\n")
    with pytest.raises(TrainingRefusal, match=r"train\.lst, line 1: .*'one two three'"):
        pairs(RELLIS, tmp_path, Part.TRAIN)


def test_a_file_that_is_no_image_is_refused_with_its_name(tmp_path) -> None:
    (tmp_path / "b.png").write_bytes(b"no image")
    with pytest.raises(TrainingRefusal, match=r"b\.png cannot be read as an image"):
        read_image(tmp_path / "b.png")
