"""The `covernav` command.

Exit status 0: done; 2: the request cannot be met, the reason in one line on standard error; 1: our failure.
Progress goes to standard error and only to a terminal. `--json -` prints one document and nothing else.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from app import evaluate_command, train_command
from app.output import check_target, write_json, write_text

# one thread a process for the numeric libraries, which read this once: the processes share the cores
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


class Refusal(ValueError):
    """A request that cannot be met."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    arguments = _parser().parse_args(argv)
    from app.evaluate_command import EvaluationFailure, EvaluationRefusal
    from app.store import StoreError, UnknownEntry
    from planner.learning_errors import PolicyError, TrainingError, TrainingRefusal
    from scenes.scenario import ScenarioError

    refusals = EvaluationRefusal, Refusal, TrainingRefusal, PolicyError, ScenarioError, StoreError
    try:
        arguments.command(arguments)
    except (*refusals, UnknownEntry) as error:
        print(f"covernav: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except (EvaluationFailure, TrainingError) as error:
        print(f"covernav: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("covernav: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return 0


# types of arguments


def _number(low: float, high: float):
    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"must be {low:g} to {high:g}, got {text}")
        return value

    return parse


def _whole(low: int, high: int):
    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be {low} to {high}, got {text}")
        return value

    return parse


_SEED = _whole(0, 2**63 - 1)
_METRE = _number(-1e9, 1e9)


class _Parser(argparse.ArgumentParser):
    """Refuses in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="covernav", description="Plan hidden drives over rough ground.", allow_abbrev=False
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    serve = commands.add_parser("serve", help="open the studio in a browser", allow_abbrev=False)
    serve.add_argument("scenario", nargs="?", metavar="SCENARIO", help="a shipped name or a file")
    serve.add_argument("--host", default="127.0.0.1")
    serve.add_argument("--port", type=_whole(0, 65535), default=8000, help="0 takes a free one")
    serve.add_argument("--workspace", type=Path, default=Path("~/.covernav"), metavar="DIR")
    serve.add_argument("--token", help="made anew at every start where it is left out")
    serve.set_defaults(command=_serve)

    run = commands.add_parser("run", help="drive one mission without a server", allow_abbrev=False)
    run.add_argument("scenario", metavar="SCENARIO", help="a shipped name or a file")
    run.add_argument("--method", metavar="NAME", help="covernav where it is left out")
    run.add_argument(
        "--motion", choices=["dwa", "dwa_rl"], default="dwa", help="what chooses among the arcs"
    )
    run.add_argument("--seed", type=_SEED, default=0)
    run.add_argument("--perception", choices=["lidar", "oracle"], default="lidar")
    run.add_argument("--goal", type=_METRE, nargs=2, metavar=("X", "Y"))
    run.add_argument("--time-limit", type=_number(0.1, 86400.0), metavar="S")
    run.add_argument("--json", metavar="FILE|-")
    run.add_argument("--record", type=Path, metavar="DIR", help="leave scenario, summary and every tick here")
    run.set_defaults(command=_run)

    evaluate_command.add_parser(commands, _whole, _number, _SEED)
    train_command.add_parser(commands, _whole, _SEED)

    _scenario_parsers(commands)

    bench = commands.add_parser("bench", help="measure speed against peers", allow_abbrev=False)
    bench.add_argument("--only", metavar="NAME")
    bench.add_argument("--json", metavar="FILE|-")
    bench.set_defaults(command=_bench)
    return parser


def _scenario_parsers(commands: Any) -> None:
    scenarios = commands.add_parser("scenarios", help="list, show, generate, import", allow_abbrev=False)
    actions = scenarios.add_subparsers(required=True, metavar="ACTION")
    actions.add_parser("list", help="the shipped ones").set_defaults(command=_list)
    show = actions.add_parser("show", help="describe one")
    show.add_argument("scenario", metavar="NAME")
    show.add_argument("--json", metavar="FILE|-", help="the whole document")
    show.set_defaults(command=_show)
    generate = actions.add_parser("generate", help="make one from a seed")
    generate.add_argument("terrain", choices=["normal", "low", "low_high", "forest"], metavar="TERRAIN")
    generate.add_argument("--seed", type=_SEED, required=True)
    generate.add_argument("--size", type=_number(24.0, 255.75), default=48.0, metavar="M")
    generate.add_argument("--goal-distance", type=_number(4.0, 100.0), default=12.0, metavar="M")
    generate.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    generate.set_defaults(command=_generate)
    survey = actions.add_parser("import", help="make one from a GeoTIFF, LAS or LAZ survey")
    survey.add_argument("file", type=Path, metavar="FILE")
    survey.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    survey.add_argument("--crop", type=_METRE, nargs=3, metavar=("X", "Y", "SIZE"))
    survey.add_argument("--resolution", type=_number(0.05, 10.0), metavar="M")
    survey.add_argument("--vertical-scale", type=_number(0.01, 100.0), default=1.0, metavar="K")
    survey.set_defaults(command=_import)


# commands


def _open(name: str):
    """A shipped scenario by name, else a file."""
    from scenes.library import shipped
    from scenes.scenario import Scenario

    path = shipped().get(name)
    if path is None:
        path = Path(name)
        if not path.exists() and path.suffix == "" and os.sep not in name:
            names = ", ".join(shipped())
            raise Refusal(f"there is neither a shipped scenario nor a file {name!r}; shipped are {names}")
    return Scenario.load(path)


def _serve(arguments: argparse.Namespace) -> None:
    from app.server import serve
    from app.settings import Settings, SettingsError

    try:
        settings = Settings.make(
            host=arguments.host, port=arguments.port, workspace=arguments.workspace, token=arguments.token
        )
        serve(settings, arguments.scenario)
    except SettingsError as error:
        raise Refusal(str(error)) from None


def _run(arguments: argparse.Namespace) -> None:
    from planner.exposure_log import timeline
    from planner.frames import Perception
    from planner.methods import DEFAULT_METHOD
    from planner.mission import Mission
    from planner.warm_up import warm_up
    from scenes.scenario import Point

    check_target(arguments.json, Refusal)
    scenario = _open(arguments.scenario)
    if arguments.goal:
        scenario = scenario.revised(goal=Point(x=arguments.goal[0], y=arguments.goal[1]))
    method = arguments.method or DEFAULT_METHOD
    if arguments.motion != "dwa":
        method += f"+{arguments.motion}"
    _check_method(method)
    perception = Perception(arguments.perception)
    warm_up(method, perception)
    mission = Mission(
        scenario,
        method,
        arguments.seed,
        perception,
        time_limit_s=arguments.time_limit,
    )
    rows = []
    try:
        for frame in mission.frames():
            rows.append(frame)
            if sys.stderr.isatty() and frame.tick % 5 == 0:
                print(f"\r\033[K{frame.time_s:6.1f} s  {frame.message}", end="", file=sys.stderr)
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr)
        summary = mission.summary()
    finally:
        mission.close()
    if arguments.record is not None:
        _record(arguments.record, scenario, summary, rows)
    _print_json(arguments.json, summary | {"timeline": timeline(rows)})
    if arguments.json != "-":
        ratio = summary["trajectory_length_m"] / max(summary["straight_line_m"], 1e-9)
        print(
            f"{summary['status']}: {summary['trajectory_length_m']:.1f} m"
            f" in {summary['execution_time_s']:.1f} s ({ratio:.2f} × the straight line),"
            f" seen for {summary['exposed_s']:.1f} s, planner {summary['planner_ms_p50']:.1f} ms"
        )


def _record(folder: Path, scenario: Any, summary: dict[str, Any], frames: list) -> None:
    from app.mission_process import frame_row
    from app.store import FRAME_COLUMNS
    from scenes.scenario import write_atomically

    lines = [",".join((*FRAME_COLUMNS, "status"))]
    lines += [",".join([*(repr(float(v)) for v in frame_row(frame)), frame.status]) for frame in frames]
    try:
        scenario.save(folder / "scenario.json")
        write_atomically(folder / "summary.json", json.dumps(summary, indent=1) + "\n")
        write_atomically(folder / "frames.csv", "\n".join(lines) + "\n")
    except OSError as error:
        raise Refusal(f"{folder} cannot be written: {error.strerror or error}") from None


def _check_method(name: str) -> None:
    from planner.methods import make_method

    try:
        make_method(name)
    except ValueError as error:  # unknown, or without usable weights
        raise Refusal(str(error)) from None


def _list(_: argparse.Namespace) -> None:
    from scenes.library import load_shipped, shipped

    width = max(len(name) for name in shipped())
    for name in shipped():
        print(f"{name:{width}}  {load_shipped(name).description}")


def _show(arguments: argparse.Namespace) -> None:
    scenario = _open(arguments.scenario)
    if arguments.json is not None:
        write_text(arguments.json, scenario.to_json(), Refusal)
        return
    ground = scenario.terrain.heightmap()
    west, east, south, north = ground.bounds
    print(f"{scenario.name}\n{scenario.description}")
    size = f"{east - west:g} × {north - south:g} m at {ground.resolution:g} m"
    print(f"map      {size}, relief {ground.relief:.1f} m")
    print(f"start    ({scenario.start.x:g}, {scenario.start.y:g}) facing {scenario.start.yaw:g}°")
    print(f"goal     ({scenario.goal.x:g}, {scenario.goal.y:g})")
    print(
        f"holds    {len(scenario.cover)} cover objects, {len(scenario.observers)} observers,"
        f" {len(scenario.obstacles)} moving obstacles"
    )


def _generate(arguments: argparse.Namespace) -> None:
    from scenes.families import generate
    from scenes.scenario import Family

    scenario = generate(
        Family(arguments.terrain),
        arguments.seed,
        size_m=arguments.size,
        goal_distance=arguments.goal_distance,
    )
    _save(scenario, arguments.output)


def _import(arguments: argparse.Namespace) -> None:
    from scenes.survey import import_survey

    scenario = import_survey(
        arguments.file,
        crop=tuple(arguments.crop) if arguments.crop else None,
        resolution=arguments.resolution,
        vertical_scale=arguments.vertical_scale,
    )
    _save(scenario, arguments.output)


def _save(scenario: Any, path: Path) -> None:
    try:
        scenario.save(path)
    except OSError as error:
        raise Refusal(f"{path} cannot be written: {error.strerror or error}") from None


def _bench(arguments: argparse.Namespace) -> None:
    from app.bench import CASES, run, table

    if arguments.only is not None and arguments.only not in CASES:
        raise Refusal(f"there is no bench {arguments.only!r}; choose one of {', '.join(CASES)}")
    check_target(arguments.json, Refusal)
    results = run(arguments.only)
    _print_json(arguments.json, results)
    if arguments.json != "-":
        print(table(results))


def _print_json(target: str | None, document: Any) -> None:
    if target is not None:
        write_json(target, document, Refusal)


if __name__ == "__main__":
    sys.exit(main())
