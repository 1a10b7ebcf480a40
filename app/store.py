"""The workspace folder: scenarios as JSON files that people can mail, runs in SQLite.

A scenario is shipped (read-only, in the package) or saved (`scenarios/ID.json` in the workspace). A run is
stored whole when its mission ends: its scenario, its summary and one row of numbers a tick.
"""

from __future__ import annotations

import json
import re
import sqlite3
import threading
import unicodedata
import zlib
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from scenes.library import shipped
from scenes.scenario import GeneratedSource, Scenario, ScenarioError

ID_PATTERN = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
MAX_ID = 60
FIRST_COLUMNS = ("time_s", "x", "y", "z", "roll", "pitch", "yaw", "v", "w")  # of runs that do not say
FRAME_COLUMNS = (*FIRST_COLUMNS, "exposure", "detection_probability")

SCHEMA = """
CREATE TABLE IF NOT EXISTS runs (
    id INTEGER PRIMARY KEY,
    started_at TEXT NOT NULL,
    scenario_id TEXT NOT NULL,
    scenario BLOB NOT NULL,   -- zlib of the scenario document
    summary TEXT NOT NULL,    -- JSON as `covernav run --json`
    frames BLOB NOT NULL      -- zlib of float64 rows
);
"""


NAME_COLUMNS = f"ALTER TABLE runs ADD COLUMN columns TEXT NOT NULL DEFAULT '{' '.join(FIRST_COLUMNS)}'"


UNSAVED_ID, UNSAVED = "unsaved-changes", " (unsaved changes)"
"""Where a scenario with changes that nobody saved is kept, and what its name ends in there."""


class StoreError(OSError):
    """The workspace cannot be read or written; the message says what and where."""


class UnknownEntry(LookupError):
    """No scenario or run of that name."""


@dataclass(frozen=True)
class ScenarioEntry:
    """One line of the scenario list; `modified` is seconds since the epoch, None for shipped ones."""

    id: str
    name: str
    description: str
    shipped: bool
    family: str | None
    modified: float | None
    problem: str | None = None


