"""Those that move or watch, as low-poly solids: a walking person, an observer, a vehicle. They face +x."""

from __future__ import annotations

from scenes.solids import Colour, Solid, ball, box, column, frustum, join, wheel
from scenes.structures import TYRE, car

SKIN: Colour = (216, 172, 140)


def person() -> Solid:
    """A walker in mid-stride, 1.75 m tall."""
    return join(
        _leg(0.13, 0.1, (58, 66, 88)), _leg(-0.13, -0.1, (58, 66, 88)),
        _torso((196, 98, 62)),
        _arm(-0.12, 0.25, (176, 86, 54)), _arm(0.12, -0.25, (176, 86, 54)),
        ball((0.11, 0.1, 0.13), (0.02, 0.0, 1.58), SKIN),
        ball((0.12, 0.11, 0.09), (-0.015, 0.0, 1.66), (84, 58, 40)),
    )  # fmt: skip


def observer() -> Solid:
    """A watcher in olive with cap and binoculars, 1.75 m tall."""
    olive: Colour = (104, 108, 70)
    parts = [
        _leg(0.0, 0.11, (72, 70, 56)), _leg(0.0, -0.11, (72, 70, 56)),
        _torso(olive),
        ball((0.11, 0.1, 0.13), (0.0, 0.0, 1.56), SKIN),
        column(0.125, (1.61, 1.75), (74, 78, 50), top=0.1, sides=8),
        box((0.13, 0.0, 1.635), (0.14, 0.17, 0.025), (74, 78, 50)),
    ]  # fmt: skip
    for side in (-1, 1):
        elbow_y = 0.2 * side
        parts.append(frustum((0.09, 0.08), (0.12, 0.11), (1.1, 1.4), olive).moved(x=0.08, y=elbow_y))
        parts.append(box((0.16, 0.15 * side, 1.33), (0.1, 0.09, 0.42), olive))
        parts.append(box((0.2, 0.05 * side, 1.555), (0.17, 0.065, 0.075), (34, 34, 36)))
    return join(*parts)


def vehicle() -> Solid:
    """A road car on its four wheels."""
    length, width, height = 4.4, 1.9, 1.7
    radius = 0.34
    wheels = [
        wheel((sx * 0.3 * length, sy * (0.5 * width - 0.11), radius), radius, 0.22, TYRE)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return join(car(length, width, height, (72, 104, 140)), *wheels)


def _leg(x: float, y: float, colour: Colour) -> Solid:
    shoe = box((x + 0.04, y, 0.04), (0.26, 0.11, 0.08), (48, 42, 38))
    return frustum((0.12, 0.11), (0.17, 0.15), (0.06, 0.86), colour).moved(x=0.6 * x, y=y) + shoe


def _torso(colour: Colour) -> Solid:
    return frustum((0.2, 0.32), (0.23, 0.42), (0.82, 1.42), colour) + column(0.06, (1.4, 1.5), SKIN, sides=5)


def _arm(x: float, y: float, colour: Colour) -> Solid:
    sleeve = frustum((0.09, 0.08), (0.12, 0.1), (0.86, 1.38), colour).moved(x=0.5 * x, y=y)
    return sleeve + box((0.6 * x, y, 0.81), (0.08, 0.07, 0.12), SKIN)
