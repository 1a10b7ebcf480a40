"""`/api/results`: evaluations are listed, shown, drawn, taken in, thrown away; bad files are refused."""

import csv
import io
import xml.etree.ElementTree as ElementTree

import pytest
from evaluations import drive, drives, results_file
from served import BEARER, application, browser

from app.results import ResultsLibrary
from app.view.view import StudioView  # noqa: F401 - the application's parts fit together

RESULTS = "/api/results/two-methods"
SQLITE = {"content-type": "application/vnd.sqlite3"}


@pytest.fixture
def client(studio):
    results_file(studio.store.workspace / "results" / "two-methods.sqlite")
    return browser(application(studio), **BEARER)


def test_the_list_says_what_there_is_and_what_is_damaged(client, studio):
    (studio.store.workspace / "results" / "broken.sqlite").write_bytes(b"hello")
    entries = {entry["id"]: entry for entry in client.get("/api/results").json()}
    assert entries["two-methods"]["methods"] == ["dwa", "covernav"]
    assert entries["two-methods"]["missions"] == 6 and entries["two-methods"]["problem"] is None
    assert "broken.sqlite" in entries["broken"]["problem"]


def test_the_sample_comes_first_and_stays(tmp_path):
    sample = results_file(tmp_path / "sample.sqlite", title="the sample")
    library = ResultsLibrary(tmp_path / "ws", sample)
    library.add(results_file(tmp_path / "b.sqlite"))
    assert [(entry["id"], entry["shipped"]) for entry in library.entries()] == [
        ("sample", True),
        ("two-methods", False),
    ]
    with pytest.raises(LookupError, match="cannot be deleted"):
        library.delete("sample")


def test_everything_needs_the_token(studio):
    stranger = browser(application(studio))
    for path in ("/results", "/api/results", f"{RESULTS}/report.html"):
        assert stranger.get(path).status_code == 401


def test_an_evaluation_has_its_table_with_the_paper_and_the_bound(client):
    found = client.get(RESULTS).json()
    assert [(row["method"], row["missions"]) for row in found["rows"]] == [("dwa", 3), ("covernav", 3)]
    assert found["bounds"][0]["bound_s"] == 1.5
    assert found["kinds"][0]["words"] == "covert suite, observers known, lidar, 6 m goals"
    assert {method["name"] for method in found["methods"]} == {"dwa", "covernav"}
    assert all(method["colour"].startswith("#") for method in found["methods"])


def test_pairs_are_compared(client):
    (row,) = client.get(f"{RESULTS}/paired?method=covernav&against=dwa").json()
    assert row["exposed_s"]["difference"] == pytest.approx(-4.0) and row["missions"] == 3
    assert client.get(f"{RESULTS}/paired?method=covernav&against=zigzag").status_code == 404


def test_missions_lead_to_their_scene_and_every_methods_way(client):
    missions = client.get(f"{RESULTS}/missions").json()
    assert len(missions) == 6 and missions[0]["status"] == "reached"
    scene = client.get(f"{RESULTS}/scenes/{missions[0]['id']}").json()
    assert [drive["method"] for drive in scene["drives"]] == ["dwa", "covernav"]
    assert len(scene["drives"][0]["x"]) == 21 and scene["watchers"]
    west, east, south, north = scene["bounds"]
    assert west < scene["start"][0] < east and south < scene["goal"][1] < north
    picture = client.get(f"{RESULTS}/scenes/{missions[0]['id']}/map.jpg")
    assert picture.headers["content-type"] == "image/jpeg" and picture.content[:2] == b"\xff\xd8"


@pytest.mark.parametrize("name", ["success-exposure", "distributions", "trajectories"])
def test_figures_come_as_svg_and_png_and_repeat(client, name):
    address = f"{RESULTS}/figures/{name}.svg?mission=1&theme=dark"
    drawn = client.get(address)
    assert drawn.headers["content-type"] == "image/svg+xml"
    assert ElementTree.fromstring(drawn.text).tag == "{http://www.w3.org/2000/svg}svg"
    assert client.get(address).text == drawn.text
    assert client.get(address.replace(".svg", ".png")).content[:4] == b"\x89PNG"


def test_tables_come_as_csv(client):
    rows = list(csv.DictReader(io.StringIO(client.get(f"{RESULTS}/table.csv").text)))
    assert [row["method"] for row in rows] == ["dwa", "covernav", "bound"]
    assert float(rows[1]["exposed_s"]) == pytest.approx(2.1) and float(rows[2]["exposed_s"]) == 1.5
    assert rows[0]["exposed_s_n"] == "3" and rows[0]["paper_success_rate"] == ""
    missions = list(csv.DictReader(io.StringIO(client.get(f"{RESULTS}/missions.csv").text)))
    assert len(missions) == 6 and missions[0]["placement"] == "uniform"


def test_the_report_needs_nothing_else(client):
    report = client.get(f"{RESULTS}/report.html")
    assert "attachment" in report.headers["content-disposition"]
    assert report.text.count("<svg") == 3 and "least exposed" in report.text
    for outside in ("<script", 'src="http', "@import", 'href="http'):
        assert outside not in report.text.replace('xlink:href="http://www.w3', "")


