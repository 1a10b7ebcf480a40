"""The controls of a replay, above the tabs while there is one: play, pause, scrub, end."""

from __future__ import annotations

from html import escape

import viser

from app.results_replay import Replay
from app.view import markup
from app.view.desk import Desk, show_value

SPEEDS = {"½×": 0.5, "1×": 1.0, "2×": 2.0, "4×": 4.0, "8×": 8.0}


class ReplayFolder:
    def __init__(self, desk: Desk) -> None:
        service = desk.viewer.view.replay.service
        self._service, gui = service, desk.gui
        self._folder = gui.add_folder("Replay", visible=False)
        with self._folder:
            self._words = gui.add_html("")
            self._time = gui.add_slider("Time, s", min=0.0, max=1.0, step=0.1, initial_value=0.0)
            desk.on_value(self._time, lambda time_s: service.seek(float(time_s)))
            self._play = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE)
            desk.on_click(self._play, self._play_or_pause)
            self._speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1×")
            desk.on_value(self._speed, lambda label: service.set_speed(SPEEDS.get(label, 1.0)))
            desk.on_click(gui.add_button("End the replay", icon=viser.Icon.X), service.end)
        self._shown: Replay | None = None
        self.refresh()

    def _play_or_pause(self) -> None:
        (self._service.pause if self._service.playing else self._service.play)()

    def refresh(self) -> None:
        """Show where the replay stands."""
        service = self._service
        replay = service.replay
        if replay is not self._shown:
            self._shown = replay
            self._folder.visible = replay is not None
            if replay is not None:
                self._time.max = max(round(replay.duration_s, 1), 0.1)
                self._words.content = words(replay)
        if replay is None:
            return
        show_value(self._time, min(round(service.time_s, 1), self._time.max))
        label = "Pause" if service.playing else "Play"
        if self._play.label != label:
            self._play.label = label
            self._play.icon = viser.Icon.PLAYER_PAUSE if service.playing else viser.Icon.PLAYER_PLAY
        nearest = min(SPEEDS, key=lambda label: abs(SPEEDS[label] - service.speed))
        show_value(self._speed, nearest)


def words(replay: Replay) -> str:
    """Whose drives are played, as HTML."""
    keys = "".join(
        markup.key(actor.colour, f"{actor.method}: {actor.outcome} after {actor.way.duration_s:.1f} s")
        for actor in replay.actors
    )
    return markup.block(f'<div style="margin-bottom:4px">{escape(replay.title)}</div>', keys)
