"""What a scene is made of, as bodies in a physics client: ground, walls, cover, walkers and the Husky.

Each function takes the client of a `scenes.physics.World` and returns Bullet's id of the body it made.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scenes.husky import WHEELS, driving_urdf
from scenes.meshes import CollisionBox, CollisionHull, collision_shape, cover_mesh, cover_pose
from scenes.scenario import CoverObject, MovingObstacle, ObstacleKind
from scenes.terrain import Heightmap

GROUND_FRICTION = 0.9
"""Rubber on dry earth, so that the Husky holds and climbs 22°."""

COVER_FRICTION = 0.4
"""Less than ground, so that wheels do not climb walls."""

SIDEWAYS_GRIP = 0.5
"""A tyre's grip across, as a share of that along. With equal grip the wheels stick and slip by turns and the
robot turns in jerks of ±0.5 rad/s; with less than 0.4 it slides down a slope of 20° that it crosses."""

WALL_HEIGHT, WALL_THICKNESS = 4.0, 4.0  # metres, over the highest ground


def add_ground(client: Any, heightmap: Heightmap, *, seen: bool = False) -> int:
    """The height field, in the split of `Heightmap.triangles`; `seen` by Bullet's renderer, too."""
    heights = heightmap.heights.astype(np.float32)
    rows, columns = heights.shape
    shape = client.createCollisionShape(
        client.GEOM_HEIGHTFIELD,
        meshScale=(heightmap.resolution, heightmap.resolution, 1.0),
        heightfieldData=heights.ravel().tolist(),
        numHeightfieldRows=columns,  # Bullet's rows are samples along x
        numHeightfieldColumns=rows,
        # Without it, tyres that slide sideways jam on the edges between coplanar triangles.
        flags=client.GEOM_CONCAVE_INTERNAL_EDGE,
    )
    # Bullet centres a height field on the middle of its range.
    middle = 0.5 * (float(heights.min()) + float(heights.max()))
    # A speck to look at spares the copy of the ground that Bullet would make for its renderer.
    visual = -1 if seen else client.createVisualShape(client.GEOM_SPHERE, radius=1e-3)
    # Only for a multibody does Bullet heed the flag about edges.
    ground = client.createMultiBody(0.0, shape, visual, basePosition=(0.0, 0.0, middle))
    client.changeDynamics(ground, -1, lateralFriction=GROUND_FRICTION)
    return ground


def add_walls(client: Any, heightmap: Heightmap) -> None:
    """Walls around the outermost samples, over which nothing drives."""
    west, east, south, north = heightmap.bounds
    low, high = float(heightmap.heights.min()) - 1.0, float(heightmap.heights.max()) + WALL_HEIGHT
    half, half_height = 0.5 * WALL_THICKNESS, 0.5 * (high - low)
    along_x = (east + WALL_THICKNESS, half, half_height)
    along_y = (half, north + WALL_THICKNESS, half_height)
    for extents, x, y in (
        (along_x, 0.0, south - half),
        (along_x, 0.0, north + half),
        (along_y, west - half, 0.0),
        (along_y, east + half, 0.0),
    ):
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=extents)
        _add(client, shape, (x, y, 0.5 * (low + high)), friction=0.0)


def add_cover(client: Any, heightmap: Heightmap, thing: CoverObject, *, mesh: bool = False) -> int:
    """A cover object where it stands: what a robot runs into or, with `mesh`, all that is seen of it."""
    shape, visual = _mesh(client, thing) if mesh else (_shape(client, thing), -1)
    pose = cover_pose(heightmap, thing)
    return _add(client, shape, pose.position, pose.quaternion, visual=visual)


def add_obstacle(client: Any, thing: MovingObstacle) -> int:
    """A person or vehicle at the origin, its frame in its middle."""
    length, width, height = thing.size
    if thing.kind is ObstacleKind.PERSON:
        shape = client.createCollisionShape(client.GEOM_CYLINDER, radius=0.5 * length, height=height)
    else:
        extents = (0.5 * length, 0.5 * width, 0.5 * height)
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=extents)
    return _add(client, shape, (0.0, 0.0, 0.0), moves=True)


def add_husky(client: Any) -> tuple[int, Sequence[int]]:
    """The robot and its wheels' joints: front left, front right, rear left, rear right."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "husky.urdf"
        path.write_text(driving_urdf(), "utf-8")
        # A true cylinder rolls more evenly than the polygon that Bullet would make of it, and is faster.
        robot = client.loadURDF(str(path), flags=client.URDF_USE_IMPLICIT_CYLINDER)
    joints = {
        client.getJointInfo(robot, index)[1].decode(): index for index in range(client.getNumJoints(robot))
    }
    wheels = [joints[wheel] for wheel in WHEELS]
    for wheel in wheels:
        client.changeDynamics(robot, wheel, anisotropicFriction=(1.0, SIDEWAYS_GRIP, 1.0))
    return robot, wheels


def _add(
    client: Any,
    shape: int,
    position,
    orientation=(0.0, 0.0, 0.0, 1.0),
    *,
    friction=COVER_FRICTION,
    visual=-1,
    moves=False,
) -> int:
    # As a plain rigid body: as multibodies, thousands of trees would take four times as long.
    body = client.createMultiBody(
        0.0,
        shape,
        visual,
        basePosition=position,
        baseOrientation=orientation,
        useMaximalCoordinates=True,
    )
    client.changeDynamics(body, -1, lateralFriction=friction)
    if not moves:
        # Bullet looks after a body that is awake at every step; one that sleeps still stops what meets it.
        client.changeDynamics(body, -1, activationState=client.ACTIVATION_STATE_SLEEP)
    return body


def _shape(client: Any, thing: CoverObject) -> int:
    shape = collision_shape(thing)
    if isinstance(shape, CollisionHull):  # Bullet makes a convex hull of points without triangles
        return client.createCollisionShape(client.GEOM_MESH, vertices=shape.points.tolist())
    if isinstance(shape, CollisionBox):
        return client.createCollisionShape(
            client.GEOM_BOX, halfExtents=shape.half_extents, collisionFramePosition=shape.center
        )
    return client.createCollisionShape(
        client.GEOM_CYLINDER, radius=shape.radius, height=shape.height, collisionFramePosition=shape.center
    )


def _mesh(client: Any, thing: CoverObject) -> tuple[int, int]:
    mesh = cover_mesh(thing)
    vertices, indices = mesh.vertices.tolist(), mesh.faces.ravel().tolist()
    shape = client.createCollisionShape(
        client.GEOM_MESH, vertices=vertices, indices=indices, flags=client.GEOM_FORCE_CONCAVE_TRIMESH
    )
    visual = client.createVisualShape(
        client.GEOM_MESH, vertices=vertices, indices=indices, normals=mesh.vertex_normals.tolist()
    )
    return shape, visual
