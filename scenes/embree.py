"""Trees of triangles that Embree 4 casts rays into, in packets of 16.

embreex brings the library; its own class casts rays one at a time. Packets give the same answers, but for
which triangle is named where several meet; where the processor has AVX-512 and rays keep close together, they
are faster.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from scenes.embree_kernel import PACKET, first_hits_kernel, occluded_kernel

Part = tuple[np.ndarray, np.ndarray]
"""A mesh: vertices (n, 3) and faces (m, 3)."""

RAYS_WORTH_A_THREAD = 4096
PIECES = 4  # for each thread
_threads = len(os.sched_getaffinity(0))

# Values of Embree's enumerations, as in embree4/rtcore_*.h.
_TRIANGLES = 0
_INDICES, _VERTICES = 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
_HIGH_QUALITY = 2  # slower to build, faster to cast into
_ROBUST = 1 << 2
_COHERENT = 1 << 16
_ALL_FEATURES = -1


class _Arguments(ctypes.Structure):
    """`RTCIntersectArguments` and `RTCOccludedArguments`, which are alike."""

    _fields_ = (
        ("flags", ctypes.c_int),
        ("features", ctypes.c_int),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("function", ctypes.c_void_p),
    )


class _Embree:
    """The library's functions, and one device for all scenes of the process: each keeps threads of its own
    otherwise."""

    def __init__(self) -> None:
        pointer, size, number = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
        # What embreex's module is linked to is found through it, under whatever name a wheel has it.
        self._library = ctypes.CDLL(importlib.import_module("embreex.rtcore_scene").__file__)
        self.new_scene = self._function("rtcNewScene", pointer, pointer)
        self.set_scene_flags = self._function("rtcSetSceneFlags", None, pointer, number)
        self.set_quality = self._function("rtcSetSceneBuildQuality", None, pointer, number)
        self.commit_scene = self._function("rtcCommitScene", None, pointer)
        self.release_scene = self._function("rtcReleaseScene", None, pointer)
        self.new_geometry = self._function("rtcNewGeometry", pointer, pointer, number)
        self.new_buffer = self._function(
            "rtcSetNewGeometryBuffer", pointer, pointer, number, ctypes.c_uint, number, size, size
        )
        self.commit_geometry = self._function("rtcCommitGeometry", None, pointer)
        self.attach_geometry = self._function("rtcAttachGeometry", ctypes.c_uint, pointer, pointer)
        self.release_geometry = self._function("rtcReleaseGeometry", None, pointer)
        self._error = self._function("rtcGetDeviceError", number, pointer)
        self.intersect, self.occluded = self._address("rtcIntersect16"), self._address("rtcOccluded16")
        self.device = self._function("rtcNewDevice", pointer, ctypes.c_char_p)(None)
        self._arguments = [_Arguments(flags, _ALL_FEATURES) for flags in (0, _COHERENT)]

    def _function(self, name: str, result: Any, *arguments: Any) -> Callable[..., Any]:
        function = getattr(self._library, name)
        function.restype, function.argtypes = result, arguments
        return function

    def _address(self, name: str) -> int:
        address = ctypes.cast(getattr(self._library, name), ctypes.c_void_p).value
        assert address is not None
        return address

    def arguments(self, coherent: bool) -> int:
        """Address of the arguments for rays that keep close together, or do not."""
        return ctypes.addressof(self._arguments[coherent])

    def error(self) -> int:
        """Embree's number for what has gone wrong in this thread since it was last asked, else 0."""
        return self._error(self.device)


_EMBREE = _Embree()


class FirstHits(NamedTuple):
    """What n rays hit first.

    distance : (n,) float32, the reach for a miss
    part, triangle : (n,) int32, -1 for a miss
    normal : (n, 3) float32 along the triangle's, not of unit length, zeros for a miss
    """

    distance: np.ndarray
    part: np.ndarray
    triangle: np.ndarray
    normal: np.ndarray


