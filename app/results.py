"""The evaluations that the studio can show: the shipped sample, and the workspace's `results/*.sqlite`."""

from __future__ import annotations

import contextlib
import re
import shutil
import threading
import unicodedata
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, count
from pathlib import Path
from typing import Any

from app.results_store import ResultsError, ResultsFile
from app.store import ID_PATTERN, MAX_ID, UnknownEntry
from planner.evaluation_table import KIND, Row, bounds, grouped, method_order, tabulate, totals
from planner.methods import METHODS, VARIANTS
from planner.paired import paired
from planner.trajectory import Trajectory
from scenes.scenario import Family

SAMPLE = Path(__file__).parents[1] / "static" / "results.sqlite"
SAMPLE_ID = "sample"
KEPT = 4


@dataclass(frozen=True, eq=False)
class Drive:
    """One method's drive of a mission, with where it went."""

    mission: dict[str, Any]
    trajectory: Trajectory


class Evaluation:
    """One file's missions and what they come to. Raises ResultsError for a file that is none."""

    def __init__(self, path: Path) -> None:
        self.file = ResultsFile(path)
        self.title = self.file.title
        self.missions = self.file.missions()
        self._by_id = {mission["id"]: mission for mission in self.missions}

    @cached_property
    def rows(self) -> list[Row]:
        return tabulate(self.missions)

    @cached_property
    def bounds(self) -> list[Row]:
        return bounds(self.missions)

    @cached_property
    def totals(self) -> tuple[list[Row], list[Row]]:
        """The methods' rows and the bound's over all terrains together."""
        return totals(self.missions)

    @property
    def table(self) -> tuple[list[Row], list[Row]]:
        """All rows of the methods and of the bound, those over all terrains last."""
        rows, bounds = self.totals
        return self.rows + rows, self.bounds + bounds

    @cached_property
    def methods(self) -> list[str]:
        return sorted({mission["method"] for mission in self.missions}, key=method_order)

    @cached_property
    def _by_kind(self) -> list[tuple[dict[str, Any], list[dict[str, Any]]]]:
        groups = grouped(self.missions, KIND)
        keys = sorted(groups, key=lambda key: (-len(groups[key]), key))
        return [
            (dict(zip(KIND, key, strict=True)), sorted(groups[key], key=lambda mission: mission["id"]))
            for key in keys
        ]

    @property
    def kinds(self) -> list[dict[str, Any]]:
        """The kinds of missions, the one with the most first."""
        return [kind for kind, _ in self._by_kind]

    def of_kind(self, number: int) -> list[dict[str, Any]]:
        """Missions of a kind, in the file's order. Raises UnknownEntry."""
        self.kind(number)
        return self._by_kind[number][1]

    def kind(self, number: int) -> dict[str, Any]:
        if not 0 <= number < len(self.kinds):
            raise UnknownEntry(f"there is no kind {number} of missions; there are {len(self.kinds)}, from 0")
        return self.kinds[number]

    def mission(self, mission_id: int) -> dict[str, Any]:
        """Raises UnknownEntry."""
        if mission_id not in self._by_id:
            raise UnknownEntry(f"there is no mission {mission_id} in {self.title}")
        return self._by_id[mission_id]

    def drives(self, mission_id: int) -> list[Drive]:
        """What every method made of the same mission, as far as its way is known. Raises UnknownEntry."""
        wanted = _place(self.mission(mission_id))
        alike = [mission for mission in self.missions if mission["drawn"] and _place(mission) == wanted]
        alike.sort(key=lambda mission: self.methods.index(mission["method"]))
        found = []
        for mission in alike:
            with contextlib.suppress(ResultsError):  # one way that is damaged does not hide the others
                found.append(self.drive(mission["id"]))
        return found

    def drive(self, mission_id: int) -> Drive:
        """Raises UnknownEntry."""
        mission = self.mission(mission_id)
        try:
            return Drive(mission, self.file.trajectory(mission_id))
        except LookupError as error:
            raise UnknownEntry(str(error.args[0])) from None

    def recipe(self, mission_id: int) -> dict[str, Any]:
        """Raises UnknownEntry."""
        self.mission(mission_id)
        try:
            return self.file.recipe(mission_id)
        except LookupError as error:
            raise UnknownEntry(str(error.args[0])) from None

    def paired(self, method: str, against: str) -> list[Row]:
        """Raises UnknownEntry for a method that did not drive."""
        for name in (method, against):
            if name not in self.methods:
                raise UnknownEntry(f"{name!r:.80} drove nothing here; {', '.join(self.methods)} did")
        return paired(self.missions, method, against)


