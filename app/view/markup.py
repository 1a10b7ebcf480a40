"""Small pieces of HTML for the panel. viser shows HTML as it is given, so all text is escaped here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
