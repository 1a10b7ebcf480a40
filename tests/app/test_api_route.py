"""`POST /api/route`: covert routes of the scenario as it is."""

import math
from itertools import pairwise

import pytest
from served import BEARER, application, browser, silent_studio

from scenes.scenario import CoverSpec, Patrol, Point

WAY = {"from": {"x": -3.0, "y": 0.0}, "to": {"x": 3.0, "y": 0.0}}


@pytest.fixture
def studio(tmp_path, meadow):
    return silent_studio(tmp_path, meadow)


@pytest.fixture
def client(studio):
    with browser(application(studio), **BEARER) as client:
        yield client


def test_a_route_leads_from_one_end_to_the_other_with_its_figures(client):
    route = client.post("/api/route", json=WAY | {"exposure_weight": 0.0}).json()
    assert route["points"][0] == [-3.0, 0.0] and route["points"][-1] == [3.0, 0.0]
    corners = route["points"]
    assert route["length_m"] == pytest.approx(sum(math.dist(a, b) for a, b in pairwise(corners)), abs=0.01)
    assert 0.0 <= route["exposure_s"] <= route["duration_s"] + 1e-9
    assert 0.0 <= route["detection_probability"] <= 1.0 and route["cost"] > 0.0
    assert route["times"] is None and route["waits"] == []


def test_more_weight_is_not_more_exposure(client, studio):
    studio.add_cover(CoverSpec(kind="cottage", x=0.0, y=3.5, length=5.0, width=2.0))
    seen = [
        client.post("/api/route", json=WAY | {"exposure_weight": weight}).json()["exposure_s"]
        for weight in (0.0, 0.5, 1.0)
    ]
    assert seen[2] <= seen[1] + 0.1 <= seen[0] + 0.2


def test_with_a_patrol_every_point_has_its_time(client, studio):
    beat = Patrol(waypoints=(Point(x=-6.0, y=8.0),), speed=2.0)
    studio.update_observer(1, {"patrol": beat.model_dump()})
    route = client.post("/api/route", json=WAY | {"exposure_weight": 0.9}).json()
    assert len(route["times"]) == len(route["points"]) and route["times"] == sorted(route["times"])
    assert route["times"][-1] == pytest.approx(route["duration_s"], abs=0.01)


def test_without_a_way_the_answer_says_what_blocks_it(client, studio):
    for y in (-6.0, 0.0, 6.0):
        studio.add_cover(CoverSpec(kind="house", x=0.0, y=y, length=1.5, width=9.0))
    answer = client.post("/api/route", json=WAY)
    assert answer.status_code == 422
    assert (
        "every way to the goal is blocked" in answer.json()["detail"] and "house" in answer.json()["detail"]
    )


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (WAY | {"exposure_weight": 1.5}, "exposure_weight"),
        (WAY | {"weight": 1.0}, "weight"),
        ({"from": WAY["from"]}, "to"),
        (WAY | {"to": {"x": 500.0, "y": 0.0}}, "off the map"),
        (WAY | {"to": {"x": True, "y": 0.0}}, "to.x"),
    ],
)
def test_what_cannot_be_met_is_422(client, body, words):
    answer = client.post("/api/route", json=body)
    assert answer.status_code == 422 and words in answer.json()["detail"]
