"""Walks, and drives, as somebody who watches them remembers them: straight legs, the places where the walkers
turned, and what a walk so far tells of how it goes on.

Many walks at once, one to a row: those that lessons are taken from, or the ways that one may go on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from scenes.pose import wrap_angle

TURNED = math.radians(60.0)
"""Change of heading between two sightings from which it counts as a turn: what a track has of it wavers."""

LONGEST_GAP = 2.0
"""Seconds between two sightings from which nobody knows what the walker did meanwhile."""

LEAST_SPEED = 0.3
"""m/s at which there is a heading."""

PLACES = 8
"""Turns that are remembered of each walk, the oldest forgotten first."""

ASIDE, ALIKE = 0.75, math.radians(45.0)
"""Metres beside its line, and difference of its heading, with which a walker comes to where it has turned."""

STEP = 0.5
"""Seconds within which there is a turn or none."""

FAR, SOON = 16.0, 4.0
"""Metres, and steps to a place, that mean as much as more."""

FEATURES = (
    "walked", "turn_seen", "last_leg", "last_leg_known", "steps_to_place", "place_known", "place_cos",
    "place_sin", "last_cos", "last_sin", "speed", "turns", "vehicle",
)  # fmt: skip


@dataclass(eq=False)
class Walks:
    """n walks. Times in seconds, NaN before a first sighting; metres, radians, m/s.

    vehicle (n,) bool : not a person
    position (n, 2), heading (n,), time (n,) : as seen last
    speed (n,) : usually
    walked (n,) : since the last turn, or since it was seen first; begun (n,) bool: it was a turn
    last_leg, last_turn (n,) : length of the leg before and the turn after it, 0 where nobody saw all of it
    places (n, PLACES, 2), inbound, turns (n, PLACES) : where it turned, how it headed there, and by how much
    count (n,) : turns seen
    """

    vehicle: np.ndarray
    position: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    time: np.ndarray
    walked: np.ndarray
    begun: np.ndarray
    last_leg: np.ndarray
    last_turn: np.ndarray
    places: np.ndarray
    inbound: np.ndarray
    turns: np.ndarray
    count: np.ndarray

    @classmethod
    def unseen(cls, vehicle: np.ndarray) -> Walks:
        """Walkers whom nobody has seen; `vehicle` (n,) bool."""
        number = len(vehicle)
        zeros = np.zeros(number)
        return cls(
            vehicle, np.zeros((number, 2)), zeros.copy(), zeros.copy(), np.full(number, np.nan), zeros.copy(),
            np.zeros(number, bool), zeros.copy(), zeros.copy(), np.full((number, PLACES, 2), np.nan),
            np.zeros((number, PLACES)), np.zeros((number, PLACES)), np.zeros(number, int),
        )  # fmt: skip

    def repeated(self, number: int) -> Walks:
        """Each walk so many times over."""
        return Walks(*(np.repeat(getattr(self, field.name), number, axis=0) for field in fields(self)))

    def see(self, time: np.ndarray, position: np.ndarray, velocity: np.ndarray, seen: np.ndarray) -> None:
        """Take in a sighting of each walk at time (n,), position (n, 2), velocity (n, 2), where seen (n,).
        One who hardly moves may be about to turn: its heading is what it was."""
        rate = np.hypot(*velocity.T)
        seen = seen & (rate >= LEAST_SPEED)
        heading = np.arctan2(velocity[:, 1], velocity[:, 0])
        passed = time - self.time
        known = seen & (passed <= LONGEST_GAP) & (passed > 0.0)
        change = np.asarray(wrap_angle(heading - self.heading))
        turned = known & (np.abs(change) > TURNED)
        ahead = np.hypot(*(position - self.position).T)
        on = known & ~turned
        fresh = on & (self.speed <= 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            pace = ahead / passed
        self.speed[on] = np.where(fresh, pace, 0.5 * (self.speed + pace))[on]
        self.walked[on] += ahead[on]
        before, corner = self._corner(passed, position, change)
        self._turn(turned, self.position + before[:, None] * _along(self.heading), change, before)
        self.walked[turned] = corner[turned]
        lost = seen & ~known
        self.walked[lost], self.begun[lost] = 0.0, False
        self.last_leg[lost], self.last_turn[lost] = 0.0, 0.0
        self.position[seen], self.heading[seen], self.time[seen] = position[seen], heading[seen], time[seen]

    def _corner(
        self, passed: np.ndarray, position: np.ndarray, change: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n,) metres walked on before a turn between two sightings, and (n,) metres after it."""
        along, offset = _along(self.heading), position - self.position
        straight = np.einsum("ij,ij->i", offset, along)
        aside = along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]
        sin, cos = np.sin(change), np.cos(change)
        whole = np.nan_to_num(self.speed * passed)
        sharp = np.abs(sin) < 0.2  # as good as back the way it came
        after = np.where(sharp, 0.5 * (whole - straight), aside / np.where(sharp, 1.0, sin))
        before = np.where(sharp, 0.5 * (whole + straight), straight - cos * after)
        return np.maximum(before, 0.0), np.maximum(after, 0.0)

    def go(self, seconds: float, turn: np.ndarray) -> None:
        """Let each walk go straight on at its speed, and then turn by turn (n,) radians, NaN for not."""
        way = self.speed * seconds
        turning = ~np.isnan(turn)
        self.walked += way
        self.position += way[:, None] * _along(self.heading)
        self._turn(turning, self.position, turn, np.zeros(len(turn)))
        self.walked[turning] = 0.0
        self.heading = np.where(turning, np.asarray(wrap_angle(self.heading + turn)), self.heading)
        self.time += seconds

    def _turn(self, turned: np.ndarray, places: np.ndarray, change: np.ndarray, beyond: np.ndarray) -> None:
        """Remember a turn at places (n, 2), in the stead of one that is as good as the same; the leg that it
        ends was `beyond` (n,) longer than is written down."""
        rows = np.flatnonzero(turned)
        if not len(rows):
            return
        again, _, _ = self._met(places, behind=1.0, reach=1.0)
        slot = np.where(again >= 0, again, self.count % PLACES)[rows]
        self.places[rows, slot] = places[rows]
        self.inbound[rows, slot] = self.heading[rows]
        self.turns[rows, slot] = change[rows]
        self.count[rows] += again[rows] < 0
        self.last_leg[rows] = np.where(self.begun, self.walked + beyond, 0.0)[rows]
        self.last_turn[rows] = change[rows]
        self.begun[rows] = True

    def _met(
        self, position: np.ndarray, behind: float, reach: float = math.inf
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) the nearest remembered place at most `reach` metres ahead of position (n, 2), or `behind` it,
        that was come to the same way, or left the way that is come now; -1 for none. (n,) metres to it, inf
        for none, and (n,) the turn there, that of then or the same undone."""
        offset, along = self.places - position[:, None], _along(self.heading)
        ahead = np.einsum("ijk,ik->ij", offset, along)
        aside = np.abs(offset[..., 1] * along[:, None, 0] - offset[..., 0] * along[:, None, 1])
        heading = self.heading[:, None]
        again = np.abs(np.asarray(wrap_angle(self.inbound - heading))) < ALIKE
        back = np.abs(np.asarray(wrap_angle(self.inbound + self.turns + math.pi - heading))) < ALIKE
        with np.errstate(invalid="ignore"):
            there = (ahead >= -behind) & (ahead <= reach) & (aside < ASIDE) & (again | back)
        distance = np.where(there, np.abs(ahead), np.inf)
        rows, nearest = np.arange(len(distance)), np.argmin(distance, axis=1)
        metres, turns = distance[rows, nearest], self.turns[rows, nearest]
        found = np.isfinite(metres)
        turns = np.where(again[rows, nearest], turns, -turns)
        return np.where(found, nearest, -1), metres, np.where(found, turns, 0.0)

    def ahead(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) metres to where each comes to a place at which it turned before, inf for none, and (n,) by how
        much it is to turn there."""
        _, metres, turns = self._met(self.position, behind=0.3)
        return metres, turns

    def features(self) -> np.ndarray:
        """(n, FEATURES) float32, all of the order of one."""
        to_place, turn = self.ahead()
        known = np.isfinite(to_place)
        return np.stack(
            [
                np.minimum(self.walked, FAR) / FAR, self.begun,
                np.minimum(self.last_leg, FAR) / FAR, self.last_leg > 0.0,
                np.minimum(to_place / (STEP * np.maximum(self.speed, LEAST_SPEED)), SOON) / SOON, known,
                np.where(known, np.cos(turn), 0.0), np.where(known, np.sin(turn), 0.0),
                np.where(self.last_turn != 0.0, np.cos(self.last_turn), 0.0), np.sin(self.last_turn),
                self.speed, np.minimum(self.count, 4) / 4.0, self.vehicle,
            ],
            axis=1,
        ).astype(np.float32)  # fmt: skip


def _along(heading: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(heading), np.sin(heading)], axis=1)
