"""viser's client page and websocket behind our own port, session and origin check.

viser knows neither sessions nor origins, so it listens on loopback, lets in only connections that carry this
process's secret, and a browser reaches it through here alone. Its page opens a websocket at the page's own
address (`/viewer`) with the sub-protocol `viser-vVERSION`; what viser picks is handed on, so that its own
check of versions still works. Frames pass unchanged; those from the browser are read first, and only the
kinds of message that a visitor may send go on.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import hashlib
import hmac
import io
import logging
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec.msgpack
import viser
from fastapi import APIRouter, Request, Response, WebSocket, WebSocketDisconnect
from fastapi.responses import RedirectResponse
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from app.sockets import close, first_to_end

log = logging.getLogger(__name__)

MAX_MESSAGE = 64 * 2**20
MAX_UPLOAD = 128 * 2**20  # viser keeps an upload in memory; larger files go through /api/scenarios/import
MAX_UPLOADS_AT_ONCE = 4
STALL_S = 15.0
SECRET_HEADER = "X-CoverNav-Viewer"
SUBPROTOCOL_PREFIX = "viser-v"
UNSENDABLE_CODES = (1005, 1006, 1015)

# What viser's page needs: its code is unpacked from the page itself, in workers, with WebAssembly.
VIEWER_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src 'self' data: blob:; "
    "frame-ancestors 'self'; base-uri 'none'; form-action 'none'"
)

FROM_BROWSER = frozenset(
    {
        "ViewerCameraMessage",
        "ScenePointerMessage",
        "SceneNodeClickMessage",
        "SceneNodeDragMessage",
        "TransformControlsUpdateMessage",
        "TransformControlsDragStartMessage",
        "TransformControlsDragEndMessage",
        "GuiUpdateMessage",
        "GuiButtonHoldMessage",
        "GuiFormDirtyMessage",
        "GuiFormSubmitMessage",
        "CommandTriggerMessage",
        "FileTransferStartUpload",
        "FileTransferPart",
        "GetRenderResponseMessage",
        "LocalStorageGetItemResponseMessage",
    }
)


class Forbidden(ValueError):
    """A frame that ends the connection; `code` is the websocket's closing code."""

    def __init__(self, reason: str, code: int = 1008) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True)
class Viewer:
    """Where viser listens on loopback, and the secret that it lets in."""

    port: int
    secret: str = field(repr=False)

    @property
    def address(self) -> str:
        return f"ws://127.0.0.1:{self.port}"


def start_viser(label: str) -> tuple[viser.ViserServer, Viewer]:
    """Start viser on a free loopback port, quietly, open to this process's proxy alone."""
    with contextlib.redirect_stdout(io.StringIO()):  # it greets with its own address
        server = viser.ViserServer(host="127.0.0.1", port=0, label=label, verbose=False)
    secret = secrets.token_hex(32)
    _admit_only(server, secret)
    return server, Viewer(server.get_port(), secret)


def _admit_only(server: viser.ViserServer, secret: str) -> None:
    """Refuse every connection to viser that lacks the secret: any page in the visitor's browser could
    otherwise find the port and connect."""
    sockets = server._websock_server
    guards = sockets._client_connect_cb

    async def guard(connection: Any) -> None:
        websocket = sockets._live_connections[connection.client_id]
        request = websocket.request
        given = request.headers.get(SECRET_HEADER, "") if request is not None else ""
        if not hmac.compare_digest(given.encode(), secret.encode()):
            sockets._client_state_from_id.pop(connection.client_id, None)
            sockets._live_connections.pop(connection.client_id, None)
            await websocket.close(1008, "connect through the studio")
            raise ConnectionRefusedError("a connection to viser past the studio was refused")

    guards.insert(0, guard)


