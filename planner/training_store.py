"""A training's folder: settings, checkpoints, episodes, logs. The newest checkpoint is whole, come what may.

=========================  =====================================================================
settings.json              what the training was started with
scenario.json              what it is on, unless scenarios are drawn
checkpoint.json            which files hold the newest checkpoint; its replacement commits it
learner-NNNNNN.safetensors networks and optimisers after so many episodes, the newest; of a training
                           that is complete also those that would drive on if it were made longer
replay/NNNNNN.safetensors  each episode as it was driven
policy.safetensors         the newest policy, ready to drive; policies/ has every tenth
episodes.jsonl             a line an episode: return, terms, success, exposure, losses
pace.jsonl                 steps a second, which differ from run to run
events.out.tfevents…       the same curves for TensorBoard
lock                       held by the process that trains here
=========================  =====================================================================
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from planner.checkpoint import read_tensors, save_policy, write_file, write_tensors
from planner.ddpg import Ddpg
from planner.folder_lock import NAME as LOCK
from planner.folder_lock import FolderInUse, FolderLock
from planner.learning_errors import PolicyError, TrainingError, TrainingRefusal
from planner.replay import Episode, Replay
from scenes.scenario import Scenario

KEPT_EVERY = 10
"""Episodes between the policies that stay."""


@dataclass(frozen=True)
class Progress:
    """episodes : driven and kept; learnt : of these, those followed by their updates; updates : in all
    log_bytes, pace_bytes : of the two logs that belong to the checkpoint
    curriculum : its state, where there is one
    before_last : of a training that is complete, the learner before its last updates, which is the one to
        drive on if it is made longer; updates_before_last : those it had had
    """

    episodes: int = 0
    learnt: int = 0
    updates: int = 0
    learner: str = ""
    log_bytes: int = 0
    pace_bytes: int = 0
    curriculum: dict[str, Any] | None = None
    before_last: str = ""
    updates_before_last: int = 0


class TrainingStore:
    """Opens a folder for one training at a time; `close` gives it up.

    Raises TrainingRefusal where it is in use or cannot be written, for a new training where it is not empty,
    and for one that goes on where it holds none.
    """

    def __init__(self, folder: Path, *, new: bool):
        self.folder = folder
        try:
            if new:
                folder.mkdir(parents=True, exist_ok=True)
                if not (folder / LOCK).exists():  # what is refused is left as it was
                    self._check_empty()
            elif not (folder / "settings.json").is_file():
                raise TrainingRefusal(f"{folder} holds no training to go on with")
            self._lock = FolderLock(folder)
        except FolderInUse as error:
            words = f"process {error.holder} trains in {folder} already; choose another"
            raise TrainingRefusal(words) from None
        except OSError as error:
            raise TrainingRefusal(f"{folder} cannot be written: {error.strerror or error}") from None
        try:
            if new:
                self._check_empty()
            (folder / "replay").mkdir(exist_ok=True)
            (folder / "policies").mkdir(exist_ok=True)
        except OSError as error:
            self.close()
            raise TrainingRefusal(f"{folder} cannot be written: {error.strerror or error}") from None
        except TrainingRefusal:
            self.close()
            raise

    def _check_empty(self) -> None:
        if (self.folder / "settings.json").exists():
            raise TrainingRefusal(f"{self.folder} holds a training already; go on with it, or choose another")
        for found in self.folder.iterdir():
            if found.name != LOCK:
                raise TrainingRefusal(f"{self.folder} is not empty (it has {found.name!r}); choose another")

    def close(self) -> None:
        """Let others train here; safe to call twice."""
        self._lock.close()

    # --- what is kept ----------------------------------------------------------------------------

    def begin(self, settings: dict[str, Any], scenario: Scenario | None = None) -> None:
        """Keep a training's settings, and the scenario it is on. Raises TrainingError."""
        if scenario is not None:
            self._write("scenario.json", scenario.to_json())
        self._write("settings.json", json.dumps(settings, indent=1) + "\n")

    def settings(self) -> dict[str, Any]:
        """Raises TrainingRefusal where they cannot be read."""
        return self._read("settings.json")

    def scenario(self) -> Scenario | None:
        """What is trained on, None for drawn ones. Raises ScenarioError where it cannot be read."""
        path = self.folder / "scenario.json"
        return Scenario.load(path) if path.exists() else None

    def progress(self) -> Progress:
        """As of the newest checkpoint; none yet for a training that did not come so far."""
        if not (self.folder / "checkpoint.json").is_file():
            return Progress()
        try:
            progress = Progress(**self._read("checkpoint.json"))
            names = ("episodes", "learnt", "updates", "log_bytes", "pace_bytes")
            counts = [getattr(progress, name) for name in names]
            if not all(type(count) is int and count >= 0 for count in counts):
                raise TypeError
        except TypeError:
            path = self.folder / "checkpoint.json"
            raise TrainingRefusal(f"{path} is not a checkpoint of this version") from None
        return progress

    def restore(self, progress: Progress, learner: Ddpg, replay: Replay) -> None:
        """Fill learner and buffer, and cut the logs back to the checkpoint. Raises TrainingRefusal where a
        file is damaged."""
        with self._refusing():
            for number in range(progress.episodes):
                replay.add(Episode.load(self._episode(number)))
            if progress.learner:
                self._restore_learner(progress, learner)
        for name, size in (("episodes.jsonl", progress.log_bytes), ("pace.jsonl", progress.pace_bytes)):
            path = self.folder / name
            if path.exists():
                os.truncate(path, size)

    def take_back(self, progress: Progress, learner: Ddpg) -> Progress:
        """The progress before the last updates of a training that was complete, and its learner with it.

        Raises TrainingRefusal where a file is damaged."""
        before = replace(
            progress, learnt=progress.episodes - 1, learner=progress.before_last, before_last="",
            updates=progress.updates_before_last, updates_before_last=0,
        )  # fmt: skip
        with self._refusing():
            self._restore_learner(before, learner)
        return before

    @contextlib.contextmanager
    def _refusing(self) -> Iterator[None]:
        """Says in words that a file of the checkpoint is damaged."""
        try:
            yield
        except (PolicyError, ValueError, KeyError) as error:
            words = f"the training in {self.folder} cannot go on: {error}"
            raise TrainingRefusal(f"{words}; what is in policies/ can still drive") from None

    def _restore_learner(self, progress: Progress, learner: Ddpg) -> None:
        path = self.folder / progress.learner
        learner.restore(read_tensors(path)[0], path)

    def keep_episode(self, number: int, episode: Episode) -> None:
        """Raises TrainingError where the disk does not take it."""
        self._attempt(lambda: episode.save(self._episode(number)))

    def append(self, name: str, row: dict[str, Any]) -> int:
        """Add a line to a log; returns its length in bytes after it."""
        line = (json.dumps(row) + "\n").encode()

        def write() -> int:
            with open(self.folder / name, "ab") as log:
                log.write(line)
                log.flush()
                os.fsync(log.fileno())
                return log.tell()

        return self._attempt(write)

    def commit(self, progress: Progress, learner: Ddpg) -> None:
        """Make a checkpoint the newest, and let go of the one before. Raises TrainingError."""
        path = self.folder / progress.learner
        self._attempt(lambda: write_tensors(path, learner.tensors()))
        about = {"episodes": str(progress.episodes), "updates": str(progress.updates)}
        self._attempt(lambda: save_policy(self.folder / "policy.safetensors", learner.actor, about))
        if progress.episodes % KEPT_EVERY == 0:
            kept = self.folder / "policies" / f"episode_{progress.episodes:06d}.safetensors"
            self._attempt(lambda: save_policy(kept, learner.actor, about))
        self._write("checkpoint.json", json.dumps(asdict(progress), indent=1) + "\n")
        for old in self.folder.glob("learner-*.safetensors"):
            if old.name not in (progress.learner, progress.before_last):
                old.unlink(missing_ok=True)

    def _episode(self, number: int) -> Path:
        return self.folder / "replay" / f"{number:06d}.safetensors"

    def _read(self, name: str) -> dict[str, Any]:
        try:
            return json.loads((self.folder / name).read_text())
        except (OSError, ValueError) as error:
            raise TrainingRefusal(f"{self.folder / name} cannot be read: {error}") from None

    def _write(self, name: str, text: str) -> None:
        self._attempt(lambda: write_file(self.folder / name, text.encode()))

    def _attempt(self, write):
        try:
            return write()
        except OSError as error:
            reason = error.strerror or error
            raise TrainingError(
                f"{self.folder} cannot be written any more: {reason}; the last checkpoint there is whole,"
                " to go on from when that is seen to"
            ) from None
