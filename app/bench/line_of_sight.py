"""The bench of viewsheds: the definition line by line, and what GDAL and xarray-spatial take beside it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import rasterio
from numba import njit

from app.bench.measure import Result, faster, interleaved
from planner.viewshed import viewshed as our_viewshed

SIDE = 512
ROW, COLUMN, EYE_HEIGHT = 200, 300, 1.7
REPEATS = 7
TOLERANCE = 1e-9

Viewshed = Callable[[np.ndarray], np.ndarray]


def viewshed() -> Result:
    """What one observer sees of 512 × 512 samples of bare fractal ground."""
    grounds = _grounds()
    ground = grounds["fractal"]
    ours_ms, peer_ms = interleaved(lambda: _ours(ground), lambda: _naive(ground), REPEATS, ours_per_turn=5)
    differing = {name: int((_ours(each) != _naive(each)).sum()) for name, each in grounds.items()}
    same = [name for name, cells in differing.items() if not cells]
    compared = f"all {SIDE}² cells the same on {len(same)} of {len(grounds)} grounds ({', '.join(same)})"
    return faster(
        "viewshed",
        ours_ms,
        peer_ms,
        "the definition line by line in numba, one thread",
        "; ".join([compared, _beside("GDAL in process", _gdal(), ground), _beside_xarray_spatial(ground)]),
    )


@cache
def _grounds() -> dict[str, np.ndarray]:
    """Grounds (512, 512) in units of a cell, the fractal one with a standard deviation of 8."""
    rng = np.random.default_rng(3)
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE))
    frequency[0, 0] = 1.0
    fractal = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(SIDE, SIDE))) / frequency**1.9, (SIDE, SIDE))
    fractal *= 8.0 / fractal.std()
    return {
        "fractal": fractal,
        "stepped": np.round(fractal),
        "noise": rng.normal(size=(SIDE, SIDE)),
        "posts": np.where(rng.random((SIDE, SIDE)) < 0.003, 10.0, 0.0),
        "flat": np.zeros((SIDE, SIDE)),
    }


def _ours(heights: np.ndarray) -> np.ndarray:
    return our_viewshed(heights, ROW, COLUMN, EYE_HEIGHT)


def _naive(heights: np.ndarray) -> np.ndarray:
    return _line_by_line(heights, ROW, COLUMN, heights[ROW, COLUMN] + EYE_HEIGHT)


@njit(cache=True)
def _line_by_line(heights, row, column, eye):
    """The definition cell by cell, each sight line walked until something hides."""
    seen = np.ones(heights.shape, np.bool_)
    for i in range(heights.shape[0]):
        for j in range(heights.shape[1]):
            down, right, rise = i - row, j - column, heights[i, j] - eye
            for k in range(1, abs(down)):
                place = column + right * k / abs(down)
                near = int(np.floor(place))
                share = place - near
                line = heights[row + k * np.sign(down)]
                ground = line[near] if share == 0.0 else (1.0 - share) * line[near] + share * line[near + 1]
                if ground > eye + rise * (k / abs(down)) + TOLERANCE:
                    seen[i, j] = False
                    break
            for k in range(1, abs(right) if seen[i, j] else 0):
                place = row + down * k / abs(right)
                near = int(np.floor(place))
                share = place - near
                line = heights[:, column + k * np.sign(right)]
                ground = line[near] if share == 0.0 else (1.0 - share) * line[near] + share * line[near + 1]
                if ground > eye + rise * (k / abs(right)) + TOLERANCE:
                    seen[i, j] = False
                    break
    return seen


def _beside(name: str, theirs: Viewshed | None, ground: np.ndarray) -> str:
    """A second peer's time, how it compares, and how much of what either sees both see."""
    if theirs is None:
        return f"{name}: not found"
    ours_ms, theirs_ms = interleaved(lambda: _ours(ground), lambda: theirs(ground), REPEATS)
    seen, marked = _ours(ground), theirs(ground)
    overlap = (seen & marked).sum() / (seen | marked).sum()
    times = f"{theirs_ms:.1f} ms, {theirs_ms / ours_ms:.2g} × ours"
    return f"{name} {times}, intersection over union of the visible cells {overlap:.3f}"


def _beside_xarray_spatial(ground: np.ndarray) -> str:
    try:
        from xarray import DataArray  # type: ignore[import-not-found]
        from xrspatial import viewshed as theirs  # type: ignore[import-not-found]
    except ImportError:
        return "xarray-spatial: not installed (extra `bench`)"
    axes = {"y": np.arange(float(SIDE)), "x": np.arange(float(SIDE))}

    def marked(heights: np.ndarray) -> np.ndarray:
        raster = DataArray(heights.copy(), coords=axes, dims=("y", "x"))
        return theirs(raster, x=float(COLUMN), y=float(ROW), observer_elev=EYE_HEIGHT).values >= 0.0

    return _beside("xarray-spatial", marked, ground)


def _gdal() -> Viewshed | None:
    """GDAL's viewshed by the library that rasterio brings along, None where that is built otherwise."""
    found = sorted(Path(rasterio.__file__).parent.with_name("rasterio.libs").glob("libgdal*"))
    if not found:
        return None
    gdal = ctypes.CDLL(str(found[0]))
    for name in ("GDALGetDriverByName", "GDALCreate", "GDALGetRasterBand", "GDALViewshedGenerate"):
        getattr(gdal, name).restype = ctypes.c_void_p
    gdal.GDALAllRegister()
    memory = ctypes.c_void_p(gdal.GDALGetDriverByName(b"MEM"))
    real, byte, read, write, edge, normal = 7, 1, 0, 1, 2, 1  # GDAL's names for them are in its headers

    def copied(dataset: ctypes.c_void_p, way: int, cells: np.ndarray, kind: int) -> ctypes.c_void_p:
        band = ctypes.c_void_p(gdal.GDALGetRasterBand(dataset, 1))
        at = cells.ctypes.data_as(ctypes.c_void_p)
        failed = gdal.GDALRasterIO(band, way, 0, 0, SIDE, SIDE, at, SIDE, SIDE, kind, 0, 0)
        if failed:
            raise RuntimeError("GDAL could not copy a raster")
        return band

    def marked(heights: np.ndarray) -> np.ndarray:
        source = ctypes.c_void_p(gdal.GDALCreate(memory, b"", SIDE, SIDE, 1, real, None))
        gdal.GDALSetGeoTransform(source, (ctypes.c_double * 6)(0, 1, 0, 0, 0, 1))
        band = copied(source, write, heights, real)
        # observer x, y, eye and target height; marks for seen, hidden and out of range; no data, curvature
        numbers = (COLUMN + 0.5, ROW + 0.5, EYE_HEIGHT, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0)
        first = (band, b"MEM", b"", None, *map(ctypes.c_double, numbers))
        last = (edge, ctypes.c_double(0.0), gdal.GDALDummyProgress, None, normal, None)
        result = ctypes.c_void_p(gdal.GDALViewshedGenerate(*first, *last))
        seen = np.zeros(heights.shape, np.uint8)
        copied(result, read, seen, byte)
        gdal.GDALClose(result)
        gdal.GDALClose(source)
        return seen > 0

    return marked
