"""Trees of triangles that Embree casts rays into."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene

Part = tuple[np.ndarray, np.ndarray]
"""A mesh: vertices (n, 3) and faces (m, 3)."""

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
