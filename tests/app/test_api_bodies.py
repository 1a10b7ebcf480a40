"""Hostile bodies: nothing that a client sends is answered with a 5xx, and nothing large is read."""

import asyncio
import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from meadows import meadow_scene
from served import BEARER, application, browser, http_scope, silent_studio

from app.api import bodies
from app.api.bodies import MAX_BODY, MAX_UPLOAD, body_limit
from scenes.scenario import MAX_FILE_BYTES

JSON = BEARER | {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    return silent_studio(tmp_path_factory.mktemp("workspace"), meadow_scene())


@pytest.fixture(scope="module")
def app(studio):
    return application(studio)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (b'{"x": NaN, "y": 0}', "x: "),
        (b'{"x": Infinity, "y": 0}', "x: "),
        (b'{"x": -Infinity, "y": 0}', "x: "),
        (b'{"x": 1e400, "y": 0}', "x: "),
        (b'{"x": true, "y": 0}', "x: "),
        (b'{"x": "1", "y": 0}', "x: "),
        (b'{"x": null, "y": 0}', "x: "),
        (b'{"x": [1], "y": 0}', "x: "),
        (b'{"x": 1e9, "y": 0}', "x: "),
        (b'{"x": 99, "y": 0}', "goal is off the map"),
        (b'{"x": 0, "y": 5}', "inside a tree"),
        (b'{"x": ' + b"9" * 4000 + b', "y": 0}', "x: "),
        (b'{"x": ' + b"9" * 5000 + b', "y": 0}', "not JSON"),
        (b'{"y": 0}', "x: is missing"),
        (b'{"x": 0, "y": 0, "z": 0}', "z: is not a field"),
        (b'{"x": 0, "y": 0, "' + b"k" * 5000 + b'": 0}', "is not a field"),
        (rb'{"x": 0, "y": 0, "\ud800": 0}', "not JSON"),
        (b'{"x": 0, "y": 0, "\xff": 0}', "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"x":' * 100_000, "not JSON"),
        (b"\xff\xfe\x00", "not JSON"),
        (b"\xef\xbb\xbf{}", "not JSON"),
        (b"{'x': 0}", "not JSON"),
        (b'{"x": 0, "y": 0} trailing', "not JSON"),
        (b"null", "body"),
        (b"[]", "body"),
        (b'"text"', "body"),
        (b"", "body"),
    ],
)
def test_a_body_that_is_not_a_goal_says_where_and_what(app, studio, body, reason):
    before = studio.scenario
    answer = browser(app).put("/api/mission/goal", content=body, headers=JSON)
    assert answer.status_code == 422, answer.text
    assert reason in answer.json()["detail"] and len(answer.text) < 2000
    assert studio.scenario is before


@pytest.mark.parametrize(
    "kind", ["text/plain", "", "application/xml", "multipart/form-data", "application/jsonx"]
)
def test_other_kinds_of_body_are_refused(app, kind):
    client = browser(app)
    headers = BEARER | {"Content-Type": kind}
    assert client.put("/api/mission/goal", content=b'{"x": 0, "y": 0}', headers=headers).status_code == 415
    assert client.post("/api/scenarios", content=b"{}", headers=headers).status_code == 415


@pytest.mark.parametrize(
    ("path", "limit"),
    [
        ("/api/mission/goal", MAX_BODY),
        ("/api/observers", MAX_BODY),
        ("/api/scenarios", MAX_FILE_BYTES),
        ("/api/scenarios/mine", MAX_FILE_BYTES),
        ("/api/scenarios/mine/open", MAX_BODY),
        ("/api/scenarios/import", MAX_UPLOAD),
    ],
)
def test_each_address_takes_only_so_much(path, limit):
    assert body_limit(path) == limit


@pytest.mark.parametrize(
    "length", ["2147483648", str(MAX_BODY + 1), "9" * 40, "-1", "1e3", "0x10", "", " ", "١٢"]
)
def test_an_announced_length_that_is_too_large_or_odd_is_refused_unread(app, length):
    status, read = asyncio.run(exchange(app, "PUT", "/api/mission/goal", b"x", length=length.encode()))
    assert (status, read) == (413, 0)


