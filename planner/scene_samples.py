"""Samples for learning, a file for each seeded scene: those that are there are not made again, so that a run
that was cut off goes on."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast
from zipfile import BadZipFile

import numpy as np
from joblib import Parallel, delayed

from planner.checkpoint import write_file
from planner.learning_errors import TrainingRefusal

Arrays = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Lessons:
    """seed : of the first scene, the weights and the order of the samples; scene i has seed + i and the
    terrains in turn; the last `held_out` of them are for validation alone
    """

    scenes: int
    held_out: int
    seed: int
    epochs: int

    @property
    def seeds(self) -> tuple[range, range]:
        """Of the scenes learnt from, and of those held out."""
        last = self.seed + self.scenes
        return range(self.seed, last), range(last, last + self.held_out)


def collect(folder: Path, seeds: Sequence[int], jobs: int, take: Callable[[int], Arrays]) -> Iterator[int]:
    """Keep what `take` makes of each seed that is not in `folder` yet, on `jobs` processes; yields each seed
    as it is there. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [seed for seed in seeds if not _file(folder, seed).exists()]
    yield from (seed for seed in seeds if seed not in set(missing))
    parallel = Parallel(n_jobs=jobs, return_as="generator_unordered")
    yield from cast(Iterator[int], parallel(delayed(_keep)(folder, seed, take) for seed in missing))


def _keep(folder: Path, seed: int, take: Callable[[int], Arrays]) -> int:
    packed = io.BytesIO()
    np.savez_compressed(packed, **take(seed))  # type: ignore[arg-type]
    write_file(_file(folder, seed), packed.getvalue())
    return seed


def kept(folder: Path, seeds: Sequence[int], names: Sequence[str]) -> Iterator[Arrays]:
    """The arrays of each seed, by their names. Raises FileNotFoundError where one is missing, TrainingRefusal
    where it is damaged or of another learner."""
    for seed in seeds:
        path = _file(folder, seed)
        try:
            with np.load(path) as arrays:
                yield {name: arrays[name] for name in names}
        except (ValueError, KeyError, EOFError, BadZipFile):
            words = f"{path} is damaged, or of another learner; delete it, and it is made anew"
            raise TrainingRefusal(words) from None


def _file(folder: Path, seed: int) -> Path:
    return folder / f"{seed}.npz"
