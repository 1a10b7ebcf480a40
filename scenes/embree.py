"""Trees of triangles that Embree casts rays into."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene

Part = tuple[np.ndarray, np.ndarray]
"""A mesh: vertices (n, 3) and faces (m, 3)."""

ANSWERS = ("tfar", "geomID", "primID", "Ng")
RAYS_WORTH_A_THREAD = 4096
PIECES = 4  # for each thread
_threads = len(os.sched_getaffinity(0))

# One device for all scenes of the process: each keeps its own threads otherwise.
_DEVICE = EmbreeDevice()


def build_tree(parts: Sequence[Part], robust: bool = False) -> EmbreeScene:
    """One tree over meshes, ready to be asked from several threads; a mesh's place in `parts` is its geomID.

    `robust` closes the hairline between neighbouring triangles, which sight lines along grid lines meet and
    sensors do not; it costs a fifth of the speed."""
    scene = EmbreeScene(_DEVICE, robust=robust)
    for vertices, faces in parts:
        TriangleMesh(scene, np.asarray(vertices, np.float32), np.asarray(faces, np.int32))
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    scene.run(np.zeros_like(up), up)  # the first ray builds the tree
    return scene


def use_threads(count: int) -> None:
    """Share rays out among so many threads from now on, at most the cores. One, beside busy processes."""
    global _threads
    _threads = max(1, min(count, len(os.sched_getaffinity(0))))
    _pool.cache_clear()


def first_hits(
    tree: EmbreeScene, origins: np.ndarray, directions: np.ndarray, reach: np.ndarray
) -> dict[str, np.ndarray]:
    """Embree's answer for the first hit of each ray: `tfar`, `geomID`, `primID`, `Ng`.

    origins, directions : (n, 3) float32; reach : (n,) float32
    Many rays are shared out among threads; that changes no answer.
    """
    shares = min(_threads, len(directions) // RAYS_WORTH_A_THREAD)
    if shares < 2:
        return tree.run(origins, directions, dists=reach, output=1)
    # In pieces, for the sky is soon found empty and the ground below is not: who is done takes another.
    pieces = [np.array_split(rays, PIECES * shares) for rays in (origins, directions, reach)]
    left = deque(enumerate(zip(*pieces, strict=True)))
    answers: dict[int, dict[str, np.ndarray]] = {}

    def work() -> None:
        while left:
            try:
                number, (begins, ways, lengths) = left.popleft()
            except IndexError:  # somebody else has taken the last
                return
            answers[number] = tree.run(begins, ways, dists=lengths, output=1)

    helpers = [_pool().submit(work) for _ in range(shares - 1)]
    work()
    for helper in helpers:
        helper.result()
    return {name: np.concatenate([answers[i][name] for i in range(len(answers))]) for name in ANSWERS}


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(_threads - 1, 1), "rays")  # one core is the asker's own


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not live on in a forked process
