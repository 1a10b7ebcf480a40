"""`covernav train`: a training from the command line, its progress on a terminal."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from app import ga_nav_command, motion_command
from app.output import check_target, write_json
from app.teach_command import add_arguments, teach

LEFT_OUT = ("goal", "heading", "stability", "elevation", "cover", "exposure", "time", "arrival", "failure")
REWARDS = (
    "corrected", *(f"corrected[no_{weight}]" for weight in LEFT_OUT),
    "paper", *(f"paper[{reading}]" for reading in ("equation", "abstract", "table", "height", "surface")),
    "terp",
)  # fmt: skip
TERRAINS = ("all", "normal", "low", "low_high", "forest")

_EPISODES = {
    "episodes", "steps", "seed", "reward", "terrain", "dynamics", "critic_rate", "demonstrations", "out",
}  # fmt: skip
_LESSONS = {"scenes", "held_out", "epochs", "seed", "jobs", "out"}
READ: dict[str, set[str]] = {
    "paper": _EPISODES | {"curriculum"},
    "terp": _EPISODES,
    "habits": _LESSONS,
    "exposure": _LESSONS,
    "ga_nav": _LESSONS | {"dataset", "data", "begin_with"},
    "dwa_rl": {"decisions", "seed", "out"},
    "resume": {"resume", "episodes"},
    "curves": {"curves", "json", "figure"},
    "validate": {"validate", "json", "missions"},
}
"""The options that each learner reads, and each of the other things that the command does."""


def add_parser(commands: Any, whole: Callable[[int, int], Any], seed: Any) -> None:
    """Describe the command and its arguments; `whole` and `seed` parse numbers."""
    words = "train the paper's learner or covernav's network"
    train = commands.add_parser("train", help=words, allow_abbrev=False)
    train.add_argument("--episodes", type=whole(1, 1_000_000), help="100 where it is left out")
    train.add_argument(
        "--steps", type=whole(1, 10_000), help="of an episode at most; 100 where it is left out"
    )
    train.add_argument("--seed", type=seed)
    train.add_argument("--reward", choices=REWARDS, help="the learner's own where it is left out")
    train.add_argument("--terrain", choices=TERRAINS, help="all, in turn, where it is left out")
    train.add_argument("--dynamics", choices=["kinematic", "physics"], help="kinematic where it is left out")
    train.add_argument("--critic-rate", choices=["1e-4", "1e-3"], help="the paper's or TERP's learning rate")
    train.add_argument("--curriculum", action="store_true", help="from 4 m on a meadow to a watched forest")
    words = "per cent of the episodes that least_cost drives, to learn from; none usually"
    train.add_argument("--demonstrations", type=whole(1, 90), metavar="PERCENT", help=words)
    where = train.add_mutually_exclusive_group()
    where.add_argument(
        "--out", type=Path, metavar="DIR", help="empty or new; named after reward and seed else"
    )
    where.add_argument("--resume", type=Path, metavar="DIR", help="go on with the training in it")
    where.add_argument("--curves", type=Path, nargs="+", metavar="DIR", help="summarise trainings by seeds")
    where.add_argument("--validate", type=Path, nargs="+", metavar="DIR", help="compare trainings' policies")
    train.add_argument("--missions", type=whole(1, 1000), help="of each terrain, of --validate; 10 usually")
    train.add_argument("--json", metavar="FILE|-", help="of --curves and --validate")
    train.add_argument("--figure", type=Path, metavar="FILE", help="of --curves, .png or .svg")
    add_arguments(train, whole)
    ga_nav_command.add_arguments(train)
    motion_command.add_arguments(train, whole)
    train.set_defaults(command=train_policy)


def train_policy(arguments: argparse.Namespace) -> None:
    """Train to the end, or until interrupted. Raises TrainingRefusal for what cannot be asked, TrainingError
    where it cannot go on."""
    from planner.learning_errors import TrainingRefusal

    _refuse_what_would_be_ignored(arguments)
    if arguments.learner in ("habits", "exposure"):
        teach(arguments)
        return
    if arguments.learner == "ga_nav":
        ga_nav_command.teach(arguments)
        return
    if arguments.learner == "dwa_rl":
        motion_command.teach(arguments)
        return
    if arguments.curves is not None:
        from planner.training_curves import summarise

        curves = summarise(arguments.curves)
        if arguments.figure is not None:
            _draw(arguments.figure, curves)
        write_json(arguments.json or "-", curves, TrainingRefusal)
        return
    if arguments.validate is not None:
        check_target(arguments.json, TrainingRefusal)
        found = _validate(arguments.validate, arguments.missions or 10)
        write_json(arguments.json or "-", found, TrainingRefusal)
        return
    from tqdm import tqdm

    from planner.training import Trainer
    from planner.training_events import EpisodeDone, Stopped

    trainer = _trainer(arguments, Trainer)
    folder, total = trainer.folder, trainer.settings.episodes
    bar = tqdm(total=total, initial=trainer.progress.episodes, disable=None, unit="episode", file=sys.stderr)
    recent: list[EpisodeDone] = []
    with bar:
        for event in trainer.run():
            if isinstance(event, EpisodeDone):
                if not event.demonstrated:
                    recent = [*recent[-19:], event]
                    bar.set_postfix_str(_words(recent))
                bar.update()
            elif isinstance(event, Stopped):
                done = f"{event.episodes} of {total} episodes"
    print(f"{done} in {folder}; the policy is {folder / 'policy.safetensors'}")


def _refuse_what_would_be_ignored(arguments: argparse.Namespace) -> None:
    """Raises TrainingRefusal for options that do not go together."""
    from planner.learning_errors import TrainingRefusal

    given = {name for name, value in vars(arguments).items() if value is not None and value is not False}
    if arguments.learner != "paper":
        for name, does in (("resume", "goes on with"), ("curves", "is about"), ("validate", "is about")):
            if name in given:
                learner = f"--learner {arguments.learner}"
                raise TrainingRefusal(f"--{name} {does} a folder's own training; leave {learner} out")
    if "figure" in given and "curves" not in given:
        raise TrainingRefusal("--figure draws learning curves; name the trainings with --curves")
    if "json" in given and not given & {"curves", "validate"}:
        raise TrainingRefusal("--json is what --curves and --validate write; a training leaves its own files")
    if "missions" in given and "validate" not in given:
        raise TrainingRefusal("--missions is how many --validate drives; name the trainings with it")
    if "curriculum" in given:
        if arguments.learner != "paper":
            raise TrainingRefusal(f"--curriculum is not for --learner {arguments.learner}; leave one out")
        for name in sorted(given & {"terrain", "steps"}):
            raise TrainingRefusal(f"--curriculum has a {name} for each stage; leave --{name} out")
    task = next((name for name in ("resume", "curves", "validate") if name in given), arguments.learner)
    settled = READ["paper"] if task == "resume" else set()  # refused in words of their own
    for name in sorted((given & set().union(*READ.values())) - READ[task] - settled):
        words = f"--{task}" if task in ("resume", "curves", "validate") else f"--learner {task}"
        raise TrainingRefusal(f"--{name.replace('_', '-')} is nothing to {words}; leave it out")


def _draw(path: Path, curves: dict[str, Any]) -> None:
    from app.training_figure import write_figure
    from planner.learning_errors import TrainingRefusal

    try:
        write_figure(path, curves)
    except OSError as error:
        raise TrainingRefusal(f"{path} cannot be written: {error.strerror or error}") from None
    except ValueError as error:
        raise TrainingRefusal(str(error)) from None


def _validate(folders: list[Path], missions: int) -> dict[str, Any]:
    from tqdm import tqdm

    from planner.policy_validation import best, validate

    found = [
        validate(folder / "policy.safetensors", missions)
        for folder in tqdm(folders, disable=None, unit="policy", file=sys.stderr)
    ]
    rows = [{"training": folder.name} | asdict(each) for folder, each in zip(folders, found, strict=True)]
    return {"best": folders[best(found)].name, "missions_per_terrain": missions, "rows": rows}


def _trainer(arguments: argparse.Namespace, make: Any) -> Any:
    from planner.learning_errors import TrainingRefusal
    from planner.training_settings import TrainingSettings

    if arguments.resume is not None:
        for name in sorted(_EPISODES - {"episodes", "out"}):
            if getattr(arguments, name) is not None:
                option = "--" + name.replace("_", "-")
                raise TrainingRefusal(f"{option} is settled by the training that goes on; leave it out")
        if arguments.curriculum:
            raise TrainingRefusal("--curriculum is settled by the training that goes on; leave it out")
        trainer = make(arguments.resume)
        if arguments.episodes is not None:
            trainer.extend(arguments.episodes)
        return trainer
    settings = TrainingSettings(
        episodes=arguments.episodes or 100,
        steps=arguments.steps or 100,
        seed=arguments.seed or 0,
        demonstrations=arguments.demonstrations or 0,
        curriculum=arguments.curriculum,
        options={"reward": arguments.reward or "corrected", "dynamics": arguments.dynamics or "kinematic"},
    )
    if arguments.learner == "terp":
        settings = _as_terp(settings, arguments.reward or "terp")
    if (arguments.terrain or "all") != "all":
        settings = replace(settings, resets=({"terrain": arguments.terrain},))
    if arguments.critic_rate is not None:
        settings = replace(settings, ddpg=replace(settings.ddpg, critic_rate=float(arguments.critic_rate)))
    name = f"training-{settings.options['reward']}-{settings.seed}"
    return make(arguments.out or Path(name), settings)


def _as_terp(settings: Any, reward: str) -> Any:
    """TERP's own reward and its learning rate of the critic; nobody watches, and cover is no matter to it."""
    options = settings.options | {"reward": reward, "observers": 0, "exposure_layer": False}
    return replace(settings, options=options, ddpg=replace(settings.ddpg, critic_rate=1e-3))


def _words(recent: list[Any]) -> str:
    count = len(recent)
    success = sum(event.success for event in recent) / count
    mean = sum(event.total for event in recent) / count
    last = recent[-1]
    stage = f"{last.stage}, " if last.stage else ""
    return f"{stage}return {mean:.1f}, success {success:.0%} over {count}, {last.steps_per_s:.0f} steps/s"
