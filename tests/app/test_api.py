"""The interface: scenarios, mission, things in the scene, runs, methods."""

from datetime import UTC, datetime

import pytest
from served import BEARER, OPEN_ID, application, browser, silent_studio

from app.api.upload import harmless_name
from app.changes import Change
from planner.frames import Status
from planner.methods import METHODS
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.scenario import Scenario

OBSERVER = {"x": 1.0, "y": 6.0, "yaw": 90, "range": 12.5, "patrol": {"waypoints": [{"x": 2, "y": 6}]}}


@pytest.fixture
def studio(tmp_path, meadow):
    return silent_studio(tmp_path, meadow)


@pytest.fixture
def client(studio):
    return browser(application(studio), **BEARER)


def test_the_mission_says_where_the_robot_is_in_metres_and_degrees(client, studio):
    studio.set_start(-3.0, 0.0, 45.0)
    mission = client.get("/api/mission").json()
    assert mission["status"] == "idle" and mission["time_s"] == 0.0 and mission["error"] is None
    assert mission["pose"] == {"x": -3.0, "y": 0.0, "z": 0.0, "roll": 0.0, "pitch": 0.0, "yaw": 45.0}
    assert mission["goal"] == {"x": 3.0, "y": 0.0}
    assert mission["cover"] == {"in_cover": False, "fraction": 0.0, "chosen": None}
    assert set(mission) == {
        *("status", "time_s", "method", "perception", "speed", "pose", "goal", "exposure", "cover", "error"),
        "policy",
    }


def test_every_command_reaches_the_mission_and_answers_with_its_state(client, studio):
    for command, status in (
        ("start", "running"),
        ("pause", "paused"),
        ("resume", "running"),
        ("step", "paused"),
    ):
        answer = client.post(f"/api/mission/{command}")
        assert (answer.status_code, answer.json()["status"]) == (200, status)
    for command in ("stop", "reset"):
        assert client.post(f"/api/mission/{command}").status_code == 200
    names = [order[0] for order in studio._drive.worker.orders]
    assert names == ["play", "play", "play", "step", "stop", "load"]


