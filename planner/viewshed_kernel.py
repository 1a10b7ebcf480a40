"""Exact viewsheds on a height grid, compiled.

Testing every crossing of every sight line (Franklin's R3) takes the cube of the grid's side. Nearly all cells
can be decided without: the grid around an observer falls into eight octants, and an octant's lines of samples
are swept outward, one ring after the other. In an octant, sight lines differ by their tangent, 0 (along the
axis) to 1 (the diagonal); equally spaced rays cut it into wedges. On every ray and for every wedge between
two of them the sweep keeps the steepest slope from the eye up to the ground met so far. For a wedge it has

* the most that any sight line in it can have met. Ground is linear along a ring and, as a slope seen from the
  eye, monotone along a line of samples between two rings (mediant inequality), so the extremes in a wedge
  lie on the rays that bound it and at the samples between them;
* the least that every sight line in it must have met, from the rings alone.

A cell's slope above the most is seen, below the least hidden, whatever the exact crossings are. Only the few
cells in between are tested crossing by crossing, and of their crossings only blocks of rings whose most
reaches the cell's slope. Every decision allows for the rounding of its terms, so the result is the
definition's everywhere.
"""

from __future__ import annotations

import numpy as np
from numba import njit

TOLERANCE = 1e-9
BLOCK = 4  # rings that share one entry in a wedge's history
ROUNDING = 1e-14  # of the greatest height difference: above what the few roundings of a slope can add up to
FEWEST_WEDGES = 8

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def sweep(heights, turned, octants, eyes, slacks, target, seen):
    """Mark what is seen in some octants.

    heights : (rows, cols) ; turned : (cols, rows) its transpose, both contiguous float64
    octants : (k, 6) int64, of each its observer, the observer's row and column, the steps (±1) in which rows
        and columns go outward, and 1 where its rings are columns, 0 where they are rows
    eyes : (n,) height of each observer's eye ; slacks : (n,) what rounding may add to a slope
    target : height of what is looked for above its ground
    seen : (n, rows, cols) bool, written to
    """
    for k in range(octants.shape[0]):
        observer, row, column, down, right, turn = octants[k]
        # Views in the octant's own frame: [ring, place on it]; the observer is [0, 0].
        if turn:
            ground = turned[column::right, row::down]
            out = seen[observer].T[column::right, row::down]
        else:
            ground = heights[row::down, column::right]
            out = seen[observer][row::down, column::right]
        _sweep_octant(ground, eyes[observer], slacks[observer], target, out)


