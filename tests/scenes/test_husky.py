import math
from xml.etree import ElementTree

import numpy as np

from scenes.husky import (
    AXLE_X,
    AXLE_Y,
    CHASSIS_BOTTOM,
    CHASSIS_HEIGHT,
    MASS_CENTRE,
    WHEEL_RADIUS,
    WHEEL_WIDTH,
    WHEELS,
    driving_urdf,
    husky_visuals,
)
from scenes.robot import HUSKY


def test_the_driving_model_weighs_44_kg_and_has_no_link_without_a_mass() -> None:
    robot = ElementTree.fromstring(driving_urdf())
    masses = [float(link.find("inertial/mass").get("value")) for link in robot.findall("link")]
    assert len(masses) == 5
    assert math.isclose(sum(masses), 44.0, abs_tol=0.01)


def test_constants_are_those_of_the_file() -> None:
    robot = ElementTree.fromstring(driving_urdf())
    links = {link.get("name"): link for link in robot.findall("link")}
    for joint in robot.findall("joint"):
        x, y, z = (float(value) for value in joint.find("origin").get("xyz").split())
        assert (abs(x), abs(y)) == (AXLE_X, AXLE_Y)
        assert math.isclose(z + CHASSIS_HEIGHT, WHEEL_RADIUS)
        cylinder = links[joint.find("child").get("link")].find("collision/geometry/cylinder")
        assert (float(cylinder.get("radius")), float(cylinder.get("length"))) == (WHEEL_RADIUS, WHEEL_WIDTH)
    chassis = links["base_link"]
    x, y, z = (float(value) for value in chassis.find("inertial/origin").get("xyz").split())
    assert np.allclose((x, y, z + CHASSIS_HEIGHT), MASS_CENTRE)
    box = chassis.find("collision/geometry/box").get("size").split()
    middle = float(chassis.find("collision/origin").get("xyz").split()[2])
    assert math.isclose(CHASSIS_HEIGHT + middle - 0.5 * float(box[2]), CHASSIS_BOTTOM, abs_tol=1e-3)


def test_the_model_has_its_meshes_and_colours() -> None:
    parts = husky_visuals()
    assert {name for name, part in parts.items() if part.wheel} == {f"{wheel}_link" for wheel in WHEELS}
    assert len(parts) == 9
    assert tuple(parts["top_plate_link"].mesh.visual.face_colors[0]) == (204, 204, 0, 255)


def test_the_assembled_meshes_are_as_large_as_the_husky_and_stand_on_the_ground() -> None:
    points = np.concatenate([part.pose.to_world(part.mesh.vertices) for part in husky_visuals().values()])
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_allclose(high - low, [HUSKY.length, HUSKY.width, HUSKY.height], atol=0.03)
    np.testing.assert_allclose(low[2], 0.0, atol=1e-3)
    np.testing.assert_allclose((low + high)[:2], 0.0, atol=0.03)
