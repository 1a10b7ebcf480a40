import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import embree
from scenes.embree import RAYS_WORTH_A_THREAD, Part, Tree

DEVICE = EmbreeDevice()


def soup(rng: np.random.Generator, triangles: int) -> Part:
    """Triangles of a metre or so, anywhere within 6 m."""
    corners = rng.uniform(-6.0, 6.0, (triangles, 1, 3)) + rng.uniform(-1.0, 1.0, (triangles, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3)


def rays(rng: np.random.Generator, count: int, one_eye: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = rng.uniform(-3.0, 3.0, 3 if one_eye else (count, 3))
    return tuple(x.astype(np.float32) for x in (origins, directions, rng.uniform(1.0, 20.0, count)))


def one_by_one(parts: list[Part], robust: bool) -> EmbreeScene:
    scene = EmbreeScene(DEVICE, robust=robust)
    for vertices, faces in parts:
        TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))
    return scene


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**31),
    count=st.sampled_from([1, 2, 15, 16, 17, 33, 500]),
    triangles=st.integers(1, 60),
    one_eye=st.booleans(),
    robust=st.booleans(),
    ordered=st.booleans(),
)
def test_packets_of_rays_answer_as_ray_after_ray_by_embreex_does(
    seed: int, count: int, triangles: int, one_eye: bool, robust: bool, ordered: bool
) -> None:
    rng = np.random.default_rng(seed)
    parts = [soup(rng, triangles), soup(rng, 5)]
    origins, directions, reach = rays(rng, count, one_eye)
    eyes = np.array(np.broadcast_to(origins, directions.shape))
    tree, peer = Tree(parts, robust), one_by_one(parts, robust)

    hits = tree.first_hits(origins, directions, reach, rng.permutation(count) if ordered else None)
    wanted = peer.run(eyes, directions, dists=reach.copy(), output=1)
    met = wanted["geomID"] >= 0
    np.testing.assert_array_equal(hits.part, wanted["geomID"])
    np.testing.assert_allclose(hits.distance, np.where(met, wanted["tfar"], reach), rtol=1e-5)
    np.testing.assert_array_equal(hits.triangle[met], wanted["primID"][met])
    np.testing.assert_array_equal(hits.normal[met], wanted["Ng"][met])
    assert (hits.triangle[~met] == -1).all()
    assert not hits.normal[~met].any()

    occluded = peer.run(eyes, directions, dists=reach.copy(), query="OCCLUDED") >= 0
    np.testing.assert_array_equal(tree.occluded(eyes, directions, reach), occluded)
    np.testing.assert_array_equal(occluded, met)


@pytest.fixture
def threads(monkeypatch):
    """Sets their number, whatever the cores."""

    def use(count: int) -> None:
        monkeypatch.setattr(embree, "_threads", count)
        embree._pool.cache_clear()

    yield use
    embree._pool.cache_clear()


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("one_eye", [False, True])
def test_the_number_of_threads_changes_no_bit(one_eye: bool, robust: bool, threads) -> None:
    rng = np.random.default_rng(1)
    tree = Tree([ground()], robust)
    some_rays = rays(rng, 3 * RAYS_WORTH_A_THREAD + 5, one_eye)
    order = rng.permutation(len(some_rays[1]))
    for way in (None, order):
        answers = []
        for count in (1, 2, 3):
            threads(count)
            answers.append(tree.first_hits(*some_rays, way))
        for answer in answers[1:]:
            for name, numbers in answer._asdict().items():
                np.testing.assert_array_equal(numbers, getattr(answers[0], name))


def ground(samples: int = 41) -> Part:
    """A grid of steps, on which many rays through its corners meet several triangles at once."""
    x, y = np.meshgrid(np.arange(samples) - samples // 2, np.arange(samples) - samples // 2)
    vertices = np.column_stack([x.ravel(), y.ravel(), ((x + y) % 3).ravel() - 4.0])
    a = (np.arange(samples - 1)[:, None] * samples + np.arange(samples - 1)).ravel()
    far = a + samples + 1
    return vertices, np.concatenate([np.column_stack([a, a + 1, far]), np.column_stack([a, far, far - 1])])


def test_the_order_of_rays_moves_no_hit_even_in_the_corners_of_triangles() -> None:
    vertices, faces = ground()
    tree, eye = Tree([(vertices, faces)]), np.array([0.0, 0.0, 3.0])
    ways = vertices[faces].mean(1) - eye, vertices - eye, vertices[faces[:, :2]].mean(1) - eye
    directions, reach = np.concatenate(ways), np.full(sum(map(len, ways)), 2.0)
    plain = tree.first_hits(eye, directions, reach)
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(directions))
        hits = tree.first_hits(eye, directions, reach, order)
        np.testing.assert_allclose(hits.distance, plain.distance, rtol=1e-6)
    inside = slice(0, len(faces))
    assert (plain.part[inside] == 0).all()


