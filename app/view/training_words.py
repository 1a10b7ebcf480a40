"""Trainings in words, tables and pictures, as HTML for the panel."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from app.training_plan import Task, TrainingStatus
from app.training_records import LAST, Training
from app.training_service import Compared
from app.training_sight import Seen, Sight
from app.view import markup, palette
from app.view.patches import data_url, patch_colours
from app.view.training import span_of

MOST_LISTED = 8
RECENT = 20  # episodes that a rate is of


def task_words(training: Training) -> str:
    """What a training learns on."""
    match training.plan.task:
        case Task.CURRICULUM:
            return "curriculum"
        case Task.GROUND:
            return f"ground of {training.scenario}"
    return training.scenario


def checkpoint_words(name: str) -> str:
    """A checkpoint as people read it."""
    if name == LAST:
        return "newest"
    count = int(name.rpartition("_")[2])
    return f"after episode {count}" if count else "before the first episode"


def state(training: Training | None) -> str:
    """Where a training stands: a sentence and its latest numbers."""
    if training is None:
        words = "Nothing has been trained here yet. The paper's learner drives, is rewarded, and learns."
        return markup.block(markup.sentence(words))
    done, wanted = len(training.episodes), training.plan.episodes
    words = f"{training.called.capitalize()} is {training.status.value}"
    if training.status is TrainingStatus.STARTING:
        words += ": the learner's libraries are being loaded"
    if training.message:
        words += f": {training.message}"
    rows = [
        ("Learns on", task_words(training)),
        ("Reward, seed", f"{training.plan.reward.value}, {training.plan.seed}"),
        ("Episodes", f"{done} of {wanted}"),
    ]
    driven = training.driven
    if training.plan.demonstrations:
        rows.append(("Driven by the planner", f"{done - len(driven)}"))
    recent = driven[-RECENT:]
    if recent:
        last = recent[-1]
        rows += [("Stage", last["stage"])] if last.get("stage") else []
        share = float(np.mean([row["success"] for row in recent]))
        rows += [
            ("Last episode", f"{ended(last['final'])}, return {last['total']:.1f}"),
            (f"Success, last {len(recent)}", f"{share:.0%}"),
        ]
        if "steps_per_s" in last:
            rows.append(("Pace", f"{last['steps_per_s']:.0f} steps/s"))
    return markup.block(markup.sentence(f"{words}."), _bar(done / wanted), markup.table(rows))


def ended(status: str) -> str:
    """How an episode ended; one that had not was cut off."""
    return "out of steps" if status == "running" else status.replace("_", " ")


def _bar(share: float) -> str:
    frame = "height:4px;border-radius:2px;overflow:hidden;background:#3a3f45;margin:2px 0 8px"
    inner = f"width:{share:.1%};height:4px;background:{palette.css(palette.GHOST)}"
    return f'<div style="{frame}"><div style="{inner}"></div></div>'


def pictures(sight: Sight) -> str:
    """Patches of what is seen beside the truth, forward up, in their colours."""
    span = span_of(sight)
    lines = [_line("", "Seen", "True")]
    for seen in Seen:
        both = (_picture(seen, patches, span) for patches in (sight.seen, sight.truth))
        lines.append(_line(seen.value.capitalize(), *both))
    grid = "display:grid;grid-template-columns:62px 1fr 1fr;gap:6px;align-items:center;justify-items:center"
    words = f"20 × 20 m about the robot, forward is up; elevation {span[0]:.1f} to {span[1]:.1f} m"
    return markup.block(markup.sentence(words), f'<div style="{grid}">{"".join(lines)}</div>')


def _line(name: str, left: str, right: str) -> str:
    quiet = '<span style="opacity:.65;justify-self:start">'
    return f"{quiet}{escape(name)}</span><span>{left}</span><span>{right}</span>"


def _picture(seen: Seen, patches: Mapping[Seen, np.ndarray], span: tuple[float, float]) -> str:
    patch = patches.get(seen)
    if patch is None and seen is Seen.ATTENTION:
        return ""
    if patch is None:
        return '<span style="opacity:.5;font-size:11px">nothing of it</span>'
    style = "width:104px;height:104px;image-rendering:pixelated;border-radius:4px;display:block"
    return f'<img alt="{seen.value}" style="{style}" src="{data_url(patch_colours(seen, patch, span))}">'


def trainings_table(trainings: list[Training], about: Training) -> str:
    """The newest trainings, one a line; the one that is shown stands out."""
    rows = []
    for training in reversed(trainings[-MOST_LISTED:]):
        recent = training.driven[-RECENT:]
        share = f"{np.mean([row['success'] for row in recent]):.0%}" if recent else "–"
        total = f"{np.mean([row['total'] for row in recent]):.1f}" if recent else "–"
        colour = palette.GHOST if training.status.live else palette.UNKNOWN
        rows.append((
            markup.Marked(str(training.id), colour, training is about), training.status.value,
            f"{len(training.episodes)}/{training.plan.episodes}", share, total,
        ))  # fmt: skip
    return markup.block(markup.grid(("", "status", "episodes", "success", "return"), rows))


def comparison(compared: Compared) -> str:
    """The figures of two drives side by side."""
    rows = []
    for name, colour, trial in zip(
        (compared.before, compared.after), palette.TRIALS, compared.trials, strict=True
    ):
        rows.append((
            markup.Marked(checkpoint_words(name), colour), trial.status.replace("_", " "),
            f"{trial.length_m:.1f} m", f"{trial.duration_s:.0f} s", f"{trial.exposed_s:.1f} s",
        ))  # fmt: skip
    return markup.block(markup.grid(("", "ended", "length", "time", "exposed"), rows))
