"""What a decision of the robot was worth: the paper's reward to the letter, its other readings, and ours.

The paper's reward (its Table I) pays exp(-ψ²), up to 1, for every step that the robot does not tilt, and at
most the metres to the goal for getting there: standing still pays best. The corrected reward pays nothing
for merely being there, a bonus for arriving, and counts what observers truly see.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Protocol

import numpy as np

from planner.frames import Status
from scenes.pose import wrap_angle
from scenes.robot import HUSKY

TOO_CLOSE = -1000.0
"""The paper's price of being nearer to cover than half the robot's width."""

ELEVATION_WEIGHTS = (0.2,) * 5
"""Of the last five positions; the paper gives neither their number nor their weights."""


class ElevationReading(StrEnum):
    """What r_elev is, according to different places in the paper; Δh_i = h_now - h_i, i counts positions.

    ABSTRACT: -Σ w_i |Δh_i|, staying level, "penalising ... high elevation"
    EQUATION: Σ w_i Δh_i, climbing pays
    TABLE: Σ w_i |Δh_i|, ups and downs pay
    HEIGHT: -w h_now with w = Σ w_i, low ground pays (a line of the source that is commented out)
    """

    ABSTRACT = "abstract"
    EQUATION = "equation"
    TABLE = "table"
    HEIGHT = "height"


class CoverReading(StrEnum):
    """What the distance in r_cover is measured to: the nearest cover object's centre, in three dimensions,
    as the paper has it (a house is then always too far away to count), or its surface on the ground."""

    CENTRE = "centre"
    SURFACE = "surface"


def elevation_reward(
    elevation: float,
    previous_elevations: Sequence[float],
    elevation_weights: Sequence[float],
    reading: ElevationReading | str = ElevationReading.ABSTRACT,
) -> float:
    """r_elev in one of its readings; elevations in metres.

    Raises ValueError for an unknown reading, or where there is not one weight for each elevation.
    """
    reading = ElevationReading(reading)
    if len(previous_elevations) != len(elevation_weights):
        raise ValueError(
            f"one weight for each previous elevation: got {len(elevation_weights)} weights"
            f" and {len(previous_elevations)} elevations"
        )
    weights = np.asarray(elevation_weights, float)
    rise = float(elevation) - np.asarray(previous_elevations, float)
    if reading is ElevationReading.EQUATION:
        return float(weights @ rise)
    if reading is ElevationReading.HEIGHT:
        return -float(weights.sum()) * float(elevation)
    steps = float(weights @ np.abs(rise))
    return steps if reading is ElevationReading.TABLE else -steps


def cover_reward(cover_distance: float, robot_width: float) -> float:
    """r_cover as the paper gives it, metres: -1000 below half the robot's width, then the distance beyond
    that, and 0 from one and a half widths on."""
    if cover_distance < 0.5 * robot_width:
        return TOO_CLOSE
    return cover_distance - 0.5 * robot_width if cover_distance <= 1.5 * robot_width else 0.0


def paper_reward(
    *,
    previous_goal_distance: float,
    goal_distance: float,
    previous_heading: float,
    heading: float,
    roll: float,
    pitch: float,
    elevation: float,
    previous_elevations: Sequence[float],
    elevation_weights: Sequence[float],
    cover_distance: float,
    robot_width: float,
) -> dict[str, float]:
    """The paper's equations to the letter: goal, dir, stab, elev, cover and their sum, total.

    Metres and radians; r_elev is read as its equation, Σ w_i (h_now - h_i), and ψ² as roll² + pitch²

    Raises ValueError for a distance to cover that is no number and a width that is not positive.
    """
    if math.isnan(cover_distance) or not robot_width > 0.0:
        raise ValueError(f"cover {cover_distance} m away of a robot {robot_width} m wide makes no sense")
    terms = {
        "goal": previous_goal_distance - goal_distance,
        "dir": -abs(float(wrap_angle(heading - previous_heading))),
        "stab": math.exp(-(roll**2 + pitch**2)),
        "elev": elevation_reward(
            elevation, previous_elevations, elevation_weights, ElevationReading.EQUATION
        ),
        "cover": cover_reward(cover_distance, robot_width),
    }
    terms = {name: float(term) for name, term in terms.items()}
    return terms | {"total": sum(terms.values())}


EPSILON = 0.1
"""Keeps the normalised return finite where the robot was once not seen at all."""


def normalised_return(total: float, most_hidden: float, least_visible: float) -> float:
    """An episode's return "normalised by" the greatest cover and the least visibility in it, which the paper
    only names: of its readings the one that "encourages maximum cover and minimum visibility" where the
    return is positive. Reported beside the return and learnt from by nobody.

    most_hidden, least_visible : shares of the robot from 0 to 1
    """
    return total * (most_hidden + EPSILON) / (least_visible + EPSILON)


@dataclass(frozen=True)
class Moment:
    """What a decision led to, as it truly is; metres, radians, seconds.

    heading_error : between the robot's heading and the way straight to the goal
    previous_elevations : of the ground at the last positions, newest first
    cover_centre, cover_surface : distances from the robot's middle to the nearest cover, inf without any
    shelter : distance to the surface of the nearest cover that stands in an observer's line of sight to the
        robot; inf where none does
    hidden : share of the robot that stays unseen of those who have it in their field of view
    exposure : visible fraction of the robot, all observers together
    slopes_ahead : rise over run of the ground ahead for each half metre, the nearest first
    """

    previous_goal_distance: float
    goal_distance: float
    previous_heading: float
    heading: float
    heading_error: float
    roll: float
    pitch: float
    elevation: float
    previous_elevations: tuple[float, ...]
    cover_centre: float = math.inf
    cover_surface: float = math.inf
    shelter: float = math.inf
    hidden: float = 0.0
    exposure: float = 0.0
    slopes_ahead: tuple[float, ...] = ()
    seconds: float = 0.25
    status: Status = Status.RUNNING


class Reward(Protocol):
    """Every term by name, and their sum, `total`."""

    def __call__(self, moment: Moment) -> dict[str, float]: ...


@dataclass(frozen=True)
class PaperReward:
    """`paper_reward` on a moment, or with other readings of r_elev and r_cover.

    robot_width : the paper's "shortest external dimension of the robot"; the width, for the height is meant
        by nobody
    """

    elevation: ElevationReading = ElevationReading.EQUATION
    cover: CoverReading = CoverReading.CENTRE
    elevation_weights: tuple[float, ...] = ELEVATION_WEIGHTS
    robot_width: float = HUSKY.width

    def __call__(self, moment: Moment) -> dict[str, float]:
        weights = self.elevation_weights[: len(moment.previous_elevations)]
        terms = paper_reward(
            previous_goal_distance=moment.previous_goal_distance,
            goal_distance=moment.goal_distance,
            previous_heading=moment.previous_heading,
            heading=moment.heading,
            roll=moment.roll,
            pitch=moment.pitch,
            elevation=moment.elevation,
            previous_elevations=moment.previous_elevations[: len(weights)],
            elevation_weights=weights,
            cover_distance=moment.cover_centre if self.cover == CoverReading.CENTRE else moment.cover_surface,
            robot_width=self.robot_width,
        )
        if self.elevation == ElevationReading.EQUATION:
            return terms
        del terms["total"]
        terms["elev"] = elevation_reward(
            moment.elevation, moment.previous_elevations[: len(weights)], weights, self.elevation
        )
        return terms | {"total": sum(terms.values())}


@dataclass(frozen=True)
class CorrectedReward:
    """Arriving pays, being seen, tilting and dawdling cost, and cover is what stands in a line of sight.

    goal : a metre nearer; heading : a radian off the goal, a second; stability, elevation : of
        exp(-ψ²) - 1 and of -Σ w_i |Δh_i|, a second
    cover : a second behind cover at `stand_off` metres, of the share of the robot that it hides; falls to 0
        at `touching` and at `far`. Less than `time`, so that standing still never pays
    exposure : a second in full view; time : a second
    arrival, failure : on reaching the goal, and on collision or rolling over. Failing costs more than being
        seen to the end of an episode, so that it is never the way out
    """

    goal: float = 1.0
    heading: float = 0.05
    stability: float = 0.5
    elevation: float = 0.2
    cover: float = 0.12
    exposure: float = 0.4
    time: float = 0.2
    arrival: float = 10.0
    failure: float = 25.0
    touching: float = 0.5
    stand_off: float = 1.0
    far: float = 4.0
    elevation_weights: tuple[float, ...] = ELEVATION_WEIGHTS

    def __call__(self, moment: Moment) -> dict[str, float]:
        """goal, heading, stab, elev, cover, exposure, time, arrival, failure and total."""
        weights = self.elevation_weights[: len(moment.previous_elevations)]
        seconds = moment.seconds
        level = math.exp(-(moment.roll**2 + moment.pitch**2)) - 1.0
        climbed = elevation_reward(moment.elevation, moment.previous_elevations[: len(weights)], weights)
        failed = moment.status in (Status.COLLIDED, Status.ROLLED_OVER, Status.STOPPED)
        terms = {
            "goal": self.goal * (moment.previous_goal_distance - moment.goal_distance),
            "heading": -self.heading * seconds * abs(float(wrap_angle(moment.heading_error))),
            "stab": self.stability * seconds * level,
            "elev": self.elevation * seconds * climbed,
            "cover": self.cover * seconds * moment.hidden * self.nearness(moment.shelter),
            "exposure": -self.exposure * seconds * moment.exposure,
            "time": -self.time * seconds,
            "arrival": self.arrival if moment.status is Status.REACHED else 0.0,
            "failure": -self.failure if failed else 0.0,
        }
        return terms | {"total": sum(terms.values())}

    def nearness(self, distance: float) -> float:
        """From 0 to 1: how well `distance` metres from cover keep, most at the stand-off."""
        if distance <= self.stand_off:
            return max(distance - self.touching, 0.0) / (self.stand_off - self.touching)
        return max(self.far - distance, 0.0) / (self.far - self.stand_off)


@dataclass(frozen=True)
class TerpReward:
    """TERP's (Weerakoon et al. 2022, the weights of its published code): toward the goal, facing it, upright,
    over level ground ahead; nothing for cover. In metres: all is divided by what the code pays for a metre
    nearer, so that values stay small; neither that nor the code's common division by 5 changes what is best.

    stability : of cos² roll + cos² pitch; heading : a degree off the goal
    elevation : of the slopes ahead, less the farther, for a centimetre of rise a cell of half a metre; the
        code's unit is that of a grid whose scale is not published
    end : paid for arriving and charged for failing, instead of all else. As published, failing costs no more
        than four tenths of a metre of way
    """

    stability: float = 45.0 / 6000.0
    heading: float = 0.4 / 6000.0
    elevation: float = 2.2 / 6000.0
    end: float = 500.0 / 1200.0

    def __call__(self, moment: Moment) -> dict[str, float]:
        """goal, stab, heading, elev, end and total."""
        terms = dict.fromkeys(("goal", "stab", "heading", "elev", "end"), 0.0)
        if moment.status is Status.REACHED:
            terms["end"] = self.end
        elif moment.status.final:
            terms["end"] = -self.end
        else:
            rises = 100.0 * 0.5 * np.abs(np.asarray(moment.slopes_ahead, float))
            nearness = 1.0 - np.arange(len(rises)) / max(len(rises), 1)
            terms["goal"] = moment.previous_goal_distance - moment.goal_distance
            terms["stab"] = self.stability * (math.cos(moment.roll) ** 2 + math.cos(moment.pitch) ** 2)
            terms["heading"] = -self.heading * math.degrees(abs(float(wrap_angle(moment.heading_error))))
            terms["elev"] = -self.elevation * float(nearness @ rises)
        return terms | {"total": sum(terms.values())}


ABLATED = ("goal", "heading", "stability", "elevation", "cover", "exposure", "time", "arrival", "failure")
"""Weights of the corrected reward that can be left out, one at a time."""

REWARDS: dict[str, Reward] = {
    "corrected": CorrectedReward(),
    "paper": PaperReward(),
    "paper[equation]": PaperReward(elevation=ElevationReading.EQUATION),
    "paper[abstract]": PaperReward(elevation=ElevationReading.ABSTRACT),
    "paper[table]": PaperReward(elevation=ElevationReading.TABLE),
    "paper[height]": PaperReward(elevation=ElevationReading.HEIGHT),
    "paper[surface]": PaperReward(cover=CoverReading.SURFACE),
    "terp": TerpReward(),
    **{f"corrected[no_{weight}]": replace(CorrectedReward(), **{weight: 0.0}) for weight in ABLATED},
}
"""By the names of `covernav train --reward`; in brackets the term that the corrected one goes without, and
what the paper's is read otherwise in."""
