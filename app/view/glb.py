"""Binary glTF written from plain arrays: vertex colours with alpha, textures and unlit surfaces.

trimesh writes glTF too, but neither unlit materials nor blended vertex colours, and it stores colours
as if they were linear light, which washes them out. Source: the glTF 2.0 specification (Khronos),
sections 3.7 (geometry), 3.9 (materials), 4.4 (GLB) and KHR_materials_unlit.
"""

from __future__ import annotations

import json
import struct
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh

from app.view.tone import for_screen, linear

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963


@dataclass(frozen=True)
class Surface:
    """A triangle mesh as the browser shall draw it.

    vertices : (n, 3) metres; faces : (m, 3) indices, counter-clockwise seen from outside
    colours : (n, 3) or (n, 4) uint8 sRGB, straight alpha, or None for white
    normals : (n, 3) unit vectors for smooth shading, or None for facets
    uv, texture : (n, 2) from 0 to 1 with v downwards, and the bytes of a JPEG or PNG
    unlit : drawn in its own colour whatever the light; blended : alpha below 1 lets through what is behind
    """

    vertices: np.ndarray
    faces: np.ndarray
    colours: np.ndarray | None = None
    normals: np.ndarray | None = None
    uv: np.ndarray | None = None
    texture: bytes | None = None
    unlit: bool = False
    blended: bool = False
    double_sided: bool = False
    roughness: float = 0.95

    @classmethod
    def from_trimesh(cls, mesh: trimesh.Trimesh) -> Surface:
        """Facets in the mesh's own face or vertex colours."""
        faces = np.asarray(mesh.faces)
        vertices = np.asarray(mesh.vertices)
        visual: Any = mesh.visual
        if getattr(visual, "kind", None) == "face":
            colours = np.asarray(visual.face_colors, np.uint8)
            if (colours == colours[0]).all():
                return cls(vertices, faces, np.tile(colours[0, :3], (len(vertices), 1)))
            colours = np.repeat(colours, 3, axis=0)
            return cls(
                vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), colours[:, :3]
            )
        return cls(vertices, faces, np.asarray(visual.vertex_colors, np.uint8)[:, :3])

    def moved(self, rotation: np.ndarray, position: np.ndarray) -> Surface:
        """The same mesh turned by a (3, 3) rotation, then shifted by (3,) metres."""
        normals = None if self.normals is None else self.normals @ rotation.T
        vertices = self.vertices @ rotation.T + position
        return Surface(
            vertices,
            self.faces,
            self.colours,
            normals,
            self.uv,
            self.texture,
            self.unlit,
            self.blended,
            self.double_sided,
            self.roughness,
        )


def merged(surfaces: list[Surface]) -> Surface:
    """One coloured mesh of many that share a material, so that the browser draws them in one call."""
    starts = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    colours = [
        np.full((len(s.vertices), 3), 255, np.uint8) if s.colours is None else s.colours for s in surfaces
    ]
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + start for s, start in zip(surfaces, starts, strict=True)]),
        np.concatenate(colours),
        unlit=surfaces[0].unlit,
        blended=surfaces[0].blended,
        double_sided=surfaces[0].double_sided,
    )


def glb(*surfaces: Surface) -> bytes:
    """The surfaces as one GLB file. Raises ValueError where one has no triangle."""
    document = _Document()
    for surface in surfaces:
        if len(surface.faces) == 0:
            raise ValueError("a surface needs at least one triangle")
        document.add(surface)
    return document.encode()


class Reskinned:
    """A mesh whose texture changes often: its geometry is encoded once."""

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._geometry = _Document()
        self._primitive = self._geometry.primitive(surface)

    def glb(self, texture: bytes) -> bytes:
        """The mesh with a JPEG or PNG on it."""
        document = self._geometry.copy()
        document.skin(replace(self._surface, texture=texture), self._primitive)
        return document.encode()