def test_names_from_a_file_are_text_in_the_report(client, studio):
    nasty = drive(0, "<script>alert(1)</script>")
    results_file(studio.store.workspace / "results" / "nasty.sqlite", [nasty], "<img src=x onerror=alert(1)>")
    report = client.get("/api/results/nasty/report.html").text
    assert "<script" not in report and "<img" not in report and "&lt;script&gt;" in report


def test_names_that_look_like_formulas_are_drawn_as_they_are(client, studio):
    odd = [drive(seed, r"a$\foo$") for seed in range(2)]
    results_file(studio.store.workspace / "results" / "odd.sqlite", odd)
    for path in ("figures/success-exposure.svg", "figures/distributions.svg", "report.html"):
        assert client.get(f"/api/results/odd/{path}").status_code == 200, path


def test_a_link_to_what_is_gone_is_told_and_hides_nothing_else(client, studio):
    (studio.store.workspace / "results" / "gone.sqlite").symlink_to("/nowhere/results.sqlite")
    found = {entry["id"]: entry for entry in client.get("/api/results").json()}
    assert "cannot be read" in found["gone"]["problem"] and found["two-methods"]["problem"] is None
    assert client.get("/api/results/gone").status_code == 404


@pytest.mark.parametrize("change", [{"size_m": 10**400}, {"family": "moon"}, {"observers": 7}])
def test_a_recipe_that_cannot_be_followed_is_told(client, studio, change):
    changed = [mission | {"scene": mission["scene"] | change} for mission in drives(1)]
    results_file(studio.store.workspace / "results" / "strange.sqlite", changed)
    answer = client.get("/api/results/strange/scenes/1")
    assert answer.status_code == 422 and answer.json()["detail"]


def test_a_file_is_taken_in_and_thrown_away(client, tmp_path):
    data = results_file(tmp_path / "mine.sqlite", title="Überblick, mein Lauf").read_bytes()
    added = client.post("/api/results", content=data, headers=SQLITE)
    assert added.status_code == 201 and added.json() == {"id": "uberblick-mein-lauf"}
    assert client.post("/api/results", content=data, headers=SQLITE).json() == {"id": "uberblick-mein-lauf-2"}
    assert client.get("/api/results/uberblick-mein-lauf/file").content == data
    assert client.delete("/api/results/uberblick-mein-lauf").status_code == 204
    assert client.get("/api/results/uberblick-mein-lauf").status_code == 404


@pytest.mark.parametrize(
    ("verb", "path", "options", "status"),
    [
        ("POST", "/api/results", {"content": b"hello"}, 415),
        ("POST", "/api/results", {"content": b"hello", "headers": SQLITE}, 422),
        ("GET", "/api/results/nobody", {}, 404),
        ("GET", "/api/results/..%2Fruns", {}, 404),
        ("DELETE", "/api/results/sample", {}, 404),
        ("GET", f"{RESULTS}/missions?kind=7", {}, 404),
        ("GET", f"{RESULTS}/missions?kind=-1", {}, 422),
        ("GET", f"{RESULTS}/scenes/99", {}, 404),
        ("GET", f"{RESULTS}/figures/pie.svg", {}, 404),
        ("GET", f"{RESULTS}/figures/trajectories.svg", {}, 404),
        ("GET", f"{RESULTS}/figures/distributions.exe", {}, 422),
        ("GET", f"{RESULTS}/figures/distributions.svg?theme=pink", {}, 422),
        ("POST", f"{RESULTS}/replay", {"json": {"missions": []}}, 422),
        ("POST", f"{RESULTS}/replay", {"json": {"missions": [1, 2, 3]}}, 422),
        ("POST", f"{RESULTS}/replay", {"json": {"missions": [True]}}, 422),
        ("POST", f"{RESULTS}/replay", {"json": {"missions": ["1"]}}, 422),
        ("POST", f"{RESULTS}/replay", {"json": {"missions": [99]}}, 404),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_reason(client, verb, path, options, status):
    answer = client.request(verb, path, **options)
    assert answer.status_code == status and answer.json()["detail"]


def test_a_mission_on_ground_that_does_not_grow_any_more_is_told(client, studio):
    changed = [mission | {"scene": mission["scene"] | {"land": "0" * 16}} for mission in drives(1)]
    results_file(studio.store.workspace / "results" / "old.sqlite", changed)
    answer = client.get("/api/results/old/scenes/1")
    assert answer.status_code == 422 and "does not grow any more" in answer.json()["detail"]
    assert client.get("/api/results/old").status_code == 200
    assert "does not grow any more" in client.get("/api/results/old/report.html").text


def test_the_page_is_served_and_linked(client):
    assert "Comparison" in client.get("/results").text
    assert 'href="/results"' in client.get("/").text
    paths = client.get("/api/openapi.json").json()["paths"]
    assert "/api/results/{id}/replay" in paths
