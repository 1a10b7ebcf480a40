"""The web server: one port for the page, the interface, the telemetry socket and the 3D view."""

from __future__ import annotations

import asyncio
import contextlib
import io
import logging
import os
import shutil
import signal
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from types import FrameType
from urllib.parse import quote

import uvicorn
import viser
from fastapi import FastAPI, WebSocket
from fastapi.responses import FileResponse, HTMLResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.types import Lifespan

from app import telemetry, viewer_proxy
from app.api import docs, errors, exposure, mission, results, route, runs, scenarios, things, training
from app.api.bodies import BodyLimit
from app.changes import COLLECTIONS
from app.connections import HEAD_LIMIT_BYTES, PromptHttp, PromptWebSocket
from app.exposure_service import ExposureService
from app.results import ResultsLibrary
from app.results_replay import ReplayService
from app.security import WILDCARDS, Gate, Hosts
from app.settings import Settings, SettingsError
from app.store import Store
from app.studio import Studio
from app.training_service import TrainingService
from app.viewer_proxy import MAX_MESSAGE, Viewer
from planner.folder_lock import FolderInUse, FolderLock
from scenes.scenario import Scenario

STATIC = Path(__file__).parents[1] / "static"
FIRST_SCENARIO = "bush-truck-cottage"
TITLE = "CoverNav Studio"
GRACE_S = 3
MOST_CONNECTIONS = 512


def create_app(
    studio: Studio,
    settings: Settings,
    viewer: Viewer | None = None,
    lifespan: Lifespan[FastAPI] | None = None,
    exposures: ExposureService | None = None,
    trainings: TrainingService | None = None,
    replays: ReplayService | None = None,
) -> FastAPI:
    """The ASGI application around a studio that its caller starts and closes; without a `viewer` it has
    no 3D view."""
    app = FastAPI(
        title=TITLE,
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
        lifespan=lifespan,
    )
    errors.install(app)
    app.add_middleware(BodyLimit)
    app.add_middleware(Gate, token=settings.token, hosts=Hosts.of(settings.host, settings.hosts))
    app.include_router(mission.router(studio))
    app.include_router(scenarios.router(studio))
    for kind in COLLECTIONS:
        app.include_router(things.router(studio, kind))
    exposures = exposures or ExposureService(studio)
    app.include_router(exposure.router(exposures))
    app.include_router(route.router(exposures))
    app.include_router(runs.router(studio.store))
    app.include_router(training.router(trainings or TrainingService(studio), studio))
    library = ResultsLibrary(studio.store.workspace)
    app.include_router(results.router(library, replays or ReplayService(studio)))
    _add_stream(app, studio)
    _add_pages(app)
    if viewer is not None:
        app.include_router(viewer_proxy.router(viewer))
    return app


def _add_stream(app: FastAPI, studio: Studio) -> None:
    revisions = telemetry.Revisions(studio)

    @app.websocket("/api/stream")
    async def stream(websocket: WebSocket) -> None:
        await telemetry.stream(websocket, studio, revisions)


def _add_pages(app: FastAPI) -> None:
    @app.head("/healthz", include_in_schema=False)
    @app.get("/healthz", tags=["studio"])
    async def healthz() -> dict[str, str]:
        """Whether the server answers; needs no session."""
        return {"status": "ok"}

    @app.get("/api/docs", include_in_schema=False)
    async def interface() -> Response:
        return HTMLResponse(docs.page(app.openapi()))

    @app.api_route("/", methods=["GET", "HEAD"], include_in_schema=False)
    async def index() -> Response:
        return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})

    @app.api_route("/results", methods=["GET", "HEAD"], include_in_schema=False)
    async def results_page() -> Response:
        return FileResponse(STATIC / "results.html", headers={"cache-control": "no-cache"})

    app.mount("/static", _Static(directory=STATIC), name="static")


class _Static(StaticFiles):
    """Browsers keep files but ask whether they still hold."""

    def file_response(self, *args, **kwargs) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers.setdefault("cache-control", "no-cache")
        return response


