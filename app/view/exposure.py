"""What the view shows of the exposure, the same for everybody who looks: the overlay and what it is of."""

from __future__ import annotations

from dataclasses import replace

from app.changes import Change, Kind, StudioError
from app.exposure_service import ExposureService, Picture
from app.studio import Studio
from app.view.exposure_overlay import ExposureOverlay
from app.view.exposure_paint import Paper, Show, Wish
from app.view.layers import Layer, LayerState


class ExposureShow:
    """Lives on the studio's loop."""

    def __init__(
        self, studio: Studio, service: ExposureService, overlay: ExposureOverlay, layers: LayerState
    ) -> None:
        self.alone = True
        self.wish = Wish()
        self._studio, self._service, self._overlay, self._layers = studio, service, overlay, layers

    @property
    def picture(self) -> Picture | None:
        """Who sees what, as last computed."""
        return self._service.picture

    @property
    def shown(self) -> Wish:
        """What the overlay is of: a selected observer's view alone, where that is asked for."""
        selection = self._studio.selection
        selected = selection.id if selection is not None and selection.kind is Kind.OBSERVER else None
        observer = selected if self.alone and selected is not None else self.wish.observer
        opacity = self._layers.opacity[Layer.EXPOSURE]
        return replace(self.wish, observer=observer, opacity=opacity)

    def choose(self, show: Show, observer: int | None = None) -> None:
        """What the overlay shows. Raises StudioError for an observer whom there is not."""
        if observer is not None and all(one.id != observer for one in self._studio.scenario.observers):
            raise StudioError(f"there is no observer {observer}", 404)
        self.wish = replace(self.wish, show=show, observer=observer)
        self._service.average(show is Show.AVERAGED)
        self.draw()

    def show_alone(self, alone: bool) -> None:
        """Whether the overlay shows a selected observer's view alone."""
        self.alone = alone
        self.draw()

    def hear(self, change: Change) -> None:
        if change is Change.EXPOSURE or (change is Change.SELECTED and self.alone):
            self.draw()
        elif change is Change.EDITED:
            gone = self.wish.observer is not None and all(
                one.id != self.wish.observer for one in self._studio.scenario.observers
            )
            if gone:
                self.choose(Show.UNITED)

    def open(self, paper: Paper) -> None:
        """Another map is drawn now."""
        self._overlay.open(paper)
        self.draw()

    def show_layer(self, layer: Layer) -> None:
        """A layer has been shown, hidden or changed: nothing is computed for nobody."""
        if layer is Layer.EXPOSURE:
            self._service.follow(self._layers.visible[layer])
            self.draw()

    def draw(self) -> None:
        picture = self.picture
        fits = picture is not None and picture.heightmap is self._studio.heightmap
        if picture is not None and fits and self._layers.visible[Layer.EXPOSURE]:
            self._overlay.draw(picture, self.shown)
