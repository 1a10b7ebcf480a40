"""Trainings on record: plan, status and every episode in the workspace's database, checkpoints and all that
a training goes on from in its folder `trainings/ID`."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.store import StoreError, UnknownEntry, connected
from app.training_plan import TrainingPlan, TrainingStatus

SCHEMA = """
CREATE TABLE IF NOT EXISTS trainings (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    started_at TEXT NOT NULL,
    scenario TEXT NOT NULL,   -- the name of the one it learns on, empty for the curriculum
    plan TEXT NOT NULL,       -- JSON, app.training_plan.TrainingPlan
    status TEXT NOT NULL,
    message TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS training_episodes (
    training INTEGER NOT NULL,
    number INTEGER NOT NULL,
    row TEXT NOT NULL,        -- JSON: steps, total, terms, success, exposed_s, final, losses, updates
    PRIMARY KEY (training, number)
) WITHOUT ROWID;
"""

LAST = "policy"
"""Name of the newest checkpoint; the others are named after the episodes before them."""


@dataclass
class Training:
    """One training as it is known now; `episodes` are dicts as in the log of `planner.training_store`."""

    id: int
    started_at: str
    scenario: str
    plan: TrainingPlan
    folder: Path
    status: TrainingStatus
    message: str = ""
    episodes: list[dict[str, Any]] = field(default_factory=list)

    @property
    def called(self) -> str:
        return f"training {self.id}"

    @property
    def driven(self) -> list[dict[str, Any]]:
        """The episodes that the policy drove itself."""
        return [row for row in self.episodes if not row.get("demonstrated")]

    def checkpoints(self) -> dict[str, Path]:
        """Policies that can drive, oldest first, by name: `episode_000010`, and `policy` for the newest."""
        kept = sorted((self.folder / "policies").glob("episode_*.safetensors"))
        newest = self.folder / f"{LAST}.safetensors"
        return {path.stem: path for path in [*kept, *([newest] if newest.is_file() else [])]}

    def checkpoint(self, name: str) -> Path:
        """Raises UnknownEntry."""
        found = self.checkpoints()
        if name not in found:
            there = f"it has {', '.join(found)}" if found else "it has none yet"
            raise UnknownEntry(f"{self.called} has no checkpoint {name!r:.60}; {there}")
        return found[name]


class TrainingRecords:
    """Safe from several threads. Raises StoreError where the workspace cannot be read or written."""

    def __init__(self, workspace: Path) -> None:
        self._workspace = workspace
        self._write(lambda database: database.executescript(SCHEMA))

    def folder(self, training_id: int) -> Path:
        return self._workspace / "trainings" / f"{training_id:04d}"

    def add(self, plan: TrainingPlan, scenario: str) -> Training:
        """Put a new training on record."""
        started_at, status = datetime.now(UTC).isoformat(timespec="seconds"), TrainingStatus.STARTING
        values = started_at, scenario, plan.model_dump_json(), status.value, ""
        number = self._write(
            lambda database: database.execute(
                "INSERT INTO trainings (started_at, scenario, plan, status, message) VALUES (?, ?, ?, ?, ?)",
                values,
            ).lastrowid
        )
        return Training(number, started_at, scenario, plan, self.folder(number), status)

    def set_status(self, training_id: int, status: TrainingStatus, message: str) -> None:
        self._write(
            lambda database: database.execute(
                "UPDATE trainings SET status = ?, message = ? WHERE id = ?",
                (status.value, message, training_id),
            )
        )

    def add_episodes(self, training_id: int, rows: Iterable[dict[str, Any]]) -> None:
        """Keep episodes; one that was driven anew takes the place of the old."""
        values = [(training_id, row["number"], json.dumps(row)) for row in rows]
        self._write(
            lambda database: database.executemany(
                "INSERT OR REPLACE INTO training_episodes VALUES (?, ?, ?)", values
            )
        )

    def delete(self, training_id: int) -> None:
        """Forget a training and remove its folder."""

        def forget(database: sqlite3.Connection) -> None:
            database.execute("DELETE FROM training_episodes WHERE training = ?", (training_id,))
            database.execute("DELETE FROM trainings WHERE id = ?", (training_id,))

        self._write(forget)
        shutil.rmtree(self.folder(training_id), ignore_errors=True)

    def load(self) -> list[Training]:
        """All of them, oldest first. Those that were under way when the studio ended are `interrupted`, with
        the episodes that their folder has and the database has not."""
        trainings = self._read()
        for training in trainings:
            if training.status.live:
                training.status = TrainingStatus.INTERRUPTED
                self._take_over(training)
                done = len(training.episodes)
                training.message = f"the studio was closed after episode {done}; resume to go on from there"
                self.set_status(training.id, training.status, training.message)
        return trainings

    def _take_over(self, training: Training) -> None:
        rows = logged_episodes(training.folder)
        if len(rows) > len(training.episodes):
            self.add_episodes(training.id, rows)
            training.episodes = rows

    def _read(self) -> list[Training]:
        episodes: dict[int, list[dict[str, Any]]] = {}
        try:
            with closing(connected(self._workspace)) as database:
                heads = database.execute("SELECT * FROM trainings ORDER BY id").fetchall()
                for row in database.execute("SELECT * FROM training_episodes ORDER BY training, number"):
                    episodes.setdefault(row["training"], []).append(json.loads(row["row"]))
            return [
                Training(
                    head["id"], head["started_at"], head["scenario"],
                    TrainingPlan.model_validate_json(head["plan"]), self.folder(head["id"]),
                    TrainingStatus(head["status"]), head["message"], episodes.get(head["id"], []),
                )
                for head in heads
            ]  # fmt: skip
        except (sqlite3.Error, ValueError) as error:
            raise StoreError(f"the trainings in {self._workspace} cannot be read: {error}") from None

    def _write(self, change) -> Any:
        try:
            with closing(connected(self._workspace)) as database, database:
                return change(database)
        except sqlite3.Error as error:
            raise StoreError(f"the training could not be recorded in {self._workspace}: {error}") from None


def logged_episodes(folder: Path) -> list[dict[str, Any]]:
    """The episodes in a training's own log that its newest checkpoint counts."""
    try:
        done = json.loads((folder / "checkpoint.json").read_text())["episodes"]
        lines = (folder / "episodes.jsonl").read_text().splitlines()[:done]
        return [json.loads(line) for line in lines]
    except (OSError, ValueError, KeyError, TypeError):
        return []  # it did not come so far
