"""`/api/exposure`: figures, grids and the line of sight, of the scenario as it is."""

import io

import numpy as np
import pytest
from served import BEARER, application, browser, silent_studio

from scenes.scenario import CoverSpec, ObserverSpec, Patrol, Point


@pytest.fixture
def studio(tmp_path, meadow):
    return silent_studio(tmp_path, meadow)


@pytest.fixture
def client(studio):
    with browser(application(studio), **BEARER) as client:
        yield client


def grid(client, query: str = "") -> np.ndarray:
    answer = client.get(f"/api/exposure?format=npy{query}")
    assert answer.status_code == 200 and answer.headers["content-type"] == "application/octet-stream"
    return np.load(io.BytesIO(answer.content), allow_pickle=False)


def test_the_figures_are_those_of_the_grid(client):
    document = client.get("/api/exposure").json()
    seen = grid(client)
    assert seen.dtype == np.float32 and seen.shape == (document["rows"], document["cols"]) == (41, 41)
    assert document["united"]["fraction"] == pytest.approx(np.mean(seen >= 0.5), abs=1e-6)
    assert document["united"]["mean"] == pytest.approx(seen.mean(), abs=1e-5)
    assert document["united"]["area_m2"] == np.count_nonzero(seen >= 0.5) * 0.25
    assert document["observers"] == [{"id": 1} | document["united"]]
    assert document["unknown_area_m2"] == 0.0
    assert (document["x_min"], document["y_min"], document["resolution"]) == (-10.0, -10.0, 0.5)


def test_an_edit_is_in_the_next_answer(client, studio):
    before = grid(client)
    second = studio.add_observer(ObserverSpec(x=-8.0, y=-8.0, fov_horizontal=360.0))
    after, alone = grid(client), grid(client, f"&observer={second.id}")
    assert after.sum() > before.sum() and np.array_equal(after, np.maximum(before, alone))
    assert np.array_equal(grid(client, "&layer=count"), (before >= 0.5) + (alone >= 0.5).astype(int))
    studio.add_cover(CoverSpec(kind="cottage", x=0.0, y=0.0, length=4.0, width=3.0))
    assert grid(client).sum() < after.sum()


def test_the_mean_over_a_beat_is_not_the_moment(client, studio):
    beat = Patrol(waypoints=(Point(x=-6.0, y=8.0),), speed=2.0)
    studio.update_observer(1, {"patrol": beat.model_dump()})
    now, mean = grid(client), grid(client, "&over=beats")
    assert set(np.unique(now)) <= {0.0, np.float32(0.1), 1.0}
    assert np.any((mean > 0.3) & (mean < 0.7))


def test_without_observers_nothing_is_seen(client, studio):
    studio.delete_observer(1)
    assert client.get("/api/exposure").json()["united"] == {"fraction": 0.0, "area_m2": 0.0, "mean": 0.0}
    assert not grid(client).any()


def test_the_profile_is_a_section_under_the_line(client):
    profile = client.get("/api/exposure/profile?observer=1&x=0&y=-2").json()
    lengths = {len(profile[name]) for name in ("distance_m", "ground_m", "cover_m", "sight_m")}
    assert lengths == {len(profile["distance_m"])}
    assert profile["eye"] == {"x": 0.0, "y": 8.0, "z": 1.7} and profile["target"]["y"] == -2.0


def test_the_profile_of_a_wall_names_it_and_the_place(client, studio):
    wall = studio.add_cover(CoverSpec(kind="cottage", x=0.0, y=0.0, length=4.0, width=3.0, height=3.0))
    profile = client.get("/api/exposure/profile?observer=1&x=0&y=-6").json()
    assert not profile["seen"] and profile["light"] == 0.0
    assert profile["blocked_by"] in (
        {"kind": "cover", "id": wall.id, "name": f"cottage {wall.id}"},
        {"kind": "cover", "id": 1, "name": "tree 1"},
    )
    assert profile["blocking_point"]["y"] < 8.0
    assert max(height for height in profile["cover_m"] if height is not None) >= 2.0


@pytest.mark.parametrize(
    ("query", "status"),
    [
        ("?format=xml", 422),
        ("?stride=0", 422),
        ("?format=npy&observer=7", 404),
        ("/profile?observer=7&x=0&y=0", 404),
        ("/profile?observer=1&x=nan&y=0", 422),
        ("/profile?observer=1&x=1e400&y=0", 422),
        ("/profile?observer=1&x=11&y=0", 422),
        ("/profile?observer=0&x=0&y=0", 422),
        ("/profile?x=0&y=0", 422),
    ],
)
def test_what_cannot_be_asked_is_refused_in_words(client, query, status):
    answer = client.get(f"/api/exposure{query}")
    assert answer.status_code == status and answer.json()["detail"]
