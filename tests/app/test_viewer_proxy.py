"""The way to viser and back: only through here, and only what a visitor may send."""

import asyncio
import re
import threading
from contextlib import asynccontextmanager

import msgspec.msgpack
import pytest
import viser
import viser._messages
from fastapi import WebSocketDisconnect
from served import BASE, BEARER, application, browser, silent_studio
from websockets.asyncio.client import connect
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed

from app import viewer_proxy
from app.server import create_app
from app.settings import Settings
from app.viewer_proxy import FROM_BROWSER, MAX_UPLOAD, BrowserFilter, Forbidden, Viewer, pipe, start_viser

PROTOCOL = f"viser-v{viser.__version__}"
SOCKET = "ws://127.0.0.1:8000/viewer"
pack = msgspec.msgpack.encode


@pytest.fixture(scope="module")
def running_viser():
    server, viewer = start_viser("test")
    yield server, viewer
    server.stop()


@pytest.fixture
def app(tmp_path, meadow, running_viser):
    studio = silent_studio(tmp_path, meadow)
    return create_app(studio, Settings.make(token="a-token-for-tests"), running_viser[1])


def test_the_page_is_visers_own_and_may_do_only_what_it_needs(app):
    client = browser(app, **BEARER)
    page = client.get("/viewer/")
    assert page.status_code == 200 and "<title>Viser</title>" in page.text
    policy = page.headers["content-security-policy"]
    assert (
        "default-src 'none'" in policy
        and "connect-src 'self'" in policy
        and "frame-ancestors 'self'" in policy
    )
    assert client.get("/viewer/", headers={"If-None-Match": page.headers["etag"]}).status_code == 304
    assert client.get("/viewer").headers["location"] == "/viewer/"


def test_without_a_viewer_there_is_none(tmp_path, meadow):
    client = browser(application(silent_studio(tmp_path, meadow)), **BEARER)
    assert client.get("/viewer/").status_code == 404


def test_a_browser_reaches_viser_and_speaks_its_sub_protocol(app, running_viser):
    running_viser[0].scene.add_frame("/somewhere")
    headers = BEARER | {"Origin": BASE}
    for address in (SOCKET, SOCKET + "/"):
        with browser(app).websocket_connect(
            address, subprotocols=[PROTOCOL], headers=dict(headers)
        ) as socket:
            assert socket.accepted_subprotocol == PROTOCOL
            assert len(socket.receive_bytes()) > 16


def test_what_a_browser_does_arrives_and_sharing_does_not(app, running_viser, monkeypatch):
    server = running_viser[0]
    pressed, shared = threading.Event(), []
    monkeypatch.setattr(server, "request_share_url", lambda *args, **kwargs: shared.append(1))
    button = server.gui.add_button("go")
    button.on_click(lambda event: pressed.set())
    press = {"type": "GuiUpdateMessage", "uuid": button._impl.uuid, "updates": {"value": True}}
    with browser(app).websocket_connect(SOCKET, subprotocols=[PROTOCOL], headers=dict(BEARER)) as socket:
        for message in ({"type": "ShareUrlRequest"}, {"type": "ShareUrlDisconnect"}, camera(), press):
            socket.send_bytes(pack(message))
        assert pressed.wait(30.0)
    assert not shared


def camera() -> dict:
    still = {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, -1.0, 1.0], "up_direction": [0.0, 0.0, 1.0]}
    lens = {"fov": 1.0, "near": 0.1, "far": 100.0, "image_height": 100, "image_width": 100}
    return {"type": "ViewerCameraMessage", "look_at": [0.0, 0.0, 0.0], **still, **lens}


def test_a_client_of_another_version_hears_what_viser_says_to_it(app):
    with (
        browser(app).websocket_connect(SOCKET, subprotocols=["viser-v0.0.1"], headers=dict(BEARER)) as socket,
        pytest.raises(WebSocketDisconnect) as closed,
    ):
        socket.receive_bytes()
    assert closed.value.code == 1002 and "0.0.1" in closed.value.reason


def test_viser_refuses_whoever_comes_past_the_studio(running_viser):
    async def knock(headers: dict) -> None:
        address = running_viser[1].address
        async with connect(
            address, subprotocols=[PROTOCOL], additional_headers=headers, proxy=None
        ) as socket:
            await socket.recv()

    for headers in ({}, {viewer_proxy.SECRET_HEADER: "guessed"}):
        with pytest.raises(ConnectionClosed) as closed:
            asyncio.run(knock(headers))
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
    assert not running_viser[0].get_clients()


def test_visers_secret_stays_out_of_representations():
    assert "hush" not in repr(Viewer(1, "hush"))


def test_the_messages_let_through_are_those_that_visers_own_page_sends():
    """Taken from the sources of viser's client; sharing is left out on purpose."""
    for name in FROM_BROWSER:
        assert hasattr(viser._messages, name), name
    assert not any(re.match("ShareUrl", name) for name in FROM_BROWSER)


