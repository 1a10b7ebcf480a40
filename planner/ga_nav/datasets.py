"""RUGD (Wigness et al. 2019) and RELLIS-3D (Jiang et al. 2021) as images with GA-Nav's six groups.

Read from the folders that the two come in:

    RUGD    RUGD_frames-with-annotations/<sequence>/<name>.png    colour images
            RUGD_annotations/<sequence>/<name>.png                classes as colours
    RELLIS  <sequence>/pylon_camera_node/<name>.jpg               colour images
            <sequence>/pylon_camera_node_label_id/<name>.png      classes as numbers
            train.lst, val.lst, test.lst                          an image and its classes a line

RUGD is split by sequences as its authors split it, RELLIS-3D by its lists. Which class belongs to which group
is as GA-Nav has it (Guan et al. 2022, table I and the code): a bush is forbidden in RELLIS-3D, where it is an
obstacle in RUGD.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from planner.ga_nav.groups import GROUP_CODE
from planner.learning_errors import TrainingRefusal
from scenes.catalogue import TraversabilityGroup as Group

WIDTH, HEIGHT = 160, 120


class DataSet(StrEnum):
    RUGD = "rugd"
    RELLIS = "rellis"


class Part(StrEnum):
    TRAIN = "train"
    VALIDATION = "val"
    TEST = "test"


@dataclass(frozen=True)
class DataClass:
    """A class of a data set: the number it has there, the colour that stands for it, and its group."""

    number: int
    colour: tuple[int, int, int]
    group: Group


BACKGROUND, SMOOTH, ROUGH, BUMPY, FORBIDDEN, OBSTACLE = Group

RUGD_CLASSES: Mapping[str, DataClass] = {
    "void": DataClass(0, (0, 0, 0), BACKGROUND),
    "dirt": DataClass(1, (108, 64, 20), ROUGH),
    "sand": DataClass(2, (255, 229, 204), ROUGH),
    "grass": DataClass(3, (0, 102, 0), ROUGH),
    "tree": DataClass(4, (0, 255, 0), OBSTACLE),
    "pole": DataClass(5, (0, 153, 153), OBSTACLE),
    "water": DataClass(6, (0, 128, 255), FORBIDDEN),
    "sky": DataClass(7, (0, 0, 255), BACKGROUND),
    "vehicle": DataClass(8, (255, 255, 0), OBSTACLE),
    "container/generic-object": DataClass(9, (255, 0, 127), OBSTACLE),
    "asphalt": DataClass(10, (64, 64, 64), SMOOTH),
    "gravel": DataClass(11, (255, 128, 0), ROUGH),
    "building": DataClass(12, (255, 0, 0), OBSTACLE),
    "mulch": DataClass(13, (153, 76, 0), ROUGH),
    "rock-bed": DataClass(14, (102, 102, 0), BUMPY),
    "log": DataClass(15, (102, 0, 0), OBSTACLE),
    "bicycle": DataClass(16, (0, 255, 128), OBSTACLE),
    "person": DataClass(17, (204, 153, 255), OBSTACLE),
    "fence": DataClass(18, (102, 0, 204), OBSTACLE),
    "bush": DataClass(19, (255, 153, 204), OBSTACLE),
    "sign": DataClass(20, (0, 102, 102), BACKGROUND),
    "rock": DataClass(21, (153, 204, 255), BUMPY),
    "bridge": DataClass(22, (102, 255, 255), OBSTACLE),
    "concrete": DataClass(23, (101, 101, 11), SMOOTH),
    "picnic-table": DataClass(24, (114, 85, 47), OBSTACLE),
}

RELLIS_CLASSES: Mapping[str, DataClass] = {
    "void": DataClass(0, (0, 0, 0), BACKGROUND),
    "dirt": DataClass(1, (108, 64, 20), ROUGH),
    "grass": DataClass(3, (0, 102, 0), ROUGH),
    "tree": DataClass(4, (0, 255, 0), OBSTACLE),
    "pole": DataClass(5, (0, 153, 153), OBSTACLE),
    "water": DataClass(6, (0, 128, 255), FORBIDDEN),
    "sky": DataClass(7, (0, 0, 255), BACKGROUND),
    "vehicle": DataClass(8, (255, 255, 0), OBSTACLE),
    "object": DataClass(9, (255, 0, 127), OBSTACLE),
    "asphalt": DataClass(10, (64, 64, 64), SMOOTH),
    "building": DataClass(12, (255, 0, 0), OBSTACLE),
    "log": DataClass(15, (102, 0, 0), OBSTACLE),
    "person": DataClass(17, (204, 153, 255), OBSTACLE),
    "fence": DataClass(18, (102, 0, 204), OBSTACLE),
    "bush": DataClass(19, (255, 153, 204), FORBIDDEN),
    "concrete": DataClass(23, (170, 170, 170), SMOOTH),
    "barrier": DataClass(27, (41, 121, 255), OBSTACLE),
    "puddle": DataClass(31, (134, 255, 239), FORBIDDEN),
    "mud": DataClass(33, (99, 66, 34), BUMPY),
    "rubble": DataClass(34, (110, 22, 138), BUMPY),
}

RUGD_SEQUENCES: Mapping[Part, tuple[str, ...]] = {
    Part.TRAIN: (
        "park-2", "trail", "trail-3", "trail-4", "trail-6", "trail-9", "trail-10", "trail-11", "trail-12",
        "trail-14", "trail-15", "village",
    ),
    Part.VALIDATION: ("park-8", "trail-5"),
    Part.TEST: ("creek", "park-1", "trail-7", "trail-13"),
}  # fmt: skip

RUGD_IMAGES, RUGD_LABELS = "RUGD_frames-with-annotations", "RUGD_annotations"


def pairs(data_set: DataSet, folder: Path, part: Part) -> list[tuple[Path, Path]]:
    """The images of a part of a data set, each with its annotation, in the order of their names.

    Raises TrainingRefusal for a folder, list or annotation that is missing."""
    found = list((_rugd_pairs if data_set is DataSet.RUGD else _rellis_pairs)(folder, part))
    if not found:
        raise TrainingRefusal(f"{folder} holds no annotated image of {data_set.value}'s part {part.value}")
    for paths in found:
        for path in paths:
            if not _is_file(path):
                raise TrainingRefusal(f"{path} is missing; copy the whole data set {data_set.value} there")
    return found


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # such as a name that is too long
        return False


def _rugd_pairs(folder: Path, part: Part) -> Iterator[tuple[Path, Path]]:
    for name in (RUGD_IMAGES, RUGD_LABELS):
        if not (folder / name).is_dir():
            raise TrainingRefusal(f"{folder} holds no folder {name}; is it where RUGD was unpacked?")
    for sequence in RUGD_SEQUENCES[part]:
        for label in sorted((folder / RUGD_LABELS / sequence).glob("*.png")):
            yield folder / RUGD_IMAGES / sequence / label.name, label


def _rellis_pairs(folder: Path, part: Part) -> Iterator[tuple[Path, Path]]:
    path = folder / f"{part.value}.lst"
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise TrainingRefusal(f"{path} cannot be read ({reason}); put RELLIS-3D's lists there") from None
    for number, line in enumerate(lines, 1):
        names = line.split()
        if len(names) not in (0, 2):
            raise TrainingRefusal(
                f"{path}, line {number}: an image and its annotation expected, not {line!r}"
            )
        if names:
            yield folder / names[0], folder / names[1]


def read_image(path: Path) -> np.ndarray:
    """(120, 160, 3) uint8, whatever the size in the file. Raises TrainingRefusal where it is no image."""
    return np.asarray(_opened(path).convert("RGB").resize((WIDTH, HEIGHT), Image.Resampling.BOX))


def read_groups(data_set: DataSet, path: Path) -> np.ndarray:
    """(120, 160) uint8 labels of an annotation. Raises TrainingRefusal, naming the file, for a colour or a
    number that no class has."""
    image = _opened(path)
    if data_set is DataSet.RELLIS:
        if image.mode not in ("L", "P", "I", "I;16"):
            raise TrainingRefusal(f"{path} holds colours; RELLIS-3D's annotations by id are numbers")
        return _grouped(np.asarray(_shrunk(image)).astype(np.int64), _RELLIS, path, str)
    colours = np.asarray(_shrunk(image.convert("RGB"))).astype(np.int64)
    keys = (colours[..., 0] << 16) + (colours[..., 1] << 8) + colours[..., 2]
    return _grouped(keys, _RUGD, path, lambda key: str((key >> 16, key >> 8 & 255, key & 255)))


_RUGD = {
    (each.colour[0] << 16) + (each.colour[1] << 8) + each.colour[2]: GROUP_CODE[each.group]
    for each in RUGD_CLASSES.values()
}
_RELLIS = {each.number: GROUP_CODE[each.group] for each in RELLIS_CLASSES.values()}


def _grouped(keys: np.ndarray, table: Mapping[int, int], path: Path, words) -> np.ndarray:
    found, place = np.unique(keys, return_inverse=True)
    for key in found.tolist():
        if key not in table:
            kind = "colour" if table is _RUGD else "number"
            raise TrainingRefusal(f"{path} holds the {kind} {words(key)}, which no class of the data set has")
    groups = np.array([table[key] for key in found.tolist()], np.uint8)
    return groups[place].reshape(keys.shape)


def _shrunk(image: Image.Image) -> Image.Image:
    return image.resize((WIDTH, HEIGHT), Image.Resampling.NEAREST)


def _opened(path: Path) -> Image.Image:
    try:
        image = Image.open(path)
        image.load()
    except (OSError, UnidentifiedImageError, ValueError, SyntaxError) as error:
        raise TrainingRefusal(f"{path} cannot be read as an image: {error}") from None
    return image


def read_part(data_set: DataSet, folder: Path, part: Part) -> tuple[np.ndarray, np.ndarray]:
    """All images (n, 120, 160, 3) uint8 of a part and their labels (n, 120, 160) uint8.

    Raises TrainingRefusal as `pairs` and `read_groups` do."""
    found = pairs(data_set, folder, part)
    rgb = np.stack([read_image(image) for image, _ in found])
    return rgb, np.stack([read_groups(data_set, label) for _, label in found])
