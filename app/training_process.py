"""The training process: it learns at a low priority, obeys the server and reports to it.

The server sends `Order`s down a pipe; this side sends back how it goes. When the server is gone it stops
after the step that is being driven; nothing finished is lost.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import signal
import threading
import time
from dataclasses import asdict, dataclass
from enum import StrEnum
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.training_drive import ENVIRONMENT
from app.training_plan import Task, TrainingPlan
from app.training_sight import Sight, TrueGround, perceived
from scenes.pose import Pose
from scenes.scenario import Scenario

if TYPE_CHECKING:
    from planner.training import Trainer
    from planner.training_collector import StepFrame
    from planner.training_events import EpisodeDone
    from planner.training_settings import TrainingSettings

NICENESS = 10
POSES_PERIOD_S, SIGHT_PERIOD_S = 0.1, 0.5
DECISION_S = 0.25


class Order(StrEnum):
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"


@dataclass(frozen=True)
class Started:
    """The libraries are loaded and the last checkpoint is read: episodes are driven from now on."""


@dataclass(frozen=True)
class Drawn:
    """An episode begins, on this ground."""

    episode: int
    scenario: Scenario


@dataclass(frozen=True)
class Moved:
    """True poses of the robot in an episode since the last report."""

    episode: int
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class Done:
    """An episode is over and safe; `row` is as in the training's log."""

    row: dict[str, Any]


@dataclass(frozen=True)
class Ended:
    """complete : all episodes are done; reason : why it could not go on, empty where it was told to stop"""

    complete: bool
    reason: str = ""


def train(
    pipe: connection.Connection, their_end: connection.Connection, plan: TrainingPlan, folder: Path,
    document: str | None,
) -> None:  # fmt: skip
    """Begin the training in `folder`, or go on with the one that is there, until it is over.

    document : the scenario to learn on, where the plan is about one"""
    their_end.close()  # else this end would keep the pipe open after the server has gone
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's to handle
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
    from planner.learning_errors import TrainingError, TrainingRefusal
    from planner.training_control import Control

    control = Control()
    threading.Thread(target=_obey, args=(pipe, control), daemon=True).start()
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the server has gone
        try:
            trainer = _trainer(plan, folder, document, control)
            pipe.send(Started())
            complete = _run(trainer, pipe)
        except (TrainingError, TrainingRefusal) as error:
            pipe.send(Ended(False, str(error)))
        except OSError as error:
            pipe.send(Ended(False, f"{folder} cannot be written: {error.strerror or error}"))
        else:
            pipe.send(Ended(complete))


def _obey(pipe: connection.Connection, control: Any) -> None:
    with contextlib.suppress(EOFError, OSError):
        while True:
            match pipe.recv():
                case Order.PAUSE:
                    control.pause()
                case Order.RESUME:
                    control.resume()
                case Order.STOP:
                    control.stop()
    control.stop()


def _trainer(plan: TrainingPlan, folder: Path, document: str | None, control: Any) -> Trainer:
    from planner.curriculum import Curriculum
    from planner.training import Trainer

    settings = None
    if not (folder / "settings.json").is_file():
        shutil.rmtree(folder, ignore_errors=True)  # it did not come to anything
        settings = training_settings(plan, document)
    curriculum = Curriculum(plan.seed) if plan.task is Task.CURRICULUM else None
    trainer = Trainer(folder, settings, control=control, frames_every=1, curriculum=curriculum)
    _keep_first_policy(trainer)
    return trainer


def _keep_first_policy(trainer: Trainer) -> None:
    """The policy before it has learnt anything, to compare with."""
    from planner.checkpoint import save_policy

    first = trainer.folder / "policies" / "episode_000000.safetensors"
    if trainer.progress.episodes == 0:
        save_policy(first, trainer.learner.actor, {"episodes": "0", "updates": "0"})


def training_settings(plan: TrainingPlan, document: str | None) -> TrainingSettings:
    """The plan in the trainer's words."""
    from planner.curriculum import STAGES
    from planner.episode import reset_options, task_like
    from planner.training_settings import TrainingSettings

    options: dict[str, Any] = {"reward": plan.reward.value, "dynamics": plan.dynamics.value}
    shared: dict[str, Any] = {
        "episodes": plan.episodes, "seed": plan.seed, "demonstrations": plan.demonstrations,
    }  # fmt: skip
    if plan.task is Task.CURRICULUM or document is None:
        steps = plan.steps or max(stage.steps for stage in STAGES)
        return TrainingSettings(steps=steps, options=options, curriculum=True, **shared)
    resets = ()
    if plan.task is Task.GROUND:
        resets = (reset_options(task_like(Scenario.model_validate_json(document))),)
    options |= {"document": document}
    return TrainingSettings(
        steps=plan.steps or 100, environment=ENVIRONMENT, options=options, resets=resets, **shared
    )


def _run(trainer: Trainer, pipe: connection.Connection) -> bool:
    from planner.training import EpisodeDone, StepFrame, Stopped

    watch, complete = _Watch(pipe), False
    for event in trainer.run():
        match event:
            case StepFrame():
                watch.show(event)
            case EpisodeDone():
                watch.flush()
                pipe.send(Done(_row(event)))
            case Stopped():
                complete = event.complete
    return complete


def _row(done: EpisodeDone) -> dict[str, Any]:
    row = asdict(done)
    if done.losses.critic != done.losses.critic:
        row["losses"] = None  # nothing was learnt yet
    return row


class _Watch:
    """Passes on what those who watch can use: poses ten times a second, what is seen twice."""

    def __init__(self, pipe: connection.Connection) -> None:
        self._pipe = pipe
        self._truth: TrueGround | None = None
        self._poses: list[Pose] = []
        self._episode, self._last = -1, Pose(0.0, 0.0, 0.0)
        self._moved = self._saw = 0.0

    def show(self, frame: StepFrame) -> None:
        if frame.scenario is not None:
            self._begin(frame.episode, frame.scenario)
        now = time.monotonic()
        if self._truth is not None and now - self._saw >= SIGHT_PERIOD_S:
            self._saw = now
            seen = perceived(frame.layers, frame.attention, frame.cost)
            truth = self._truth.about(self._last, frame.step * DECISION_S)
            self._pipe.send(Sight(frame.episode, frame.step, self._last, seen, truth))
        self._last = frame.pose  # the layers are those of the step before
        self._poses.append(frame.pose)
        if now - self._moved >= POSES_PERIOD_S:
            self.flush()

    def _begin(self, episode: int, scenario: Scenario) -> None:
        self.flush()
        self._episode, self._truth = episode, TrueGround(scenario)
        start = scenario.start
        ground = float(scenario.terrain.heightmap().height_at(start.x, start.y))
        self._last = Pose(start.x, start.y, ground, yaw=math.radians(start.yaw))
        self._pipe.send(Drawn(episode, scenario))

    def flush(self) -> None:
        self._moved = time.monotonic()
        if self._poses:
            self._pipe.send(Moved(self._episode, tuple(self._poses)))
            self._poses = []
