"""What a learned policy sees: robot-centric layers and a state vector, from a `Percept`.

Body frame as `planner.frames.Percept.elevation_patch`: 40 × 40 cells of 0.5 m, axis 0 along +y (left),
axis 1 along +x (forward), the robot in the middle.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import distance_transform_edt

from planner.elevation_map import PATCH_CELLS, PATCH_RESOLUTION
from planner.frames import GridMap, Percept
from scenes.catalogue import CATALOGUE
from scenes.pose import Pose
from scenes.robot import HUSKY

LAYERS = ("elevation", "unknown", "obstacle", "cover", "exposure", "belief")
STATE_SIZE, TERP_STATE_SIZE, GRADIENTS = 27, 25, 20

ELEVATION_LIMIT = 5.0  # metres; what is higher or lower looks like this
OBSTACLE_REACH = 2.0
GOAL_SCALE, GOAL_LIMIT = 12.0, 5.0
COVER_SCALE = 10.0
TURN_SCALE = 0.375  # radians: a decision's turn at full rate
GRADIENT_SCALE = math.tan(HUSKY.max_slope)
LIMIT = 3.0  # of what may grow beyond 1

LOW = np.zeros((len(LAYERS), PATCH_CELLS, PATCH_CELLS), np.float32)
LOW[0] = -ELEVATION_LIMIT
HIGH = np.ones_like(LOW)
HIGH[0] = ELEVATION_LIMIT
STATE_LOW = np.array([0, -1, 0, 0, *[-LIMIT] * (GRADIENTS + 1), 0, 0], np.float32)
STATE_HIGH = np.array([GOAL_LIMIT, 1, LIMIT, LIMIT, *[LIMIT] * (GRADIENTS + 1), 1, 1], np.float32)

_ALONG = (np.arange(PATCH_CELLS) - 0.5 * (PATCH_CELLS - 1)) * PATCH_RESOLUTION
_FORWARD, _LEFT = np.meshgrid(_ALONG, _ALONG)


Observation = dict[str, np.ndarray]
"""layers, (6, 40, 40) float32, and state, (27,) float32; see `observe`."""


def observe(
    percept: Percept,
    *,
    heading_change: float = 0.0,
    visible: float = 0.0,
    exposure: np.ndarray | None = None,
    belief: np.ndarray | None = None,
) -> Observation:
    """The observation of a percept.

    heading_change : radians turned since the last decision
    visible : share of the robot that the known observers see now
    exposure, belief : (40, 40) shares from 0 to 1 in the patch's cells; zeros where not given

    | layer | meaning | range |
    |---|---|---|
    | 0 elevation | ground over the robot's, metres; unknown cells filled from the nearest known | -5..5 |
    | 1 unknown | 1 where it was filled | 0, 1 |
    | 2 obstacle | nearness of what blocks, 1 on it, 0 from 2 m on; moving obstacles too | 0..1 |
    | 3 cover | confidence in cover that can hide the robot, on its outline | 0..1 |
    | 4 exposure | visible share expected of a robot there, from known observers | 0..1 |
    | 5 belief | chance that an observer not yet seen sees a robot there | 0..1 |

    | state | meaning | unit | range |
    |---|---|---|---|
    | 0 | distance to the goal | 12 m | 0..5 |
    | 1 | bearing of the goal, left positive | π | -1..1 |
    | 2, 3 | size of pitch and of roll | 30° | 0..3 |
    | 4 | heading change since the last decision | 0.375 rad | -3..3 |
    | 5-24 | slope of the ground ahead, for each half metre up to 10 m | tan 22° | -3..3 |
    | 25 | to the surface of the nearest known cover that can hide the robot | 10 m | 0..1 |
    | 26 | visible share of the robot now | 1 | 0..1 |

    The first 25 are TERP's (Weerakoon et al. 2022).
    """
    layers = np.zeros(LOW.shape, np.float32)
    np.clip(percept.elevation_patch, -ELEVATION_LIMIT, ELEVATION_LIMIT, out=layers[0])
    layers[1] = percept.unknown_patch
    layers[2] = _obstacle_nearness(percept)
    middles, radii, confidences = _concealing(percept)
    layers[3] = _cover_presence(middles, radii, confidences)
    for layer, given in ((4, exposure), (5, belief)):
        if given is not None:
            layers[layer] = np.clip(np.nan_to_num(given), 0.0, 1.0)
    surface = np.hypot(*middles.T) - radii
    cover_distance = float(surface.min(initial=COVER_SCALE))
    state = np.concatenate(
        [_terp_state(percept, heading_change), [np.clip(cover_distance / COVER_SCALE, 0.0, 1.0), visible]]
    )
    return {"layers": layers, "state": np.clip(state, STATE_LOW, STATE_HIGH).astype(np.float32)}


def in_body_frame(pose: Pose, points: np.ndarray) -> np.ndarray:
    """World points (n, 2) as forward and left of the base, (n, 2) metres."""
    offset = np.reshape(points, (-1, 2)) - (pose.x, pose.y)
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return offset @ np.array([[cos, -sin], [sin, cos]])


def patch_points(pose: Pose) -> np.ndarray:
    """(1600, 2) world x and y of the patch's cell centres, row by row."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return np.column_stack(
        [
            (pose.x + cos * _FORWARD - sin * _LEFT).ravel(),
            (pose.y + sin * _FORWARD + cos * _LEFT).ravel(),
        ]
    )


