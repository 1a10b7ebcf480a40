import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import embree
from scenes.embree import RAYS_WORTH_A_THREAD, Part, Tree, use_threads

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
    np.testing.assert_array_equal(tree.occluded(origins, directions, reach), occluded)
    np.testing.assert_array_equal(occluded, met)


@pytest.mark.parametrize("one_eye", [False, True])
def test_the_number_of_threads_and_the_order_of_rays_change_no_bit(one_eye: bool) -> None:
    rng = np.random.default_rng(1)
    tree = Tree([soup(rng, 200)])
    some_rays = rays(rng, 3 * RAYS_WORTH_A_THREAD + 5, one_eye)
    answers = []
    before = embree._threads
    try:
        for threads in (1, 2, 3):
            use_threads(threads)
            answers.append(tree.first_hits(*some_rays))
            answers.append(tree.first_hits(*some_rays, rng.permutation(len(some_rays[1]))))
    finally:
        use_threads(before)
    for answer in answers[1:]:
        for name, numbers in answer._asdict().items():
            np.testing.assert_array_equal(numbers, getattr(answers[0], name))


def test_a_tree_of_nothing_is_hit_by_nothing() -> None:
    tree = Tree([])
    origins, directions, reach = rays(np.random.default_rng(0), 20, False)
    hits = tree.first_hits(origins, directions, reach)
    assert (hits.part == -1).all()
    np.testing.assert_array_equal(hits.distance, reach)
    assert not tree.occluded(origins, directions, reach).any()
    assert tree.first_hits(origins[:0], directions[:0], reach[:0]).part.shape == (0,)


def test_what_embree_complains_of_is_told() -> None:
    embree._EMBREE.new_geometry(embree._EMBREE.device, 999)  # no such kind
    with pytest.raises(RuntimeError, match="Embree could not build the tree"):
        Tree([])
    Tree([])