class _Document:
    def __init__(self) -> None:
        self._chunks: list[bytes] = []
        self._length = 0
        self._json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "materials": [],
            "accessors": [],
            "bufferViews": [],
        }

    def copy(self) -> _Document:
        other = _Document()
        other._chunks, other._length, other._json = [*self._chunks], self._length, deepcopy(self._json)
        return other

    def add(self, surface: Surface) -> None:
        self.skin(surface, self.primitive(surface))

    def primitive(self, surface: Surface) -> dict[str, Any]:
        """The geometry alone."""
        attributes = {"POSITION": self._accessor(surface.vertices.astype("<f4"), "VEC3", bounds=True)}
        if surface.normals is not None:
            attributes["NORMAL"] = self._accessor(surface.normals.astype("<f4"), "VEC3")
        if surface.uv is not None:
            uv = np.round(65535.0 * surface.uv).astype("<u2")
            attributes["TEXCOORD_0"] = self._accessor(uv, "VEC2", normalized=True)
        if surface.colours is not None:
            attributes["COLOR_0"] = self._accessor(_light(surface), "VEC4", normalized=True)
        index = "<u2" if len(surface.vertices) < 2**16 else "<u4"
        faces = self._accessor(surface.faces.astype(index).reshape(-1), "SCALAR", target=_ELEMENT_BUFFER)
        return {"attributes": attributes, "indices": faces}

    def skin(self, surface: Surface, primitive: dict[str, Any]) -> None:
        """A node of the geometry in the surface's material."""
        index = len(self._json["meshes"])
        self._json["materials"].append(self._material(surface))
        self._json["meshes"].append({"primitives": [primitive | {"material": index}]})
        self._json["nodes"].append({"mesh": index})
        self._json["scenes"][0]["nodes"].append(index)

    def _material(self, surface: Surface) -> dict[str, Any]:
        colour: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": surface.roughness}
        if surface.texture is not None:
            colour["baseColorTexture"] = {"index": self._texture(surface.texture)}
        material: dict[str, Any] = {"pbrMetallicRoughness": colour, "doubleSided": surface.double_sided}
        if surface.blended:
            material["alphaMode"] = "BLEND"
        if surface.unlit:
            material["extensions"] = {"KHR_materials_unlit": {}}
            self._json["extensionsUsed"] = ["KHR_materials_unlit"]
        return material

    def _texture(self, image: bytes) -> int:
        view = self._view(image)
        mime = "image/png" if image.startswith(b"\x89PNG") else "image/jpeg"
        images = self._json.setdefault("images", [])
        images.append({"bufferView": view, "mimeType": mime})
        clamped = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}
        self._json.setdefault("samplers", [clamped])
        textures = self._json.setdefault("textures", [])
        textures.append({"source": len(images) - 1, "sampler": 0})
        return len(textures) - 1

    def _accessor(
        self,
        array: np.ndarray,
        kind: str,
        *,
        bounds: bool = False,
        normalized: bool = False,
        target: int = _ARRAY_BUFFER,
    ) -> int:
        component = {"f4": _FLOAT, "u2": _UINT16, "u4": _UINT32}[array.dtype.str[1:]]
        accessor: dict[str, Any] = {
            "bufferView": self._view(np.ascontiguousarray(array).tobytes(), target),
            "componentType": component,
            "count": len(array),
            "type": kind,
        }
        if bounds:
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if normalized:
            accessor["normalized"] = True
        self._json["accessors"].append(accessor)
        return len(self._json["accessors"]) - 1

    def _view(self, data: bytes, target: int | None = None) -> int:
        view = {"buffer": 0, "byteOffset": self._length, "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        padded = data + b"\0" * (-len(data) % 4)
        self._chunks.append(padded)
        self._length += len(padded)
        self._json["bufferViews"].append(view)
        return len(self._json["bufferViews"]) - 1

    def encode(self) -> bytes:
        self._json["buffers"] = [{"byteLength": self._length}]
        text = json.dumps(self._json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        binary = b"".join(self._chunks)
        total = 12 + 8 + len(text) + 8 + len(binary)
        return b"".join(
            [
                struct.pack("<III", 0x46546C67, 2, total),
                struct.pack("<II", len(text), 0x4E4F534A),
                text,
                struct.pack("<II", len(binary), 0x004E4942),
                binary,
            ]
        )


def _light(surface: Surface) -> np.ndarray:
    """(n, 4) uint16 linear light and alpha of the surface's colours."""
    assert surface.colours is not None
    sent = surface.colours[:, :3]
    rgba = np.full((len(sent), 4), 65535, "<u2")
    rgba[:, :3] = np.round(65535.0 * linear(for_screen(sent) if surface.unlit else sent))
    if surface.colours.shape[1] == 4:
        rgba[:, 3] = surface.colours[:, 3].astype(np.uint16) * 257
    return rgba
