"""What the view shows of trainings, the same for everybody who looks: the robot that learns, what it sees
laid over the ground, and drives with two checkpoints side by side."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from app.changes import Change, StudioError
from app.studio import Studio
from app.training_process import Drawn, Moved
from app.training_records import Training
from app.training_service import TrainingService, View
from app.training_sight import Seen, Sight
from app.training_trial import Driver
from app.view import palette
from app.view.layers import Layer, LayerState
from app.view.learner import LearnerGround
from app.view.nodes import Lines, draped, polyline, resampled
from app.view.patches import height_span, patch_colours

log = logging.getLogger(__name__)

REFRESH_S = 0.2  # between refreshes of the panels
TRIAL_LIFT = 0.2


@dataclass(frozen=True)
class Laid:
    """What is laid over the ground about the robot that learns; `truth`: as it truly is."""

    seen: Seen | None = Seen.ATTENTION
    truth: bool = False


class TrainingShow:
    """Lives on the studio's loop. `refresh` is called, at most five times a second, when panels have to show
    something new."""

    def __init__(
        self,
        studio: Studio,
        scene: viser.SceneApi,
        layers: LayerState,
        service: TrainingService,
        refresh: Callable[[], None],
    ) -> None:
        self.service, self.laid = service, Laid()
        self.sight: Sight | None = None
        self.chosen: int | None = None
        self.comparing = False
        self._studio, self._layers, self._refresh = studio, layers, refresh
        self._ground = LearnerGround(scene, f"/{Layer.LEARNER.value}", f"/{Layer.LEARNED.value}")
        root = f"/{Layer.TRIALS.value}"
        # the first is wider, so that it is seen where both went the same way
        self._trials = Lines(scene, f"{root}/before", 0.18), Lines(scene, f"{root}/after", 0.08)
        self._episode = -1
        self._queue: list[Drawn] = []
        self._standing = False
        self._due: asyncio.TimerHandle | None = None
        self._leave = service.watch(self._hear)

    def close(self) -> None:
        self._leave()
        if self._due is not None:
            self._due.cancel()

    # what is shown

    @property
    def training(self) -> Training | None:
        """The one that panels are about: the chosen one, else the one that learns, else the newest."""
        trainings = self.service.trainings
        for training in trainings:
            if training.id == self.chosen:
                return training
        return self.service.live or (trainings[-1] if trainings else None)

    def choose(self, training_id: int | None) -> None:
        """Let panels be about this training. Raises UnknownEntry."""
        if training_id is not None:
            self.service.training(training_id)
        self.chosen = training_id
        self._soon()

    def lay(self, laid: Laid) -> None:
        """What to lay over the ground about the robot."""
        self.laid = laid
        self._lay_sight()
        self._soon()

    def show_layer(self, layer: Layer) -> None:
        if layer is Layer.LEARNED:
            self._lay_sight()

    def hear(self, change: Change) -> None:
        match change:
            case Change.TRAINING:
                if self.service.live is None:
                    self._forget_learner()
                self._draw_trials()
                self._soon()
            case Change.OPENED:
                self._forget_learner()

    @property
    def robot(self) -> np.ndarray:
        """(3,) where the robot that learns is drawn. Raises StudioError where there is none."""
        here = self._ground.here
        if here is None:
            raise StudioError("no robot learns at present", 409)
        return here

    async def compare(self, before: str, after: str, driver: Driver) -> None:
        """Drive the open mission with two checkpoints of the training. Raises StudioError, UnknownEntry."""
        training = self.training
        if training is None:
            raise StudioError("there is no training to compare checkpoints of", 404)
        if self.comparing:
            raise StudioError("two checkpoints are being compared; wait for them", 409)
        self.comparing = True
        self._soon()
        try:
            await self.service.compare(training.id, before, after, driver)
        finally:
            self.comparing = False
            self._soon()

    def _soon(self) -> None:
        if self._due is None:
            self._due = asyncio.get_running_loop().call_later(REFRESH_S, self._refresh_now)

    def _refresh_now(self) -> None:
        self._due = None
        self._refresh()

    # the robot that learns

    def _hear(self, view: View) -> None:
        match view:
            case Drawn():
                self._queue = [view]
                if not self._standing:
                    self._standing = True
                    self._studio.background(self._stand())
            case Moved(episode, poses) if episode == self._episode:
                self._ground.move(poses)
            case Sight(episode=episode) if episode == self._episode:
                self.sight = view
                self._lay_sight()
                self._soon()

    async def _stand(self) -> None:
        try:
            while self._queue:
                drawn = self._queue.pop()
                await self._ground.stand(drawn.scenario, drawn.episode, self._studio.heightmap)
                self._episode = drawn.episode
        except asyncio.CancelledError:
            raise
        except Exception:
            log.exception("the robot that learns could not be drawn")
        finally:
            self._standing = False

    def _forget_learner(self) -> None:
        self._episode, self.sight = -1, None
        self._ground.clear()

    def _lay_sight(self) -> None:
        sight, laid = self.sight, self.laid
        shown = None
        if sight is not None and laid.seen is not None and self._layers.visible[Layer.LEARNED]:
            patch = (sight.truth if laid.truth else sight.seen).get(laid.seen)
            if patch is not None:
                shown = patch_colours(laid.seen, patch, span_of(sight))
        pose = sight.pose if sight is not None else None
        if pose is not None:
            self._ground.lay(shown, pose, self._layers.opacity[Layer.LEARNED])

    # before and after

    def _draw_trials(self) -> None:
        compared, heightmap = self.service.compared, self._studio.heightmap
        for order, lines in enumerate(self._trials):
            if compared is None:
                lines.hide()
                continue
            points = np.asarray(compared.trials[order].points, float)
            way = polyline(draped(heightmap, resampled(points, 0.3), TRIAL_LIFT + 0.03 * order))
            lines.show(way, palette.TRIALS[order])


def span_of(sight: Sight) -> tuple[float, float]:
    """One scale of heights for what is seen and what is there."""
    return height_span(sight.seen[Seen.ELEVATION], sight.truth[Seen.ELEVATION])