@pytest.mark.parametrize(
    "message",
    [
        {"type": "ShareUrlRequest"},
        {"type": "ShareUrlDisconnect"},
        {"type": "RunJavascriptMessage", "source": "alert(1)"},
        {"type": "Message"},
        {"type": None},
        {"type": ["GuiUpdateMessage"]},
        {"uuid": "x"},
        {},
        [],
        3,
        None,
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"update_cb": []}},
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1, "removed": True}},
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": [1]},
        {"type": "GuiUpdateMessage", "uuid": "x"},
    ],
)
def test_what_a_visitor_may_not_send_is_dropped(message):
    assert not BrowserFilter().passes(pack(message))


def test_the_last_of_two_types_counts_as_it_does_for_viser():
    frame = b"\x82" + pack("type") + pack("ViewerCameraMessage") + pack("type") + pack("ShareUrlRequest")
    assert msgspec.msgpack.decode(frame) == {"type": "ShareUrlRequest"}
    assert not BrowserFilter().passes(frame)


@pytest.mark.parametrize(
    "frame", [b"", b"\xc1", b"\x91" * 100_000, b"\xd9\xff", b"\x82\xa4type", b"\x81\xc2"]
)
def test_what_is_no_message_ends_the_connection(frame):
    with pytest.raises(Forbidden):
        assert not BrowserFilter().passes(frame)
        raise Forbidden("dropped")


def start(size, parts=1, upload="u") -> bytes:
    names = {"source_component_uuid": "c", "transfer_uuid": upload, "filename": "f", "mime_type": "m"}
    return pack({"type": "FileTransferStartUpload", **names, "part_count": parts, "size_bytes": size})


def part(content, upload="u") -> bytes:
    message = {"type": "FileTransferPart", "source_component_uuid": "c", "transfer_uuid": upload}
    return pack(message | {"part_index": 0, "content": content})


def test_uploads_pass_up_to_their_announced_size():
    judge = BrowserFilter()
    assert judge.passes(start(5, 2)) and judge.passes(part(b"abc")) and judge.passes(part(b"de"))
    assert judge.passes(start(0, 0, "empty"))
    for number in range(20):  # finished ones do not count
        assert judge.passes(start(1, 1, str(number))) and judge.passes(part(b"x", str(number)))


@pytest.mark.parametrize(
    "frames",
    [
        [start(MAX_UPLOAD + 1)],
        [start(-1)],
        [start(2**63)],
        [start("5")],
        [start(True)],
        [start(5, 10**9)],
        [start(5), part(b"abcdef")],
        [start(5), part("abc")],
        [part(b"abc")],
        [start(5), part(b"abc", "another")],
        [start(5), part(b"abcde"), part(b"f")],
        [start(1, 1, str(number)) for number in range(5)],
    ],
)
def test_uploads_that_are_too_large_or_lie_end_the_connection(frames):
    judge = BrowserFilter()
    with pytest.raises(Forbidden):
        for frame in frames:
            judge.passes(frame)


class Browser:
    """A browser's websocket as the proxy sees it; reads only while `reading` is set."""

    def __init__(self) -> None:
        self.scope = {"subprotocols": [PROTOCOL]}
        self.reading = asyncio.Event()
        self.read = 0
        self.closed: tuple[int, str] | None = None

    async def accept(self, subprotocol: str | None) -> None:
        self.accepted = subprotocol

    async def send_bytes(self, frame: bytes) -> None:
        await self.reading.wait()
        self.read += 1

    async def receive(self) -> dict:
        await asyncio.Event().wait()
        return {}

    async def close(self, code: int, reason: str) -> None:
        self.closed = (code, reason)


@asynccontextmanager
async def a_viser_that_never_stops(sent: list[int]):
    async def pour(connection) -> None:
        while True:
            await connection.send(b"\0" * 2**20)
            sent.append(1)

    async with serve(pour, "127.0.0.1", 0, compression=None, subprotocols=[PROTOCOL]) as server:
        yield Viewer(server.sockets[0].getsockname()[1], "secret")


def test_a_browser_that_stops_reading_holds_viser_back_and_is_closed(monkeypatch):
    monkeypatch.setattr(viewer_proxy, "STALL_S", 0.3)
    sent: list[int] = []

    async def run() -> Browser:
        deaf = Browser()
        async with a_viser_that_never_stops(sent) as viewer:
            await asyncio.wait_for(pipe(deaf, viewer), 30.0)
        return deaf

    deaf = asyncio.run(run())
    assert deaf.closed == (1008, "the browser has stopped reading")
    assert len(sent) < 40  # MiB: what the sockets' buffers and the short queue hold, no more


def test_where_viser_is_gone_the_browser_is_told_to_come_back():
    browser_socket = Browser()
    asyncio.run(pipe(browser_socket, Viewer(1, "secret")))
    assert browser_socket.closed == (1013, "the viewer is not ready")