def test_the_settings_of_a_mission(client, studio):
    assert client.put("/api/mission/goal", json={"x": 2, "y": 1.5}).json()["goal"] == {"x": 2.0, "y": 1.5}
    assert client.put("/api/mission/speed", json={"factor": 4}).json()["speed"] == 4.0
    assert client.put("/api/mission/method", json={"name": "dwa"}).json()["method"] == "dwa"
    assert client.put("/api/mission/perception", json={"mode": "oracle"}).json()["perception"] == "oracle"
    assert client.put("/api/mission/seed", json={"seed": 7}).status_code == 200 and studio.seed == 7
    assert client.put("/api/mission/pose", json={"x": -1, "y": 1, "yaw": 180}).status_code == 200
    assert studio._drive.worker.orders[-1][:3] == ("set_pose", -1.0, 1.0)


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "reason"),
    [
        ("POST", "/api/mission/resume", None, 409, "not paused"),
        ("POST", "/api/edits/undo", None, 409, "nothing to undo"),
        ("POST", "/api/edits/redo", None, 409, "nothing to redo"),
        ("PUT", "/api/mission/goal", {"x": 50, "y": 0}, 422, "off the map"),
        ("PUT", "/api/mission/pose", {"x": 0, "y": 5, "yaw": 0}, 422, "inside a tree"),
        ("PUT", "/api/mission/speed", {"factor": 9}, 422, "factor: must be less than or equal to 8"),
        ("PUT", "/api/mission/method", {"name": "teleport"}, 404, "teleport"),
        (
            "PUT",
            "/api/mission/perception",
            {"mode": "magic"},
            422,
            "mode: must be 'lidar' or 'oracle'",
        ),
        ("PUT", "/api/mission/seed", {"seed": -1}, 422, "seed: "),
        ("PUT", "/api/mission/seed", {"seed": 1.0}, 422, "seed: "),
        ("GET", "/api/mission/start", None, 405, "Method Not Allowed"),
        ("GET", "/api/nowhere", None, 404, "/api/docs"),
        ("POST", "/api/observers", {"x": 0}, 422, "y: is missing"),
        ("POST", "/api/observers", {"x": 0, "y": 50}, 422, "off the map"),
        ("POST", "/api/observers", {"x": 0, "y": 0, "height": 2}, 422, "height: is not a field"),
        ("POST", "/api/observers", {"x": 0, "y": 0, "id": 4}, 422, "id: is not a field"),
        ("POST", "/api/observers", {"x": 0, "y": 0, "patrol": {"waypoints": []}}, 422, "patrol.waypoints: "),
        ("POST", "/api/observers", {"x": 0, "y": 0, "name": "<script>"}, 422, "name: "),
        ("POST", "/api/cover", {"kind": "castle", "x": 0, "y": 0}, 422, "kind: "),
        ("POST", "/api/cover", {"kind": "house", "x": 3, "y": 0}, 422, "goal is inside a house"),
        ("POST", "/api/obstacles", {"kind": "person", "x": 0, "y": 0, "yaw": 400}, 422, "yaw: "),
        ("PATCH", "/api/observers/1", {"fov_horizontal": 400}, 422, "fov_horizontal: "),
        ("PATCH", "/api/observers/1", {"x": None}, 422, "x: "),
        ("PATCH", "/api/observers/1", {"id": 2}, 422, "id: is not a field"),
        ("PATCH", "/api/observers/7", {"x": 0}, 404, "no observer 7"),
        ("PATCH", "/api/observers/x", {"x": 0}, 422, "id: "),
        ("DELETE", "/api/observers/99999999999999999999", None, 422, "id: "),
        ("DELETE", "/api/cover/9", None, 404, "no cover object 9"),
        ("GET", "/api/scenarios/nowhere", None, 404, "nowhere"),
        ("GET", "/api/scenarios/..", None, 404, ""),
        ("GET", "/api/scenarios/%2e%2e%2fruns", None, 404, ""),
        ("PUT", "/api/scenarios/nowhere", {}, 422, "name: is missing"),
        ("POST", "/api/scenarios/nowhere/open", None, 404, "nowhere"),
        ("DELETE", "/api/scenarios/nowhere", None, 404, "nowhere"),
        ("POST", "/api/scenarios/generate", {"terrain": "moon", "seed": 1}, 422, "terrain: "),
        ("POST", "/api/scenarios/save", {"name": ""}, 422, "name: "),
        ("GET", "/api/runs/1", None, 404, "no run 1"),
        ("GET", "/api/runs/0/frames", None, 422, "id: "),
        ("GET", "/api/runs?limit=1000000", None, 422, "limit: "),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(client, studio, method, path, body, status, reason):
    before = studio.scenario
    answer = client.request(method, path, json=body) if body is not None else client.request(method, path)
    assert answer.status_code == status, answer.text
    assert reason in answer.json()["detail"]
    assert studio.scenario is before


@pytest.mark.parametrize(
    ("field", "spec", "change", "refused"),
    [
        ("observers", OBSERVER, {"yaw": 10, "patrol": None}, {"range": -1}),
        ("cover", {"kind": "rock", "x": -5, "y": -5}, {"length": 3.0}, {"kind": "none"}),
        ("obstacles", {"kind": "person", "x": 5, "y": -5}, {"name": "postman"}, {"patrol": 3}),
    ],
)
def test_things_are_added_changed_and_deleted(client, studio, field, spec, change, refused):
    there_were = len(client.get(f"/api/{field}").json())
    added = client.post(f"/api/{field}", json=spec)
    assert added.status_code == 201
    number = added.json()["id"]
    address = added.headers["location"]
    assert address == f"/api/{field}/{number}"
    assert {key: added.json()[key] for key in ("x", "y")} == {key: spec[key] for key in ("x", "y")}
    changed = client.patch(address, json=change)
    assert changed.status_code == 200 and changed.json() == added.json() | change
    assert client.patch(address, json=refused).status_code == 422
    assert changed.json() in client.get(f"/api/{field}").json()
    assert client.delete(address).status_code == 204
    assert client.delete(address).status_code == 404
    assert len(client.get(f"/api/{field}").json()) == there_were


def test_a_cover_object_takes_the_usual_size_of_its_class_and_keeps_a_size_through_changes(client):
    rock = client.post("/api/cover", json={"kind": "rock", "x": -5, "y": -5, "height": 2.25}).json()
    assert rock["length"] > 0.0 and rock["height"] == 2.25
    moved = client.patch(f"/api/cover/{rock['id']}", json={"x": -6}).json()
    assert moved == rock | {"x": -6.0}
    usual = client.patch(f"/api/cover/{rock['id']}", json={"kind": "bush", "height": None}).json()
    assert usual["height"] == CATALOGUE[CoverKind.BUSH].height.usual and usual["length"] == rock["length"]
    assert client.patch(f"/api/cover/{rock['id']}", json={"x": None}).status_code == 422


def test_an_edit_is_undone_and_redone(client):
    client.post("/api/observers", json=OBSERVER)
    assert client.post("/api/edits/undo").status_code == 200
    assert len(client.get("/api/observers").json()) == 1
    assert client.post("/api/edits/redo").status_code == 200
    assert len(client.get("/api/observers").json()) == 2


def test_a_scenario_is_sent_fetched_replaced_opened_and_deleted(client, studio, meadow):
    told = []
    studio.subscribe(told.append)
    text = meadow.to_json()
    made = client.post("/api/scenarios", content=text, headers={"Content-Type": "application/json"})
    assert made.status_code == 201 and made.headers["location"] == "/api/scenarios/test-meadow"
    assert Change.LIBRARY in told and studio.scenario_id == OPEN_ID
    fetched = client.get("/api/scenarios/test-meadow")
    assert Scenario.model_validate_json(fetched.text).to_json() == text
    other = meadow.revised(name="Another").to_json()
    assert client.put("/api/scenarios/test-meadow", content=other, headers=JSON).status_code == 200
    entry = {e["id"]: e for e in client.get("/api/scenarios").json()}["test-meadow"]
    assert entry["name"] == "Another" and not entry["shipped"]
    assert client.post("/api/scenarios/test-meadow/open").json()["status"] == "idle"
    assert studio.scenario.name == "Another" and Change.OPENED in told
    assert client.delete("/api/scenarios/test-meadow").status_code == 204
    assert client.post("/api/scenarios/test-meadow/open").status_code == 404


JSON = {"Content-Type": "application/json"}


def test_the_open_scenario_can_be_fetched_before_it_was_ever_saved(client, meadow):
    assert client.get(f"/api/scenarios/{OPEN_ID}").json()["name"] == meadow.name


def test_shipped_scenarios_stay(client, meadow):
    shipped = [entry["id"] for entry in client.get("/api/scenarios").json() if entry["shipped"]]
    assert shipped
    for answer in (
        client.delete(f"/api/scenarios/{shipped[0]}"),
        client.put(f"/api/scenarios/{shipped[0]}", content=meadow.to_json(), headers=JSON),
    ):
        assert answer.status_code == 409 and "shipped" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda t: t.replace('"version": 1', '"version": 2'), "version: "),
        (lambda t: t.replace('"resolution": 0.5', '"resolution": 1e400'), "resolution: "),
        (lambda t: t.replace('"resolution": 0.5', '"resolution": NaN'), "resolution: "),
        (lambda t: t.replace("[0.0,0.0", "[NaN,0.0", 1), "terrain.heights: row 0, column 0"),
        (lambda t: t.replace("[0.0,0.0", "[true,0.0", 1), "terrain.heights: row 0, column 0"),
        (lambda t: t.replace("[0.0,0.0", "[1e400,0.0", 1), "terrain.heights: row 0, column 0"),
        (lambda t: t.replace("[0.0,0.0", "[0.0", 1), "terrain.heights: row"),
        (lambda t: t.replace('"description": ""', '"describtion": ""'), "describtion: is not a field"),
        (lambda t: t.replace('"name": "Test meadow",', ""), "name: is missing"),
        (lambda t: t[:-40], "Invalid JSON"),
        (lambda t: "[" * 100_000, "Invalid JSON"),
        (lambda t: '{"cover": [' + '{"id":1},' * 200_000 + "{}]}", "is missing"),
    ],
)
def test_a_damaged_document_is_refused_with_the_place(client, meadow, damage, reason):
    answer = client.post("/api/scenarios", content=damage(meadow.to_json()), headers=JSON)
    assert answer.status_code == 422, answer.text
    assert reason in answer.json()["detail"] and len(answer.text) < 3000


