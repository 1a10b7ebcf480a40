"""Robot-centric patches as pictures: small images for the panel, and laid over the ground about the robot."""

from __future__ import annotations

import base64
import io

import numpy as np
from PIL import Image
from scipy import ndimage

from app.training_sight import Seen
from app.view import palette
from app.view.glb import Surface
from planner.observation import patch_points
from scenes.pose import Pose
from scenes.terrain import Heightmap

LEAST_SPAN = 0.6  # metres of height between the darkest and the lightest
LIFT = 0.09
CLEAR = 30  # alpha, of 255, where there is nothing to see


def patch_colours(seen: Seen, patch: np.ndarray, span: tuple[float, float] | None = None) -> np.ndarray:
    """(40, 40, 4) uint8 RGBA of a patch, clear where it is NaN.

    span : metres that are darkest and lightest, for elevation"""
    known = np.isfinite(patch) | np.isposinf(patch)
    if seen is Seen.COST:
        colours = palette.cost_colours(patch)
        colours[known, 3] = np.maximum(colours[known, 3], 150)
        return colours
    values = np.nan_to_num(patch, nan=0.0)
    colours = np.full((*patch.shape, 4), 255, np.uint8)
    match seen:
        case Seen.ELEVATION:
            low, high = span or height_span(patch)
            table = palette.elevation_colours((values.ravel() - low) / (high - low))
        case Seen.EXPOSURE:
            table = palette.exposure_colours(values.ravel())
        case Seen.COVER:
            table = palette.cover_colours(values.ravel())
            colours[..., 3] = np.where(values > 0.0, 255, CLEAR)
        case _:
            least, most = float(values.min()), float(values.max())
            share = (values - least) / max(most - least, 1e-9)
            table = palette.attention_colours(share.ravel())
            colours[..., 3] = np.round(CLEAR + (255 - CLEAR) * share)
    colours[..., :3] = table.reshape(*patch.shape, 3)
    colours[~known, 3] = 0
    return colours


def height_span(*patches: np.ndarray) -> tuple[float, float]:
    """The lowest and highest metres in some patches, at least `LEAST_SPAN` apart."""
    heights = np.concatenate([patch[np.isfinite(patch)] for patch in patches] or [np.zeros(1)])
    low, high = (float(heights.min()), float(heights.max())) if len(heights) else (0.0, 0.0)
    more = 0.5 * max(0.0, LEAST_SPAN - (high - low))
    return low - more, high + more


def data_url(colours: np.ndarray) -> str:
    """A patch's colours as an image's address: forward is up, left is left, unknown is grey hatching."""
    image = np.transpose(colours, (1, 0, 2))[::-1, ::-1]
    stripe = (np.add.outer(np.arange(len(image)), np.arange(len(image))) // 2) % 3 == 0
    hatching = np.where(stripe[..., None], palette.UNKNOWN_STRIPE, palette.UNKNOWN)
    behind = np.where(image[..., 3:] > 0, palette.PANEL, hatching)
    share = image[..., 3:] / 255.0
    opaque = np.round(share * image[..., :3] + (1.0 - share) * behind).astype(np.uint8)
    with io.BytesIO() as buffer:
        Image.fromarray(opaque).save(buffer, "PNG")
        return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def patch_surface(colours: np.ndarray, pose: Pose, ground: Heightmap, opacity: float) -> Surface | None:
    """A patch's colours (40, 40, 4) over the ground about `pose`; None where nothing of it is on the map."""
    size = len(colours)
    points = patch_points(pose)
    west, east, south, north = ground.bounds
    x, y = np.clip(points[:, 0], west, east), np.clip(points[:, 1], south, north)
    tops = ndimage.maximum_filter(ground.height_at(x, y).reshape(size, size), 3)
    vertices = np.column_stack([points, tops.ravel() + LIFT])
    rgba = colours.reshape(-1, 4).copy()
    outside = np.any((points < (west, south)) | (points > (east, north)), axis=1)
    rgba[:, 3] = np.where(outside, 0, np.round(rgba[:, 3] * opacity))
    index = np.arange(size * size).reshape(size, size)
    near, ahead = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    left, far = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.column_stack([near, ahead, left]), np.column_stack([ahead, far, left])])
    faces = faces[(rgba[faces, 3] > 0).any(axis=1) & ~outside[faces].any(axis=1)]
    if len(faces) == 0:
        return None
    used, faces = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3), rgba[used], unlit=True, blended=True)
