"""Training a policy: episodes are driven in a process of their own, the learner learns from earlier ones.

Episode k is driven by the policy as it was after the updates for episode k − 2, while those for episode k − 1
are made: both cores are busy, and yet the settings alone decide every number. All randomness is drawn afresh
for each episode from the seed and the episode's number, so that nothing about it has to be kept.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from planner.checkpoint import weights
from planner.curriculum import Curriculum
from planner.ddpg import Ddpg, LossError, Losses
from planner.learning_errors import TrainingError, TrainingRefusal
from planner.observation import LAYERS
from planner.replay import Batch, Episode, Replay
from planner.training_collector import (
    Collected,
    CollectionError,
    Collector,
    CollectorProcess,
    EpisodeOrder,
    StepFrame,
)
from planner.training_control import Control
from planner.training_events import EpisodeDone, Stopped, TrainingEvent
from planner.training_log import TensorBoardLog
from planner.training_settings import DEMONSTRATOR, ENVIRONMENT, TrainingSettings
from planner.training_store import Progress, TrainingStore
from scenes.scenario import Scenario

_POLICY_STREAM, _BATCH_STREAM, _EPISODE_STREAM = 0, 1, 2


class Trainer:
    """One training in one folder. `run` yields what happens; abandoning it, as killing the process, loses the
    episode on its way and nothing else.

    parallel : drive the episodes in a process of their own; the result is the same
    frames_every : steps between `StepFrame`s, 0 for none
    curriculum : to take the tasks from, where it is not the one of the settings
    scenario : to train on; it is kept in the folder

    Raises TrainingRefusal for a folder that does not fit.
    """

    def __init__(
        self,
        folder: Path,
        settings: TrainingSettings | None = None,
        *,
        control: Control | None = None,
        parallel: bool = True,
        frames_every: int = 0,
        curriculum: Curriculum | None = None,
        scenario: Scenario | None = None,
    ):
        self.control, self.folder = control or Control(), folder
        self._store = TrainingStore(folder, new=settings is not None)
        self._parallel, self._frames_every = parallel, frames_every
        try:
            if settings is None:
                settings = TrainingSettings.from_document(self._store.settings())
            else:
                self._store.begin(settings.document(), scenario)
            self.settings, self._scenario = settings, self._store.scenario()
            self.progress = self._store.progress()
            self._curriculum = curriculum or (Curriculum(settings.seed) if settings.curriculum else None)
            reads = settings.architecture
            self.learner = Ddpg(reads, settings.ddpg, self._draw(_POLICY_STREAM, 0))
            self.replay = Replay(settings.ddpg.buffer, reads.channels, reads.state)
            self._store.restore(self.progress, self.learner, self.replay)
            if self._curriculum is not None and self.progress.curriculum is not None:
                self._curriculum.restore(self.progress.curriculum)
        except BaseException:
            self._store.close()
            raise

    def extend(self, episodes: int) -> None:
        """Train for so many episodes in all, to the same end as if it had been begun for so many.

        Raises TrainingRefusal for fewer than it was begun with."""
        if episodes < self.settings.episodes:
            self._store.close()
            raise TrainingRefusal(
                f"the training was begun for {self.settings.episodes} episodes, not {episodes}"
            )
        self.settings = replace(self.settings, episodes=episodes)
        self._store.begin(self.settings.document(), self._scenario)

    def _take_back(self) -> None:
        """Of a training that was complete and has been made longer: the last updates, for they are due while
        the next episode is driven."""
        if self.progress.before_last and self.progress.episodes < self.settings.episodes:
            self.progress = self._store.take_back(self.progress, self.learner)

    def run(self) -> Iterator[TrainingEvent]:
        """Train until all episodes are done or `control` stops it, yielding what happens.

        Raises TrainingError where it cannot go on: a loss or reward that is not finite, a full disk, an
        environment that fails. The last checkpoint stays."""
        _prepare_process()
        settings = self.settings
        collector = Collector(settings.environment, self._environment_options(), settings.architecture)
        with contextlib.ExitStack() as stack:
            stack.callback(self._store.close)
            self._take_back()
            curves = TensorBoardLog(self._store.folder, self.progress.episodes)
            stack.callback(curves.close)
            source = CollectorProcess(collector) if self._parallel else _Inline(collector)
            stack.callback(source.close)
            yield from self._rounds(source, curves)

    def _environment_options(self) -> dict[str, Any]:
        """The settings', and no layers of exposure where neither the network reads them nor anybody looks."""
        settings = self.settings
        options: dict[str, Any] = {}
        unread = settings.architecture.channels <= LAYERS.index("exposure") and not self._frames_every
        if unread and settings.environment == ENVIRONMENT:
            options["exposure_layer"] = False
        options |= {**settings.options, "max_steps": settings.steps}
        if self._scenario is not None:
            options["scenario"] = self._scenario
        return options

    # --- a round ---------------------------------------------------------------------------------

    def _rounds(self, source: CollectorProcess | _Inline, curves: TensorBoardLog) -> Iterator[TrainingEvent]:
        settings = self.settings
        try:
            while self.progress.learnt < settings.episodes and not self.control.stopped:
                yield from self._round(source, curves)
            yield Stopped(self.progress.episodes, self.progress.learnt >= settings.episodes)
        except (CollectionError, LossError) as error:
            kept = f"the checkpoint after episode {self.progress.episodes} is kept in {self._store.folder}"
            raise TrainingError(f"{error}; {kept}") from error

    def _round(self, source: CollectorProcess | _Inline, curves: TensorBoardLog) -> Iterator[TrainingEvent]:
        """Drive the next episode while the updates for the last one are made; keep both."""
        begun, progress, self._idle_s = time.perf_counter(), self.progress, 0.0
        number, collected = progress.episodes, None
        driving = number < self.settings.episodes
        if driving:
            source.begin(self._order(number))
        losses: list[Losses] = []
        batches = self._batches(number) if progress.learnt < number else iter(())
        for batch in batches:
            losses.append(self.learner.update(batch))
            if self._held(source):
                return
            item = source.poll() if driving and collected is None else None
            if isinstance(item, Collected):
                collected = item
            elif item is not None:
                yield item
        while driving and collected is None:
            item = source.poll(0.05)
            if isinstance(item, Collected):
                collected = item
            elif item is not None:
                yield item
            if self._held(source):
                return
        updates = progress.updates + len(losses)
        if collected is None:
            learner = f"learner-{number:06d}-final.safetensors"
            progress = replace(
                progress, learnt=number, updates=updates, learner=learner,
                before_last=progress.learner, updates_before_last=progress.updates,
            )  # fmt: skip
            self._store.commit(progress, self.learner)
            self.progress = progress
            return
        pace = len(collected.episode) / (time.perf_counter() - begun - self._idle_s)
        done = EpisodeDone(
            number, len(collected.episode), collected.total, collected.terms, collected.success,
            collected.exposed_s, collected.final, _mean(losses), updates, pace,
            None if self._curriculum is None else self._curriculum.stage.name, collected.normalised,
            self.settings.demonstrated(number),
        )  # fmt: skip
        self._keep(collected.episode, done)
        curves.add(done)
        yield done

    def _keep(self, episode: Episode, done: EpisodeDone) -> None:
        """All of it in memory and on disk, the checkpoint last."""
        store, number = self._store, done.number
        store.keep_episode(number, episode)
        self.replay.add(episode)
        if self._curriculum is not None and done.demonstrated:
            self._curriculum.skip()
        elif self._curriculum is not None:
            self._curriculum.record(done.success)
        row = {name: value for name, value in asdict(done).items() if name != "steps_per_s"}
        row["losses"] = None if math.isnan(done.losses.critic) else row["losses"]
        progress = Progress(
            episodes=number + 1,
            learnt=number,
            updates=done.updates,
            learner=f"learner-{number + 1:06d}.safetensors",
            log_bytes=store.append("episodes.jsonl", row),
            pace_bytes=store.append("pace.jsonl", {"number": number, "steps_per_s": done.steps_per_s}),
            curriculum=None if self._curriculum is None else self._curriculum.state(),
        )
        store.commit(progress, self.learner)
        self.progress = progress

    def _held(self, source: CollectorProcess | _Inline) -> bool:
        """Wait while paused; whether to stop."""
        if self.control.paused:
            begun = time.perf_counter()
            source.pause()
            self.control.wait()
            source.go_on()
            self._idle_s += time.perf_counter() - begun
        return self.control.stopped

    def _order(self, number: int) -> EpisodeOrder:
        settings = self.settings
        options = self._options(number) if self._curriculum is None else self._curriculum.options()
        return EpisodeOrder(
            number,
            self._draw(_EPISODE_STREAM, number),
            options.get("max_steps", settings.steps),
            None if number < settings.random_episodes else settings.ddpg.noise,
            options,
            weights(self.learner.actor),
            self._frames_every,
            DEMONSTRATOR if settings.demonstrated(number) else None,
            self._following(number + 1),
        )

    def _following(self, number: int) -> tuple[int, Mapping[str, Any]] | None:
        """Seed and options of an episode yet to come; a curriculum's hang on how those before it go."""
        if self._curriculum is not None or number >= self.settings.episodes:
            return None
        return self._draw(_EPISODE_STREAM, number), self._options(number)

    def _options(self, number: int) -> Mapping[str, Any]:
        """The options of an episode, those of the settings in turn."""
        resets = self.settings.resets
        return resets[number % len(resets)] if resets else {}

    def _batches(self, number: int) -> Iterator[Batch]:
        """One for each step of the newest episode, from all that was driven so far."""
        size = self.settings.ddpg.batch
        if len(self.replay) < size:
            return
        rng = np.random.default_rng([self.settings.seed, _BATCH_STREAM, number])
        for _ in range(self.replay.newest):
            yield self.replay.sample(size, rng)

    def _draw(self, stream: int, number: int) -> int:
        return int(np.random.SeedSequence([self.settings.seed, stream, number]).generate_state(1)[0])


class _Inline:
    """A collector in this process, which drives when it is asked for what came in."""

    def __init__(self, collector: Collector):
        self._collector = collector
        self._items: Iterator[StepFrame | Collected] = iter(())

    def begin(self, order: EpisodeOrder) -> None:
        self._items = self._collector.collect(order)

    def poll(self, timeout: float = 0.0) -> StepFrame | Collected | None:
        return next(self._items, None)

    def pause(self) -> None: ...

    def go_on(self) -> None: ...

    def close(self) -> None:
        self._collector.close()


def _mean(losses: list[Losses]) -> Losses:
    if not losses:
        return Losses()
    critic, actor = np.mean([(loss.critic, loss.actor) for loss in losses], axis=0).tolist()
    return Losses(critic, actor)


def _prepare_process() -> None:
    """One thread, that sums come out the same everywhere; and memory that was freed is kept, or most of an
    update would go into getting the same few megabytes from the system again."""
    torch.set_num_threads(1)
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        trim_threshold, mmap_threshold = -1, -3
        mallopt(trim_threshold, 1 << 30)
        mallopt(mmap_threshold, 1 << 30)