class Tree:
    """One tree over meshes, which several threads may ask at once. It cannot leave its process.

    parts : meshes; what was hit is told by their place in this
    robust : closes the hairline between neighbouring triangles, which sight lines along grid lines meet and
        sensors do not; it costs a fifth of the speed

    Raises ValueError for what is not of the shapes named here, RuntimeError where Embree cannot build the
    tree. Directions need not be of unit length: distances and reaches are multiples of theirs. A ray with a
    number that is not finite meets nothing; a reach may be infinite.
    """

    def __init__(self, parts: Sequence[Part], robust: bool = False):
        _EMBREE.error()  # somebody else's
        self._scene = _EMBREE.new_scene(_EMBREE.device)
        # At the end of the process threads may still be casting.
        weakref.finalize(self, _EMBREE.release_scene, self._scene).atexit = False
        _EMBREE.set_scene_flags(self._scene, _ROBUST if robust else 0)
        _EMBREE.set_quality(self._scene, _HIGH_QUALITY)
        for vertices, faces in parts:
            geometry = _EMBREE.new_geometry(_EMBREE.device, _TRIANGLES)
            _fill(geometry, _VERTICES, _FLOAT3, np.ascontiguousarray(vertices, np.float32))
            _fill(geometry, _INDICES, _UINT3, np.ascontiguousarray(faces, np.uint32))
            _EMBREE.commit_geometry(geometry)
            _EMBREE.attach_geometry(self._scene, geometry)
            _EMBREE.release_geometry(geometry)
        _EMBREE.commit_scene(self._scene)
        error = _EMBREE.error()
        if error:
            raise RuntimeError(f"Embree could not build the tree of triangles: its error {error}")

    def __reduce__(self):
        raise TypeError("a tree of triangles cannot leave its process; build it again from its parts")

    def first_hits(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        reach: np.ndarray,
        order: np.ndarray | None = None,
    ) -> FirstHits:
        """The first hit of each ray, surfaces being hit from both sides.

        origins : (n, 3), or (3,) for rays from one point, which are cast together and are fastest where
            neighbours point alike; directions : (n, 3); reach : (n,)
        order : (n,) indices of the rays in an order in which neighbours point alike, where theirs is not
            such; where a ray meets several triangles in their common edge it may settle which is named
        Many rays are shared out among threads; that changes no answer.
        """
        rays = _as_rays(origins, directions, reach)
        count = len(rays[1])
        order = _as_order(order, count)
        hits = FirstHits(
            np.empty(count, np.float32),
            np.empty(count, np.int32),
            np.empty(count, np.int32),
            np.empty((count, 3), np.float32),
        )

        def cast(some: np.ndarray) -> None:
            arguments = _EMBREE.arguments(np.ndim(origins) == 1)
            first_hits_kernel(_EMBREE.intersect, self._scene, arguments, *rays, some, *hits)

        shares = min(_threads, count // RAYS_WORTH_A_THREAD)
        if shares < 2:
            cast(order)
        else:
            _share_out(cast, order if len(order) else np.arange(count), shares)
        return hits

    def occluded(self, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """(n,) bool: whether anything lies on each ray. origins, directions : (n, 3); reach : (n,)"""
        rays = _as_rays(origins, directions, reach)
        answer = np.empty(len(rays[1]), bool)
        occluded_kernel(_EMBREE.occluded, self._scene, _EMBREE.arguments(False), *rays, answer)
        return answer


def _fill(geometry: int, kind: int, layout: int, rows: np.ndarray) -> None:
    """Copy the rows (n, 3) of numbers of four bytes into a new buffer of the geometry."""
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"a mesh's vertices and faces must be (n, 3), got {rows.shape}")
    buffer = _EMBREE.new_buffer(geometry, kind, 0, layout, rows.itemsize * 3, len(rows))
    if buffer:
        ctypes.memmove(buffer, rows.ctypes.data, rows.nbytes)


def _as_rays(
    origins: np.ndarray, directions: np.ndarray, reach: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contiguous and in single precision; a point for all of them as (1, 3)."""
    origins, directions, reach = (np.ascontiguousarray(x, np.float32) for x in (origins, directions, reach))
    count = len(directions)
    if (
        directions.shape != (count, 3)
        or origins.shape not in ((3,), (count, 3))
        or reach.shape != (count,)
    ):
        raise ValueError(
            "rays must be origins (n, 3) or (3,), directions (n, 3) and reach (n,),"
            f" got {origins.shape}, {directions.shape} and {reach.shape}"
        )
    return origins.reshape(-1, 3), directions, reach


def _as_order(order: np.ndarray | None, count: int) -> np.ndarray:
    """Indices of so many rays; none where they keep their own order."""
    if order is None or not count:
        return np.empty(0, np.intp)
    order = np.ascontiguousarray(order, np.intp)
    if order.shape != (count,) or order.min() < 0 or order.max() >= count:
        raise ValueError(f"an order of {count} rays must name each of them once")
    return order


def _share_out(cast: Callable[[np.ndarray], None], order: np.ndarray, shares: int) -> None:
    """Let so many threads cast rays, in pieces: the sky is soon found empty and the ground below is not, so
    who is done takes another. In whole packets: rays are cast beside the same others as by one thread."""
    packets = -(-len(order) // PACKET)
    cuts = np.linspace(0, packets, PIECES * shares + 1).astype(int)[1:-1] * PACKET
    left = deque(np.split(order, cuts))

    def work() -> None:
        while left:
            try:
                piece = left.popleft()
            except IndexError:  # somebody else has taken the last
                return
            cast(piece)

    helpers = [_pool().submit(work) for _ in range(shares - 1)]
    try:
        work()
    finally:
        left.clear()
        for helper in helpers:
            if not helper.cancel():  # one that has not begun finds nothing left
                helper.result()


def use_threads(count: int) -> None:
    """Share rays out among so many threads from now on, at most the cores. One, beside busy processes."""
    global _threads
    _threads = max(1, min(count, len(os.sched_getaffinity(0))))
    _pool.cache_clear()


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(_threads - 1, 1), "rays")  # one core is the asker's own


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not live on in a forked process
