"""The gate: who gets in, by HTTP and by websocket alike."""

import asyncio

import pytest
from fastapi.testclient import TestClient
from hypothesis import given
from hypothesis import strategies as st
from meadows import meadow_scene
from served import BASE, BEARER, TOKEN, application, browser, http_scope, silent_studio
from starlette.testclient import WebSocketDenialResponse

from app.security import Gate, Hosts, is_plain, same_origin
from app.settings import Settings

STREAM = "ws://127.0.0.1:8000/api/stream"


@pytest.fixture(scope="module")
def app(tmp_path_factory):
    return application(silent_studio(tmp_path_factory.mktemp("workspace"), meadow_scene()))


def test_only_healthz_is_open(app):
    client = browser(app)
    assert client.get("/healthz").json() == {"status": "ok"}
    paths = [
        "/",
        "/viewer/",
        "/static/studio.css",
        "/api/mission",
        "/api/docs",
        "/api/openapi.json",
        "/nothing",
    ]
    assert {client.get(path).status_code for path in paths} == {401}
    assert client.post("/api/mission/start").status_code == 401


@pytest.mark.parametrize(
    "path",
    [
        "/healthz/",
        "//healthz",
        "/healthz/../api/mission",
        "/healthz/%2e%2e/api/mission",
        "/./healthz",
        "/HEALTHZ",
        "/healthz%00",
        "/healthz;/api/mission",
        "/%2fapi/mission",
        "//api/mission",
        "/api//mission",
        "/api/./mission",
        "/static/../api/mission",
        "/static/%2e%2e/%2e%2e/etc/passwd",
        "/api%2fmission",
        "/viewer/..%2fapi/mission",
        "/\\api/mission",
    ],
)
def test_no_spelling_of_a_path_slips_through(app, path):
    """Without a session every one is refused; with one, what is not in plain form is not found."""

    def status(headers: dict) -> int:
        decoded = path.replace("%2e", ".").replace("%2f", "/").replace("%00", "\0")
        return asyncio.run(raw_status(app, decoded, path, headers))

    assert status({}) == 401
    assert status({"authorization": f"Bearer {TOKEN}"}) in (404, 200)
    if not is_plain(path.replace("%2e", ".").replace("%2f", "/").replace("%00", "\0")):
        assert status({"authorization": f"Bearer {TOKEN}"}) == 404


async def raw_status(app, path: str, raw_path: str, headers: dict) -> int:
    """Send a request whose path no client library has tidied up."""
    lines = [(b"host", b"127.0.0.1:8000"), *((k.encode(), v.encode()) for k, v in headers.items())]
    scope = http_scope("GET", path, raw_path.encode(), lines)
    statuses = []

    async def receive():
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message):
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    await app(scope, receive, send)
    return statuses[0]


def test_the_token_in_the_address_becomes_a_session_and_leaves_the_address(app):
    client = browser(app)
    answer = client.get(f"/api/mission?view=top&token={TOKEN}")
    assert answer.status_code == 303 and answer.headers["location"] == "/api/mission?view=top"
    cookie = answer.headers["set-cookie"]
    assert TOKEN not in cookie
    for part in ("HttpOnly", "SameSite=strict", "Path=/"):
        assert part in cookie
    assert client.get("/api/mission").status_code == 200


def test_the_redirect_never_leaves_this_server(app):
    answer = asyncio.run(raw_status(app, "//elsewhere.example/", "//elsewhere.example/", {}))
    assert answer == 401
    client = browser(app)
    location = client.get(f"/%0d%0aSet-Cookie:x?token={TOKEN}").headers.get("location", "/")
    assert location.startswith("/") and "\r" not in location


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Authorization": "Bearer wrong"},
        {"Authorization": "Bearer "},
        {"Authorization": "Basic " + TOKEN},
        {"Authorization": f"Bearer {TOKEN}x"},
        {"Authorization": "Bearer \xff\xfe"},
        {"Cookie": f"covernav_8000={TOKEN}"},
        {"Cookie": "covernav_8000=; covernav_8000=0"},
        {"Cookie": "covernav_8000=\xff"},
        {"Cookie": "=;;;=;" * 50},
    ],
)
def test_without_the_token_there_is_no_entry(app, headers):
    raw = {name: value.encode("latin-1") for name, value in headers.items()}
    answer = browser(app).get("/api/mission", headers=raw)
    assert answer.status_code == 401 and "token" in answer.json()["detail"]
    assert denied(browser(app), raw) == 401


def test_a_person_gets_a_page_to_sign_in_on(app):
    answer = browser(app).get("/", headers={"Accept": "text/html,*/*"})
    assert answer.status_code == 401 and 'name="token"' in answer.text
    wrong = browser(app).get("/?token=wrong", headers={"Accept": "text/html"})
    assert wrong.status_code == 401 and "not the token" in wrong.text


def test_the_session_is_not_the_token_and_differs_by_port(app):
    client = TestClient(app, "http://localhost:9001", follow_redirects=False)
    cookie = client.get(f"/?token={TOKEN}").headers["set-cookie"]
    assert cookie.startswith("covernav_9001=")


