"""Read the points of a LAS or LAZ survey, in bounded memory and without trust in its header."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import vlr_factory
from laspy.vlrs.vlrlist import VLRList
from pyproj import CRS
from pyproj.exceptions import CRSError

from scenes.georeference import Extent, Georeference, Region, choose_region, georeference
from scenes.scenario import ScenarioError

MAX_POINTS = 200_000_000
MAX_KEPT = 12_000_000
CHUNK_BYTES = 2**25
MAX_RECORDS = 1000
MAX_PROJECTION = 2**20  # bytes of a record that names a coordinate system
MARGIN = 15.0
NOISE_CLASSES = (7, 18)


@dataclass(frozen=True)
class PointCloud:
    """Returns of a survey in scene metres about the region's middle.

    x, y, z : (n,) float64; z above the survey's vertical datum
    classes : (n,) uint8, ASPRS classification
    """

    reference: Georeference
    region: Region
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    classes: np.ndarray


def read_points(path: Path, crop: tuple[float, float, float] | None) -> PointCloud:
    """The returns in the chosen region and 15 m about it, without withheld ones and noise.

    Raises ScenarioError for files that are truncated, damaged, empty or too large."""
    _check_header(path)
    projections = _extended_projections(path)
    try:
        with path.open("rb") as stream:
            reader = laspy.LasReader(
                stream, closefd=False, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False
            )
            reader.header.evlrs = projections
            return _read(reader, crop)
    except (ScenarioError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:  # a panic of the decompressor is no Exception
        reason = "its records contradict each other" if isinstance(error, KeyError) else str(error)
        reason = " ".join(reason.split())[:200] or type(error).__name__
        raise ScenarioError(f"is damaged or no LAS/LAZ: {reason}") from None


def _check_header(path: Path) -> None:
    """Refuse headers that promise more than the file can hold before any decoder allocates for them.

    Layout: ASPRS LAS 1.4 R15, table 3; LASzip's chunk table stands at the end of the points."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(375)
        if len(head) < 227:
            raise ScenarioError("is truncated: it ends within its header")
        major, minor = head[24], head[25]
        header_size, to_points, records = struct.unpack_from("<HII", head, 94)
        point_format, record_length, count = struct.unpack_from("<BHI", head, 104)
        if (major, minor) >= (1, 4) and len(head) >= 255:
            count = struct.unpack_from("<Q", head, 247)[0] or count
        numbers = np.array(struct.unpack_from("<12d", head, 131))
        if not (np.isfinite(numbers).all() and (numbers[:3] != 0.0).all()):
            raise ScenarioError("its header has a scale, offset or bound that is not a usable number")
        if records > MAX_RECORDS or header_size > to_points or to_points > size:
            raise ScenarioError("is truncated or damaged: its header points beyond the end of the file")
        if count == 0:
            raise ScenarioError("has no points")
        if count > MAX_POINTS:
            raise ScenarioError(f"claims {count:,} points; at most {MAX_POINTS:,} can be imported")
        if point_format & 0xC0:
            _check_chunk_table(stream, to_points, size, record_length)
        elif to_points + count * record_length > size:
            raise ScenarioError(
                f"is truncated: {count:,} points need {to_points + count * record_length:,} bytes, "
                f"the file has {size:,}"
            )


def _extended_projections(path: Path) -> VLRList:
    """The coordinate systems that stand behind the points, as LAS 1.4 has them; what else stands there, whole
    waveforms even, is passed over.

    Layout: ASPRS LAS 1.4 R15, tables 3 and 4."""
    found, size = VLRList(), path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(375)
        if (head[24], head[25]) < (1, 4) or len(head) < 247:
            return found
        where, count = struct.unpack_from("<QI", head, 235)
        if count > MAX_RECORDS:
            raise ScenarioError(f"is damaged: it claims {count:,} extended records")
        for _ in range(count):
            stream.seek(min(where, size))
            record = stream.read(60)
            if len(record) < 60:
                raise ScenarioError("is truncated or damaged: an extended record lies beyond its end")
            user, number, length = struct.unpack_from("<2x16sHQ", record)
            if user.rstrip(b"\0") == b"LASF_Projection" and length <= MAX_PROJECTION:
                content = stream.read(length)
                found.append(vlr_factory(laspy.VLR("LASF_Projection", number, "", content)))
            where += 60 + length
    return found


def _check_chunk_table(stream, to_points: int, size: int, record_length: int) -> None:
    stream.seek(to_points)
    head = stream.read(8)
    where = struct.unpack("<q", head)[0] if len(head) == 8 else -1
    if where == -1:
        stream.seek(max(size - 8, 0))
        where = struct.unpack("<q", stream.read(8).rjust(8, b"\xff"))[0]
    if not to_points < where <= size - 8:
        raise ScenarioError("is truncated or damaged: its table of compressed chunks is not in the file")
    stream.seek(where + 4)
    chunks = struct.unpack("<I", stream.read(4))[0]
    if chunks * max(record_length, 1) > size:
        raise ScenarioError(f"is damaged: {chunks:,} compressed chunks do not fit into {size:,} bytes")


def _read(reader: laspy.LasReader, crop: tuple[float, float, float] | None) -> PointCloud:
    header = reader.header
    (west, south, _), (east, north, _) = header.mins.tolist(), header.maxs.tolist()
    native = Extent(west, east, south, north)
    if not (native.west <= native.east and native.south <= native.north):
        raise ScenarioError("its header's bounds are the wrong way round")
    reference = georeference(_crs(header), native, heights_follow_unit=True)
    region = choose_region(crop, reference, native)
    half_width, half_height = 0.5 * region.width + MARGIN, 0.5 * region.height + MARGIN
    kept: list[tuple[np.ndarray, ...]] = []
    total = 0
    for chunk in reader.chunk_iterator(max(1, min(1_000_000, CHUNK_BYTES // header.point_format.size))):
        east, north = reference.to_survey(np.asarray(chunk.x), np.asarray(chunk.y))
        x, y = (east - region.easting) * region.unit, (north - region.northing) * region.unit
        classes = np.asarray(chunk.classification).astype(np.uint8)
        near = (np.abs(x) <= half_width) & (np.abs(y) <= half_height)
        near &= ~np.isin(classes, NOISE_CLASSES) & (np.asarray(chunk.withheld) == 0)
        z = np.asarray(chunk.z)[near] * reference.vertical_unit
        kept.append((x[near], y[near], z, classes[near]))
        total += int(near.sum())
        if total > MAX_KEPT:
            raise ScenarioError(f"the chosen part has over {MAX_KEPT:,} points: crop to less")
    if total == 0:
        raise ScenarioError("has no points in the chosen part")
    x, y, z, classes = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    if not math.isfinite(float(np.abs(z).max())):
        raise ScenarioError("has points whose height is not a finite number")
    return PointCloud(reference, region, x, y, z, classes)


def _crs(header: laspy.LasHeader) -> CRS | None:
    try:
        return header.parse_crs()
    except (CRSError, ValueError, KeyError, IndexError, AttributeError, UnicodeDecodeError) as error:
        raise ScenarioError(f"its coordinate system cannot be read: {error}") from None
