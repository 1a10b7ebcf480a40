"""Drive: play and pause, how fast, by which method, and the numbers of the moment."""

from __future__ import annotations

import math

import viser

from app.changes import Change
from app.studio import Studio
from app.view import markup
from app.view.desk import Desk, show_value
from planner.frames import Frame, Perception, Status
from planner.methods import METHODS, with_motion

SPEEDS = {"⅛×": 0.125, "¼×": 0.25, "½×": 0.5, "1×": 1.0, "2×": 2.0, "4×": 4.0, "8×": 8.0}
PERCEPTIONS = {"sensors (lidar, camera)": Perception.LIDAR, "oracle (knows the scene)": Perception.ORACLE}
MOTIONS = {"dynamic window": "dwa", "learned (DWA-RL)": "dwa_rl"}
LARGEST_SEED = 2**31 - 1


class DriveTab:
    def __init__(self, desk: Desk) -> None:
        gui, studio = desk.gui, desk.studio
        self._studio = studio
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        desk.on_click(self._play, self._play_or_pause)
        moves = gui.add_button_group("Mission", ("Step", "Reset", "Stop"))
        desk.on_choice(moves, {"Step": studio.step, "Reset": studio.reset, "Stop": studio.stop})
        self._speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1×")
        desk.on_value(self._speed, lambda label: studio.set_speed(SPEEDS.get(label, 1.0)))
        method, _ = with_motion(studio.method)
        self._method = gui.add_dropdown("Method", tuple(METHODS), initial_value=method)
        desk.on_value(self._method, self._choose_method)
        self._motion = gui.add_dropdown("Arcs chosen by", tuple(MOTIONS))
        desk.on_value(self._motion, self._choose_motion)
        self._perception = gui.add_dropdown("Perception", tuple(PERCEPTIONS))
        desk.on_value(
            self._perception, lambda label: studio.set_perception(PERCEPTIONS.get(str(label), str(label)))
        )
        self._seed = gui.add_number("Seed", studio.seed, min=0, max=LARGEST_SEED, step=1)
        desk.on_value(self._seed, lambda seed: studio.set_seed(int(seed)))
        self._numbers = gui.add_html("")
        self._shown = ""
        self.refresh(Change.SETTINGS)

    def _play_or_pause(self) -> None:
        (self._studio.pause if self._studio.status is Status.RUNNING else self._studio.play)()

    def _choose_method(self, label: str) -> None:
        _, motion = with_motion(self._studio.method)
        if label != called(self._studio):
            self._studio.set_method(driven_by(label, motion))

    def _choose_motion(self, label: str) -> None:
        studio = self._studio
        method, motion = with_motion(studio.method)
        wanted = MOTIONS.get(label, label)
        if wanted != motion:
            studio.set_method(driven_by(method, wanted), studio.weights)

    def refresh(self, change: Change) -> None:
        studio = self._studio
        if change is not Change.FRAME:
            running = studio.status is Status.RUNNING
            label = "Pause" if running else "Drive again" if studio.status.final else "Play"
            if self._play.label != label:
                self._play.label = label
                self._play.icon = viser.Icon.PLAYER_PAUSE if running else viser.Icon.PLAYER_PLAY
        if change is Change.SETTINGS:
            nearest = min(SPEEDS, key=lambda label: abs(math.log(SPEEDS[label] / studio.speed)))
            perception = next(label for label, mode in PERCEPTIONS.items() if mode is studio.perception)
            show_value(self._speed, nearest)
            labels = tuple(METHODS) if studio.weights is None else (*METHODS, called(studio))
            if tuple(self._method.options) != labels:
                self._method.options = labels
            show_value(self._method, called(studio))
            _, motion = with_motion(studio.method)
            show_value(self._motion, next(label for label, name in MOTIONS.items() if name == motion))
            show_value(self._perception, perception)
            show_value(self._seed, min(studio.seed, LARGEST_SEED))
        numbers = live_numbers(studio)
        if numbers != self._shown:
            self._numbers.content = self._shown = numbers


def called(studio: Studio) -> str:
    """The method, with the training's checkpoint that it drives by, if any."""
    method, _ = with_motion(studio.method)
    return method if studio.weights is None else f"{method} · {studio.weights.stem}"


def driven_by(method: str, motion: str) -> str:
    """The name of a method with a motion control."""
    return method if motion == MOTIONS["dynamic window"] else f"{method}+{motion}"


def live_numbers(studio: Studio) -> str:
    """The state in words and the numbers of the newest frame, as HTML."""
    rows = _frame_rows(studio.frame) if studio.frame is not None else []
    if studio.status is Status.RUNNING:
        rows.append(("Speed reached", f"{studio.real_factor:.1f}× of {studio.speed:g}×"))
    return markup.block(markup.sentence(studio.message), markup.table(rows))


def _frame_rows(frame: Frame) -> list[tuple[str, str]]:
    gap = math.hypot(frame.goal[0] - frame.pose.x, frame.goal[1] - frame.pose.y)
    rows = [
        ("Time", f"{frame.time_s:.1f} s"),
        ("To the goal", f"{gap:.1f} m"),
        ("Driven", f"{frame.metrics.trajectory_length_m:.1f} m"),
        ("Speed", f"{frame.twist.v:z.2f} m/s, {math.degrees(frame.twist.w):z.0f} °/s"),
        ("Roll, pitch", f"{math.degrees(frame.pose.roll):z.1f}°, {math.degrees(frame.pose.pitch):z.1f}°"),
        ("In cover (Algorithm 1)", f"{100.0 * frame.metrics.cover_fraction:.0f} % of the way"),
        ("Planner", f"{frame.planner_ms:.0f} ms"),
    ]
    if frame.percept is not None:
        seen = sorted(frame.percept.detections, key=lambda detection: -detection.confidence)[:3]
        if seen:
            rows.append(("Camera sees", ", ".join(f"{d.class_name} {d.confidence:.2f}" for d in seen)))
    return rows
