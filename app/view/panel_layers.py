"""Layers: what is drawn, how strongly, and what the colours mean."""

from __future__ import annotations

import numpy as np

from app.view import markup, palette, segmentation
from app.view.desk import Desk, show_value
from app.view.layers import STYLES


class LayersTab:
    def __init__(self, desk: Desk) -> None:
        gui, viewer = desk.gui, desk.viewer
        view = viewer.view
        self._layers = view.layers
        cameras = gui.add_button_group("Camera", ("Opening", "Above", "Follow"))
        desk.on_choice(cameras, {
            "Opening": viewer.look_as_at_first, "Above": viewer.look_from_above, "Follow": viewer.follow,
        })  # fmt: skip
        self._boxes, self._sliders = {}, {}
        for layer, style in STYLES.items():
            gui.add_html(markup.swatch(style.swatch))
            label = f"{style.title}  ({style.key})" if style.key else style.title
            box = self._boxes[layer] = gui.add_checkbox(label, self._layers.visible[layer])
            desk.on_value(box, lambda on, layer=layer: view.show_layer(layer, bool(on)))
            if layer in self._layers.opacity:
                slider = gui.add_slider("Opacity", 0.0, 1.0, 0.05, self._layers.opacity[layer])
                self._sliders[layer] = slider
                desk.on_value(slider, lambda share, layer=layer: view.set_opacity(layer, float(share)))
        gui.add_html(legend())

    def refresh(self) -> None:
        for handles, values in ((self._boxes, self._layers.visible), (self._sliders, self._layers.opacity)):
            for layer, handle in handles.items():
                show_value(handle, values[layer])


def legend() -> str:
    """What the cost scale and the colours of arcs mean."""
    stops = palette.cost_colours(np.linspace(0.0, palette.COST_FULL, 6))[:, :3].tolist()
    reasons = (
        markup.key(colour, palette.REJECTION_WORDS[reason]) for reason, colour in palette.REJECTED.items()
    )
    return markup.block(
        markup.heading("Cost"),
        markup.scale([(red, green, blue) for red, green, blue in stops], "0", f"{palette.COST_FULL:.0f}"),
        markup.key(palette.COST_FORBIDDEN, "forbidden", height=8),
        markup.heading("Ground by its looks"),
        segmentation.legend(),
        markup.heading("Arcs"),
        markup.key(palette.CHOSEN_ARC, "chosen"),
        markup.key(palette.CANDIDATE_ARC, "candidate"),
        *reasons,
    )
