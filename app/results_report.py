"""An evaluation as one page that needs nothing else: tables, figures, one mission a terrain."""

from __future__ import annotations

import re
import zlib
from functools import partial
from html import escape
from typing import Any

from app.results import Evaluation, described
from app.results_figures import (
    MOST_DOTS,
    Theme,
    distributions,
    render,
    success_against_exposure,
    trajectories,
)
from app.results_map import Grounds
from app.results_tables import BOUND, COLUMNS, PAPER_FORMATS, around, kind_words, shown
from app.store import UnknownEntry
from planner.evaluation_table import ALL_TERRAINS
from scenes.scenario import ScenarioError

BESIDE_EXPOSURE = "Success against exposure, with 95 % intervals; the dashed line is the least exposed route"
SPREAD = f"Successes: drives ({MOST_DOTS} of a method at most), the middle half, the median"
STYLE = """
body { margin: 0 auto; max-width: 88rem; padding: 2rem 1.25rem 4rem; color: #1c1f22; background: #fff;
  font: 15px/1.55 system-ui, sans-serif }
h1 { font-size: 1.5rem } h2 { margin-top: 2.4rem; font-size: 1.15rem }
table { border-collapse: collapse; font-size: 12px; font-variant-numeric: tabular-nums }
td, th { padding: 3px 7px; border-bottom: 1px solid #d5d9dd; text-align: right; white-space: nowrap }
td:first-child, th:first-child, td:nth-child(2), th:nth-child(2), td:last-child { text-align: left }
th { white-space: normal; vertical-align: bottom; line-height: 1.25 }
tr.bound td { font-style: italic; color: #5a626a; border-bottom: 2px solid #9aa2aa }
.paper, .quiet { color: #5a626a } .wide { overflow-x: auto } svg { max-width: min(100%, 68rem); height: auto }
figure { margin: 1.4rem 0 } figcaption { color: #5a626a; font-size: 13px }
"""


def page(found: Evaluation, grounds: Grounds) -> str:
    """The whole page. Text is escaped; figures are SVG within it."""
    kinds = "".join(_kind(found, number, grounds) for number in range(len(found.kinds)))
    methods = "".join(
        f"<li><code>{escape(name)}</code> {escape(described(name))}</li>" for name in found.methods
    )
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f"<title>{escape(found.title)}: evaluation</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(found.title)}</h1><p class=quiet>{len(found.missions)} drives. Means are over the"
        " successes; in brackets 95 % intervals, in grey what the CoverNav paper reports"
        " (arXiv 2308.06594).</p>"
        f"{kinds}<h2>Methods</h2><ul>{methods}</ul></body></html>"
    )


def _kind(found: Evaluation, number: int, grounds: Grounds) -> str:
    kind = found.kind(number)
    rows, bounds = (
        [row for row in them if all(row[name] == kind[name] for name in kind)]
        for them in found.table
    )
    missions = found.of_kind(number)
    by_terrain = [[row for row in them if row["terrain"] != ALL_TERRAINS] for them in (rows, bounds)]
    parts = [
        f"<h2>{escape(kind_words(kind))}</h2>",
        table(rows, bounds),
        _figure(partial(success_against_exposure, *by_terrain), BESIDE_EXPOSURE, number),
        _figure(partial(distributions, missions, found.methods), SPREAD, number),
    ]
    for terrain in dict.fromkeys(row["terrain"] for row in by_terrain[0]):
        example = next((m for m in missions if m["terrain"] == terrain and m["drawn"]), None)
        if example is not None:
            parts.append(_example(found, example, grounds, number))
    return "".join(parts)


def _example(found: Evaluation, mission: dict[str, Any], grounds: Grounds, number: int) -> str:
    try:
        ground = grounds.of(found.recipe(mission["id"]))
    except (ScenarioError, UnknownEntry) as error:
        return f"<p class=quiet>{escape(str(error))}</p>"
    ways = [(drive.mission["method"], drive.trajectory) for drive in found.drives(mission["id"])]
    if not ways:
        return f"<p class=quiet>the ways of {escape(mission['terrain'])} are damaged</p>"
    caption = f"{mission['terrain']}, seed {mission['seed']}"
    return _figure(partial(trajectories, ground, ways), caption, number)


def _figure(draw: Any, caption: str, number: int) -> str:
    """An SVG in the page; ids are made its own, for those of several figures would collide."""
    text = render(draw, Theme.LIGHT, "svg").decode()
    text = text[text.index("<svg") :]
    mark = f"f{number}-{zlib.crc32(caption.encode())}-"
    text = re.sub(r'(\bid="|href="#|url\(#)', lambda found: found[1] + mark, text)
    return f"<figure>{text}<figcaption>{escape(caption)}</figcaption></figure>"


def table(rows: list[dict[str, Any]], bounds: list[dict[str, Any]]) -> str:
    """The comparison as an HTML table, the bound beneath each terrain."""
    names = ["terrain", "method", "n", "success %", *(name for name, *_ in COLUMNS), "failures"]
    lines = [f"<tr>{''.join(f'<th>{escape(name)}</th>' for name in names)}</tr>"]
    beneath = {row["terrain"]: row for row in bounds}
    for place, row in enumerate(rows):
        lines.append(_method_row(row))
        last = place + 1 == len(rows) or rows[place + 1]["terrain"] != row["terrain"]
        if last and row["terrain"] in beneath:
            lines.append(_bound_row(beneath[row["terrain"]]))
    return f'<div class="wide"><table>{"".join(lines)}</table></div>'


def _method_row(row: dict[str, Any]) -> str:
    low, high = (100.0 * edge for edge in row["success_ci95"])
    success = f"{100.0 * row['success_rate']:.0f} ({low:.0f}–{high:.0f}){_paper(row, 'success_rate')}"
    cells = [escape(row["terrain"]), f"<code>{escape(row['method'])}</code>", str(row["missions"]), success]
    for _, key, style in COLUMNS:
        cells.append(shown(row[key], style) + around(row, key, style) + _paper(row, key))
    failures = ", ".join(f"{n} {reason}" for reason, n in row["failures"].items())
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in [*cells, escape(failures) or 'none'])}</tr>"


def _paper(row: dict[str, Any], key: str) -> str:
    figures = row["paper"]
    if not figures or key not in figures:
        return ""
    return f' <span class="paper">paper {shown(figures[key], PAPER_FORMATS[key])}</span>'


def _bound_row(row: dict[str, Any]) -> str:
    cells = [escape(row["terrain"]), "bound", str(row["missions"]), ""]
    cells += [shown(row[BOUND[key]], style) if key in BOUND else "" for _, key, style in COLUMNS]
    return f'<tr class="bound">{"".join(f"<td>{cell}</td>" for cell in [*cells, ""])}</tr>'
