"""`covernav evaluate`: methods compared on the same missions, going on from where it was interrupted."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from app.output import check_target, write_json

METHODS_HELP = "all, ablations, or names between commas; NAME@WEIGHTS drives with the weights of a file"


class EvaluationRefusal(ValueError):
    """A request that cannot be met, in one sentence."""


class EvaluationFailure(RuntimeError):
    """An evaluation that could not go on, in one sentence."""


def add_parser(commands: Any, whole: Any, number: Any, seed: Any) -> None:
    """Describe the command and its arguments; `whole`, `number` and `seed` parse numbers."""
    evaluate = commands.add_parser("evaluate", help="compare methods on seeded missions", allow_abbrev=False)
    evaluate.add_argument("--methods", default="all", metavar="all|a,b", help=METHODS_HELP)
    evaluate.add_argument("--against", metavar="NAME", help="compare the others with this one, pair by pair")
    evaluate.add_argument("--terrains", default="all", metavar="all|a,b")
    evaluate.add_argument("--suite", choices=["random", "covert", "crossing"], default="random")
    evaluate.add_argument("--observers", choices=["known", "unknown"], default="known")
    evaluate.add_argument("--placement", choices=["uniform", "vantage"], default="uniform")
    evaluate.add_argument("--perception", choices=["lidar", "oracle"], default="lidar")
    evaluate.add_argument("--missions", type=whole(1, 100_000), default=100, help="of each terrain")
    evaluate.add_argument("--seed", type=seed, default=0, help="of the first mission")
    evaluate.add_argument("--jobs", type=whole(1, 256), default=2, help="processes")
    evaluate.add_argument("--goal-distance", type=number(4.0, 60.0), default=12.0, metavar="M")
    evaluate.add_argument("--cluster", metavar="ADDRESS", help="drive on a Ray cluster instead of here")
    evaluate.add_argument("--out", type=Path, metavar="DIR", help="keep finished missions; go on from them")
    evaluate.add_argument("--json", metavar="FILE|-")
    evaluate.set_defaults(command=evaluate_methods)


def evaluate_methods(arguments: argparse.Namespace) -> None:
    """Evaluate, and print or write the tables.

    Raises EvaluationRefusal for what cannot be asked, EvaluationFailure where no mission could be driven,
    KeyboardInterrupt where it was stopped."""
    from planner.evaluation_journal import Journal, JournalError

    methods = _methods(arguments.methods)
    against = arguments.against or methods[0]
    if against not in methods:
        raise EvaluationRefusal(f"--against {against} is not among the methods; add it to --methods")
    wanted = _wanted(arguments, methods)
    check_target(arguments.json, EvaluationRefusal)
    if arguments.out is None:
        missions, stopped = _drive(wanted, arguments, None)
        _report(arguments, missions, methods, against, stopped)
        return
    try:
        journal = Journal(arguments.out)
    except OSError as error:
        raise EvaluationRefusal(f"{arguments.out} cannot be written: {error.strerror or error}") from None
    except JournalError as error:
        raise EvaluationRefusal(str(error)) from None
    if journal.damaged:
        words = f"{journal.damaged} lines of {journal.path} are damaged; what they held is driven again"
        print(f"covernav: {words}", file=sys.stderr)
    try:
        with journal:
            _check_kept(arguments.out, [journal.results[spec] for spec in wanted if spec in journal.results])
            missions, stopped = _drive(wanted, arguments, journal)
            if journal.full:
                raise EvaluationRefusal(
                    f"{arguments.out}: the disk is full; all finished missions are kept: make room and give"
                    " the same command again"
                )
            _keep(arguments.out, list(journal.results.values()), arguments.out.resolve().name)
    except OSError as error:
        words = f"{arguments.out} cannot be written: {error.strerror or error}"
        raise EvaluationRefusal(f"{words}; finished missions are kept") from None
    _report(arguments, missions, methods, against, stopped)


def _methods(text: str) -> list[str]:
    """The methods that are asked for, each once; every one can be made."""
    from planner.methods import COMPARED, METHODS, VARIANTS, make_method

    names: list[str] = []
    for word in filter(None, (word.strip() for word in text.split(","))):
        if word == "all":
            names += [name for name in COMPARED if name in METHODS]
        elif word == "ablations":
            if not VARIANTS:
                raise EvaluationRefusal("there are no ablations to compare")
            varied = dict.fromkeys(name.partition("[")[0] for name in VARIANTS)
            names += [*varied, *VARIANTS]
        else:
            names.append(word)
    if not names:
        raise EvaluationRefusal(f"--methods names none; choose from {', '.join(METHODS)}")
    for name in names:
        try:
            make_method(name)
        except ValueError as error:  # unknown, or without usable weights
            raise EvaluationRefusal(str(error)) from None
    return list(dict.fromkeys(names))


def _check_kept(folder: Path, kept: Sequence[dict[str, Any]]) -> None:
    """Refuse drives with other weights than there are now; say so where other code drove.

    Raises EvaluationRefusal."""
    from planner.fingerprint import code_digest
    from planner.methods import make_method, policies_of

    for name in dict.fromkeys(mission["method"] for mission in kept):
        now = {policy["sha256"] for policy in policies_of(make_method(name))}
        then = (
            {mission[key]["sha256"] for key in ("policy", "motion_policy") if mission.get(key)}
            for mission in kept
            if mission["method"] == name
        )
        if any(policies != now for policies in then):
            raise EvaluationRefusal(
                f"{folder} holds drives of {name} with other weights than it has now; name another folder"
            )
    strange = sum(mission.get("code") != code_digest() for mission in kept)
    if strange:
        words = f"{strange} of the missions in {folder} were driven by other code than this"
        print(f"covernav: {words}; another folder drives them anew", file=sys.stderr)


def _wanted(arguments: argparse.Namespace, methods: Sequence[str]) -> list[Any]:
    from planner.evaluation import specs
    from planner.frames import Perception
    from planner.posting import Placement
    from planner.suites import Knowledge, Suite
    from scenes.scenario import Family

    words = [word.strip() for word in arguments.terrains.split(",") if word.strip()]
    terrains = list(Family) if words == ["all"] else words
    if not terrains:
        raise EvaluationRefusal(f"--terrains names none; choose from {', '.join(Family)}")
    if arguments.seed + arguments.missions > 2**63:
        raise EvaluationRefusal(f"the last mission's seed would be above {2**63 - 1}; lower --seed")
    for terrain in terrains:
        if terrain not in set(Family):
            raise EvaluationRefusal(f"there is no terrain {terrain!r}; choose one of {', '.join(Family)}")
    return specs(
        methods,
        list(dict.fromkeys(Family(terrain) for terrain in terrains)),
        arguments.missions,
        arguments.seed,
        Perception(arguments.perception),
        arguments.goal_distance,
        Suite(arguments.suite),
        Knowledge(arguments.observers),
        Placement(arguments.placement),
    )


def _drive(
    wanted: list[Any], arguments: argparse.Namespace, journal: Any
) -> tuple[list[dict[str, Any]], bool]:
    """The missions' results, and whether somebody stopped it before the last."""
    from tqdm import tqdm

    from planner.evaluation_run import evaluate

    pool = _pool(arguments)
    kept = 0 if journal is None else sum(spec in journal.results for spec in wanted)
    missions: list[dict[str, Any]] = []
    with _interruptible() as stop:
        bar = tqdm(total=len(wanted), initial=kept, disable=None, unit="mission", file=sys.stderr)
        with bar:
            for result in evaluate(wanted, pool, journal, stop):
                missions.append(result)
                bar.update(len(missions) > kept)
    return missions, len(missions) < len(wanted)


