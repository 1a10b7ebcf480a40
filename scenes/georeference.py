"""Where a survey lies: its coordinate system, made metric, and the part of it that becomes a scene.

Three frames: *native* coordinates are the file's own; *survey* coordinates are projected (the native ones,
or local UTM where the native system is not metric on the ground); the scene's metres lie about an origin
given in survey coordinates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from pyproj import CRS, Proj, Transformer
from pyproj.exceptions import CRSError, ProjError

from scenes.scenario import ScenarioError
from scenes.terrain import MAX_CELLS, MIN_CELLS

FINEST, COARSEST = 0.25, 2.0
RESOLUTION_LIMITS = (0.05, 10.0)
MAX_MAP_SCALE_ERROR = 0.01


@dataclass(frozen=True)
class Extent:
    """A rectangle along the axes of its frame."""

    west: float
    east: float
    south: float
    north: float

    @property
    def middle(self) -> tuple[float, float]:
        return 0.5 * (self.west + self.east), 0.5 * (self.south + self.north)

    def contains(self, x: float, y: float) -> bool:
        return self.west <= x <= self.east and self.south <= y <= self.north

    def words(self) -> str:
        return f"{self.west:.10g} to {self.east:.10g} east and {self.south:.10g} to {self.north:.10g} north"


@dataclass(frozen=True)
class Georeference:
    """How native coordinates become survey coordinates, and those metres.

    crs : of the survey coordinates, None where the file names none (metres are assumed then)
    unit, vertical_unit : metres in one unit of survey coordinates, and of native heights
    to_utm : native to survey coordinates, None where they are the same
    """

    crs: CRS | None
    unit: float
    vertical_unit: float
    to_utm: Transformer | None = None

    def to_survey(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        """Native x and y (arrays of one shape) in survey coordinates; inf where they have none."""
        if self.to_utm is None:
            return np.asarray(x, float), np.asarray(y, float)
        return self.to_utm.transform(x, y)

    def to_native(self, east, north) -> tuple[np.ndarray, np.ndarray]:
        """The inverse of `to_survey`."""
        if self.to_utm is None:
            return np.asarray(east, float), np.asarray(north, float)
        return self.to_utm.transform(east, north, direction="INVERSE")

    def extent(self, native: Extent) -> Extent:
        """The rectangle in survey coordinates that holds a native one.

        Raises ScenarioError where the system does not reach that far."""
        if self.to_utm is None:
            return native
        try:
            west, south, east, north = self.to_utm.transform_bounds(
                native.west, native.south, native.east, native.north
            )
        except ProjError:
            west = east = south = north = math.inf
        if not all(map(math.isfinite, (west, south, east, north))):
            raise ScenarioError(
                f"the survey spans {native.words()}, too much for one local system of metres: "
                "cut the region of interest out of it first"
            )
        return Extent(west, east, south, north)

    @property
    def label(self) -> str | None:
        """The system's authority code, or its definition, as a scenario keeps it."""
        if self.crs is None:
            return None
        text = self.crs.to_string()
        return text if len(text) <= 4000 else self.crs.name[:4000]


def georeference(crs: CRS | None, native: Extent, *, heights_follow_unit: bool) -> Georeference:
    """Find metric coordinates for a survey that spans `native`.

    Geographic systems, and projected ones whose scale is off by more than 1 % there (Web Mercator), go to
    local UTM. heights_follow_unit : whether heights without a unit of their own are in the horizontal unit
    of a projected system; metres otherwise.
    Raises ScenarioError for systems that are neither geographic nor projected nor local.
    """
    if crs is None:
        return Georeference(None, 1.0, 1.0)
    if crs.is_geocentric:
        raise ScenarioError(f"its system {crs.name} is geocentric; export it in a projected system")
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    horizontal = horizontal.source_crs if horizontal.is_bound and horizontal.source_crs else horizontal
    unit = horizontal.axis_info[0].unit_conversion_factor if horizontal.axis_info else 1.0
    upward = [axis.unit_conversion_factor for axis in crs.axis_info if axis.direction == "up"]
    metric = not horizontal.is_geographic
    vertical_unit = upward[0] if upward else (unit if heights_follow_unit and metric else 1.0)
    if not (math.isfinite(unit) and unit > 0.0 and math.isfinite(vertical_unit) and vertical_unit > 0.0):
        raise ScenarioError(f"its system {crs.name} has no usable unit of length")
    if metric and (not horizontal.is_projected or _true_to_scale(horizontal, native)):
        return Georeference(horizontal, unit, vertical_unit)
    utm, transformer = _local_utm(horizontal, native)
    return Georeference(utm, 1.0, vertical_unit, transformer)


def _true_to_scale(crs: CRS, native: Extent) -> bool:
    try:
        projection = Proj(crs)
        factors = projection.get_factors(*projection(*native.middle, inverse=True))
    except (CRSError, ProjError):
        return True
    scales = (factors.meridional_scale, factors.parallel_scale)
    return all(abs(scale - 1.0) <= MAX_MAP_SCALE_ERROR for scale in scales)


