import numpy as np
from grounds import ground, rough, thing

from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import MovingObstacle
from scenes.sensors import SemanticCamera
from scenes.shading import AMBIENT, SKY_COLOUR, SUN, SURFACE_COLOURS, shade
from scenes.terrain import SURFACES, Heightmap


def shade_twin(rays: RayScene, hits, origin, directions):
    """`shade` in plain numpy."""
    heightmap = rays.heightmap
    count = len(hits.body)
    surface, colour = np.full(count, -1, np.int8), np.tile(np.array(SKY_COLOUR, float), (count, 1))
    grounded = hits.body == 0
    points = origin[:2] + hits.distance[grounded, None].astype(float) * directions[grounded, :2]
    cells = [heightmap.cell(x, y) for x, y in points]
    surface[grounded] = [heightmap.surface[cell] for cell in cells]
    colour[grounded] = [SURFACE_COLOURS[SURFACES[heightmap.surface[cell]]] for cell in cells]
    starts, table = rays.colours
    covered = hits.body > 0
    colour[covered] = table[starts[hits.body[covered]] + hits.triangle[covered]]
    hit = hits.body >= 0
    normal = hits.normal[hit] / np.linalg.norm(hits.normal[hit], axis=1, keepdims=True)
    toward = -np.sign(np.einsum("ij,ij->i", normal, directions[hit]))
    light = np.clip(toward * (normal @ SUN), 0.0, 1.0)
    colour[hit] *= (AMBIENT + (1.0 - AMBIENT) * light)[:, None]
    return surface, colour


def test_the_kernel_shades_as_plain_numpy_does() -> None:
    heightmap = rough(1)
    surface = np.random.default_rng(0).integers(0, len(SURFACES), heightmap.shape).astype(np.uint8)
    heightmap = Heightmap(heightmap.heights, heightmap.resolution, surface, heightmap.quality)
    rays = RayScene(heightmap, [thing("tree", 5, 1), thing("house", 8, -6, id=2, yaw=20)])
    rays.set_walkers([MovingObstacle(id=1, kind="vehicle", x=6.0, y=4.0)])
    directions = SemanticCamera().directions
    origin = np.array([0.0, 0.0, 1.0])
    hits = rays.cast(origin, directions, 15.0)
    assert set(hits.body) == {-1, 0, 1, 2, 3}
    shading = shade(rays, hits, origin, directions)
    surface, colour = shade_twin(rays, hits, origin, directions)
    assert np.mean(shading.surface == surface) > 0.9999  # a point on a cell's border may round either way
    same = shading.surface == surface
    np.testing.assert_allclose(shading.rgb[same].astype(float), colour[same], atol=0.51)


def test_a_face_to_the_sun_is_brighter_than_one_turned_away() -> None:
    rays = RayScene(ground(), [thing("building", 0, 0, yaw=float(np.degrees(np.arctan2(SUN[1], SUN[0]))))])
    sunward = np.array([SUN[0], SUN[1], 0.0]) / np.hypot(SUN[0], SUN[1])
    middle = np.array([0.0, 0.0, 2.0])
    eyes = np.array([middle + 12.0 * sunward, middle - 12.0 * sunward])
    looks = np.array([-sunward, sunward])
    hits = rays.cast(eyes, looks, 20.0)
    assert (hits.body == 1).all()
    lit, dark = (shade(rays, hits, eyes[0], looks.astype(np.float32)).rgb.astype(float)).sum(axis=1)
    assert lit > dark


def test_an_image_does_not_depend_on_which_side_a_face_was_wound() -> None:
    inside = RayScene(ground(), [thing("building", 0, 0)])
    origin = Pose(0.0, 0.0, 1.5).position
    directions = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], np.float32)
    hits = inside.cast(origin, directions, 30.0)
    rgb = shade(inside, hits, origin, directions).rgb
    assert (hits.body == 1).all()
    assert (rgb > 0).any(axis=1).all()
