"""The Husky's model: pybullet_data's `husky/husky.urdf` for the physics and its meshes for the view."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from xml.etree import ElementTree

import pybullet_data
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.visual import ColorVisuals

from scenes.pose import Pose

WHEELS = ("front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel")
WHEEL_RADIUS = 0.17775
WHEEL_WIDTH = 0.1143
AXLE_X, AXLE_Y = 0.256, 0.2854
"""Where a wheel's middle is in the base frame: ±AXLE_X, ±AXLE_Y, WHEEL_RADIUS; the axles lie along y."""

CHASSIS_HEIGHT = 0.14493
"""Metres from the ground plane, where the base frame lies, up to the frame of the URDF's `base_link`."""

MASS_CENTRE = (0.0, 0.0, CHASSIS_HEIGHT + 0.09947)
"""Of the chassis, base frame, metres. The file has it 87 mm to the rear, where a bare Husky turns about its
rear axle; with lidar and camera in front it is balanced, and turns about its middle."""

TYRE_STIFFNESS, TYRE_DAMPING = 1e5, 2e3  # N/m, N·s/m

CHASSIS_BOTTOM = 0.136
"""Clearance under the chassis, metres."""


@dataclass(frozen=True, eq=False)
class HuskyPart:
    """One coloured mesh in its own frame and `pose_base_part`. A wheel turns about its own y axis."""

    mesh: trimesh.Trimesh
    pose: Pose
    wheel: bool


def _source() -> Path:
    return Path(pybullet_data.getDataPath()) / "husky" / "husky.urdf"


@cache
def driving_urdf() -> str:
    """The model reduced to what drives: the chassis and its four wheels, without meshes.

    Bullet would give a kilogram to every link for which the file has no mass (plates, bumpers, sensors):
    six kilograms too much, all of it in the wrong place. The tyres are made as stiff as pumped ones are; at
    the file's 30 kN/m they sink 4 mm.
    """
    robot = ElementTree.parse(_source()).getroot()
    kept = {"base_link"} | {f"{wheel}_link" for wheel in WHEELS}
    for element in list(robot):
        name = element.get("name", "")
        if not (element.tag == "link" and name in kept) and not (element.tag == "joint" and name in WHEELS):
            robot.remove(element)
            continue
        for visual in element.findall("visual"):
            element.remove(visual)
        for field, value in (("stiffness", TYRE_STIFFNESS), ("damping", TYRE_DAMPING)):
            for setting in element.findall(f"contact/{field}"):
                setting.set("value", f"{value:g}")
        if name == "base_link":
            x, y, z = MASS_CENTRE
            for origin in element.findall("inertial/origin"):
                origin.set("xyz", f"{x} {y} {z - CHASSIS_HEIGHT}")
    return ElementTree.tostring(robot, encoding="unicode")


@cache
def husky_visuals() -> dict[str, HuskyPart]:
    """The real meshes by link name, `pose_base_part` with the base on the ground plane between the wheels.

    Wheels are at rest there; turning them is a rotation about their y axis by the joint's angle.
    """
    from yourdfpy import URDF  # here, because only the view needs it and it takes a second to import

    source = _source()
    # Left over from the file's template; yourdfpy takes it for a number.
    text = re.sub(r"\$\(optenv\s+\S+\s*([^)]*)\)", r"\1", source.read_text("utf-8"))
    model = URDF.load(StringIO(text), load_meshes=False)
    colours = {material.name: material.color.rgba for material in model.robot.materials if material.color}
    parts = {}
    for name, link in model.link_map.items():
        for visual in link.visuals:
            mesh = trimesh.load_mesh(source.parent / visual.geometry.mesh.filename)
            mesh.visual = ColorVisuals(mesh, face_colors=colours[visual.material.name])
            transform = model.get_transform(name, "base_footprint")
            if visual.origin is not None:
                transform = transform @ visual.origin
            pose = Pose.from_quaternion(transform[:3, 3], Rotation.from_matrix(transform[:3, :3]).as_quat())
            parts[name] = HuskyPart(mesh, pose, wheel=name.removesuffix("_link") in WHEELS)
    return parts