def test_the_same_meshes_give_the_same_bits() -> None:
    rng = np.random.default_rng(4)
    parts = [soup(rng, 3000), ground()]
    some_rays = rays(rng, 5000, True)
    first = Tree(parts).first_hits(*some_rays)
    for _ in range(4):
        for name, numbers in Tree(parts).first_hits(*some_rays)._asdict().items():
            np.testing.assert_array_equal(numbers, getattr(first, name))


@pytest.mark.parametrize("one_eye", [False, True])
@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_ray_that_is_not_finite_meets_nothing_and_spoils_no_other(broken: float, one_eye: bool) -> None:
    rng = np.random.default_rng(2)
    tree = Tree([soup(rng, 300)])
    origins, directions, reach = rays(rng, 64, one_eye)
    sound = tree.first_hits(origins, directions, reach)
    directions[20, 1] = broken
    hits = tree.first_hits(origins, directions, reach)
    others = np.arange(64) != 20
    assert hits.part[20] == -1
    np.testing.assert_array_equal(hits.part[others], sound.part[others])
    np.testing.assert_array_equal(hits.distance[others], sound.distance[others])


@given(st.integers(0, 2**31))
def test_rays_along_the_axes_are_as_single_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree, eye = Tree([ground(9)]), rng.uniform(-3.0, 3.0, 3)
    directions = rng.choice([-1.0, 1.0, 0.0, -0.0, -1e-20, 1e-20, -1e-30], (200, 3))
    directions[~(np.abs(directions) == 1.0).any(1), 2] = -1.0
    reach = np.full(200, np.inf)
    together = tree.first_hits(eye, directions, reach)
    alone = tree.first_hits(np.tile(eye, (200, 1)), directions, reach)
    np.testing.assert_array_equal(together.distance, alone.distance)
    np.testing.assert_array_equal(together.part, alone.part)


def test_any_layout_and_type_of_array_means_the_same() -> None:
    rng = np.random.default_rng(3)
    tree = Tree([soup(rng, 100), (np.zeros((0, 3)), np.zeros((0, 3), int)), soup(rng, 100)])
    origins, directions, reach = rays(rng, 50, False)
    plain = tree.first_hits(origins, directions, reach)
    assert set(plain.part) == {-1, 0, 2}
    odd = np.asfortranarray(origins.astype(float)), np.repeat(directions, 2, axis=0)[::2], reach.copy()
    odd[2].flags.writeable = False
    for order in (None, np.arange(50, dtype=np.int32), np.arange(100)[::2] // 2):
        np.testing.assert_array_equal(tree.first_hits(*odd, order).distance, plain.distance)


@pytest.mark.parametrize(
    ("origins", "directions", "reach", "order"),
    [
        ((7, 3), (8, 3), (8,), None),
        ((1, 3), (8, 3), (8,), None),
        ((8, 3), (8, 2), (8,), None),
        ((8, 3), (8, 3), (7,), None),
        ((3,), (8, 3), (8,), [0, 1, 2]),
        ((3,), (8, 3), (8,), [0, 1, 2, 3, 4, 5, 6, 8]),
        ((3,), (8, 3), (8,), [-1, 1, 2, 3, 4, 5, 6, 7]),
    ],
)
def test_what_is_not_of_the_right_shape_is_refused(origins, directions, reach, order) -> None:
    tree = Tree([ground()])
    with pytest.raises(ValueError, match=r"rays must be|an order of 8 rays"):
        tree.first_hits(np.zeros(origins), np.zeros(directions), np.zeros(reach), order and np.array(order))
    with pytest.raises(ValueError, match=r"must be \(n, 3\)"):
        Tree([(np.zeros((4, 2)), np.zeros((1, 3), int))])


def test_a_tree_of_nothing_is_hit_by_nothing() -> None:
    tree = Tree([])
    origins, directions, reach = rays(np.random.default_rng(0), 20, False)
    hits = tree.first_hits(origins, directions, reach)
    assert (hits.part == -1).all()
    np.testing.assert_array_equal(hits.distance, reach)
    assert not tree.occluded(origins, directions, reach).any()
    assert tree.first_hits(origins[:0], directions[:0], reach[:0]).part.shape == (0,)


def test_a_tree_does_not_leave_its_process() -> None:
    tree = Tree([ground()])
    for leave in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match="cannot leave its process"):
            leave(tree)


def test_trees_come_and_go_while_others_are_asked() -> None:
    rng = np.random.default_rng(5)
    tree, some_rays = Tree([soup(rng, 500)]), rays(rng, 4000, True)
    wanted = tree.first_hits(*some_rays).distance

    def ask(_: int) -> bool:
        return bool((tree.first_hits(*some_rays).distance == wanted).all())

    def build(number: int) -> bool:
        return Tree([soup(np.random.default_rng(number), 200)]).first_hits(*some_rays).part.max() == 0

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(lambda n: (ask if n % 2 else build)(n), range(60)))


def test_what_embree_complains_of_is_told(monkeypatch) -> None:
    monkeypatch.setattr(embree, "_TRIANGLES", 999)  # no such kind
    with pytest.raises(RuntimeError, match="Embree could not build the tree"):
        Tree([ground()])
    monkeypatch.undo()
    Tree([ground()])