def _local_utm(crs: CRS, native: Extent) -> tuple[CRS, Transformer]:
    """WGS 84 / UTM (polar stereographic beyond its limits) of the zone the middle lies in."""
    try:
        lon, lat = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(*native.middle)
        if not (abs(lon) <= 540.0 and abs(lat) <= 90.0):
            raise ScenarioError(f"its middle {native.middle} is no longitude and latitude")
        zone = int((lon + 180.0) // 6.0) % 60 + 1
        code = 32661 if lat > 84.0 else 32761 if lat < -80.0 else (32600 if lat >= 0.0 else 32700) + zone
        utm = CRS.from_epsg(code)
        return utm, Transformer.from_crs(crs, utm, always_xy=True)
    except (CRSError, ProjError) as error:
        raise ScenarioError(f"its system {crs.name} cannot be turned into UTM: {error}") from None


@dataclass(frozen=True)
class SceneGrid:
    """The scene's samples: `rows` × `cols` at `resolution` metres about (easting, northing)."""

    easting: float
    northing: float
    unit: float
    resolution: float
    rows: int
    cols: int

    @property
    def half_width(self) -> float:
        return 0.5 * (self.cols - 1) * self.resolution

    @property
    def half_height(self) -> float:
        return 0.5 * (self.rows - 1) * self.resolution

    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """Scene x of every column and scene y of every row."""
        return (
            np.arange(self.cols) * self.resolution - self.half_width,
            np.arange(self.rows) * self.resolution - self.half_height,
        )

    def xy(self) -> tuple[np.ndarray, np.ndarray]:
        """Scene x and y of every sample, each (rows, cols)."""
        x, y = np.meshgrid(*self.axes())
        return x, y

    def to_survey(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        return self.easting + np.asarray(x) / self.unit, self.northing + np.asarray(y) / self.unit

    def to_scene(self, east, north) -> tuple[np.ndarray, np.ndarray]:
        return (np.asarray(east) - self.easting) * self.unit, (np.asarray(north) - self.northing) * self.unit

    def cells(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row and column of the nearest sample of scene points (n,), and which of them are on the grid."""
        row = np.rint((y + self.half_height) / self.resolution).astype(np.int64)
        col = np.rint((x + self.half_width) / self.resolution).astype(np.int64)
        return row, col, (row >= 0) & (row < self.rows) & (col >= 0) & (col < self.cols)


@dataclass(frozen=True)
class Region:
    """The part of a survey that becomes the scene: (easting, northing) in its middle, size in metres."""

    easting: float
    northing: float
    unit: float
    width: float
    height: float

    def grid(self, spacing: float, resolution: float | None) -> SceneGrid:
        """Sample the region: at `resolution`, or as finely as the measurements' `spacing` (metres) deserves,
        within 0.25 to 2 m and the largest map. Raises ScenarioError where no map is large enough."""
        longest = max(self.width, self.height)
        if resolution is None:
            fits = math.ceil(100.0 * longest / (MAX_CELLS - 1)) / 100.0
            resolution = min(max(spacing, FINEST, fits), COARSEST)
        rows, cols = (int(side / resolution + 1e-6) + 1 for side in (self.height, self.width))
        size = f"{self.width:.6g} × {self.height:.6g} m at {resolution:g} m is {rows:.6g} × {cols:.6g} cells"
        if max(rows, cols) > MAX_CELLS:
            limit = int((MAX_CELLS - 1) * resolution)
            raise ScenarioError(
                f"{size}, and a map has at most {MAX_CELLS} a side: crop to {limit} m or less"
            )
        if min(rows, cols) < MIN_CELLS:
            limit = (MIN_CELLS - 1) * resolution
            raise ScenarioError(
                f"{size}, and a map has at least {MIN_CELLS} a side: take {limit:g} m or more"
            )
        return SceneGrid(self.easting, self.northing, self.unit, resolution, rows, cols)


def choose_region(
    crop: tuple[float, float, float] | None, reference: Georeference, native: Extent
) -> Region:
    """What to import: everything, or the square that `crop` (x, y, size in metres) names by its middle.

    x and y are survey coordinates (easting and northing as the scenario records them); where those do not
    lie in the survey they are read as native ones (longitude and latitude) or else as metres east and north
    of the survey's middle, so that (0, 0, 100) is its middle 100 m.
    Raises ScenarioError, with the right range, where the point lies outside in every reading.
    """
    extent = reference.extent(native)
    middle_x, middle_y = extent.middle
    half_width = 0.5 * (extent.east - extent.west) * reference.unit
    half_height = 0.5 * (extent.north - extent.south) * reference.unit
    whole = Region(middle_x, middle_y, reference.unit, 2.0 * half_width, 2.0 * half_height)
    if crop is None:
        return whole
    x, y, size = crop
    offset = Extent(-half_width, half_width, -half_height, half_height)
    if extent.contains(x, y):
        east, north = x, y
    elif native.contains(x, y):
        east, north = (float(v) for v in reference.to_survey(x, y))
    elif offset.contains(x, y):
        east, north = middle_x + x / reference.unit, middle_y + y / reference.unit
    else:
        raise ScenarioError(
            f"the crop's middle ({x:.10g}, {y:.10g}) is not in the survey: it spans {extent.words()}"
            f" ({offset.words()} in metres from its middle)"
        )
    return replace(whole, easting=east, northing=north, width=size, height=size)
