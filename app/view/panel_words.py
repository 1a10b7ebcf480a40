"""States in words."""

from __future__ import annotations

from planner.frames import Status

STATUS_WORDS: dict[Status, str] = {
    Status.IDLE: "ready",
    Status.RUNNING: "driving",
    Status.PAUSED: "paused",
    Status.REACHED: "goal reached",
    Status.COLLIDED: "collided",
    Status.ROLLED_OVER: "rolled over",
    Status.TIMEOUT: "out of time",
    Status.STUCK: "stuck",
    Status.UNREACHABLE: "goal unreachable",
    Status.STOPPED: "stopped",
}
