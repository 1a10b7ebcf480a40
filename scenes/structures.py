"""Houses, fences and wrecked vehicles as low-poly solids of about their final size."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scenes.solids import Colour, Solid, box, extrusion, frustum, join, panel, wheel

FOUNDATION_DEPTH = 1.0
POST_DEPTH = 0.5
EAVES = 0.14
WHITE: Colour = (232, 226, 212)
GLASS: Colour = (66, 84, 98)
STONE: Colour = (132, 124, 114)
TAIL_LIGHT: Colour = (140, 40, 34)
TYRE: Colour = (44, 42, 40)
HOUSE_WALLS: tuple[Colour, ...] = ((206, 190, 164), (190, 170, 148), (214, 204, 186), (176, 158, 146))
HOUSE_ROOFS: tuple[Colour, ...] = ((138, 72, 54), (122, 80, 62), (96, 88, 88))
COTTAGE_WALLS: tuple[Colour, ...] = ((158, 124, 88), (172, 138, 100), (142, 114, 86))
COTTAGE_ROOFS: tuple[Colour, ...] = ((98, 74, 56), (110, 88, 62), (84, 78, 66))
CONCRETE: tuple[Colour, ...] = ((172, 170, 166), (162, 160, 152), (184, 178, 166))
WOOD: tuple[Colour, ...] = ((142, 112, 78), (128, 104, 78), (154, 124, 90))
RUSTY: tuple[Colour, ...] = ((112, 104, 74), (124, 92, 66), (96, 104, 96))
RUST: Colour = (132, 80, 50)


def house(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """Plastered walls, tiled gable roof, chimney, door and windows."""
    return _gabled(rng, (length, width, height), HOUSE_WALLS, HOUSE_ROOFS, eaves_share=0.56)


def cottage(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """Timber walls under a low, dark gable roof."""
    return _gabled(rng, (length, width, height), COTTAGE_WALLS, COTTAGE_ROOFS, eaves_share=0.6)


def _gabled(
    rng: np.random.Generator,
    size: tuple[float, float, float],
    walls: tuple[Colour, ...],
    roofs: tuple[Colour, ...],
    eaves_share: float,
) -> Solid:
    length, width, height = size
    wall, roof = walls[rng.integers(len(walls))], roofs[rng.integers(len(roofs))]
    half_length, half_width = 0.5 * length - EAVES, 0.5 * width - EAVES
    eaves, ridge = eaves_share * height, 0.92 * height
    outline = [(-half_width, 0.0), (half_width, 0.0), (half_width, eaves), (0.0, ridge), (-half_width, eaves)]
    parts = [
        box(
            (0, 0, -0.5 * FOUNDATION_DEPTH + 0.1),
            (length - EAVES, width - EAVES, FOUNDATION_DEPTH + 0.2),
            STONE,
        ),
        extrusion(outline, half_length, wall),
    ]
    slope, thick = (ridge - eaves) / half_width, 0.05 * height
    drop = eaves - slope * EAVES
    for side in (-1.0, 1.0):
        slab = [
            (0.0, ridge), (0.0, ridge + thick),
            (side * (half_width + EAVES), drop + thick), (side * (half_width + EAVES), drop),
        ]  # fmt: skip
        parts.append(extrusion(slab, 0.5 * length, roof))
    chimney_x = 0.25 * length * rng.choice((-1.0, 1.0))
    parts.append(box((chimney_x, 0.12 * width, 0.84 * height), (0.5, 0.5, 0.32 * height), STONE))
    parts += _long_side(1, length, half_width, eaves, door=False)
    parts += _long_side(-1, length, half_width, eaves, door=True)
    for side in (-1, 1):
        parts += _window(
            (side * half_length, 0.0, 0.55 * eaves), (side, 0), min(1.1, 0.35 * width), 0.4 * eaves
        )
    return join(*parts)


def _long_side(side: int, length: float, half_width: float, eaves: float, door: bool) -> list[Solid]:
    """Windows in a row, with a door in the middle of the front."""
    count = int(np.clip(length // 2.2, 2, 5))
    spacing, parts = (length - 1.0) / count, []
    for index in range(count):
        x = spacing * (index - 0.5 * (count - 1))
        if door and index == count // 2:
            tall = 0.78 * eaves
            parts.append(panel((x, side * (half_width + 0.03), 0.5 * tall), (0, side), (1.1, tall), WHITE))
            parts.append(
                panel(
                    (x, side * (half_width + 0.05), 0.48 * tall), (0, side), (0.9, 0.92 * tall), (98, 62, 44)
                )
            )
        else:
            parts += _window(
                (x, side * half_width, 0.58 * eaves), (0, side), min(1.0, 0.6 * spacing), 0.4 * eaves
            )
    return parts


def _window(
    centre: tuple[float, float, float], normal: tuple[int, int], width: float, height: float
) -> list[Solid]:
    """A pane in a light frame, set just before the wall so that neither flickers."""
    x, y, z = centre
    return [
        panel((x + gap * normal[0], y + gap * normal[1], z), normal, (width - inset, height - inset), colour)
        for gap, inset, colour in ((0.03, 0.0, WHITE), (0.05, 0.16, GLASS))
    ]


def building(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """A flat-roofed block with rows of windows, a parapet and a box on the roof."""
    wall = CONCRETE[rng.integers(len(CONCRETE))]
    trim: Colour = (int(0.82 * wall[0]), int(0.82 * wall[1]), int(0.82 * wall[2]))
    top, foundation = 0.86 * height, FOUNDATION_DEPTH
    half_length, half_width = 0.5 * length - 0.1, 0.5 * width - 0.1
    return join(
        box((0, 0, 0.5 * (top - foundation)), (2 * half_length, 2 * half_width, top + foundation), wall),
        box((0, 0, top + 0.02 * height), (length, width, 0.06 * height), trim),
        box((0.2 * length, 0.1 * width, 0.94 * height), (0.22 * length, 0.3 * width, 0.12 * height), trim),
        *_facade((0, -1), half_width, length, top, door=True),
        *_facade((0, 1), half_width, length, top),
        *_facade((1, 0), half_length, width, top),
        *_facade((-1, 0), half_length, width, top),
    )


def _facade(
    normal: tuple[int, int], reach: float, across: float, top: float, door: bool = False
) -> list[Solid]:
    """Rows of windows on the wall `reach` metres out along `normal`, a door in the middle of the lowest."""
    floors, columns = int(np.clip(top // 2.6, 1, 4)), int(np.clip(across // 2.0, 1, 5))
    storey, spacing = top / floors, (across - 0.6) / columns
    parts = []
    for floor in range(floors):
        for column in range(columns):
            along = spacing * (column - 0.5 * (columns - 1))
            x, y = normal[0] * reach + normal[1] * along, normal[1] * reach + normal[0] * along
            if door and floor == 0 and column == columns // 2:
                doorway = (x, y + 0.05 * normal[1], 0.4 * storey)
                parts.append(panel(doorway, normal, (1.2, 0.8 * storey), (84, 72, 62)))
            else:
                place = (x, y, storey * (floor + 0.55))
                parts += _window(place, normal, min(1.3, 0.6 * across / columns), 0.42 * storey)
    return parts


def fence(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """Posts and three rails."""
    wood = WOOD[rng.integers(len(WOOD))]
    posts = int(np.clip(round(length / 1.8), 1, 16)) + 1
    post_width = min(0.12, 0.5 * length)
    parts = [
        box(
            (x, 0.0, 0.5 * (height * tall - POST_DEPTH)),
            (post_width, width, height * tall + POST_DEPTH),
            wood,
        )
        for x, tall in zip(
            np.linspace(-0.5, 0.5, posts) * (length - post_width), rng.uniform(0.94, 1.0, posts), strict=True
        )
    ]
    rail = (length, 0.55 * width, 0.11 * height)
    parts += [box((0.0, 0.0, share * height), rail, wood) for share in (0.25, 0.54, 0.83)]
    return join(*parts).mottled(rng, 0.08)


def wreck(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """A rusty vehicle that sits askew with a wheel off: a truck when it is long and tall, else a car."""
    paint = RUSTY[rng.integers(len(RUSTY))]
    is_truck = length > 5.2 and height > 2.0
    body = (_truck if is_truck else car)(length, width, height, paint)
    radius = (0.18 if is_truck else 0.22) * height
    axles = [(sx * 0.31 * length, sy * (0.5 * width - 0.11)) for sx in (-1, 1) for sy in (-1, 1)]
    lost = int(rng.integers(4))
    wheels = [wheel((x, y, radius), radius, 0.22, TYRE) for i, (x, y) in enumerate(axles) if i != lost]
    dx, dy = axles[lost]
    lean = Rotation.from_euler("xy", (-0.05 * np.sign(dy), 0.035 * np.sign(dx))).as_matrix()
    stained = _rusted(body.mottled(rng, 0.05), rng)
    return join(stained, *wheels).turned(lean).moved(z=-0.04 * height)


def _rusted(body: Solid, rng: np.random.Generator) -> Solid:
    colours = body.colours.copy()
    stained = rng.random(len(colours)) < 0.3
    colours[stained] = 0.45 * colours[stained] + 0.55 * np.array(RUST)
    return Solid(body.triangles, colours)


def car(length: float, width: float, height: float, paint: Colour) -> Solid:
    """Body, cabin, panes, lights and bumpers, without wheels; the front is at +x."""
    sill, belt = 0.2 * height, 0.58 * height
    cabin_x, cabin = -0.06 * length, (0.6 * length, 0.42 * length)
    parts = [
        frustum((length, width), (0.95 * length, 0.94 * width), (sill, belt), paint),
        frustum((cabin[0], 0.9 * width), (cabin[1], 0.76 * width), (belt, height), paint).moved(x=cabin_x),
        frustum((0.54 * length, 0.925 * width), (0.42 * length, 0.8 * width),
                (belt + 0.04 * height, 0.93 * height), GLASS).moved(x=cabin_x),
        frustum((0.595 * length, 0.8 * width), (0.44 * length, 0.68 * width),
                (belt + 0.03 * height, 0.94 * height), GLASS).moved(x=cabin_x),
    ]  # fmt: skip
    lamp = (0.03 * length, 0.18 * width, 0.1 * height)
    for y in (-0.34 * width, 0.34 * width):
        parts.append(box((0.482 * length, y, 0.46 * height), lamp, WHITE))
        parts.append(box((-0.482 * length, y, 0.46 * height), lamp, TAIL_LIGHT))
    return join(*parts)


def _truck(length: float, width: float, height: float, paint: Colour) -> Solid:
    """A cab with a bonnet before a slatted load bed."""
    floor = 0.34 * height
    tarp: Colour = (112, 112, 88)
    return join(
        box((0, 0, 0.85 * floor), (0.96 * length, 0.5 * width, 0.3 * floor), (62, 58, 54)),
        # Low enough for a lidar on the Husky to see that there is no way under the bed.
        box((0.0, 0.0, 0.2 * height), (0.94 * length, 0.84 * width, 0.28 * height), (52, 50, 46)),
        box((0.41 * length, 0, 0.47 * height), (0.18 * length, 0.86 * width, 0.3 * height), paint),
        frustum((0.2 * length, width), (0.16 * length, 0.9 * width), (floor, 0.86 * height), paint)
        .moved(x=0.22 * length),
        box((0.27 * length, 0, 0.7 * height), (0.115 * length, 0.8 * width, 0.18 * height), GLASS),
        box((0.21 * length, 0, 0.7 * height), (0.1 * length, 1.0 * width, 0.16 * height), GLASS),
        box((-0.19 * length, 0, 0.5 * height), (0.6 * length, width, 0.32 * height), (118, 98, 72)),
        extrusion(
            [(-0.48 * width, 0.6 * height), (0.48 * width, 0.6 * height), (0.48 * width, 0.84 * height),
             (0.3 * width, height), (-0.3 * width, height), (-0.48 * width, 0.84 * height)],
            0.29 * length, tarp,
        ).moved(x=-0.19 * length),
    )  # fmt: skip