class BrowserFilter:
    """Judges one browser's frames; keeps count of its uploads."""

    def __init__(self) -> None:
        self._uploads: dict[str, int] = {}

    def passes(self, frame: bytes) -> bool:
        """Whether a frame may go on to viser; False drops it. Raises Forbidden."""
        try:
            message = msgspec.msgpack.decode(frame)  # as viser does, so that both read the same
        except (msgspec.DecodeError, RecursionError, ValueError):
            raise Forbidden("not a message of the viewer", 1007) from None
        kind = message.get("type") if isinstance(message, dict) else None
        if not isinstance(kind, str) or kind not in FROM_BROWSER:
            log.warning("a viewer's message was dropped: %.60r", kind)
            return False
        match kind:
            case "GuiUpdateMessage":
                return _changes_value_alone(message)
            case "FileTransferStartUpload":
                self._begin_upload(message)
            case "FileTransferPart":
                self._count_upload(message)
        return True

    def _begin_upload(self, message: Mapping[str, Any]) -> None:
        size, upload = message.get("size_bytes"), message.get("transfer_uuid")
        parts = message.get("part_count")
        if type(size) is not int or type(parts) is not int or not isinstance(upload, str):
            raise Forbidden("not a message of the viewer", 1007)
        if not 0 <= size <= MAX_UPLOAD or not 0 <= parts <= size:
            raise Forbidden(f"files above {MAX_UPLOAD >> 20} MiB go to /api/scenarios/import", 1009)
        if len(self._uploads) >= MAX_UPLOADS_AT_ONCE:
            raise Forbidden("too many uploads at once")
        if size:
            self._uploads[upload] = size

    def _count_upload(self, message: Mapping[str, Any]) -> None:
        content, upload = message.get("content"), message.get("transfer_uuid")
        if not isinstance(content, bytes) or not isinstance(upload, str) or upload not in self._uploads:
            raise Forbidden("not a message of the viewer", 1007)
        self._uploads[upload] -= len(content)
        if self._uploads[upload] < 0:
            raise Forbidden("an upload is larger than announced", 1009)
        if self._uploads[upload] == 0:
            del self._uploads[upload]


def _changes_value_alone(message: Mapping[str, Any]) -> bool:
    """viser sets whatever attribute of a control is named; its own page names `value` alone."""
    updates = message.get("updates")
    return isinstance(updates, dict) and set(updates) <= {"value"}


def router(viewer: Viewer) -> APIRouter:
    """`/viewer/` with its websocket."""
    routes = APIRouter(include_in_schema=False)
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    packed = gzip.compress(page, mtime=0)
    etag = f'"{hashlib.sha256(page).hexdigest()[:32]}"'

    @routes.get("/viewer")
    async def without_slash() -> Response:
        return RedirectResponse("/viewer/", 308)

    @routes.get("/viewer/")
    async def client_page(request: Request) -> Response:
        headers = {
            "content-security-policy": VIEWER_POLICY,
            "cache-control": "no-cache",
            "etag": etag,
            "vary": "accept-encoding",
        }
        if request.headers.get("if-none-match") == etag:
            return Response(status_code=304, headers=headers)
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(packed, media_type="text/html", headers=headers | {"content-encoding": "gzip"})
        return Response(page, media_type="text/html", headers=headers)

    @routes.websocket("/viewer")
    @routes.websocket("/viewer/")
    async def client_socket(websocket: WebSocket) -> None:
        await pipe(websocket, viewer)

    return routes


async def pipe(browser: WebSocket, viewer: Viewer) -> None:
    """Carry frames between a browser, whose session and origin the gate has checked, and viser."""
    names = browser.scope["subprotocols"]
    offered = [Subprotocol(name) for name in names if name.startswith(SUBPROTOCOL_PREFIX)]
    try:
        upstream = await connect(
            viewer.address,
            subprotocols=offered or None,
            additional_headers={SECRET_HEADER: viewer.secret},
            compression=None,
            max_size=MAX_MESSAGE,
            max_queue=4,
            open_timeout=5.0,
            close_timeout=1.0,
            proxy=None,
        )
    except (OSError, InvalidHandshake, TimeoutError) as error:
        log.warning("viser cannot be reached: %s", error)
        await close(browser, 1013, "the viewer is not ready")
        return
    async with upstream:
        await browser.accept(subprotocol=upstream.subprotocol)
        try:
            await first_to_end(_to_browser(upstream, browser), _to_viser(browser, upstream))
        except Forbidden as error:
            await close(browser, error.code, str(error))
        except TimeoutError:
            await close(browser, 1008, "the browser has stopped reading")
        except ConnectionClosed as closed:
            ended = closed.rcvd
            if ended is None or ended.code in UNSENDABLE_CODES:
                await close(browser, 1011)
            else:
                await close(browser, ended.code, ended.reason)
        except (WebSocketDisconnect, RuntimeError):
            pass  # the browser has gone


async def _to_browser(upstream: ClientConnection, browser: WebSocket) -> None:
    """Frames outward. Sending waits while the browser does not read, and so, frame by frame, does viser's
    own producer for it, which keeps only the newest of what repeats."""
    while True:
        frame = await upstream.recv()
        async with asyncio.timeout(STALL_S):
            if isinstance(frame, bytes):
                await browser.send_bytes(frame)
            else:
                await browser.send_text(frame)


async def _to_viser(browser: WebSocket, upstream: ClientConnection) -> None:
    judge = BrowserFilter()
    while True:
        message = await browser.receive()
        if message["type"] == "websocket.disconnect":
            return
        frame = message.get("bytes")
        if frame is None:
            raise Forbidden("not a message of the viewer", 1003)
        if judge.passes(frame):
            await upstream.send(frame)
