"""The bench of the server: from a goal that is set to the telemetry that tells of it."""

from __future__ import annotations

import http.client
import json
import math
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from websockets.sync.client import connect
from websockets.sync.connection import Connection

from app.bench.measure import Result, faster, percentile
from scenes.families import generate
from scenes.scenario import Family, Scenario

BOUND_MS = 100.0
CLICKS = 40
PAUSE_S = 0.25
STARTUP_S, ANSWER_S, STOP_S = 60.0, 10.0, 15.0
TOKEN = "bench"
CLICK_OFFSETS = [(0.15 * math.cos(k), 0.15 * math.sin(k)) for k in range(CLICKS)]


def click_to_goal() -> Result:
    """PUT of a goal to the telemetry message that carries it, p95, while a mission runs."""
    scenario = generate(Family.NORMAL, 1, size_m=64.0, goal_distance=30.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.json"
        scenario.save(path)
        with _server(path, Path(folder) / "workspace") as port, _telemetry(port) as socket:
            http_client = http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_S)
            _send(http_client, "POST", "/api/mission/start", None)
            _wait(socket, lambda message: message["status"] == "running" and message["time_s"] > 0.5)
            spent, running = _click(http_client, socket, scenario)
    return faster(
        "click_to_goal",
        percentile(spent, 95.0),
        BOUND_MS,
        "the 100 ms bound",
        f"{len(spent)} goals set, each came back in a telemetry message as it was set; median "
        f"{percentile(spent, 50.0):.1f} ms; the mission was running in {running} of them",
    )


def _click(
    http_client: http.client.HTTPConnection, socket: Connection, scenario: Scenario
) -> tuple[list[float], int]:
    spent, running = [], 0
    for dx, dy in CLICK_OFFSETS:
        goal = {"x": round(scenario.goal.x + dx, 3), "y": round(scenario.goal.y + dy, 3)}
        begun = time.perf_counter()
        _send(http_client, "PUT", "/api/mission/goal", goal)
        message = _wait(socket, lambda message, goal=goal: message["goal"] == goal)
        spent.append(1e3 * (time.perf_counter() - begun))
        running += message["status"] == "running"
        time.sleep(PAUSE_S)
    return spent, running


def _send(http_client: http.client.HTTPConnection, verb: str, path: str, body: dict | None) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
    http_client.request(verb, path, None if body is None else json.dumps(body), headers)
    answer = http_client.getresponse()
    text = answer.read().decode()
    if answer.status >= 300:
        raise RuntimeError(f"{verb} {path} answered {answer.status}: {text[:200]}")


def _wait(socket: Connection, wanted) -> dict:
    """The first message that is `wanted`; raises TimeoutError after 10 s."""
    until = time.monotonic() + ANSWER_S
    while True:
        message = json.loads(socket.recv(timeout=max(0.0, until - time.monotonic())))
        if wanted(message):
            return message


@contextmanager
def _telemetry(port: int) -> Iterator[Connection]:
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with connect(f"ws://127.0.0.1:{port}/api/stream", additional_headers=headers, proxy=None) as socket:
        yield socket


@contextmanager
def _server(scenario: Path, workspace: Path) -> Iterator[int]:
    """`covernav serve` in a process of its own, on a free port."""
    command = [
        sys.executable, "-m", "app.cli", "serve", str(scenario),
        "--port", "0", "--token", TOKEN, "--workspace", str(workspace),
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield _port(process)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _port(process: subprocess.Popen[str]) -> int:
    """From the address that the server prints once it answers."""
    assert process.stdout is not None
    for line in process.stdout:
        found = re.search(r"http://[^/]*:(\d+)/", line)
        if found:
            return int(found[1])
    raise RuntimeError(f"the server ended with status {process.wait(STOP_S)} before it answered")