def on_patch(grid: GridMap, values: np.ndarray, pose: Pose) -> np.ndarray:
    """(40, 40) of a layer (rows, cols) over the map, about a robot at `pose`; beyond the map its border's."""
    rows, cols = grid.shape
    row, col = grid.cells(*patch_points(pose).T)
    return values[row.clip(0, rows - 1), col.clip(0, cols - 1)].reshape(PATCH_CELLS, PATCH_CELLS)


def _terp_state(percept: Percept, heading_change: float) -> np.ndarray:
    ahead, left = in_body_frame(percept.pose, np.array([percept.goal]))[0]
    return np.array(
        [
            percept.goal_distance / GOAL_SCALE,
            math.atan2(left, ahead) / math.pi,
            abs(percept.pose.pitch) / HUSKY.max_tilt,
            abs(percept.pose.roll) / HUSKY.max_tilt,
            heading_change / TURN_SCALE,
            *(slopes_ahead(percept) / GRADIENT_SCALE),
        ]
    )


def slopes_ahead(percept: Percept) -> np.ndarray:
    """(20,) rise over run of the ground ahead, for each half metre up to 10 m."""
    middle = PATCH_CELLS // 2
    # The lane as wide as the robot; the first slope is from half a cell behind the middle to half before it.
    lane = percept.elevation_patch[middle - 1 : middle + 1, middle - 1 :].mean(axis=0)
    return np.diff(lane.astype(float)) / PATCH_RESOLUTION


def _obstacle_nearness(percept: Percept) -> np.ndarray:
    blocked = np.zeros((PATCH_CELLS, PATCH_CELLS), bool)
    row, col = _cells(in_body_frame(percept.pose, _blocked_points(percept.grid)))
    inside = (row >= 0) & (row < PATCH_CELLS) & (col >= 0) & (col < PATCH_CELLS)
    blocked[row[inside], col[inside]] = True
    if percept.moving:
        places = in_body_frame(percept.pose, np.array([(thing.x, thing.y) for thing in percept.moving]))
        for (ahead, left), thing in zip(places, percept.moving, strict=True):
            blocked |= np.hypot(_FORWARD - ahead, _LEFT - left) <= thing.radius + 0.5 * PATCH_RESOLUTION
    if not blocked.any():
        return np.zeros(blocked.shape, np.float32)
    distance = np.asarray(distance_transform_edt(~blocked, sampling=PATCH_RESOLUTION))
    return np.maximum(1.0 - distance / OBSTACLE_REACH, 0.0)


def _blocked_points(grid: GridMap) -> np.ndarray:
    """(n, 2) world centres of the map's obstacle cells."""
    row, col = np.divmod(np.flatnonzero(grid.obstacle), grid.shape[1])
    return np.column_stack([grid.x_min + col * grid.resolution, grid.y_min + row * grid.resolution])


def _cells(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns in the patch of points (n, 2), forward and left; may lie outside."""
    half = 0.5 * PATCH_CELLS * PATCH_RESOLUTION
    col, row = np.floor((points.T + half) / PATCH_RESOLUTION).astype(int)
    return row, col


def _concealing(percept: Percept) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the known cover that can hide the robot: middles (n, 2) forward and left, radii (n,) and
    confidences (n,)."""
    known = [
        thing
        for thing in percept.cover
        if CATALOGUE[thing.kind].conceals(thing.width, thing.height, HUSKY.width, HUSKY.height)
    ]
    middles = in_body_frame(percept.pose, np.array([(thing.x, thing.y) for thing in known]))
    radii = np.array([0.5 * thing.width for thing in known])
    return middles, radii, np.array([thing.confidence for thing in known])


def _cover_presence(middles: np.ndarray, radii: np.ndarray, confidences: np.ndarray) -> np.ndarray:
    presence = np.zeros((PATCH_CELLS, PATCH_CELLS), np.float32)
    half = 0.5 * PATCH_CELLS * PATCH_RESOLUTION
    reach = np.maximum(radii, 0.5 * PATCH_RESOLUTION)
    shown = np.flatnonzero((np.abs(middles) < half + reach[:, None]).all(axis=1))
    shown = shown[np.argsort(confidences[shown], kind="stable")]  # the surest is painted last
    around = middles[shown, None] + reach[shown, None, None] * np.array([[-1.0], [1.0]]) + half
    edges = np.clip(around, 0.0, 2.0 * half) / PATCH_RESOLUTION
    first, beyond = np.floor(edges[:, 0]).astype(int), np.maximum(np.ceil(edges[:, 1]).astype(int), 1)
    for index, (left_col, low_row), (right_col, high_row) in zip(
        shown.tolist(), first.tolist(), beyond.tolist(), strict=True
    ):
        window = slice(low_row, high_row), slice(left_col, right_col)
        ahead, left = middles[index]
        inside = np.hypot(_FORWARD[window] - ahead, _LEFT[window] - left) <= reach[index]
        presence[window][inside] = confidences[index]
    row, col = _cells(middles[shown])
    inside = (row >= 0) & (row < PATCH_CELLS) & (col >= 0) & (col < PATCH_CELLS)
    np.maximum.at(presence, (row[inside], col[inside]), confidences[shown][inside].astype(np.float32))
    return presence
