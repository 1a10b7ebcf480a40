"""Rays packed for Embree 4 and its answers unpacked, in compiled loops.

The record is `RTCRayHit16` of `embree4/rtcore_ray.h`: a row of 16 numbers for each field, on a boundary of 64
bytes. `RTCRay16` is its beginning; even where that is asked for, Embree may write into the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

PACKET = 16
ROWS = 24  # of a record; with one level of instances Embree 4.4 has 21

# Which rows are which. Of a vector's three the first is named.
ORIGIN, NEAR, DIRECTION, TIME, FAR, MASK, ID, FLAGS = 0, 3, 4, 7, 8, 9, 10, 11
NORMAL, TRIANGLE, GEOMETRY, INSTANCE = 12, 17, 18, 19

EVERYTHING = -1  # as a mask
NOTHING = -1  # as a geometry or an instance
FLAT = np.float32(1e-18)
"""Embree takes smaller parts of a direction for positive ones, but their sign from themselves."""


def _lower_call(_typing, entry, valid, scene, rays, arguments):
    """How compiled code calls `rtcIntersect16` or `rtcOccluded16` at the address `entry`, with the addresses
    of the validity of each ray, the scene, the rays and the arguments.

    Code with an address in it would not be kept for the next process."""

    def generate(context, builder, _signature, values):
        address, *given = values
        function = ir.FunctionType(ir.VoidType(), [value.type for value in given])
        builder.call(builder.inttoptr(address, function.as_pointer()), given)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 5), generate


_call: Any = intrinsic(_lower_call)


@njit(cache=True, nogil=True)
def first_hits_kernel(
    entry, scene, arguments, origins, directions, reach, order, distance, geometry, triangle, normal
):
    """Write the first hits of rays into `distance`, `geometry`, `triangle` (n,) and `normal` (n, 3): the
    reach, -1, -1 and zeros for a miss.

    origins : (n, 3), or (1, 3) for all; directions : (n, 3); reach : (n,), all float32
    order : indices of the rays to cast, in that order; all in their own where it is empty
    """
    record, valid = _aligned(ROWS * PACKET), _aligned(PACKET).view(np.int32)
    words = record.view(np.int32)
    count = len(order) if len(order) else len(directions)
    for begin in range(0, count, PACKET):
        rays = min(PACKET, count - begin)
        _pack(record, words, valid, begin, rays, origins, directions, reach, order)
        _call(entry, valid.ctypes.data, scene, record.ctypes.data, arguments)
        for lane in range(rays):
            ray = order[begin + lane] if len(order) else begin + lane
            distance[ray] = record[FAR * PACKET + lane]
            geometry[ray] = words[GEOMETRY * PACKET + lane]
            triangle[ray] = words[TRIANGLE * PACKET + lane] if geometry[ray] != NOTHING else -1
            for axis in range(3):
                hit = geometry[ray] != NOTHING
                normal[ray, axis] = record[(NORMAL + axis) * PACKET + lane] if hit else np.float32(0.0)


@njit(cache=True, nogil=True)
def occluded_kernel(entry, scene, arguments, origins, directions, reach, occluded):
    """Write into `occluded` (n,) bool whether anything lies on each ray. Rays as for `first_hits_kernel`."""
    record, valid = _aligned(ROWS * PACKET), _aligned(PACKET).view(np.int32)
    words, order = record.view(np.int32), np.empty(0, np.intp)
    for begin in range(0, len(directions), PACKET):
        rays = min(PACKET, len(directions) - begin)
        _pack(record, words, valid, begin, rays, origins, directions, reach, order)
        _call(entry, valid.ctypes.data, scene, record.ctypes.data, arguments)
        for lane in range(rays):
            occluded[begin + lane] = record[FAR * PACKET + lane] == -np.inf


@njit(cache=True)
def _aligned(count):
    """(count,) float32 on a boundary of 64 bytes."""
    numbers = np.zeros(count + 16, np.float32)
    begin = -np.intp(numbers.ctypes.data) % 64 // 4
    return numbers[begin : begin + count]


@njit(cache=True)
def _pack(record, words, valid, begin, rays, origins, directions, reach, order):
    """Put the next rays into the record; lanes without one are not valid, nor are rays that are not finite,
    which would spoil their neighbours."""
    for lane in range(PACKET):
        valid[lane] = 0
    for lane in range(rays):
        ray = order[begin + lane] if len(order) else begin + lane
        eye = ray if len(origins) > 1 else 0
        total = np.float32(0.0) if reach[ray] == reach[ray] else reach[ray]
        for axis in range(3):
            part = directions[ray, axis]
            total += origins[eye, axis] + part
            record[(ORIGIN + axis) * PACKET + lane] = origins[eye, axis]
            record[(DIRECTION + axis) * PACKET + lane] = part if abs(part) >= FLAT else np.float32(0.0)
        valid[lane] = -1 if total - total == 0.0 else 0
        record[FAR * PACKET + lane] = reach[ray]
        record[NEAR * PACKET + lane] = record[TIME * PACKET + lane] = 0.0
        words[MASK * PACKET + lane] = EVERYTHING
        words[ID * PACKET + lane] = words[FLAGS * PACKET + lane] = 0
        words[GEOMETRY * PACKET + lane] = words[INSTANCE * PACKET + lane] = NOTHING
