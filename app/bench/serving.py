"""The bench of the server: from a goal that is set to the telemetry that tells of it, and from the end of an
observer's drag to the picture of what it sees."""

from __future__ import annotations

import contextlib
import http.client
import json
import math
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from websockets.sync.client import connect
from websockets.sync.connection import Connection

from app.bench.measure import Result, faster, percentile
from scenes.families import generate
from scenes.scenario import Family, Scenario

BOUND_MS, OVERLAY_BOUND_MS = 100.0, 250.0
CLICKS, DRAGS, MOVES = 40, 30, 8
MOVE_S = 0.06  # between the edits of a drag
PAUSE_S = 0.25
STARTUP_S, ANSWER_S, STOP_S = 180.0, 10.0, 15.0
TOKEN = "bench"
CLICK_OFFSETS = [(0.15 * math.cos(k), 0.15 * math.sin(k)) for k in range(CLICKS)]


def click_to_goal() -> Result:
    """PUT of a goal to the telemetry message that carries it, p95, while a mission runs."""
    scenario = generate(Family.NORMAL, 1, size_m=64.0, goal_distance=30.0)
    with _driving(scenario) as (http_client, socket):
        spent, running = _click(http_client, socket, scenario)
    return faster(
        "click_to_goal",
        percentile(spent, 95.0),
        BOUND_MS,
        "the 100 ms bound",
        f"{len(spent)} goals set, each came back in a telemetry message as it was set; median "
        f"{percentile(spent, 50.0):.1f} ms; the mission was running in {running} of them",
    )


def drag_to_overlay() -> Result:
    """The last edit of an observer's drag to the telemetry message that says its picture has been sent, p95,
    while a mission runs."""
    scenario = generate(Family.NORMAL, 2, size_m=64.0, goal_distance=40.0, observers=4)
    with _driving(scenario) as (http_client, socket):
        spent, sharp, running = _drag(http_client, socket, scenario)
    return faster(
        "drag_to_overlay",
        percentile(spent, 95.0),
        OVERLAY_BOUND_MS,
        "the 250 ms bound",
        f"{len(spent)} drags of {MOVES} moves among {len(scenario.observers)} observers on "
        f"{scenario.terrain.heights.shape[0]}² cells; each ended with a picture of its last place, {sharp} "
        f"sharp at once; median {percentile(spent, 50.0):.1f} ms; the mission was running in {running}",
    )


def _drag(
    http_client: http.client.HTTPConnection, socket: Connection, scenario: Scenario
) -> tuple[list[float], int, int]:
    """Milliseconds of each drag, how many pictures were sharp at once, and in how many it drove."""
    spent, sharp, running = [], 0, 0
    for drag in range(DRAGS):
        observer = scenario.observers[drag % len(scenario.observers)]
        before = _wait(socket, lambda message: message["overlay"] is not None)["edits"]
        for move in range(1, MOVES + 1):
            time.sleep(MOVE_S)
            begun = time.perf_counter()
            place = {"x": round(observer.x + 0.1 * move + 0.01 * drag, 3)}
            _send(http_client, "PATCH", f"/api/observers/{observer.id}", place)
        last = before + MOVES
        message = _wait(socket, lambda message, last=last: message["overlay"]["edits"] >= last)
        spent.append(1e3 * (time.perf_counter() - begun))
        sharp += message["overlay"]["sharp"]
        running += message["status"] == "running"
        time.sleep(PAUSE_S)
        _drain(socket)
    return spent, sharp, running


def _drain(socket: Connection) -> None:
    """Let go of what was said meanwhile."""
    with contextlib.suppress(TimeoutError):
        while True:
            socket.recv(timeout=0.0)


@contextmanager
def _driving(scenario: Scenario) -> Iterator[tuple[http.client.HTTPConnection, Connection]]:
    """A server of its own with the scenario open and a mission running, and its telemetry."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.json"
        scenario.save(path)
        with _server(path, Path(folder) / "workspace") as port, _telemetry(port) as socket:
            http_client = http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_S)
            _send(http_client, "POST", "/api/mission/start", None)
            http_client.close()  # else the server does while the mission gets ready; it opens again by itself
            _wait(socket, _drives, STARTUP_S)
            yield http_client, socket


def _drives(message: dict) -> bool:
    return message["status"] == "running" and message["time_s"] > 0.5


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


def _wait(socket: Connection, wanted: Callable[[dict], bool], patience_s: float = ANSWER_S) -> dict:
    """The first message that is `wanted`; raises TimeoutError after `patience_s`."""
    until = time.monotonic() + patience_s
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