FOREIGN = [
    "http://evil.example",
    "http://127.0.0.1:8001",
    "http://localhost:8000",
    "https://127.0.0.1:8000.evil.example",
    "http://127.0.0.1:8000@evil.example",
    "null",
    "",
    "file://",
    "http://127.0.0.1:8000/path",
    "http://127.0.0.1:99999",
    "javascript:alert(1)",
    "http://[::1",
]


@pytest.mark.parametrize("origin", FOREIGN)
def test_a_foreign_origin_is_refused_even_with_the_token(app, origin):
    headers = BEARER | {"Origin": origin}
    client = browser(app)
    for method, path in (("GET", "/api/mission"), ("POST", "/api/mission/start"), ("GET", "/healthz")):
        assert client.request(method, path, headers=headers).status_code == 403
    assert denied(client, headers) == 403


def test_our_own_origin_is_welcome(app):
    headers = BEARER | {"Origin": BASE}
    assert browser(app).get("/api/mission", headers=headers).status_code == 200
    with connect(browser(app), headers) as stream:
        assert stream.receive_json()["status"] == "idle"


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8000",
        "127.0.0.1.evil.example",
        "192.168.1.7",
        "localhost.",
        "a@localhost",
        "",
    ],
)
def test_an_unexpected_host_is_refused(app, host):
    headers = BEARER | {"Host": host}
    assert browser(app).get("/api/mission", headers=headers).status_code == 403
    assert browser(app).get("/healthz", headers=headers).status_code == 403
    assert denied(browser(app), headers) == 403


@pytest.mark.parametrize("host", ["localhost:8000", "127.0.0.1", "[::1]:8000", "LOCALHOST"])
def test_loopback_names_are_ours(app, host):
    assert browser(app).get("/api/mission", headers=BEARER | {"Host": host}).status_code == 200


@pytest.mark.parametrize(
    ("bound", "host", "ours"),
    [
        ("0.0.0.0", "192.168.1.7:8000", True),
        ("0.0.0.0", "[fe80::1]", True),
        ("::", "10.0.0.1", True),
        ("0.0.0.0", "rebound.example", False),
        ("192.168.1.7", "192.168.1.7", True),
        ("192.168.1.7", "192.168.1.8", False),
        ("lab.example", "LAB.example:80", True),
        ("[::1]", "[0:0::1]", True),
        ("127.0.0.1", "proxy.example", True),
    ],
)
def test_hosts_follow_the_address_the_server_is_bound_to(bound, host, ours):
    assert Hosts.of(bound, ("proxy.example",)).allow(host) is ours


@pytest.mark.parametrize(
    ("origin", "host", "same"),
    [
        ("http://localhost:8000", "localhost:8000", True),
        ("http://LOCALHOST:8000", "localhost:8000", True),
        ("http://localhost", "localhost:80", True),
        ("https://studio.example", "studio.example", True),
        ("https://studio.example", "studio.example:80", False),
        ("http://[::1]:8000", "[0::1]:8000", True),
        ("ftp://localhost", "localhost", False),
        ("http://localhost", "localhost:8000", False),
    ],
)
def test_an_origin_is_ours_when_it_names_what_the_host_header_names(origin, host, same):
    assert same_origin(origin, host) is same


@given(st.text(max_size=60), st.text(max_size=60))
def test_no_origin_or_host_breaks_the_gate(origin, host):
    assert same_origin(origin, host) in (True, False)
    assert Hosts.of("0.0.0.0").allow(host) in (True, False)


@given(st.text(max_size=40))
def test_a_plain_path_has_no_second_reading(path):
    if is_plain(path):
        assert path.startswith("/") and "//" not in path and "/../" not in path + "/" and "\\" not in path


def test_every_answer_carries_the_security_headers(app):
    client = browser(app)
    answers = [
        client.get("/healthz"),
        client.get("/api/mission", headers=BEARER),
        client.get("/nothing", headers=BEARER),
        client.get("/", headers={"Accept": "text/html"}),
        client.get("/api/mission", headers={"Origin": "http://evil.example"}),
    ]
    for answer in answers:
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert "frame-ancestors 'self'" in answer.headers["content-security-policy"]
        assert answer.headers["cache-control"] == "no-store"


def test_sockets_of_servers_without_denial_responses_are_closed(tmp_path):
    sent = []

    async def run() -> None:
        async def app(scope, receive, send):
            raise AssertionError("let through")

        gate = Gate(app, Settings.make(token=TOKEN).token, Hosts.of("127.0.0.1"))
        scope = {
            "type": "websocket",
            "path": "/api/stream",
            "query_string": b"",
            "headers": [(b"host", b"localhost")],
        }

        async def send(message):
            sent.append(message)

        await gate(scope, None, send)

    asyncio.run(run())
    assert [message["type"] for message in sent] == ["websocket.close"]


def connect(client: TestClient, headers: dict):
    return client.websocket_connect(STREAM, headers=dict(headers))


def denied(client: TestClient, headers: dict) -> int:
    with pytest.raises(WebSocketDenialResponse) as refusal, connect(client, headers):
        pass
    return refusal.value.status_code
