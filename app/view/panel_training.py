"""Train: begin, hold and end a training, its curves, what its robot sees, its checkpoints on the mission."""

from __future__ import annotations

from typing import Any

import viser

from app.changes import StudioError
from app.training_plan import MOST_DEMONSTRATIONS, RewardName, Task, TrainingPlan, TrainingStatus
from app.training_records import LAST, Training
from app.training_sight import Seen
from app.training_trial import Driver
from app.view import curves, markup
from app.view.curves import CurvePlot
from app.view.desk import Desk, show_value
from app.view.training import Laid
from app.view.training_words import (
    checkpoint_words,
    comparison,
    pictures,
    state,
    task_words,
    trainings_table,
)

TASKS = {
    "curriculum, 4 m to 50 m": Task.CURRICULUM,
    "this mission": Task.MISSION,
    "other drives on this ground": Task.GROUND,
}
REWARDS = {"corrected": RewardName.CORRECTED, "paper, literally": RewardName.PAPER}
LAID = {
    "attention": Seen.ATTENTION, "cost": Seen.COST, "elevation": Seen.ELEVATION, "exposure": Seen.EXPOSURE,
    "cover": Seen.COVER, "nothing": None,
}  # fmt: skip
DRIVERS = {"network alone": Driver.NETWORK, "network and dynamic window": Driver.METHOD}
NONE = "none yet"
LARGEST_SEED = 2**31 - 1


