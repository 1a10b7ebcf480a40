"""An evaluation as one SQLite file that people can mail: every mission's figures, its way and its scene.

The file may come from anybody: it is opened to be read alone, and nothing in it is believed unchecked.
"""

from __future__ import annotations

import json
import os
import sqlite3
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from app.changes import StudioError
from planner.evaluation import MissionSpec
from planner.evaluation_table import KIND, REFERENCE, grouped
from planner.trajectory import Trajectory

FORMAT = "covernav evaluation 1"
NAME = "results.sqlite"
MOST_MISSIONS = 30_000
MOST_KINDS = 200
MOST_BYTES = 2**20  # of one mission's way or scene
MOST_SUMMARY = 2**15  # bytes of one mission's figures
MOST_SUMMARIES = 2**26  # bytes of all missions' figures
MOST_REASON = 300  # characters of why a mission ended in an error
MOST_STEPS = 2000  # of SQLite's machine, in thousands, for one question
MOST_SAMPLES = 100_000
LARGEST = 1e12  # no figure of a drive is near it, and means of such are still numbers
CONDITIONS = ("terrain", "method", "suite", "observers", "perception", "placement")
FIGURES = (
    "trajectory_length_m", "straight_line_m", "execution_time_s", "exposure_fraction", "exposed_s",
    "longest_exposure_s", "detection_probability", "cover_fraction", "concealed_fraction",
    "elevation_gradient_m", "max_roll_deg", "max_pitch_deg", "collisions", "dynamic_violations",
    "planner_ms_p50", "planner_ms_p95", *REFERENCE,
)  # fmt: skip
"""What a mission's summary holds in numbers, each finite or null."""
READ = (*CONDITIONS, "status", "reason", "success", "seed", "goal_distance", *FIGURES)
"""What is read of a mission's summary; the rest is for people who open the file themselves."""

SCHEMA = """
CREATE TABLE about (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE scenes (id INTEGER PRIMARY KEY, recipe BLOB NOT NULL UNIQUE);
CREATE TABLE missions (
    id INTEGER PRIMARY KEY,
    terrain TEXT NOT NULL, method TEXT NOT NULL, seed INTEGER NOT NULL, status TEXT NOT NULL,
    summary BLOB NOT NULL,      -- zlib of the JSON of a mission in `covernav evaluate --json`
    trajectory BLOB,            -- zlib of the JSON of planner.trajectory
    scene INTEGER REFERENCES scenes (id)  -- zlib of the JSON of planner.scene_recipe
);
"""


class ResultsError(StudioError):
    """A file that is no evaluation, in one sentence."""


