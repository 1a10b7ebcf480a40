"""Read a GeoTIFF elevation model onto a scene's grid."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from pyproj import CRS
from pyproj.exceptions import CRSError
from rasterio import Affine
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning
from rasterio.windows import Window

from scenes.georeference import Extent, Georeference, choose_region, georeference
from scenes.ground import INTERPOLATED, MEASURED, MISSING, SurveyGround, fill_gaps, surface_by_slope
from scenes.scenario import ScenarioError

MAX_PIXELS = 100_000_000
MAX_BLOCK_BYTES = 2**28
STRIP_PIXELS = 4_000_000
ELEVATION_RANGE = (-12000.0, 9000.0)
USUAL_SENTINELS = (-9999.0, -32768.0, -32767.0)
VERTICAL_UNITS = {
    "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048,
    "us survey foot": 1200.0 / 3937.0, "us-ft": 1200.0 / 3937.0, "ftus": 1200.0 / 3937.0,
    "cm": 0.01, "centimetre": 0.01, "mm": 0.001, "millimetre": 0.001, "dm": 0.1, "decimetre": 0.1,
}  # fmt: skip
# Nothing but the file itself is opened: no side files, no directory listing, no network.
SEALED: dict[str, Any] = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "GDAL_HTTP_MAX_RETRY": "0",
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": "none",
    "GDAL_CACHEMAX": 2**27,
    "GDAL_NUM_THREADS": "1",
}
GAP_PIXELS = 3.0
MIN_GAP = 3.0


def read_geotiff(
    path: Path, crop: tuple[float, float, float] | None, resolution: float | None
) -> SurveyGround:
    """Resample band 1 bilinearly (after averaging whole pixels where the scene is coarser).

    A cell that a pixel's centre lies in is measured; between coarser pixels, and over gaps of up to three
    pixels (3 m at least) to the nearest value, it is interpolated; elsewhere it is missing. Missing are
    nodata, masked and non-finite pixels, the usual undeclared sentinels (-9999, -32768) and what lies
    outside -12,000 to 9,000 m. Heights are in the band's unit, else the system's vertical unit, else a
    projected system's own unit, else metres.
    Raises ScenarioError for what is no elevation model, is damaged, or is too large.
    """
    try:
        with rasterio.Env(**SEALED), warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(path.resolve(), driver="GTiff") as raster:
                return _resample(raster, crop, resolution)
    except ScenarioError:
        raise
    except Exception as error:  # GDAL's errors share no public base
        reason = " ".join(str(error.__cause__ or error).split())[:200]
        raise ScenarioError(f"is damaged or no GeoTIFF: {reason}") from error


def _resample(raster, crop, resolution) -> SurveyGround:
    _check_elevation_model(raster)
    to_native = raster.transform
    corners = _apply(to_native, np.array([0, 1, 0, 1]) * raster.width, np.array([0, 0, 1, 1]) * raster.height)
    corners = np.column_stack(corners)
    if not np.isfinite(corners).all() or abs(to_native.determinant) < 1e-30:
        raise ScenarioError(f"its pixel transform {tuple(to_native)[:6]} is not usable")
    (west, south), (east, north) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    native = Extent(west, east, south, north)
    reference = georeference(_crs(raster), native, heights_follow_unit=True)
    region = choose_region(crop, reference, native)
    pixel = _pixel_size(reference, to_native, region.easting, region.northing)
    grid = region.grid(max(pixel), resolution)
    x, y = reference.to_native(*grid.to_survey(*grid.xy()))
    cols, rows = _apply(~to_native, x, y)
    unit = VERTICAL_UNITS.get((raster.units[0] or "").strip().lower(), reference.vertical_unit)
    heights, between = _sample(raster, rows, cols, grid.resolution, pixel, unit)
    heights, quality = fill_gaps(heights, grid.resolution, 0.0)  # what is left is too wide to bridge
    quality[(quality == MEASURED) & between] = INTERPOLATED
    surface = surface_by_slope(heights, quality, grid.resolution)
    return SurveyGround(reference, grid, heights, quality, surface)


def _apply(transform: Affine, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b, c, d, e, f = tuple(transform)[:6]
    return a * x + b * y + c, d * x + e * y + f


def _check_elevation_model(raster) -> None:
    kind = np.dtype(raster.dtypes[0]) if raster.dtypes[0] in np.sctypeDict else None
    if kind is None or kind.kind not in "iuf":
        raise ScenarioError(f"band 1 holds {raster.dtypes[0]} numbers; an elevation model holds real ones")
    if raster.colorinterp[0] not in (ColorInterp.gray, ColorInterp.undefined):
        raise ScenarioError(
            f"band 1 of {raster.count} is {raster.colorinterp[0].name}: this is a picture; "
            "an elevation model has its heights in band 1"
        )
    rows, cols = raster.block_shapes[0]
    if rows * cols * kind.itemsize > MAX_BLOCK_BYTES:
        raise ScenarioError(f"its blocks are {rows} × {cols} pixels, too large to decode: store it in tiles")
    if raster.transform == Affine.identity():
        raise ScenarioError("has no georeference, so the size of its pixels is unknown")
    if not (math.isfinite(raster.scales[0]) and raster.scales[0] != 0.0 and math.isfinite(raster.offsets[0])):
        raise ScenarioError(f"band 1 has scale {raster.scales[0]} and offset {raster.offsets[0]}")


def _crs(raster) -> CRS | None:
    try:
        return CRS.from_wkt(raster.crs.to_wkt()) if raster.crs else None
    except CRSError as error:
        raise ScenarioError(f"its coordinate system cannot be read: {error}") from None


def _pixel_size(
    reference: Georeference, to_native: Affine, easting: float, northing: float
) -> tuple[float, float]:
    """Metres from row to row and from column to column at a place in survey coordinates."""
    x, y = reference.to_native(easting, northing)
    east, north = reference.to_survey(
        np.array([x, x + to_native.b, x + to_native.a]), np.array([y, y + to_native.e, y + to_native.d])
    )
    steps = np.hypot(east[1:] - east[0], north[1:] - north[0]) * reference.unit
    if not (np.isfinite(steps).all() and (steps > 1e-6).all()):
        raise ScenarioError("its pixels have no usable size in metres")
    return float(steps[0]), float(steps[1])


def _sample(
    raster, rows: np.ndarray, cols: np.ndarray, resolution: float, pixel: tuple[float, float], unit: float
) -> tuple[np.ndarray, np.ndarray]:
    """Bilinear heights in metres at fractional pixel places (corner-based), NaN where a pixel that counts is
    missing in a gap too wide to bridge; and whether a place is far from all measured pixels' centres."""
    step_r, step_c = (max(1, int(resolution / size + 1e-6)) for size in pixel)
    first_r, last_r = _span(rows, step_r, raster.height)
    first_c, last_c = _span(cols, step_c, raster.width)
    if last_r <= first_r or last_c <= first_c:
        raise ScenarioError("has no pixels in the chosen part")
    if (last_r - first_r) * (last_c - first_c) > MAX_PIXELS:
        raise ScenarioError(
            f"the chosen part is {last_r - first_r} × {last_c - first_c} pixels, over {MAX_PIXELS:,}: "
            "crop to less"
        )
    values = unit * _averaged(raster, first_r, last_r, first_c, last_c, step_r, step_c)
    values[~((values >= ELEVATION_RANGE[0]) & (values <= ELEVATION_RANGE[1]))] = np.nan
    if np.isnan(values).all():
        raise ScenarioError("has no elevation in the chosen part: every pixel there is nodata")
    spacing = max(step_r * pixel[0], step_c * pixel[1])
    filled, quality = fill_gaps(values, spacing, max(MIN_GAP, GAP_PIXELS * max(pixel)))
    r, c = (rows - first_r) / step_r - 0.5, (cols - first_c) / step_c - 0.5
    away = np.hypot((r - np.rint(r)) * step_r * pixel[0], (c - np.rint(c)) * step_c * pixel[1])
    bridged = _bilinear((quality == INTERPOLATED).astype(float), r, c) > 1e-9
    heights = _bilinear(np.where(quality == MISSING, np.nan, filled), r, c)
    return heights, bridged | (away > 0.75 * resolution)