def serve(settings: Settings, scenario: str | None = None) -> None:
    """Serve until SIGTERM or Ctrl-C; prints the address with its token once it answers.

    scenario : a shipped or saved name, or a file
    Raises SettingsError, ScenarioError, StoreError."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    store = Store(settings.workspace)
    with _alone_in(store.workspace), _listening_socket(settings) as listening:
        shutil.rmtree(store.workspace / "uploads", ignore_errors=True)
        document, scenario_id = _first_scenario(store, scenario)
        settings = settings.model_copy(update={"port": listening.getsockname()[1]})
        studio = Studio(store, document, scenario_id)
        viser_server, viewer = viewer_proxy.start_viser(TITLE)
        exposures, trainings = ExposureService(studio), TrainingService(studio)
        replays = ReplayService(studio)
        lifespan = _lifespan(studio, viser_server, exposures, trainings, replays)
        app = create_app(studio, settings, viewer, lifespan, exposures, trainings, replays)
        server = _Server(_configuration(app), lambda: print(address(settings), flush=True))
        server.run(sockets=[listening])
        if not server.started:
            raise RuntimeError("the server could not start; its log says why")


@contextlib.contextmanager
def _alone_in(workspace: Path) -> Iterator[None]:
    """Keep other studios out of the workspace: each would take the other's trainings for abandoned ones."""
    try:
        lock = FolderLock(workspace)
    except FolderInUse as error:
        words = f"the studio of process {error.holder} has {workspace} open"
        raise SettingsError(f"{words}; close it, or name another folder with --workspace") from None
    except OSError as error:
        raise SettingsError(f"{workspace} cannot be written: {error.strerror or error}") from None
    try:
        yield
    finally:
        lock.close()


def address(settings: Settings) -> str:
    """Where a browser on this machine finds the studio, with the token."""
    host = settings.host.strip("[]")
    if host in WILDCARDS:
        host = "127.0.0.1"
    place = f"[{host}]" if ":" in host else host
    return f"http://{place}:{settings.port}/?token={quote(settings.token, safe='')}"


def _first_scenario(store: Store, name: str | None) -> tuple[Scenario, str]:
    if name is None:
        entries = store.scenarios()
        name = FIRST_SCENARIO if store.holds(FIRST_SCENARIO) else entries[0].id
    if store.holds(name):
        return store.load(name), name
    document = Scenario.load(name)
    return document, store.new_id(document.name)


def _listening_socket(settings: Settings) -> socket.socket:
    host = settings.host.strip("[]")
    try:
        family = socket.getaddrinfo(host, settings.port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, settings.port), family=family, backlog=128)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
        raise SettingsError(f"cannot listen on {settings.host} port {settings.port}: {reason}") from None


def _configuration(app: FastAPI) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        http=PromptHttp,
        ws=PromptWebSocket,
        loop="asyncio",
        lifespan="on",
        log_config=None,
        access_log=False,  # it would write down tokens
        server_header=False,
        proxy_headers=False,
        ws_max_size=MAX_MESSAGE,
        ws_per_message_deflate=False,
        h11_max_incomplete_event_size=HEAD_LIMIT_BYTES,
        limit_concurrency=MOST_CONNECTIONS,
        timeout_graceful_shutdown=GRACE_S,
    )


class _Server(uvicorn.Server):
    """Tells when it answers; ends with status 0 on a signal."""

    def __init__(self, config: uvicorn.Config, greet: Callable[[], None]) -> None:
        super().__init__(config)
        self._greet = greet

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._greet()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """As uvicorn's, but the signal is not raised again afterwards: it was obeyed."""
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


def _lifespan(
    studio: Studio,
    viser_server: viser.ViserServer,
    exposures: ExposureService,
    trainings: TrainingService,
    replays: ReplayService,
) -> Lifespan[FastAPI]:
    @contextlib.asynccontextmanager
    async def live(app: FastAPI) -> AsyncIterator[None]:
        from app.view.view import StudioView  # the interface works without the view's libraries loaded

        await studio.start()
        view = StudioView(studio, viser_server, exposures, trainings, replays)
        view.start()
        try:
            yield
        finally:
            view.close()
            replays.close()
            exposures.close()
            await trainings.close()
            with contextlib.redirect_stdout(io.StringIO()):  # viser says goodbye
                await asyncio.gather(asyncio.to_thread(viser_server.stop), studio.close())

    return live