def _pool(arguments: argparse.Namespace) -> Any:
    from planner.evaluation_cluster import Cluster, ClusterError
    from planner.evaluation_run import Local

    if arguments.cluster is None:
        return Local(arguments.jobs)
    try:
        return Cluster(arguments.cluster)
    except ClusterError as error:
        raise EvaluationRefusal(str(error)) from None


@contextmanager
def _interruptible() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets; the second, or SIGTERM, is a KeyboardInterrupt."""
    stop = threading.Event()

    def interrupted(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGTERM or stop.is_set():
            raise KeyboardInterrupt
        stop.set()
        words = "finishing the missions under way; once more stops at once"
        print(f"\ncovernav: {words}", file=sys.stderr)

    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, interrupted) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _keep(folder: Path, missions: list[dict[str, Any]], title: str) -> None:
    """Write the tables and the file for the browser beside the journal, of all that it holds."""
    from app import results_store
    from app.results_tables import csv_table
    from scenes.scenario import write_atomically

    missions = in_order(missions)
    table = _document(missions, None)
    write_atomically(folder / "table.json", json.dumps(table, indent=1, allow_nan=False) + "\n")
    write_atomically(folder / "table.csv", csv_table(*_all_rows(table)))
    if missions:
        results_store.write(folder / results_store.NAME, missions, title)


def in_order(missions: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Missions in an order that does not tell when each was finished."""
    from planner.evaluation import MissionSpec

    return sorted(missions, key=MissionSpec.of)


def _document(missions: list[dict[str, Any]], pairs: tuple[Sequence[str], str] | None) -> dict[str, Any]:
    from app.results_store import versions
    from planner.evaluation_table import bounds, tabulate, totals
    from planner.paired import paired

    document: dict[str, Any] = {"rows": tabulate(missions), "bounds": bounds(missions)}
    document["totals"], document["total_bounds"] = totals(missions)
    if pairs is not None:
        methods, against = pairs
        others = [name for name in methods if name != against]
        document["paired"] = [row for name in others for row in paired(missions, name, against)]
    return document | {"versions": versions(missions)}


def _all_rows(document: dict[str, Any]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The methods' rows and the bound's, those over all terrains last."""
    return document["rows"] + document["totals"], document["bounds"] + document["total_bounds"]


def _report(
    arguments: argparse.Namespace,
    missions: list[dict[str, Any]],
    methods: Sequence[str],
    against: str,
    stopped: bool,
) -> None:
    from app.results_tables import markdown, paired_markdown
    from planner.evaluation_table import reasons

    for reason, count in reasons(missions).items():
        print(f"covernav: {count} missions could not be driven: {reason}", file=sys.stderr)
    if stopped:
        out = arguments.out
        rest = "with --out they would be kept" if out is None else f"the same command goes on in {out}"
        print(f"covernav: {len(missions)} missions are finished; {rest}", file=sys.stderr)
        if not missions:
            raise KeyboardInterrupt
    elif missions and sum(reasons(missions).values()) == len(missions):
        raise EvaluationFailure("no mission could be driven; the reason stands above")
    document = _document(in_order(missions), (methods, against))
    if arguments.json != "-":
        print(markdown(*_all_rows(document)))
        if arguments.against is not None and document["paired"]:
            print("\n" + paired_markdown(document["paired"]))
    if arguments.json is not None:
        plain = [{k: v for k, v in m.items() if k not in ("trajectory", "scene")} for m in in_order(missions)]
        write_json(arguments.json, document | {"missions": plain}, EvaluationRefusal)
    if stopped:
        raise KeyboardInterrupt