def _span(places: np.ndarray, step: int, size: int) -> tuple[int, int]:
    """First and one past the last pixel to read, whole steps from the first."""
    low, high = np.nanmin(places), np.nanmax(places)
    if not (math.isfinite(low) and math.isfinite(high)):
        raise ScenarioError("the chosen part reaches beyond its coordinate system")
    first = int(np.clip(math.floor(low) - 2 * step, 0, size))
    return first, int(np.clip(math.ceil(high) + 2 * step, 0, size))


def _averaged(
    raster, first_r: int, last_r: int, first_c: int, last_c: int, step_r: int, step_c: int
) -> np.ndarray:
    """Means of step_r × step_c pixels, read in strips so that memory stays bounded."""
    width = last_c - first_c
    strip = max(1, STRIP_PIXELS // (width * step_r)) * step_r
    parts = []
    for row in range(first_r, last_r, strip):
        window = Window(first_c, row, width, min(strip, last_r - row))  # pyright: ignore[reportCallIssue]
        band = raster.read(1, window=window, masked=True)
        with np.errstate(invalid="ignore", over="ignore"):  # whatever bits a damaged file holds
            values = np.ma.filled(band.astype(np.float64), np.nan)
            values[np.isin(values, USUAL_SENTINELS)] = np.nan
            values = values * raster.scales[0] + raster.offsets[0]
        values[~(np.abs(values) < 1e9)] = np.nan
        parts.append(_block_means(values, step_r, step_c))
    return np.concatenate(parts)


def _block_means(values: np.ndarray, step_r: int, step_c: int) -> np.ndarray:
    """Mean of the known pixels of each block, NaN where fewer than half of them are known."""
    if step_r == step_c == 1:
        return values
    rows, cols = -(-values.shape[0] // step_r), -(-values.shape[1] // step_c)
    padded = np.full((rows * step_r, cols * step_c), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(rows, step_r, cols, step_c)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(2 * count >= step_r * step_c, total / np.maximum(count, 1), np.nan)


def _bilinear(values: np.ndarray, r: np.ndarray, c: np.ndarray) -> np.ndarray:
    rows, cols = values.shape
    inside = (r >= -0.5) & (r <= rows - 0.5) & (c >= -0.5) & (c <= cols - 0.5)
    r, c = (np.clip(np.where(inside, v, 0.0), 0.0, n - 1.0) for v, n in ((r, rows), (c, cols)))
    row, col = np.minimum(r.astype(int), max(rows - 2, 0)), np.minimum(c.astype(int), max(cols - 2, 0))
    fr, fc = r - row, c - col
    total = np.zeros(r.shape)
    for dr, dc, weight in (
        (0, 0, (1 - fr) * (1 - fc)), (0, 1, (1 - fr) * fc), (1, 0, fr * (1 - fc)), (1, 1, fr * fc),
    ):  # fmt: skip
        corner = values[np.minimum(row + dr, rows - 1), np.minimum(col + dc, cols - 1)]
        total += np.where(weight > 1e-9, weight * corner, 0.0)
    return np.where(inside, total, np.nan)
