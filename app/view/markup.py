"""Small pieces of HTML for the panel. viser shows HTML as it is given, so all text is escaped here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from app.view import palette

_NAME = "padding:2px 12px 2px 0;white-space:nowrap;vertical-align:top;opacity:.65"
_VALUE = "padding:2px 0;text-align:right;font-variant-numeric:tabular-nums"


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Names on the left, values on the right."""
    lines = (
        f'<tr><td style="{_NAME}">{escape(name)}</td><td style="{_VALUE}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<table style="width:100%;border-collapse:collapse">{"".join(lines)}</table>'


def block(*parts: str) -> str:
    """Parts that are HTML already, with the panel's margins."""
    return f'<div style="padding:4px 14px 10px;font-size:13px">{"".join(parts)}</div>'


def sentence(text: str) -> str:
    return f'<div style="margin:2px 0 8px;opacity:.9">{escape(text)}</div>'


def note(text: str, aside: str) -> str:
    """A sentence that stands out, with a quieter remark."""
    box = "padding:7px 12px;margin:0 8px 4px;border-radius:6px;font-size:12.5px"
    return (
        f'<div style="{box};background:rgba(38,160,150,.22);color:#d6f2ee">{escape(text)}'
        f'<span style="opacity:.7"> · {escape(aside)}</span></div>'
    )


def heading(text: str) -> str:
    return f'<div style="margin:8px 0 4px;opacity:.65">{escape(text)}</div>'


def key(colour: palette.RGB, text: str, height: int = 3) -> str:
    """A line of a legend: a sample of the colour and what it means."""
    sample = f"width:18px;height:{height}px;border-radius:2px;background:{palette.css(colour)}"
    return (
        '<div style="display:flex;align-items:center;gap:8px;margin:2px 0">'
        f'<span style="{sample}"></span>{escape(text)}</div>'
    )


def chip(colour: palette.RGB, text: str) -> str:
    """A sample of a colour with its meaning, beside others."""
    sample = f"display:inline-block;width:12px;height:8px;border-radius:2px;background:{palette.css(colour)}"
    return (
        f'<span style="margin-right:10px;white-space:nowrap"><span style="{sample}"></span> '
        f"{escape(text)}</span>"
    )


@dataclass(frozen=True)
class Marked:
    """A cell of a grid with its colour; one that `stands_out` is bold."""

    text: str
    colour: palette.RGB
    stands_out: bool = False


def grid(head: Sequence[str], rows: Iterable[Sequence[str | Marked]]) -> str:
    """Rows of figures under a head; the first column is on the left, the others on the right."""
    top = "".join(_cell("th", column, text) for column, text in enumerate(head))
    lines = (
        f"<tr>{''.join(_cell('td', column, text) for column, text in enumerate(row))}</tr>" for row in rows
    )
    return (
        '<table style="width:100%;border-collapse:collapse;margin-top:6px;font-size:12px;'
        f'font-variant-numeric:tabular-nums"><tr style="opacity:.65">{top}</tr>{"".join(lines)}</table>'
    )


def _cell(tag: str, column: int, content: str | Marked) -> str:
    style = f"padding:2px 0 2px {6 if column else 0}px;text-align:{'right' if column else 'left'}"
    if isinstance(content, str):
        return f'<{tag} style="{style};font-weight:400">{escape(content)}</{tag}>'
    weight = 700 if content.stands_out else 400
    bar = f"border-left:4px solid {palette.css(content.colour)};padding-left:6px;font-weight:{weight}"
    return f'<{tag} style="{style};{bar}">{escape(content.text)}</{tag}>'


def scale(colours: Sequence[palette.RGB], low: str, high: str) -> str:
    """A gradient with what its ends mean."""
    stops = ",".join(palette.css(colour) for colour in colours)
    return (
        f'<div style="height:8px;border-radius:4px;background:linear-gradient(90deg,{stops})"></div>'
        '<div style="display:flex;justify-content:space-between;opacity:.65">'
        f"<span>{escape(low)}</span><span>{escape(high)}</span></div>"
    )


def swatch(colour: palette.RGB) -> str:
    """A spot of colour at the left edge of the widget that follows."""
    spot = f"left:2px;top:2px;width:4px;height:14px;border-radius:2px;background:{palette.css(colour)}"
    return (
        '<div style="position:relative;height:0;z-index:1">'
        f'<span style="position:absolute;{spot}"></span></div>'
    )
