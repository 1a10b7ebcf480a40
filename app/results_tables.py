"""An evaluation's table as Markdown for a terminal or a README, and as CSV for a spreadsheet."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from app.results_store import FIGURES
from planner.evaluation_table import GROUPED_BY, MEANS, REMOVED

Row = dict[str, Any]

COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("length m", "trajectory_length_m", ".1f"),
    ("length ratio", "length_ratio", ".2f"),
    ("mission s", "execution_time_s", ".1f"),
    ("exposed s", "exposed_s", ".1f"),
    ("longest s", "longest_exposure_s", ".1f"),
    ("detected %", "detection_probability", ".0%"),
    ("avoidable removed %", REMOVED, ".0%"),
    ("in cover %", "cover_fraction", ".0%"),
    ("concealed %", "concealed_fraction", ".0%"),
    ("climb and fall m", "elevation_gradient_m", ".2f"),
    ("violations", "dynamic_violations", ".2f"),
    ("collided %", "collision_rate", ".0%"),
    ("timeout %", "timeout_rate", ".0%"),
    ("planner ms", "planner_ms_p50", ".0f"),
)
"""Heading, key of a row and format; a per cent sign is left to the heading."""

WITH_INTERVAL = ("exposed_s", REMOVED)

BOUND = {"trajectory_length_m": "bound_m", "exposed_s": "bound_s"}
"""What the bound's row has in the table's columns."""

PAPER_FORMATS = {"success_rate": ".0%", "trajectory_length_m": ".0f", "execution_time_s": ".0f"}


def kind_words(row: Row) -> str:
    """The kind of mission in words, beside the terrain."""
    goal = f"{row['goal_distance']:g} m goals"
    placement = "" if row["placement"] == "uniform" else f" {row['placement']}"
    return f"{row['suite']} suite,{placement} observers {row['observers']}, {row['perception']}, {goal}"


def markdown(rows: Sequence[Row], bounds: Sequence[Row]) -> str:
    """A table for each kind of mission: the paper's figures in brackets, exposed seconds and what was
    removed of them with their intervals, the bound's row beneath each terrain."""
    parts = []
    for kind in dict.fromkeys(kind_words(row) for row in rows):
        mine = [row for row in rows if kind_words(row) == kind]
        beneath = {row["terrain"]: row for row in bounds if kind_words(row) == kind}
        headings = ["terrain", "method", "n", "success % (95 % interval)", *(name for name, *_ in COLUMNS)]
        lines = [kind, "", _line([*headings, "failures"]), "|---" * (len(headings) + 1) + "|"]
        for index, row in enumerate(mine):
            lines.append(_method_line(row))
            last = index + 1 == len(mine) or mine[index + 1]["terrain"] != row["terrain"]
            if last and row["terrain"] in beneath:
                lines.append(_bound_line(beneath[row["terrain"]]))
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def _method_line(row: Row) -> str:
    low, high = row["success_ci95"]
    success = f"{100 * row['success_rate']:.0f} ({100 * low:.0f}–{100 * high:.0f})"
    success += _in_the_paper(row, "success_rate")
    cells = [row["terrain"], f"`{row['method']}`", str(row["missions"]), success]
    for _, key, style in COLUMNS:
        cells.append(shown(row[key], style) + around(row, key, style) + _in_the_paper(row, key))
    failures = ", ".join(f"{n} {reason}" for reason, n in row["failures"].items())
    return _line([*cells, failures or "none"])


def _in_the_paper(row: Row, key: str) -> str:
    figures = row["paper"]
    return f" [{shown(figures[key], PAPER_FORMATS[key])}]" if figures and key in figures else ""


def _bound_line(row: Row) -> str:
    cells = [row["terrain"], "*bound*", str(row["missions"]), ""]
    cells += [shown(row[BOUND[key]], style) if key in BOUND else "" for _, key, style in COLUMNS]
    return _line([*cells, ""])


def around(row: Row, key: str, style: str) -> str:
    """The interval of a figure in brackets, empty where the tables show none."""
    interval = row["ci95"].get(key) if key in WITH_INTERVAL else None
    if interval is None:
        return ""
    low, high = interval
    return f" ({shown(low, style)}{' to ' if low < 0.0 else '–'}{shown(high, style)})"


def shown(value: float | None, style: str) -> str:
    return "–" if value is None else format(value, style).rstrip("%")


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def paired_markdown(rows: Sequence[Row]) -> str:
    """Differences of pairs, with their intervals."""
    headings = ["terrain", "method", "less", "pairs", "success points", "exposed s", "mission s", "tilt °"]
    lines = [_line(headings), "|---" * len(headings) + "|"]
    for row in rows:
        cells = [row["terrain"], f"`{row['method']}`", f"`{row['against']}`", str(row["missions"])]
        cells.append(_difference(row["success"], 100.0))
        cells += [_difference(row[key]) for key in ("exposed_s", "execution_time_s", "max_tilt_deg")]
        lines.append(_line(cells))
    return "\n".join(lines)


def _difference(found: Row, scale: float = 1.0) -> str:
    if found["difference"] is None:
        return "–"
    text = f"{scale * found['difference']:+.1f}"
    if found["ci95"] is None:
        return text
    low, high = found["ci95"]
    return f"{text} ({scale * low:+.1f} to {scale * high:+.1f})"


def csv_table(rows: Sequence[Row], bounds: Sequence[Row]) -> str:
    """One line a row and all that it has; the bound's lines are of the method `bound`."""
    table = [flat(row) for row in rows] + [flat_bound(row) for row in bounds]
    columns = list(dict.fromkeys(key for row in table for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return text.getvalue()


def csv_missions(missions: Sequence[Row]) -> str:
    """One line a mission with its figures."""
    columns = (*GROUPED_BY, "seed", "status", "success", *FIGURES)
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(GROUPED_BY | mission for mission in missions)
    return text.getvalue()


def flat(row: Row) -> Row:
    """A row without rows inside: intervals as `..._low` and `..._high`, counts as `..._n`."""
    found: Row = {}
    for key, value in row.items():
        match key:
            case "n" | "ci95" | "paper":
                continue
            case "success_ci95":
                found |= {"success_low": value[0], "success_high": value[1]}
            case "failures":
                found[key] = "; ".join(f"{n} {reason}" for reason, n in value.items())
            case _:
                found[key] = value
        if key in (*MEANS, REMOVED):
            low, high = row["ci95"].get(key) or (None, None)
            found |= {f"{key}_low": low, f"{key}_high": high, f"{key}_n": row["n"].get(key)}
    return found | {f"paper_{key}": (row["paper"] or {}).get(key) for key in PAPER_FORMATS}


def flat_bound(row: Row) -> Row:
    kept = {key: value for key, value in row.items() if key not in BOUND.values()}
    return kept | {"method": "bound"} | {key: row[name] for key, name in BOUND.items()}
