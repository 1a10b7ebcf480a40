"""The paper's reward to the letter, its other readings, and what the corrected one pays for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from field import field, thing

from planner.environment import CoverNavEnv, action_of
from planner.frames import Status
from planner.reward import (
    ABLATED,
    REWARDS,
    CorrectedReward,
    CoverReading,
    ElevationReading,
    Moment,
    PaperReward,
    cover_reward,
    elevation_reward,
    normalised_return,
    paper_reward,
)
from scenes.pose import Twist
from scenes.scenario import Observer

STANDING = Moment(
    previous_goal_distance=10.0, goal_distance=10.0, previous_heading=0.0, heading=0.0, heading_error=0.0,
    roll=0.0, pitch=0.0, elevation=0.0, previous_elevations=(0.0,) * 5,
)  # fmt: skip


def literal(**changes) -> dict[str, float]:
    usual = {
        "previous_goal_distance": 10.0,
        "goal_distance": 10.0,
        "previous_heading": 0.0,
        "heading": 0.0,
        "roll": 0.0,
        "pitch": 0.0,
        "elevation": 0.0,
        "previous_elevations": [0.0],
        "elevation_weights": [1.0],
        "cover_distance": 99.0,
        "robot_width": 0.67,
    }
    return paper_reward(**(usual | changes))


class TestThePapersReward:
    def test_its_terms_are_five_and_their_sum(self) -> None:
        terms = literal(goal_distance=9.0, heading=0.2, roll=0.1, elevation=0.3, cover_distance=0.5)
        assert list(terms) == ["goal", "dir", "stab", "elev", "cover", "total"]
        assert terms["total"] == pytest.approx(sum(terms[name] for name in list(terms)[:-1]))

    def test_goal_is_the_metres_nearer(self) -> None:
        assert literal(previous_goal_distance=10.0, goal_distance=9.75)["goal"] == 0.25

    @pytest.mark.parametrize(
        ("before", "now", "turned"), [(0.0, 0.5, 0.5), (0.5, 0.0, 0.5), (3.1, -3.1, 2 * math.pi - 6.2)]
    )
    def test_dir_is_the_heading_changed_the_short_way_round(self, before, now, turned) -> None:
        assert literal(previous_heading=before, heading=now)["dir"] == pytest.approx(-turned)

    def test_stab_falls_with_both_angles(self) -> None:
        assert literal()["stab"] == 1.0
        assert literal(roll=0.3, pitch=-0.4)["stab"] == pytest.approx(math.exp(-0.25))

    def test_elev_is_its_equation(self) -> None:
        terms = literal(elevation=2.0, previous_elevations=[1.0, 3.0, 1.5], elevation_weights=[0.5, 0.2, 0.1])
        assert terms["elev"] == pytest.approx(0.5 * 1.0 - 0.2 * 1.0 + 0.1 * 0.5)

    @pytest.mark.parametrize(
        ("widths", "reward"),
        [(0.0, -1000.0), (0.499, -1000.0), (0.5, 0.0), (1.0, 0.5), (1.5, 1.0), (1.501, 0.0), (math.inf, 0.0)],
    )
    def test_cover_pays_between_half_a_width_and_one_and_a_half(self, widths, reward) -> None:
        assert cover_reward(2.0 * widths, 2.0) == pytest.approx(2.0 * reward if reward > -1000 else reward)

    def test_there_is_a_weight_for_each_elevation(self) -> None:
        with pytest.raises(ValueError, match="one weight for each"):
            literal(previous_elevations=[1.0, 2.0])


class TestReadings:
    @pytest.mark.parametrize(
        ("reading", "value"), [("abstract", -0.9), ("equation", -0.1), ("table", 0.9), ("height", -2.0)]
    )
    def test_of_elevation(self, reading, value) -> None:
        assert elevation_reward(2.0, [1.2, 3.0], [0.5, 0.5], reading) == pytest.approx(value)

    def test_staying_level_is_the_usual_one(self) -> None:
        assert elevation_reward(1.0, [0.0], [1.0]) == -1.0

    def test_an_unknown_one_is_refused(self) -> None:
        with pytest.raises(ValueError, match="sideways"):
            elevation_reward(1.0, [0.0], [1.0], "sideways")

    def test_of_cover_to_the_centre_or_to_the_surface(self) -> None:
        beside_a_house = replace(STANDING, cover_centre=4.0, cover_surface=0.8)
        centre, surface = (PaperReward(cover=reading)(beside_a_house)["cover"] for reading in CoverReading)
        assert centre == 0.0 and surface == pytest.approx(0.8 - 0.335)

    def test_they_go_into_the_total(self) -> None:
        climbing = replace(STANDING, elevation=1.0)
        for reading in ElevationReading:
            terms = PaperReward(elevation=reading)(climbing)
            total = terms.pop("total")
            assert total == pytest.approx(sum(terms.values()))

    def test_at_an_episodes_beginning_there_are_fewer_positions(self) -> None:
        assert PaperReward()(replace(STANDING, elevation=1.0, previous_elevations=(0.0,)))["elev"] == 0.2


class TestTheCorrectedReward:
    reward = CorrectedReward()

    def test_every_term_has_a_name(self) -> None:
        terms = self.reward(STANDING)
        total = terms.pop("total")
        assert total == pytest.approx(sum(terms.values()))
        assert set(terms) == {
            "goal", "heading", "stab", "elev", "cover", "exposure", "time", "arrival", "failure"
        }  # fmt: skip

    def test_heading_is_the_error_toward_the_goal_not_the_change(self) -> None:
        turning = replace(STANDING, previous_heading=1.0)
        assert self.reward(turning)["heading"] == 0.0
        assert self.reward(replace(STANDING, heading_error=1.0))["heading"] < 0.0

    def test_cover_pays_most_at_the_stand_off(self) -> None:
        paid = [
            self.reward(replace(STANDING, hidden=1.0, shelter=distance))["cover"]
            for distance in (0.3, 0.5, 0.75, 1.0, 2.0, 4.0, 9.0)
        ]
        assert paid[0] == paid[1] == paid[5] == paid[6] == 0.0
        assert 0.0 < paid[2] < paid[3] > paid[4] > 0.0

    def test_cover_that_hides_from_nobody_pays_nothing(self) -> None:
        beside_a_rock = replace(STANDING, cover_surface=1.0, cover_centre=1.5)
        assert self.reward(beside_a_rock)["cover"] == 0.0

    def test_no_moment_of_standing_still_pays(self) -> None:
        best = replace(STANDING, hidden=1.0, shelter=self.reward.stand_off)
        assert self.reward(best)["total"] < 0.0

    def test_failing_is_never_the_way_out(self) -> None:
        worst = replace(STANDING, exposure=1.0, heading_error=math.pi)
        for status in (Status.COLLIDED, Status.ROLLED_OVER, Status.STOPPED):
            assert self.reward(replace(worst, status=status))["total"] < 100 * self.reward(worst)["total"]

    def test_being_seen_costs_by_the_second(self) -> None:
        half, full = (self.reward(replace(STANDING, exposure=share))["exposure"] for share in (0.5, 1.0))
        assert full == 2.0 * half < 0.0
        assert self.reward(replace(STANDING, exposure=1.0, seconds=0.5))["exposure"] == 2.0 * full


def parked_and_arriving(reward) -> tuple[float, float]:
    """Returns, by formula, of standing for an episode and of driving 12 m to the goal at 1 m/s."""
    parked = 100 * reward(STANDING)["total"]
    arriving = 0.0
    for step in range(48):
        left = 12.0 - 0.25 * step
        moving = replace(STANDING, previous_goal_distance=left, goal_distance=left - 0.25)
        arriving += reward(replace(moving, status=Status.REACHED if step == 47 else Status.RUNNING))["total"]
    return parked, arriving


def test_by_the_papers_formula_parking_pays_better_than_arriving() -> None:
    parked, arriving = parked_and_arriving(REWARDS["paper"])
    assert parked == 100.0 and arriving == 60.0


def test_by_the_corrected_formula_it_does_not() -> None:
    parked, arriving = parked_and_arriving(REWARDS["corrected"])
    assert parked < 0.0 < arriving


def driven(reward: str, dynamics: str, command: Twist) -> tuple[float, Status]:
    """The return of one command held for an episode over a watched meadow, with a bush on it."""
    watcher = Observer(id=1, x=0.0, y=9.0, yaw=-90.0)
    scenario = field(
        goal=(6.0, 0.0), start=(-6.0, 0.0), observers=(watcher,), cover=(thing(1, "bush", x=0, y=3),)
    )
    env = CoverNavEnv(scenario=scenario, reward=reward, dynamics=dynamics, perception="oracle")
    env.reset(seed=0)
    total, over = 0.0, False
    while not over:
        _, paid, terminated, truncated, info = env.step(action_of(command))
        total, over = total + paid, terminated or truncated
    env.close()
    return total, info["status"]


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_a_robot_that_parks_outscores_one_that_arrives_under_the_papers_reward_alone(dynamics) -> None:
    returns = {}
    for reward in ("paper", "corrected"):
        parked, waiting = driven(reward, dynamics, Twist(0.0, 0.0))
        arriving, there = driven(reward, dynamics, Twist(0.9, 0.0))
        assert waiting is Status.RUNNING and there is Status.REACHED
        returns[reward] = parked, arriving
    parked, arriving = returns["paper"]
    assert parked > arriving
    parked, arriving = returns["corrected"]
    assert parked < 0.0 < arriving


def test_rewards_are_plain_numbers() -> None:
    for reward in REWARDS.values():
        assert all(type(value) is float and np.isfinite(value) for value in reward(STANDING).values())


def test_the_papers_other_readings_go_by_name() -> None:
    readings = {name: REWARDS[f"paper[{name}]"] for name in ("abstract", "table", "height")}
    for name, reward in readings.items():
        assert reward == PaperReward(elevation=ElevationReading(name))
    assert REWARDS["paper[surface]"] == PaperReward(cover=CoverReading.SURFACE)


def test_the_normalised_return_grows_with_cover_and_falls_with_visibility():
    better, middling, worse = (normalised_return(4.0, *shares) for shares in ((1, 0), (0.5, 0), (0.5, 0.5)))
    assert better > middling > worse
    assert normalised_return(4.0, 0.3, 0.3) == pytest.approx(4.0)


def test_each_weight_of_the_corrected_reward_can_be_left_out():
    for weight in ABLATED:
        left = REWARDS[f"corrected[no_{weight}]"]
        assert getattr(left, weight) == 0.0 and getattr(REWARDS["corrected"], weight) > 0.0


@pytest.mark.parametrize("wrong", [{"cover_distance": math.nan}, {"robot_width": -1.0}])
def test_the_papers_reward_refuses_what_makes_no_sense(wrong):
    with pytest.raises(ValueError, match="makes no sense"):
        literal(**wrong)