class TrainingTab:
    def __init__(self, desk: Desk) -> None:
        self._desk, self._show = desk, desk.viewer.view.training
        gui, show = desk.gui, self._show
        self._state = gui.add_html("")
        self._hold = gui.add_button_group("Training", ("Pause", "Stop"), visible=False)
        desk.on_choice(self._hold, {"Pause": self._pause, "Stop": self._stop})
        self._held = gui.add_button_group("Training", ("Resume", "Stop"), visible=False)
        desk.on_choice(self._held, {"Resume": self._resume, "Stop": self._stop})
        self._begin = gui.add_folder("New training")
        with self._begin:
            self._task = gui.add_dropdown("Learn on", tuple(TASKS))
            self._reward = gui.add_dropdown("Reward", tuple(REWARDS))
            self._episodes = gui.add_number("Episodes", 100, min=1, max=100_000, step=1)
            self._demonstrations = gui.add_number(
                "Demos, %", 0, min=0, max=MOST_DEMONSTRATIONS, step=1,
                hint="Demonstrations: episodes that least_cost drives, for the policy to learn from",
            )  # fmt: skip
            self._seed = gui.add_number("Seed", 0, min=0, max=LARGEST_SEED, step=1)
            start = gui.add_button("Start training", icon=viser.Icon.SCHOOL)
            desk.on_click(start, self._start)
        self._plots = (
            CurvePlot(gui, "Return and its terms", curves.return_curve),
            CurvePlot(gui, "Success", curves.success_curve, scale=(0.0, 1.0)),
            CurvePlot(gui, "Exposure", curves.exposure_curve, opened=False),
            CurvePlot(gui, "Losses", curves.loss_curve, opened=False),
        )
        self._sight_folder = gui.add_folder("What it sees, and the truth", visible=False)
        with self._sight_folder:
            look = gui.add_button("Look at the robot that learns", icon=viser.Icon.EYE)
            desk.on_click(look, desk.viewer.look_at_learner)
            self._laid = gui.add_dropdown("Over the ground", tuple(LAID))
            desk.on_value(self._laid, self._lay)
            self._truth = gui.add_checkbox("As it truly is", show.laid.truth)
            desk.on_value(self._truth, lambda truth: show.lay(Laid(show.laid.seen, bool(truth))))
            self._sight = gui.add_html("")
        self._past = gui.add_folder("Trainings and checkpoints", visible=False)
        with self._past:
            self._add_past(gui)
        self._told: dict[int, str] = {}
        self.refresh()

    def _add_past(self, gui: viser.GuiApi) -> None:
        desk = self._desk
        self._table = gui.add_html("")
        self._chosen: Any = gui.add_dropdown("Training", (NONE,))
        desk.on_value(self._chosen, lambda label: self._show.choose(_number(label)))
        self._checkpoint: Any = gui.add_dropdown("Checkpoint", (NONE,))
        desk.on_click(gui.add_button("Drive with it", icon=viser.Icon.STEERING_WHEEL), self._use)
        self._before: Any = gui.add_dropdown("Before", (NONE,))
        self._driver = gui.add_dropdown("Driven by", tuple(DRIVERS))
        desk.on_click(gui.add_button("Compare before and after", icon=viser.Icon.ARROWS_DIFF), self._compare)
        self._compared = gui.add_html("")
        more = gui.add_button_group("", ("Resume", "Delete"))
        desk.on_choice(more, {"Resume": self._resume, "Delete": self._delete})

    # what a person does

    async def _start(self) -> None:
        plan = TrainingPlan(
            task=TASKS.get(self._task.value, Task.CURRICULUM),
            reward=REWARDS.get(self._reward.value, RewardName.CORRECTED),
            episodes=_within(self._episodes.value, 1, 100_000),
            seed=_within(self._seed.value, 0, LARGEST_SEED),
            demonstrations=_within(self._demonstrations.value, 0, MOST_DEMONSTRATIONS),
        )
        training = await self._show.service.start(plan)
        self._show.choose(training.id)

    def _live(self) -> Training:
        live = self._show.service.live
        if live is None:
            raise StudioError("no training is under way", 409)
        return live

    def _pause(self) -> None:
        self._show.service.pause(self._live().id)

    def _stop(self) -> None:
        self._show.service.stop(self._live().id)

    def _resume(self) -> None:
        training = self._show.service.live or self._about()
        self._show.service.resume(training.id)

    def _about(self) -> Training:
        training = self._show.training
        if training is None:
            raise StudioError("there is no training yet", 404)
        return training

    async def _delete(self) -> None:
        training = self._about()
        if training.status.live:
            raise StudioError(f"{training.called} is {training.status}: stop it before it is deleted", 409)
        await self._show.service.delete(training.id)

    async def _use(self) -> None:
        training, name = self._about(), self._checkpoints().get(self._checkpoint.value, LAST)
        note = self._desk.progress("Checkpoint", "being put into the mission")
        try:
            await self._show.service.use(training.id, name)
        finally:
            note.remove()

    async def _compare(self) -> None:
        names, training = self._checkpoints(), self._about()
        before, after = (names.get(chosen.value, LAST) for chosen in (self._before, self._checkpoint))
        note = self._desk.progress("Before and after", f"{training.called} drives this mission twice")
        try:
            await self._show.compare(before, after, DRIVERS.get(self._driver.value, Driver.NETWORK))
        finally:
            note.remove()

    def _lay(self, label: str) -> None:
        self._show.lay(Laid(LAID.get(label), self._show.laid.truth))

    def _checkpoints(self) -> dict[str, str]:
        training = self._show.training
        names = training.checkpoints() if training is not None else {}
        return {checkpoint_words(name): name for name in names}

    # what is shown

    def refresh(self) -> None:
        """Show trainings as they are now."""
        show = self._show
        training, live = show.training, show.service.live
        self._hold.visible = live is not None and live.status is not TrainingStatus.PAUSED
        self._held.visible = live is not None and live.status is TrainingStatus.PAUSED
        self._begin.visible = live is None
        self._tell(self._state, state(training))
        if training is not None:
            for plot in self._plots:
                plot.show(training.id, training.driven)
        sight = show.sight
        self._sight_folder.visible = sight is not None
        if sight is not None:
            self._tell(self._sight, pictures(sight))
        laid = next(label for label, seen in LAID.items() if seen is show.laid.seen)
        show_value(self._laid, laid)
        show_value(self._truth, show.laid.truth)
        self._refresh_past(training)

    def _refresh_past(self, training: Training | None) -> None:
        show, trainings = self._show, self._show.service.trainings
        self._past.visible = training is not None
        if training is None:
            return
        self._tell(self._table, trainings_table(trainings, training))
        labels = tuple(_label(one) for one in reversed(trainings))
        _offer(self._chosen, labels, _label(training))
        names = tuple(self._checkpoints()) or (NONE,)
        _offer(self._checkpoint, names, names[-1])
        _offer(self._before, names, names[0])
        compared = show.service.compared
        if show.comparing:
            words = markup.block(markup.sentence("driving the mission with both …"))
        else:
            words = comparison(compared) if compared is not None else ""
        self._tell(self._compared, words)

    def _tell(self, handle: viser.GuiHtmlHandle, content: str) -> None:
        if self._told.get(id(handle)) != content:
            self._told[id(handle)] = content
            handle.content = content


def _offer(dropdown: Any, options: tuple[str, ...], usual: str) -> None:
    """Give a dropdown its options; what was chosen stays chosen while there is such a thing."""
    if tuple(dropdown.options) != options:
        kept = dropdown.value
        dropdown.options = options
        show_value(dropdown, kept if kept in options and kept != NONE else usual)


def _within(value: float, low: int, high: int) -> int:
    return int(min(max(value, low), high))


def _label(training: Training) -> str:
    return f"{training.id} · {task_words(training)}"


def _number(label: str) -> int | None:
    head = str(label).partition(" ")[0]
    return int(head) if head.isdigit() else None