class Store:
    """Owns one workspace folder. Raises StoreError where the folder cannot be used."""

    def __init__(self, workspace: Path) -> None:
        self.workspace = Path(workspace).expanduser().resolve()
        self._folder = self.workspace / "scenarios"
        self._entries: dict[Path, tuple[float, ScenarioEntry]] = {}
        self._naming = threading.Lock()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with closing(connected(self.workspace)) as database:
                database.executescript(SCHEMA)
                if "columns" not in {row["name"] for row in database.execute("PRAGMA table_info(runs)")}:
                    database.execute(NAME_COLUMNS)
        except (OSError, sqlite3.Error) as error:
            raise StoreError(f"the workspace {self.workspace} cannot be used: {error}") from None

    # scenarios

    def scenarios(self) -> list[ScenarioEntry]:
        """Shipped ones first, then saved ones by name; a damaged file is listed with its problem."""
        own = sorted((self._entry(path, False) for path in self._folder.glob("*.json")), key=lambda e: e.name)
        return [self._entry(path, True) for path in shipped().values()] + own

    def _entry(self, path: Path, is_shipped: bool) -> ScenarioEntry:
        modified = path.stat().st_mtime
        known = self._entries.get(path)
        if known is not None and known[0] == modified:
            return known[1]
        when = None if is_shipped else modified
        try:
            scenario = Scenario.load(path)
        except ScenarioError as error:
            entry = ScenarioEntry(path.stem, path.stem, "", is_shipped, None, when, str(error))
        else:
            source = scenario.terrain.source
            family = source.family.value if isinstance(source, GeneratedSource) else None
            entry = ScenarioEntry(
                path.stem, scenario.name, scenario.description, is_shipped, family, when
            )
        self._entries[path] = (modified, entry)
        return entry

    def path(self, scenario_id: str) -> Path:
        """Where a scenario lies. Raises UnknownEntry."""
        own = self._own_path(scenario_id)
        if own is not None and own.is_file():
            return own
        if scenario_id in shipped():
            return shipped()[scenario_id]
        raise UnknownEntry(f"there is no scenario {scenario_id!r:.80}")

    def _own_path(self, scenario_id: str) -> Path | None:
        fits = len(scenario_id) <= MAX_ID and ID_PATTERN.fullmatch(scenario_id)
        return self._folder / f"{scenario_id}.json" if fits else None

    def load(self, scenario_id: str) -> Scenario:
        """Raises UnknownEntry, or ScenarioError for a damaged file."""
        return Scenario.load(self.path(scenario_id))

    def is_shipped(self, scenario_id: str) -> bool:
        return scenario_id in shipped()

    def new_id(self, name: str) -> str:
        """An unused id made from a name."""
        plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
        stem = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[: MAX_ID - 8].strip("-") or "scenario"
        taken = {UNSAVED_ID, *shipped()} | {path.stem for path in self._folder.glob("*.json")}
        candidates = chain([stem], (f"{stem}-{number}" for number in count(2)))
        return next(candidate for candidate in candidates if candidate not in taken)

    def save(self, scenario_id: str, scenario: Scenario) -> None:
        """Write atomically. Raises StoreError where it cannot; the old file then stays as it was."""
        path = self._own_path(scenario_id)
        if path is None or self.is_shipped(scenario_id):
            raise UnknownEntry(f"{scenario_id!r:.80} is not a name to save under")
        try:
            scenario.save(path)
        except OSError as error:
            raise StoreError(f"{scenario_id} could not be saved: {error.strerror or error}") from None

    def keep_unsaved(self, scenario: Scenario) -> None:
        """Keep what nobody saved in the one place for that, `UNSAVED_ID`. Raises StoreError."""
        name = f"{scenario.name[: 80 - len(UNSAVED)]}{UNSAVED}"
        self.save(UNSAVED_ID, scenario.revised(name=name))

    def holds(self, scenario_id: str) -> bool:
        """Whether there is a scenario of that id, shipped or saved."""
        try:
            return self.path(scenario_id).is_file()
        except UnknownEntry:
            return False

    def add(self, scenario: Scenario) -> str:
        """Save under a new id, which is returned; safe from several threads. Raises StoreError."""
        with self._naming:
            scenario_id = self.new_id(scenario.name)
            self.save(scenario_id, scenario)
        return scenario_id

    def delete(self, scenario_id: str) -> None:
        """Raises UnknownEntry, also for a shipped scenario."""
        if self.is_shipped(scenario_id):
            raise UnknownEntry(f"{scenario_id} is shipped with the studio and cannot be deleted")
        self.path(scenario_id).unlink()

    # runs

    def add_run(
        self,
        scenario_id: str,
        scenario: Scenario,
        summary: dict[str, Any],
        frames: Sequence[Sequence[float]],
        started_at: datetime,
    ) -> int:
        """Store a finished run and return its id. Raises StoreError."""
        rows = np.asarray(frames, np.float64).reshape(-1, len(FRAME_COLUMNS))
        record = (
            started_at.astimezone(UTC).isoformat(timespec="seconds"),
            scenario_id,
            zlib.compress(scenario.to_json().encode()),
            json.dumps(summary, allow_nan=False),
            zlib.compress(rows.tobytes()),
            " ".join(FRAME_COLUMNS),
        )
        try:
            with closing(connected(self.workspace)) as database, database:
                cursor = database.execute(
                    "INSERT INTO runs (started_at, scenario_id, scenario, summary, frames, columns)"
                    " VALUES (?, ?, ?, ?, ?, ?)",
                    record,
                )
                return int(cursor.lastrowid or 0)
        except sqlite3.Error as error:
            raise StoreError(f"the run could not be stored in {self.workspace}: {error}") from None

    def runs(self, limit: int = 200) -> list[dict[str, Any]]:
        """The newest runs first: id, started_at, scenario_id and the summary's keys."""
        with closing(connected(self.workspace)) as database:
            rows = database.execute(
                "SELECT id, started_at, scenario_id, summary FROM runs ORDER BY id DESC LIMIT ?", (limit,)
            ).fetchall()
        return [_describe(row) for row in rows]

    def run(self, run_id: int) -> dict[str, Any]:
        """Raises UnknownEntry."""
        return _describe(self._run_row(run_id, "id, started_at, scenario_id, summary"))

    def frames(self, run_id: int) -> list[dict[str, float]]:
        """One dict a tick with FRAME_COLUMNS, fewer for runs of old; metres, radians. Raises UnknownEntry."""
        record = self._run_row(run_id, "frames, columns")
        columns = record["columns"].split()
        rows = np.frombuffer(zlib.decompress(record["frames"]), np.float64).reshape(-1, len(columns))
        return [dict(zip(columns, row, strict=True)) for row in rows.tolist()]

    def run_scenario(self, run_id: int) -> Scenario:
        """The scenario that a run was driven in. Raises UnknownEntry."""
        document = zlib.decompress(self._run_row(run_id, "scenario")["scenario"])
        return Scenario.model_validate_json(document)

    def _run_row(self, run_id: int, columns: str) -> sqlite3.Row:
        with closing(connected(self.workspace)) as database:
            row = None
            if 0 < run_id < 2**63:
                row = database.execute(f"SELECT {columns} FROM runs WHERE id = ?", (run_id,)).fetchone()
        if row is None:
            raise UnknownEntry(f"there is no run {run_id}")
        return row


def connected(workspace: Path) -> sqlite3.Connection:
    """The workspace's database, to be closed. Raises sqlite3.Error."""
    database = sqlite3.connect(workspace / "runs.sqlite", timeout=10.0)
    database.row_factory = sqlite3.Row
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    return database


def _describe(row: sqlite3.Row) -> dict[str, Any]:
    head = {key: row[key] for key in ("id", "started_at", "scenario_id")}
    return head | json.loads(row["summary"])