@_compiled
def _sweep_octant(ground, eye, slack, target, out):
    """Mark what is seen in the octant of an observer at ground[0, 0] up to the diagonal."""
    out[0, 0] = True
    depth, width = ground.shape[0] - 1, ground.shape[1] - 1
    wedges = max(depth, FEWEST_WEDGES)  # at least as many as a ring has samples: at most one lies in each
    rays = wedges + 1
    base = eye + TOLERANCE  # ground may stand above the sight line by the tolerance: as if it were lower
    ring, inner = np.zeros(min(depth, width) + 2), np.zeros(min(depth, width) + 2)
    near, far, before = np.empty(rays), np.empty(rays), np.empty(rays)
    place, high, low = np.empty(rays), np.empty(rays), np.empty(rays)
    most, least, latest = np.full(wedges, -np.inf), np.full(wedges, -np.inf), np.full(wedges, -np.inf)
    block, history = np.full(wedges, -np.inf), np.empty((wedges, depth // BLOCK + 1))
    for m in range(1, depth + 1):
        last = min(m, width)
        for j in range(last + 1):
            ring[j] = ground[m, j] - base
        ring[last + 1] = ring[last]
        for j in range(last + 1):
            wedge = np.uint64(min(int(j * (wedges / m)), wedges - 1))
            slope = (ring[np.uint64(j)] + (target + 2.0 * TOLERANCE)) / m
            if slope + slack >= least[wedge] and (
                slope - slack >= most[wedge]
                or _clear(ground, eye, target, m, j, slope - slack, block[wedge], history[wedge])
            ):
                out[m, j] = True
        inside = min(wedges, (width * wedges) // m) + 1
        _gather(m / wedges, inside, ring, inner, near, far, before)
        _meet(m, wedges, inside, near, far, before, place, high, low)
        if inside < rays:  # the first ray outside the grid: the last sample bounds its wedge instead
            place[inside], high[inside], low[inside] = width, -np.inf, np.inf
        _bound(min(inside, wedges), m, far, place, high, low, most, least, latest, block)
        if m % BLOCK == 0:
            history[:, m // BLOCK - 1] = block
            block[:] = latest  # what lies between this ring and the next is bounded by samples of both
        ring, inner = inner, ring


@_compiled
def _gather(spacing, count, ring, inner, near, far, before):
    """The samples around the places where `count` rays cross a ring, and the nearer one a ring before.

    Apart from the arithmetic, for compilers vectorise loops only without scattered reads."""
    for i in range(count):
        j = np.uint64(np.int64(i * spacing))
        near[i] = ring[j]
        far[i] = ring[j + np.uint64(1)]
        before[i] = inner[j]


@_compiled
def _meet(m, wedges, count, near, far, before, place, high, low):
    """Slopes that each ray meets: `low` on ring m, `high` the greater of that and on the way there."""
    reach = 1.0 if m > 1 else 0.0  # nothing is crossed before the first ring
    for i in range(count):
        x = i * (m / wedges)
        place[i] = np.floor(x)
        share = x - place[i]
        on_ring = (near[i] + share * (far[i] - near[i])) / m
        # How far before the ring it crossed a line of samples that runs outward, in rings.
        back = share * wedges / i if i > 0 else 0.0
        on_the_way = (near[i] + back * (before[i] - near[i])) / (m - back)
        low[i] = on_ring
        high[i] = on_the_way if back < reach and on_the_way > on_ring else on_ring


@_compiled
def _bound(count, m, far, place, high, low, most, least, latest, block):
    """Widen the bounds of `count` wedges by what ring m and the way there add."""
    for i in range(count):
        sample = far[i] / m
        holds_sample = place[i + 1] > place[i]
        top = high[i] if high[i] > high[i + 1] else high[i + 1]
        bottom = low[i] if low[i] < low[i + 1] else low[i + 1]
        top = sample if holds_sample and sample > top else top
        bottom = sample if holds_sample and sample < bottom else bottom
        latest[i] = top
        block[i] = top if top > block[i] else block[i]
        most[i] = top if top > most[i] else most[i]
        least[i] = bottom if bottom > least[i] else least[i]


@_compiled
def _clear(ground, eye, target, m, j, slope, block, history):
    """Whether nothing hides cell [m, j], looking only where its wedge may have met `slope` or more."""
    rise = ground[m, j] + target - eye
    full = (m - 1) // BLOCK
    if block > slope and _hides(ground, eye, rise, m, j, full * BLOCK, m - 1):
        return False
    for k in range(full - 1, -1, -1):
        if history[k] > slope and _hides(ground, eye, rise, m, j, k * BLOCK, (k + 1) * BLOCK):
            return False
    return True


@_compiled
def _hides(ground, eye, rise, m, j, after, until):
    """Whether ground hides cell [m, j] where its sight line crosses lines beyond ring `after` up to `until`.

    Places are computed in an order that makes them exact on samples, where no neighbour counts."""
    for k in range(after + 1, until + 1):
        place = (j * k) / m
        near = int(place)
        share = place - near
        height = ground[k, near]
        if share > 0.0:
            height += share * (ground[k, near + 1] - height)
        if height > eye + rise * (k / m) + TOLERANCE:
            return True
    for k in range((after * j) // m + 1, min((until * j) // m, j - 1) + 1):
        place = (m * k) / j
        near = int(place)
        share = place - near
        height = ground[near, k]
        if share > 0.0:
            height += share * (ground[near + 1, k] - height)
        if height > eye + rise * (k / j) + TOLERANCE:
            return True
    return False
