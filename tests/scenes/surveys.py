"""Small survey files that the tests make for themselves."""

from pathlib import Path

import laspy
import numpy as np
import pyproj
import rasterio
from rasterio.transform import from_origin

EAST, NORTH = 500_000.0, 5_000_000.0
UTM = "EPSG:32632"
US_FEET = "EPSG:2263"  # New York Long Island, US survey feet


def hill(x, y):
    """A gentle ground in metres, 100 m up, bent in both directions."""
    return 100.0 + 0.05 * x - 0.03 * y + 0.4 * np.sin(0.15 * x) * np.cos(0.1 * y)


def write_geotiff(
    path: Path, bands: np.ndarray, *, transform=None, crs: str | None = UTM, pixel: float = 1.0, **options
) -> Path:
    """bands : (rows, cols) or (bands, rows, cols), rows north to south about (EAST, NORTH)."""
    scales, offsets, units = (options.pop(key, None) for key in ("scales", "offsets", "units"))
    bands = bands[None] if bands.ndim == 2 else bands
    count, rows, cols = bands.shape
    transform = transform or from_origin(EAST - 0.5 * cols * pixel, NORTH + 0.5 * rows * pixel, pixel, pixel)
    profile = {"count": count, "height": rows, "width": cols, "dtype": bands.dtype, **options}
    with rasterio.open(path, "w", driver="GTiff", crs=crs, transform=transform, **profile) as raster:
        raster.write(bands)
        if scales:
            raster.scales, raster.offsets = scales, offsets
        if units:
            raster.units = units
    return path


def hill_pixels(rows: int, cols: int, pixel: float = 1.0) -> np.ndarray:
    """`hill` at the pixel centres of `write_geotiff`'s default transform."""
    x = (np.arange(cols) + 0.5) * pixel - 0.5 * cols * pixel
    y = 0.5 * rows * pixel - (np.arange(rows) + 0.5) * pixel
    return hill(*np.meshgrid(x, y)).astype(np.float32)


def write_las(path: Path, points: np.ndarray, classes, *, crs: str | None = UTM, version="1.4") -> Path:
    """points : (n, 3) metres about (EAST, NORTH, 0), or native coordinates where `crs` is not UTM."""
    header = laspy.LasHeader(version=version, point_format=6 if version == "1.4" else 1)
    header.scales, header.offsets = np.full(3, 0.001), np.array([EAST, NORTH, 0.0]) * (crs in (UTM, None))
    if crs:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    las = laspy.LasData(header)
    shifted = points + (np.array([EAST, NORTH, 0.0]) if crs in (UTM, None) else 0.0)
    las.x, las.y, las.z = shifted.T
    las.classification = np.broadcast_to(np.asarray(classes, np.uint8), len(points)).copy()
    las.write(path)
    return path


def ground_points(rng: np.random.Generator, size: float, count: int) -> np.ndarray:
    x, y = rng.uniform(-0.5 * size, 0.5 * size, (2, count))
    return np.column_stack([x, y, hill(x, y)])


def crown_points(
    rng: np.random.Generator, x: float, y: float, height: float, radius: float, count: int = 400
) -> np.ndarray:
    """Returns from a tree: a dome over (x, y) that is `height` above the hill in its middle."""
    angle, reach = rng.uniform(0.0, 2.0 * np.pi, count), radius * np.sqrt(rng.uniform(0.0, 1.0, count))
    reach[0] = 0.0
    px, py = x + reach * np.cos(angle), y + reach * np.sin(angle)
    return np.column_stack([px, py, hill(px, py) + height * (1.0 - 0.4 * (reach / radius) ** 2)])