def test_a_2_gb_upload_is_refused_unread(app):
    status, read = asyncio.run(exchange(app, "POST", "/api/scenarios/import", b"x", length=b"2147483648"))
    assert (status, read) == (413, 0)


def test_a_body_that_streams_beyond_the_limit_is_cut_off(app):
    chunk = b" " * 2**16
    status, read = asyncio.run(exchange(app, "PUT", "/api/mission/goal", chunk))
    assert status == 413 and read <= MAX_BODY + 2 * len(chunk)


def test_an_upload_that_streams_beyond_the_limit_leaves_nothing_behind(app, studio, monkeypatch):
    monkeypatch.setattr(bodies, "MAX_UPLOAD", 2**20)
    start = b'--B\r\nContent-Disposition: form-data; name="file"; filename="big.tif"\r\n\r\n'
    status, read = asyncio.run(
        exchange(
            app,
            "POST",
            "/api/scenarios/import",
            b"\0" * 2**16,
            first=start,
            kind=b"multipart/form-data; boundary=B",
        )
    )
    assert status == 413 and read < 2**22
    assert not list((studio.store.workspace / "uploads").iterdir())


def test_a_body_that_stops_coming_is_given_up(app, monkeypatch):
    monkeypatch.setattr(bodies, "BODY_PAUSE_S", 0.05)
    status, _ = asyncio.run(exchange(app, "PUT", "/api/mission/goal", None))
    assert status == 408


async def exchange(app, method, path, chunk, *, first=None, length=None, kind=b"application/json"):
    """Send the same chunk without end (None: nothing comes); returns the status and the bytes taken."""
    headers = [
        (b"host", b"localhost"),
        (b"authorization", BEARER["Authorization"].encode()),
        (b"content-type", kind),
    ]
    if length is not None:
        headers.append((b"content-length", length))
    scope = http_scope(method, path, path.encode(), headers)
    statuses, read, pending = [], 0, [first] if first else []

    async def receive():
        nonlocal read
        if chunk is None:
            await asyncio.Event().wait()
        body = pending.pop() if pending else chunk
        read += len(body)
        return {"type": "http.request", "body": body, "more_body": True}

    async def send(message):
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    await app(scope, receive, send)
    return statuses[0], read


SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.sampled_from([1e308, -0.0, 2**63, 10**30, "", "\x00", "lidar", "tree", "dwa", "<b>"])
)
KEYS = st.sampled_from(
    ["x", "y", "yaw", "id", "kind", "name", "mode", "factor", "patrol", "waypoints", "terrain"]
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(KEYS | st.text(max_size=8), inner, max_size=5)
    ),
    max_leaves=12,
)
IDS = st.sampled_from(
    ["1", "0", "-1", "999999", "99999999999999999999", "9" * 5000, "x", "1.5", "%00", "..", "é"]
)


@settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_request_made_from_the_interface_description_gets_a_5xx(app, data):
    operations = [
        (verb, path)
        for path, verbs in app.openapi()["paths"].items()
        for verb in verbs
        if (verb, path) != ("post", "/api/scenarios/generate")  # takes seconds where it succeeds
    ]
    verb, path = data.draw(st.sampled_from(operations))
    address = path.replace("{id}", data.draw(IDS)) if "{id}" in path else path
    body = json.dumps(data.draw(VALUES))
    answer = browser(app).request(verb, address, content=body.encode("utf-8", "surrogatepass"), headers=JSON)
    assert answer.status_code < 500, (verb, address, body, answer.text)
    if answer.status_code >= 400:
        assert isinstance(answer.json()["detail"], str)


@given(
    st.binary(max_size=300),
    st.sampled_from(
        [b"multipart/form-data", b"multipart/form-data; boundary=B", b"multipart/form-data; boundary="]
    ),
)
def test_no_form_gets_a_5xx(app, content, kind):
    body = b'--B\r\nContent-Disposition: form-data; name="file"; filename="a.laz"\r\n\r\n' + content
    for sent in (content, body, body + b"\r\n--B--\r\n"):
        answer = browser(app).post(
            "/api/scenarios/import", content=sent, headers=BEARER | {"Content-Type": kind}
        )
        assert answer.status_code in (415, 422), answer.text
