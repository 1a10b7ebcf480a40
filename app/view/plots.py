"""Small plots for the panel, as SVG: a drive's exposure over time, and the section under a line of sight."""

from __future__ import annotations

from html import escape

import numpy as np

from app.view import palette
from planner.exposure import SightProfile

WIDTH, HEIGHT = 292, 96
LEFT, RIGHT, TOP, BOTTOM = 38, 4, 6, 16
_GROUND, _COVER, _PROBABILITY = (111, 121, 82), (88, 124, 70), (206, 178, 226)


class _Axes:
    """Pixels of values in the ranges `x` and `y`."""

    def __init__(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        self._x, self._y = x, y
        self.parts: list[str] = []

    def points(self, x: np.ndarray, y: np.ndarray) -> str:
        u = LEFT + (x - self._x[0]) / max(self._x[1] - self._x[0], 1e-9) * (WIDTH - LEFT - RIGHT)
        v = HEIGHT - BOTTOM - (y - self._y[0]) / max(self._y[1] - self._y[0], 1e-9) * (HEIGHT - TOP - BOTTOM)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(u, v, strict=True))

    def line(
        self, x: np.ndarray, y: np.ndarray, colour: palette.RGB, width: float = 1.5, dash: str = ""
    ) -> None:
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        self.parts.append(
            f'<polyline points="{self.points(x, y)}" fill="none" stroke="{palette.css(colour)}" '
            f'stroke-width="{width}" stroke-linejoin="round"{dashes}/>'
        )

    def area(self, x: np.ndarray, y: np.ndarray, colour: palette.RGB, opacity: float = 0.8) -> None:
        floor = np.full(2, self._y[0])
        outline = f"{self.points(x, y)} {self.points(x[[-1, 0]], floor)}"
        self.parts.append(f'<polygon points="{outline}" fill="{palette.css(colour)}" opacity="{opacity}"/>')

    def spot(self, x: float, y: float, colour: palette.RGB) -> None:
        u, v = self.points(np.array([x]), np.array([y])).split(",")
        fill = palette.css(colour)
        self.parts.append(f'<circle cx="{u}" cy="{v}" r="3.5" fill="{fill}" stroke="#1a1b1e"/>')

    def svg(self, low: str, high: str, x_low: str, x_high: str, title: str) -> str:
        right, base = WIDTH - RIGHT, HEIGHT - BOTTOM
        words = "".join(
            f'<text x="{x}" y="{y}" text-anchor="{anchor}">{escape(text)}</text>'
            for x, y, anchor, text in (
                (LEFT - 4, base, "end", low), (LEFT - 4, TOP + 8, "end", high),
                (LEFT, HEIGHT - 4, "start", x_low), (right, HEIGHT - 4, "end", x_high),
            )
        )  # fmt: skip
        return (
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="100%" role="img" aria-label="{escape(title)}" '
            f'style="font:10px system-ui;fill:#9aa2aa"><title>{escape(title)}</title>{"".join(self.parts)}'
            f'<path d="M{LEFT} {TOP}V{base}H{right}" fill="none" stroke="#4a4f55"/>{words}</svg>'
        )


def timeline_svg(times: np.ndarray, fraction: np.ndarray, probability: np.ndarray) -> str:
    """Visible fraction (orange) and probability of having been detected (pale) over seconds, each (n,)."""
    end = max(float(times[-1]) if len(times) else 0.0, 5.0)
    axes = _Axes((0.0, end), (0.0, 1.0))
    if len(times) > 1:
        axes.area(times, fraction, palette.SEEN)
        axes.line(times, probability, _PROBABILITY)
    return axes.svg("0", "100 %", "0 s", f"{end:.0f} s", "exposure over time")


def profile_svg(profile: SightProfile) -> str:
    """Ground, what stands on it, and the line of sight, with the point that hides."""
    tops = np.where(np.isnan(profile.cover), profile.ground, profile.cover)
    heights = np.concatenate([profile.ground, profile.sight, np.minimum(tops, profile.sight.max() + 4.0)])
    low, high = float(heights.min()) - 0.3, float(heights.max()) + 0.3
    end = float(profile.distance[-1])
    axes = _Axes((0.0, max(end, 0.1)), (low, high))
    axes.area(profile.distance, np.clip(tops, low, high), _COVER, 0.75)
    axes.area(profile.distance, profile.ground, _GROUND, 1.0)
    if profile.point is None:
        axes.line(profile.distance, profile.sight, palette.SEEN if profile.seen else palette.UNKNOWN)
    else:
        at = float(np.hypot(*(profile.point - profile.eye)[:2]))
        before = profile.distance <= at
        height = float(profile.point[2])
        axes.line(
            np.append(profile.distance[before], at), np.append(profile.sight[before], height), palette.HIDDEN
        )
        axes.line(
            np.append(at, profile.distance[~before]), np.append(height, profile.sight[~before]),
            palette.UNKNOWN, 1.2, "3 3",
        )  # fmt: skip
        axes.spot(at, height, palette.HIDDEN)
    title = f"section from observer {profile.observer_id}"
    return axes.svg(f"{low:.0f} m", f"{high:.0f} m", "eye", f"{end:.0f} m", title)