def test_edits_made_here_can_be_saved(client, studio):
    client.put("/api/mission/goal", json={"x": 1, "y": 1})
    saved = client.post("/api/scenarios/save", json={})
    assert saved.json()["id"] == OPEN_ID and not studio.dirty
    copy = client.post("/api/scenarios/save", json={"name": "Second try"})
    assert copy.json() == {"id": "second-try", "name": "Second try"}
    assert client.get("/api/scenarios/second-try").json()["goal"] == {"x": 1.0, "y": 1.0}


def test_a_scenario_document_can_be_uploaded_too(client, studio, meadow):
    files = {"file": ("../my scene.json", meadow.to_json(), "application/json")}
    answer = client.post("/api/scenarios/import", files=files)
    assert answer.status_code == 201 and answer.json()["id"] == studio.scenario_id
    assert not list((studio.store.workspace / "uploads").iterdir())


@pytest.mark.parametrize(
    ("files", "data", "reason"),
    [
        ({"file": ("a.laz", b"LASF" + b"\0" * 400)}, {}, "a.laz"),
        ({"file": ("a.tif", b"II*\0" + b"\0" * 400)}, {}, "a.tif"),
        ({"file": ("a.laz", b"")}, {}, "a.laz"),
        ({"file": ("a.json", b"{}")}, {}, "a.json"),
        ({"file": ("a.json", b"\xff\xfe")}, {}, "a.json"),
        ({"other": ("a.laz", b"LASF")}, {}, "field 'file'"),
        ({"file": ("a.laz", b"LASF")}, {"crop": "1 2"}, "crop"),
        ({"file": ("a.laz", b"LASF")}, {"crop": "1 2 nan"}, "crop[2]"),
        ({"file": ("a.laz", b"LASF")}, {"resolution": "fine"}, "resolution: "),
        ({"file": ("a.laz", b"LASF")}, {"vertical_scale": "1e400"}, "vertical_scale: "),
        ({"file": ("a.laz", b"LASF")}, {"colour": "red"}, "colour: is not a field"),
        ({"file": ("a.laz", b"LASF")}, {"crop": "1" * 5000}, "longer than"),
    ],
)
def test_an_upload_that_cannot_be_used_is_refused_by_its_own_name(client, studio, files, data, reason):
    answer = client.post("/api/scenarios/import", files=files, data=data)
    assert answer.status_code == 422, answer.text
    detail = answer.json()["detail"]
    assert reason in detail and str(studio.store.workspace) not in detail
    assert not list((studio.store.workspace / "uploads").iterdir())