def versions(missions: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Of what the figures of missions depend on; `code`: every code that drove them, `unknown` where they
    do not say."""
    names = ("covernav-studio", "numpy", "numba", "pybullet", "embreex")
    codes = sorted({str(mission.get("code") or "unknown") for mission in missions})
    return {name: version(name) for name in names} | {"code": codes}


def write(path: Path, missions: Sequence[dict[str, Any]], title: str) -> None:
    """Replace the file by one with these missions, whole or not at all. Raises OSError."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    os.close(handle)
    temporary = Path(name)
    try:
        with closing(sqlite3.connect(temporary)) as database, database:
            database.executescript("PRAGMA journal_mode = MEMORY;" + SCHEMA)
            _fill(database, missions, title)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except sqlite3.Error as error:
        raise OSError(f"{path} could not be written: {error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def _fill(database: sqlite3.Connection, missions: Sequence[dict[str, Any]], title: str) -> None:
    about = {"format": FORMAT, "title": title, "versions": json.dumps(versions(missions))}
    database.executemany("INSERT INTO about VALUES (?, ?)", about.items())
    scenes: dict[bytes, int] = {}
    for mission in missions:
        summary = {key: value for key, value in mission.items() if key not in ("trajectory", "scene")}
        scene = None
        if mission.get("scene") is not None:
            scene = scenes.setdefault(_packed(mission["scene"]), len(scenes) + 1)
        way = None if mission.get("trajectory") is None else _packed(mission["trajectory"])
        head = (str(mission["terrain"]), mission["method"], mission["seed"], str(mission["status"]))
        database.execute(
            "INSERT INTO missions (terrain, method, seed, status, summary, trajectory, scene)"
            " VALUES (?, ?, ?, ?, ?, ?, ?)",
            (*head, _packed(summary), way, scene),
        )
    database.executemany("INSERT INTO scenes VALUES (?, ?)", ((id, recipe) for recipe, id in scenes.items()))


class ResultsFile:
    """An evaluation's file. Raises ResultsError where it is none, also from its methods."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._open() as database:
            about = dict(database.execute("SELECT key, value FROM about LIMIT 20").fetchall())
            if about.get("format") != FORMAT:
                raise ResultsError(f"{path.name} is not an evaluation of `covernav evaluate`")
            title = str(about.get("title", path.stem))[:200]
            self.title = title if title.isprintable() else path.stem

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        try:
            with closing(sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro", uri=True)) as database:
                database.execute("PRAGMA trusted_schema = OFF")
                budget = iter(range(MOST_STEPS))
                database.set_progress_handler(lambda: int(next(budget, None) is None), 100_000)
                kinds = dict(database.execute("SELECT name, type FROM sqlite_schema LIMIT 50").fetchall())
                if any(kinds.get(name) != "table" for name in ("about", "missions", "scenes")):
                    raise ResultsError(f"{self.path.name} is not an evaluation of `covernav evaluate`")
                yield database
        except sqlite3.Error as error:
            raise ResultsError(f"{self.path.name} cannot be read as an evaluation: {error}") from None

    def missions(self) -> list[dict[str, Any]]:
        """Every mission's summary with its `id` and `drawn`, whether its way is known."""
        with self._open() as database:
            rows = database.execute(
                "SELECT id, summary, trajectory IS NOT NULL AND scene IS NOT NULL FROM missions"
                " ORDER BY id LIMIT ?",
                (MOST_MISSIONS + 1,),
            )
            found, read = [], 0
            for id, data, drawn in rows:
                text = _text(data, MOST_SUMMARY)
                read += len(text)
                if len(found) == MOST_MISSIONS or read > MOST_SUMMARIES:
                    words = f"{MOST_MISSIONS} missions or {MOST_SUMMARIES >> 20} MiB of their figures"
                    raise ResultsError(f"{self.path.name} has more than {words}; evaluate them in parts")
                found.append(self._checked(_document(text)) | {"id": id, "drawn": bool(drawn)})
        if not found:
            raise ResultsError(f"{self.path.name} holds no mission; give it one with `covernav evaluate`")
        if len(grouped(found, KIND)) > MOST_KINDS:
            raise ResultsError(f"{self.path.name} has more than {MOST_KINDS} kinds of missions")
        return found

    def _checked(self, summary: Any) -> dict[str, Any]:
        try:
            MissionSpec.of(summary)
            texts = [summary[name] for name in (*CONDITIONS, "status") if name in summary]
            names = (*FIGURES, "goal_distance", "seed")
            numbers = {name: summary[name] for name in names if summary.get(name) is not None}
            sound = all(_is_text(text) for text in texts) and all(
                type(number) in (int, float) and (name == "seed" or abs(number) <= LARGEST)
                for name, number in numbers.items()
            )
            if not (sound and isinstance(summary["success"], bool) and type(summary["seed"]) is int):
                raise ValueError
            if not 0 <= summary["seed"] < 2**63 or len(numbers.keys() & set(REFERENCE)) not in (0, 4):
                raise ValueError
            needed = [summary.get(name) for name in ("trajectory_length_m", "execution_time_s")]
            if summary["success"] and None in needed:
                raise ValueError
        except (ValueError, KeyError, TypeError, OverflowError):
            raise ResultsError(f"{self.path.name} holds a mission that is damaged") from None
        read = {name: summary[name] for name in READ if name in summary}
        if "reason" in read:
            read["reason"] = str(read["reason"])[:MOST_REASON]
        return read

    def trajectory(self, mission: int) -> Trajectory:
        """Raises LookupError where there is none."""
        document = self._blob("SELECT trajectory FROM missions WHERE id = ?", mission)
        try:
            found = Trajectory.of(document)
        except ValueError as error:
            raise ResultsError(f"{self.path.name}, mission {mission}: {error}") from None
        if len(found.time_s) > MOST_SAMPLES:
            raise ResultsError(f"{self.path.name}, mission {mission}: its way is too long to draw")
        return found

    def recipe(self, mission: int) -> dict[str, Any]:
        """How to make the mission's scene. Raises LookupError where it is not known."""
        return self._blob(
            "SELECT recipe FROM scenes JOIN missions ON missions.scene = scenes.id WHERE missions.id = ?",
            mission,
        )

    def _blob(self, question: str, mission: int) -> Any:
        with self._open() as database:
            row = database.execute(question, (mission,)).fetchone()
        if row is None or row[0] is None:
            raise LookupError(f"there is no mission {mission} whose way is known in {self.path.stem}")
        return _unpacked(row[0])


def _is_text(text: Any) -> bool:
    return isinstance(text, str) and len(text) < 300 and text.isprintable()


def _packed(document: Any) -> bytes:
    return zlib.compress(json.dumps(document, allow_nan=False, separators=(",", ":")).encode(), 9)


def _unpacked(data: Any) -> Any:
    return _document(_text(data, MOST_BYTES))


def _text(data: Any, most: int) -> bytes:
    """What was packed, at most so many bytes. Raises ResultsError."""
    try:
        unpacker = zlib.decompressobj()
        text = unpacker.decompress(data, most)
        if unpacker.unconsumed_tail:
            raise ValueError
    except (TypeError, ValueError, zlib.error):
        raise ResultsError("a mission's data are damaged") from None
    return text


def _document(text: bytes) -> Any:
    try:
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise ResultsError("a mission's data are damaged") from None


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is no number in JSON")
