"""The server as a process and on real sockets: how it starts, what it cuts off, how it ends."""

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from served import BEARER, TOKEN, application, silent_studio

from app import connections
from app.server import _configuration, _listening_socket, _Server, address, serve
from app.settings import Settings, SettingsError
from scenes.scenario import Scenario, ScenarioError

ROOT = Path(__file__).parents[2]
PATIENCE_S = 120.0
KNOWN = f"Authorization: Bearer {TOKEN}"


@contextmanager
def answering(app):
    """The application on a real port, in a thread; gives the port."""
    ready = threading.Event()
    listening = _listening_socket(Settings.make(token=TOKEN, port=0))
    server = _Server(_configuration(app), ready.set)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    assert ready.wait(PATIENCE_S)
    try:
        yield listening.getsockname()[1]
    finally:
        server.should_exit = True
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


@pytest.fixture
def port(tmp_path, meadow):
    with answering(application(silent_studio(tmp_path, meadow))) as port:
        yield port


def talk(port: int, request: bytes) -> bytes:
    """Send bytes as they are; what comes back until the server closes."""
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection:
        connection.sendall(request)
        answer = b""
        while chunk := connection.recv(2**16):
            answer += chunk
    return answer


def head(*lines: str, port: int) -> bytes:
    return "\r\n".join((*lines, f"Host: 127.0.0.1:{port}", "Connection: close", "", "")).encode("latin-1")


UPGRADE = ("Upgrade: websocket", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==")


def upgrade(path: str, *lines: str, port: int) -> bytes:
    request = head(f"GET {path} HTTP/1.1", *UPGRADE, *lines, port=port)
    return request.replace(b"Connection: close", b"Connection: Upgrade")


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        (("GET /healthz HTTP/1.1",), b"200"),
        (("GET /api/mission HTTP/1.1",), b"401"),
        (("GET /api/mission HTTP/1.1", KNOWN), b"200"),
        (("GET /api/%2e%2e/api/mission HTTP/1.1", KNOWN), b"404"),
        (("GET //api/mission HTTP/1.1",), b"401"),
        (("NONSENSE",), b"400"),
        (("POST /api/scenarios/import HTTP/1.1", KNOWN, "Content-Length: 2147483648"), b"413"),
    ],
)
def test_what_comes_over_the_wire_is_answered_plainly(port, lines, status):
    answer = talk(port, head(*lines, port=port))
    assert answer.split(b" ", 2)[1] == status


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        ((), b"401"),
        (("Authorization: Bearer wrong",), b"401"),
        ((KNOWN, "Origin: http://evil.example"), b"403"),
    ],
)
@pytest.mark.parametrize("path", ["/api/stream", "/viewer", "/viewer/", "//viewer", "/api/../viewer"])
def test_a_socket_is_refused_before_it_opens(port, path, lines, status):
    answer = talk(port, upgrade(path, *lines, port=port))
    assert answer.split(b" ", 2)[1] == status and b"101" not in answer.split(b"\r\n")[0]


@pytest.mark.parametrize("start", [b"GET /", b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Long: "])
def test_a_request_head_that_grows_and_grows_is_cut_off(port, start):
    connection = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
    with connection, pytest.raises((BrokenPipeError, ConnectionResetError)):
        connection.sendall(start)
        for _ in range(2000):
            connection.sendall(b"a" * 2**16)


def test_a_request_head_that_dawdles_is_given_up(tmp_path, meadow, monkeypatch):
    monkeypatch.setattr(connections, "HEAD_LIMIT_S", 0.2)
    with answering(application(silent_studio(tmp_path, meadow))) as port:
        assert talk(port, b"") == b""
        assert talk(port, b"GET / HTTP/1.1\r\nHost: local") == b""


def test_a_stream_outlives_the_time_for_a_request_head(tmp_path, meadow, monkeypatch):
    monkeypatch.setattr(connections, "HEAD_LIMIT_S", 0.2)
    app = application(silent_studio(tmp_path, meadow))
    with answering(app) as port, socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection:
        connection.sendall(upgrade("/api/stream", KNOWN, port=port))
        assert b"101" in connection.recv(2**16)
        connection.settimeout(1.0)
        with pytest.raises(TimeoutError):
            while connection.recv(2**16):
                pass


def test_a_reader_that_never_reads_does_not_keep_the_server_from_ending(tmp_path, meadow):
    with answering(application(silent_studio(tmp_path, meadow))) as port:
        deaf = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        deaf.sendall(upgrade("/api/stream", KNOWN, port=port))
        assert httpx.get(f"http://127.0.0.1:{port}/healthz").status_code == 200
    deaf.close()


def test_a_port_that_is_taken_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        settings = Settings.make(port=taken.getsockname()[1], workspace=tmp_path)
        with pytest.raises(SettingsError, match=f"port {settings.port}"):
            serve(settings)


def test_a_scenario_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"nowhere\.json"):
        serve(Settings.make(port=0, workspace=tmp_path), str(tmp_path / "nowhere.json"))


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"host": "127.0.0.1"}, "http://127.0.0.1:8000/?token=a%2Bb%26c"),
        ({"host": "::1"}, "http://[::1]:8000/?token=a%2Bb%26c"),
        ({"host": "0.0.0.0"}, "http://127.0.0.1:8000/?token=a%2Bb%26c"),
        ({"host": "lab.example", "port": 9}, "http://lab.example:9/?token=a%2Bb%26c"),
    ],
)
def test_the_address_that_is_printed_leads_in(fields, expected):
    assert address(Settings.make(token="a+b&c", **fields)) == expected


@pytest.fixture
def process(tmp_path):
    """`covernav serve` as people start it; gives the process and the address that it printed."""
    command = [sys.executable, "-c", "from app.cli import main; main()", "serve", "--port", "0"]
    command += ["--token", TOKEN, "--workspace", str(tmp_path)]
    running = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert running.stdout is not None
    try:
        yield running, running.stdout.readline().split("/?token=")[0]
    finally:
        running.kill()
        running.communicate()


def test_sigterm_during_a_save_ends_with_the_save_whole_and_status_zero(process, tmp_path, meadow):
    running, base = process
    text = meadow.to_json()
    headers = BEARER | {"Content-Type": "application/json"}
    client = httpx.Client(base_url=base, headers=headers, timeout=PATIENCE_S)
    assert client.get("/api/mission").json()["status"] == "idle"
    assert client.post("/api/scenarios", content=text).status_code == 201
    stop = threading.Event()

    def save_again_and_again() -> None:
        while not stop.is_set():
            try:
                client.put("/api/scenarios/test-meadow", content=text)
            except httpx.HTTPError:
                return

    saving = threading.Thread(target=save_again_and_again)
    saving.start()
    time.sleep(0.2)
    running.send_signal(signal.SIGTERM)
    _, complaints = running.communicate(timeout=PATIENCE_S)
    stop.set()
    saving.join(PATIENCE_S)
    assert running.returncode == 0 and "Traceback" not in complaints
    saved = tmp_path / "scenarios" / "test-meadow.json"
    assert json.loads(Scenario.load(saved).to_json()) == json.loads(text)
    assert not list(saved.parent.glob(".*.part"))