@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        ("survey.laz", "survey.laz"),
        ("../../etc/passwd", "passwd"),
        ("C:\\maps\\hill.tif", "hill.tif"),
        ("..", "upload"),
        ("", "upload"),
        ("a\x00b<c>.laz", "a_b_c_.laz"),
        ("höhe.laz", "h_he.laz"),
        ("x" * 300 + ".laz", "x" * 40 + ".laz"),
    ],
)
def test_names_of_uploads_are_made_harmless(sent, kept):
    assert harmless_name(sent) == kept


def test_runs_are_listed_and_their_frames_given_in_degrees(client, studio, meadow):
    summary = {"scenario": meadow.name, "status": Status.REACHED.value, "success": True}
    rows = [(0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 3.141592653589793, 0.5, 0.0, 0.75, 0.2)]
    number = studio.store.add_run(OPEN_ID, meadow, summary, rows, datetime(2024, 5, 1, tzinfo=UTC))
    (run,) = client.get("/api/runs").json()
    assert run["id"] == number and run["status"] == "reached" and run["scenario_id"] == OPEN_ID
    assert client.get(f"/api/runs/{number}").json() == run
    (frame,) = client.get(f"/api/runs/{number}/frames").json()
    assert frame["yaw"] == pytest.approx(180.0) and frame["v"] == 0.5
    assert (frame["exposure"], frame["detection_probability"]) == (0.75, 0.2)


def test_methods_are_named_and_described(client):
    methods = client.get("/api/methods").json()
    assert [method["name"] for method in methods] == list(METHODS)
    assert all(method["description"] for method in methods)


def test_the_interface_describes_itself(client):
    described = client.get("/api/openapi.json").json()
    assert {"/api/mission", "/api/scenarios/{id}", "/api/observers/{id}", "/api/runs"} <= set(
        described["paths"]
    )
    assert "Scenario" in described["components"]["schemas"]
    page = client.get("/api/docs")
    assert "/api/mission/goal" in page.text and "<script" not in page.text
    assert "default-src 'self'" in page.headers["content-security-policy"]


def test_an_error_of_ours_is_told_without_its_inner_workings(client, studio, monkeypatch):
    def fail() -> None:
        raise ZeroDivisionError("secret")

    monkeypatch.setattr(studio, "play", fail)
    answer = client.post("/api/mission/start")
    assert answer.status_code == 500 and "secret" not in answer.text
    assert answer.headers["x-content-type-options"] == "nosniff"