def described(method: str) -> str:
    """What a method is, in one sentence; empty for one that is not known here."""
    entry = METHODS.get(method) or VARIANTS.get(method)
    return "" if entry is None else entry.description


def _place(mission: dict[str, Any]) -> tuple:
    return mission["terrain"], mission["seed"], *(mission.get(name, usual) for name, usual in KIND.items())


Version = tuple[Path, int, int]


def _version(path: Path) -> Version:
    """What is another once the file is. Raises OSError."""
    stat = path.stat()
    return path, stat.st_mtime_ns, stat.st_size


class ResultsLibrary:
    """Finds evaluations by id; those that were read stay in memory, at most `KEPT`."""

    def __init__(self, workspace: Path, sample: Path = SAMPLE) -> None:
        self._folder, self._sample = workspace / "results", sample
        self._read: OrderedDict[Version, Evaluation] = OrderedDict()
        self._listed: dict[Path, tuple[Version, dict[str, Any]]] = {}
        self._reading = threading.Lock()
        self._naming = threading.Lock()

    def entries(self) -> list[dict[str, Any]]:
        """The shipped one first, then by name: id, title, shipped, missions, methods, terrains; `problem`
        where a file cannot be read."""
        own = sorted(self._folder.glob("*.sqlite")) if self._folder.is_dir() else []
        paths = [self._sample] if self._sample.is_file() else []
        return [self._entry(path) for path in (*paths, *own) if path == self._sample or self._id(path)]

    def _id(self, path: Path) -> str:
        return SAMPLE_ID if path == self._sample else path.stem if ID_PATTERN.fullmatch(path.stem) else ""

    def _entry(self, path: Path) -> dict[str, Any]:
        head = {"id": self._id(path), "shipped": path == self._sample}
        try:
            now = _version(path)
            known, entry = self._listed.get(path, (None, {}))
            if known == now:
                return entry
            found = self._load(path)
        except (ResultsError, OSError) as error:  # such as a link to what is gone
            words = str(error) if isinstance(error, ResultsError) else f"{path.name} cannot be read"
            nothing = {"title": path.stem, "missions": 0, "methods": [], "terrains": []}
            return head | nothing | {"problem": words}
        driven = {mission["terrain"] for mission in found.missions}
        terrains = [family.value for family in Family if family in driven]
        entry = head | {
            "title": found.title, "missions": len(found.missions), "methods": found.methods,
            "terrains": terrains, "problem": None,
        }  # fmt: skip
        self._listed[path] = now, entry
        return entry

    def path(self, results_id: str) -> Path:
        """Raises UnknownEntry."""
        if results_id == SAMPLE_ID and self._sample.is_file():
            return self._sample
        fits = len(results_id) <= MAX_ID and ID_PATTERN.fullmatch(results_id)
        path = self._folder / f"{results_id}.sqlite"
        if not fits or not path.is_file():
            raise UnknownEntry(f"there is no evaluation {results_id!r:.80}")
        return path

    def get(self, results_id: str) -> Evaluation:
        """Raises UnknownEntry, ResultsError."""
        return self._load(self.path(results_id))

    def _load(self, path: Path) -> Evaluation:
        key = _version(path)
        with self._reading:
            if key not in self._read:
                self._read[key] = Evaluation(path)
            self._read.move_to_end(key)
            while len(self._read) > KEPT:
                self._read.popitem(last=False)
            return self._read[key]

    def add(self, file: Path) -> str:
        """Take over a file, which is moved; returns its id. Raises ResultsError, OSError."""
        title = Evaluation(file).title
        with self._naming:
            self._folder.mkdir(parents=True, exist_ok=True)
            results_id = self._new_id(title)
            shutil.move(file, self._folder / f"{results_id}.sqlite")
        return results_id

    def _new_id(self, title: str) -> str:
        plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().lower()
        stem = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[: MAX_ID - 8].strip("-") or "evaluation"
        taken = {SAMPLE_ID, *(path.stem for path in self._folder.glob("*.sqlite"))}
        candidates = chain([stem], (f"{stem}-{number}" for number in count(2)))
        return next(candidate for candidate in candidates if candidate not in taken)

    def delete(self, results_id: str) -> None:
        """Raises UnknownEntry, also for the shipped one."""
        if results_id == SAMPLE_ID:
            raise UnknownEntry("the sample is shipped with the studio and cannot be deleted")
        self.path(results_id).unlink()
