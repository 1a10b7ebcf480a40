"""What the view shows of the exposure, the same for everybody who looks: whose view the overlay is of, a
place that is explained, the routes that are compared, watchers' posts and the nearest hiding place."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import viser

from app.changes import Change, Kind, StudioError
from app.exposure_fields import Over
from app.exposure_service import ExposureService, Picture
from app.route_service import RouteService
from app.studio import Studio
from app.view.exposure_lines import ExplainedLines, RouteLines
from app.view.exposure_overlay import ExposureOverlay
from app.view.exposure_paint import Paper, Show, Wish
from app.view.layers import Layer, LayerState
from planner.covert_route import CovertRoute
from planner.exposure import SightProfile
from planner.vantage import EYE_HEIGHT, RANGE, Vantage
from scenes.scenario import ObserverSpec

OVER = {Show.AVERAGED: Over.BEATS, Show.BELIEF: Over.BELIEF}
NEAR_A_ROUTE = 0.6  # metres from its line that a click still means it


class ExposureShow:
    """Lives on the studio's loop."""

    def __init__(
        self, studio: Studio, scene: viser.SceneApi, layers: LayerState, exposures: ExposureService
    ) -> None:
        self.alone = True
        self.wish = Wish()
        self.place: tuple[float, float] | None = None
        self.profiles: tuple[SightProfile, ...] = ()
        self.posts: tuple[Vantage, ...] = ()
        self.refuge: CovertRoute | None = None
        self.routes = RouteService(studio)
        self._studio, self._layers, self._exposures = studio, layers, exposures
        self._overlay = ExposureOverlay(scene, f"/{Layer.EXPOSURE.value}", studio)
        self._explained = ExplainedLines(scene, f"/{Layer.EXPLAINED.value}")
        self._lines = RouteLines(scene, f"/{Layer.COMPARED.value}")

    def open(self, paper: Paper) -> None:
        """Another map is drawn now."""
        self._overlay.open(paper)
        self.draw()

    def close(self) -> None:
        self.routes.close()

    # the overlay

    @property
    def picture(self) -> Picture | None:
        """Who sees what, as last computed."""
        return self._exposures.picture

    @property
    def shown(self) -> Wish:
        """What the overlay is of: a selected observer's view alone, where that is asked for."""
        selection = self._studio.selection
        selected = selection.id if selection is not None and selection.kind is Kind.OBSERVER else None
        observer = selected if self.alone and selected is not None else self.wish.observer
        if self.wish.show is Show.BELIEF:
            observer = None
        return replace(self.wish, observer=observer, opacity=self._layers.opacity[Layer.EXPOSURE])

    def choose(self, show: Show, observer: int | None = None) -> None:
        """What the overlay shows. Raises StudioError for an observer whom there is not."""
        if observer is not None and not self._stands(observer):
            raise StudioError(f"there is no observer {observer}", 404)
        self.wish = replace(self.wish, show=show, observer=observer)
        self._exposures.show(OVER.get(show, Over.NOW))
        self._studio.tell(Change.EXPOSURE)

    def show_alone(self, alone: bool) -> None:
        """Whether the overlay shows a selected observer's view alone."""
        self.alone = alone
        self._studio.tell(Change.EXPOSURE)

    def show_layer(self, layer: Layer) -> None:
        """A layer has been shown, hidden or changed: nothing is computed for nobody."""
        if layer is Layer.EXPOSURE:
            self._exposures.follow(self._layers.visible[layer])
            self.draw()

    def draw(self) -> None:
        picture = self.picture
        if picture is None or picture.heightmap is not self._studio.heightmap:
            return
        if picture.over is not OVER.get(self.wish.show, Over.NOW):
            return  # what is wished for is on its way
        if self._layers.visible[Layer.EXPOSURE]:
            self._overlay.draw(picture, self.shown)

    def _stands(self, observer: int) -> bool:
        return any(one.id == observer for one in self._studio.scenario.observers)

    # what changes

    def hear(self, change: Change) -> None:
        match change:
            case Change.OPENED:
                self.forget()
            case Change.EXPOSURE | Change.SELECTED:
                self.draw()
            case Change.ROUTES:
                self._lines.draw(self.routes.comparison, self._studio.heightmap)
            case Change.EDITED:
                if self.wish.observer is not None and not self._stands(self.wish.observer):
                    self.choose(Show.UNITED)
                if self.place is not None:
                    self._studio.background(self._explain_again(self.place))
                self._show_posts(())
                self._show_refuge(None)

    def forget(self) -> None:
        """Nothing is explained, posted or compared any more."""
        self.stop_explaining()
        self._show_posts(())
        self._show_refuge(None)
        self.routes.forget()

    # explaining

    async def explain(self, x: float, y: float) -> None:
        """Show who sees a robot at (x, y), and why. Raises StudioError."""
        self.profiles = await self._exposures.profiles(x, y)
        self.place = x, y
        self._explained.draw(self.profiles)
        self._studio.tell(Change.EXPOSURE)

    async def _explain_again(self, place: tuple[float, float]) -> None:
        profiles = await self._exposures.profiles(*place)
        if self.place == place:
            self.profiles = profiles
            self._explained.draw(profiles)
            self._studio.tell(Change.EXPOSURE)

    def stop_explaining(self) -> None:
        self.place, self.profiles = None, ()
        self._explained.clear()
        self._studio.tell(Change.EXPOSURE)

    # routes, posts and hiding places

    def route_at(self, x: float, y: float) -> str | None:
        """The method that follows the compared route nearest to a click there, if it is near."""
        comparison = self.routes.comparison
        if comparison is None or not self._layers.visible[Layer.COMPARED]:
            return None
        gaps = {name: _gap(route.points, x, y) for name, route in comparison.routes.items()}
        best = min(gaps, key=gaps.__getitem__, default=None)
        return best if best is not None and gaps[best] <= NEAR_A_ROUTE else None

    def follow(self, method: str) -> None:
        """Drive along a compared route. Raises StudioError for a method there is not."""
        self._studio.set_method(method)
        self._studio.play()

    async def find_posts(self, count: int) -> None:
        """Show where watchers would see most of the route that is driven, or of the shortest."""
        self._show_posts(await self.routes.watchers(self._studio.method, count))

    async def find_refuge(self) -> None:
        """Show the quickest way to where nobody sees the robot."""
        self._show_refuge(await self.routes.hiding_place())

    def drive_to_refuge(self) -> None:
        """Make the hiding place the goal. Raises StudioError where none has been found."""
        if self.refuge is None:
            raise StudioError("find the nearest hiding place first", 409)
        x, y = self.refuge.points[-1]
        self._studio.set_goal(round(float(x), 3), round(float(y), 3))

    def occupy_posts(self) -> None:
        """Put observers on the posts. Raises StudioError where there are none."""
        if not self.posts:
            raise StudioError("ask where watchers should stand first", 409)
        for post in tuple(self.posts):
            x, y, yaw = round(post.x, 2), round(post.y, 2), round(math.degrees(post.yaw), 1)
            watcher = ObserverSpec(
                x=x, y=y, yaw=yaw, eye_height=EYE_HEIGHT,
                range=RANGE, fov_horizontal=360.0, fov_vertical=180.0,
            )  # fmt: skip
            self._studio.add_observer(watcher)

    def _show_posts(self, posts: tuple[Vantage, ...]) -> None:
        if posts or self.posts:
            self.posts = posts
            self._lines.draw_posts(posts, self._studio.heightmap)
            self._studio.tell(Change.ROUTES)

    def _show_refuge(self, way: CovertRoute | None) -> None:
        if way is not None or self.refuge is not None:
            self.refuge = way
            self._lines.draw_refuge(way, self._studio.heightmap)
            self._studio.tell(Change.ROUTES)


def _gap(points: np.ndarray, x: float, y: float) -> float:
    """Metres from (x, y) to a polyline (k, 2)."""
    begin, along = points[:-1], np.diff(points, axis=0)
    length = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip((((x, y) - begin) * along).sum(axis=1) / length, 0.0, 1.0)
    return float(np.hypot(*(begin + share[:, None] * along - (x, y)).T).min())
