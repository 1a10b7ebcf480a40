"""The environment: Gymnasium's contract, what an episode is, and that nothing of one outlives it."""

import math
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from field import field, thing
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import planner  # noqa: F401 - makes the environment known
from planner.curriculum import Curriculum, Progress
from planner.environment import DECISION_S, CoverNavEnv, action_of, command_of
from planner.episode import Grounds, Task
from planner.frames import Status
from scenes.families import generate
from scenes.pose import Pose, Twist
from scenes.scenario import Family, MovingObstacle, Observer, ObstacleKind, Patrol, Point, ScenarioError

STRAIGHT, STOP = action_of(Twist(0.9, 0.0)), action_of(Twist(0.0, 0.0))
WATCHER = Observer(id=1, x=0.0, y=9.0, yaw=-90.0)


def same(one, other) -> bool:
    return all(np.array_equal(one[name], other[name]) for name in ("layers", "state"))


def run(env, seed, actions) -> list:
    """Everything that an episode of these actions shows."""
    observation, info = env.reset(seed=seed)
    told = [observation["layers"].tobytes(), observation["state"].tobytes(), info["pose"]]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        told += [observation["layers"].tobytes(), observation["state"].tobytes(), reward, info]
        if terminated or truncated:
            break
    return told


@pytest.fixture(scope="module")
def env() -> CoverNavEnv:
    return CoverNavEnv("forest", variety=1)


@pytest.fixture(scope="module")
def actions() -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2)).astype(np.float32)


class TestGymnasiumsContract:
    def test_it_is_made_by_name_after_importing_the_planner_which_is_cheap(self) -> None:
        code = (
            "import sys, gymnasium, planner; gymnasium.spec('CoverNav-v0');"
            "sys.exit(bool({'torch', 'pybullet', 'numba'} & set(sys.modules)))"
        )
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

    @pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
    def test_check_env(self, dynamics) -> None:
        made = gymnasium.make(
            "CoverNav-v0", terrain="normal", reward="corrected", dynamics=dynamics, variety=1
        )
        check_env(made.unwrapped)
        made.close()

    @pytest.mark.parametrize("mode", ["sync", "async"])
    def test_it_runs_vectorised(self, mode, env, actions) -> None:
        made = gymnasium.make_vec("CoverNav-v0", 2, mode, terrain="forest", variety=1)
        observations, _ = made.reset(seed=5)
        assert observations["layers"].shape == (2, 6, 40, 40)
        _, rewards, *_, info = made.step(np.stack([STRAIGHT, STOP]))
        assert rewards.shape == (2,)
        assert set(info["terms"]) >= {"goal", "exposure", "total"}
        made.close()
        alone, _ = env.reset(seed=5)
        assert np.array_equal(observations["layers"][0], alone["layers"])

    def test_stable_baselines3_trains_on_it(self) -> None:
        learning = pytest.importorskip("stable_baselines3")
        made = gymnasium.make("CoverNav-v0", terrain="normal", variety=1, perception="oracle")
        learner = learning.DDPG(
            "MultiInputPolicy", made, learning_starts=4, batch_size=4, buffer_size=32, seed=0
        )
        learner.learn(8)
        assert learner.num_timesteps == 8

    def test_actions_are_terps(self) -> None:
        assert command_of(np.array([1.0, -1.0])) == Twist(1.0, -1.5)
        assert command_of(np.array([-1.0, 0.0])) == Twist(0.0, 0.0)
        assert command_of(np.array([5.0, 5.0])) == Twist(1.0, 1.5)
        command = command_of(action_of(Twist(0.4, -0.3)))
        assert (command.v, command.w) == pytest.approx((0.4, -0.3), abs=1e-6)

    @pytest.mark.parametrize("action", [[math.nan, 0.0], [0.0], [0.0, math.inf]])
    def test_an_action_is_two_finite_numbers(self, env, action) -> None:
        env.reset(seed=0)
        with pytest.raises(ValueError, match="two finite numbers"):
            env.step(np.array(action))


class TestEpisodes:
    def test_the_same_seed_gives_the_same_to_the_last_bit(self, env, actions) -> None:
        assert run(env, 7, actions) == run(CoverNavEnv("forest", variety=1), 7, actions)
        assert run(env, 8, actions) != run(env, 7, actions)

    def test_in_physics_too(self, actions) -> None:
        once, again = (
            run(CoverNavEnv("normal", dynamics="physics", variety=1), 7, actions) for _ in range(2)
        )
        assert once == again

    @pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
    def test_nothing_outlives_a_collision(self, dynamics, actions) -> None:
        wall = thing(1, "cottage", x=3.5, y=0.0)
        scenario = field(goal=(9.0, 0.0), cover=(wall,), observers=(WATCHER,))
        used = CoverNavEnv(scenario=scenario, dynamics=dynamics)
        assert run(used, 1, [STRAIGHT] * 20)[-1]["status"] is Status.COLLIDED
        fresh = CoverNavEnv(scenario=scenario, dynamics=dynamics)
        assert run(used, 2, actions) == run(fresh, 2, actions)

    def test_it_ends_at_the_goal(self) -> None:
        env = CoverNavEnv(scenario=field(goal=(2.0, 0.0)))
        env.reset(seed=0)
        for _ in range(12):
            _, _, terminated, truncated, info = env.step(STRAIGHT)
            if terminated:
                break
        assert terminated and not truncated
        assert info["status"] is Status.REACHED and info["success"]
        assert info["terms"]["arrival"] == 10.0
        with pytest.raises(ResetNeeded):
            env.step(STRAIGHT)

    def test_it_ends_on_a_slope_too_steep_to_stand_on(self) -> None:
        heights = np.tile(1.5 * np.maximum(np.linspace(-12.0, 12.0, 97) - 1.0, 0.0), (97, 1)).T
        env = CoverNavEnv(scenario=field(goal=(8.0, 0.0), heights=heights))
        env.reset(seed=0)
        env.step(action_of(Twist(0.0, 1.5)))
        for _ in range(60):
            *_, terminated, _, info = env.step(action_of(Twist(0.8, 0.3)))
            if terminated:
                break
        assert info["status"] in (Status.ROLLED_OVER, Status.STOPPED) and info["terms"]["failure"] < 0.0

    def test_it_is_cut_short_after_its_steps(self) -> None:
        env = CoverNavEnv(scenario=field(), max_steps=3)
        env.reset(seed=0)
        over = [env.step(STOP)[2:4] for _ in range(3)]
        assert over == [(False, False), (False, False), (False, True)]
        env.reset(options={"max_steps": 1})
        assert env.step(STOP)[3]

    def test_exposed_seconds_are_what_observers_see(self) -> None:
        seen, hidden = (
            CoverNavEnv(scenario=field(goal=(8.0, 0.0), observers=watching))
            for watching in ((WATCHER,), (Observer(id=1, x=0.0, y=9.0, yaw=90.0),))
        )
        for env, seconds in ((seen, 4 * DECISION_S), (hidden, 0.0)):
            env.reset(seed=0)
            for _ in range(4):
                observation, *_, info = env.step(STOP)
            assert info["exposed_s"] == pytest.approx(seconds)
            assert observation["state"][26] == pytest.approx(seconds)
            assert info["terms"]["exposure"] == pytest.approx(-0.4 * 0.25 * seconds)

    def test_the_exposure_layer_is_dark_behind_cover_and_light_before_it(self) -> None:
        wall = thing(1, "building", x=5.0, y=0.0, length=4.0, width=6.0)
        watcher = Observer(id=1, x=-9.0, y=0.0, yaw=0.0, fov_horizontal=180.0)
        env = CoverNavEnv(
            scenario=field(goal=(0.0, 8.0), cover=(wall,), observers=(watcher,)), perception="oracle"
        )
        exposure = env.reset(seed=0)[0]["layers"][4]
        ahead = exposure[20]
        assert ahead[20] > 0.9 and ahead[36] < 0.1
        env.reset(seed=0, options={"scenario": field(cover=(wall,), goal=(0.0, 8.0))})
        assert not env.step(STOP)[0]["layers"][4].any(), "nobody watches"

    def test_the_belief_layer_fears_those_of_whom_the_robot_was_not_told(self) -> None:
        untold = WATCHER.model_copy(update={"known": False})
        told, unaware = (
            CoverNavEnv(scenario=field(goal=(8.0, 0.0), observers=(each,))) for each in (WATCHER, untold)
        )
        assert not told.reset(seed=0)[0]["layers"][5].any()
        belief = unaware.reset(seed=0)[0]["layers"][5]
        assert 0.0 < belief.max() <= 1.0
        again = unaware.reset(seed=0)[0]["layers"][5]
        assert np.array_equal(belief, again)

    def test_cover_in_the_line_of_sight_pays_and_hides(self) -> None:
        wall = thing(1, "building", x=0.0, y=4.0, length=8.0, width=4.0)
        env = CoverNavEnv(scenario=field(goal=(8.0, 0.0), cover=(wall,), observers=(WATCHER,)))
        env.reset(seed=0)
        terms = env.step(STOP)[4]["terms"]
        assert terms["exposure"] == 0.0
        assert terms["cover"] == pytest.approx(0.12 * 0.25 * 2.0 / 3.0, abs=1e-3), "two metres from its wall"

    def test_unknown_observers_see_without_being_told(self) -> None:
        hedge = thing(1, "bush", x=0.0, y=4.0, length=2.0, height=1.0)
        away = WATCHER.model_copy(update={"known": False, "y": 11.5, "range": 30.0, "eye_height": 4.0})
        env = CoverNavEnv(scenario=field(goal=(8.0, 0.0), observers=(away,), cover=(hedge,)))
        _, info = env.reset(seed=0)
        assert info["exposed_s"] == 0.0
        observation, *_, info = env.step(STOP)
        assert info["exposed_s"] > 0.0
        assert observation["state"][26] in (0.0, np.float32(info["exposed_s"] / DECISION_S))

    def test_who_walks_is_run_into(self) -> None:
        person = MovingObstacle(
            id=1, kind=ObstacleKind.PERSON, x=2.0, y=0.0, patrol=Patrol(waypoints=(Point(x=1.5, y=0.0),))
        )
        env = CoverNavEnv(scenario=field(goal=(8.0, 0.0), obstacles=(person,)))
        env.reset(seed=0)
        while not env.status.final:
            env.step(STRAIGHT)
        assert env.status is Status.COLLIDED


class TestDrawing:
    @pytest.mark.parametrize("terrain", list(Family))
    def test_drives_are_as_far_as_asked_and_watched_as_asked(self, terrain) -> None:
        task = Task(terrain, 12.0, observers=3, patrols=True, known=False, obstacles=2)
        rng = np.random.default_rng(4)
        ground = Grounds(variety=1).draw(task, rng)
        for _ in range(5):
            scenario = ground.draw(task, rng)
            away = math.dist((scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y))
            assert 10.8 <= away <= 13.2
            assert len(scenario.observers) == 3 and len(scenario.obstacles) == 2
            assert not any(observer.known for observer in scenario.observers)
            assert any(observer.patrol for observer in scenario.observers)
            assert scenario.revised() == scenario, "a document like any other"

    def test_grounds_are_kept_and_the_oldest_let_go(self) -> None:
        grounds, rng = Grounds(variety=1, capacity=1), np.random.default_rng(0)
        first = grounds.draw(Task(Family.NORMAL), rng)
        assert grounds.draw(Task(Family.NORMAL, 4.0), rng) is first
        grounds.draw(Task(Family.LOW), rng)
        assert grounds.draw(Task(Family.NORMAL), rng) is not first

    def test_options_of_a_reset_win(self, env) -> None:
        env.reset(seed=0, options={"terrain": "low", "goal_distance": 5.0, "observers": 0})
        scenario = env.scenario
        assert scenario.name.startswith("low") and not scenario.observers
        assert math.dist((scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)) <= 5.5
        env.reset(seed=0)
        assert env.scenario.name.startswith("forest")

    def test_a_curriculums_options_are_options(self, env) -> None:
        for stage in (0, 4):
            env.reset(seed=0, options=Curriculum(1, progress=Progress(stage=stage)).options())
            assert env.steps_allowed == Curriculum(1, progress=Progress(stage=stage)).stage.steps

    def test_a_scenario_is_driven_as_it_stands_or_with_ends_of_its_own(self, env) -> None:
        meadow = field(goal=(5.0, 1.0), observers=(WATCHER,))
        env.reset(seed=0, options={"scenario": meadow})
        assert env.scenario == meadow
        env.reset(seed=0, options={"scenario": meadow, "goal_distance": 6.0})
        assert env.scenario.goal != meadow.goal and env.scenario.terrain is meadow.terrain

    def test_a_goal_out_of_reach_is_told_with_the_scenarios_name(self, env) -> None:
        fence = tuple(
            thing(i, "fence", x=x, y=y, yaw=yaw, length=6.0)
            for i, (x, y, yaw) in enumerate(((8, 3, 0), (8, -3, 0), (5, 0, 90), (11, 0, 90)), 1)
        )
        with pytest.raises(ScenarioError, match=r"'field' has no reachable goal.*\(8, 0\)"):
            env.reset(options={"scenario": field(goal=(8.0, 0.0), cover=fence)})
        with pytest.raises(ScenarioError, match=r"'field' has no reachable goal 40 m from anywhere"):
            env.reset(options={"scenario": field(), "goal_distance": 40.0})

    @pytest.mark.parametrize(
        ("wanted", "words"),
        [
            ({"terrain": "swamp"}, "swamp"),
            ({"reward": "fame"}, "reward 'fame' is none of corrected, paper"),
            ({"dynamics": "magic"}, "magic"),
            ({"goal_distance": 0.0}, "goal distance"),
            ({"observers": -1}, "number of observers"),
            ({"max_steps": 0}, "at least one"),
            ({"max_steps": 2.7}, "whole number of steps"),
            ({"variety": 0}, "at least one ground"),
            ({"reward": None}, "reward None is none of"),
            ({"observers": 2.5}, "observers must be a whole number"),
            ({"known": "no"}, "known must be true or false"),
            ({"goal_distance": "far"}, "goal distance must be metres"),
            ({"scenario": "bush-truck-cottage"}, "scenario must be a"),
        ],
    )
    def test_what_makes_no_sense_is_refused(self, wanted, words) -> None:
        with pytest.raises(ValueError, match=words):
            CoverNavEnv(**wanted)

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"max_steps": 0}, "at least one"),
            ({"observers": "2"}, "observers must be a whole number"),
            ({"scenario": "bush"}, "scenario must be a"),
            ({"scenario": field(), "observers": 3}, "give goal_distance, too"),
        ],
    )
    def test_options_that_make_no_sense_are_refused(self, env, options, words) -> None:
        with pytest.raises(ValueError, match=words):
            env.reset(options=options)

    def test_an_unknown_option_is_refused(self, env) -> None:
        with pytest.raises(ValueError, match="option 'weather' is none of terrain,"):
            env.reset(options={"weather": "rain"})

    def test_a_scenario_that_was_refused_leaves_no_episode(self, env) -> None:
        env.reset(seed=0)
        with pytest.raises(ScenarioError):
            env.reset(options={"scenario": field(), "goal_distance": 40.0})
        with pytest.raises(ResetNeeded):
            env.step(STOP)
        assert isinstance(env.reset(seed=0)[1]["pose"], Pose)


def test_a_ground_that_was_made_ahead_is_the_one_that_is_drawn(monkeypatch):
    made = []

    def counted(family, seed, **options):
        made.append(family)
        return generate(family, seed, **options)

    monkeypatch.setattr("planner.episode.generate", counted)
    ahead, later = CoverNavEnv(variety=3), CoverNavEnv(variety=3)
    wanted = {"terrain": "low", "goal_distance": 8.0, "max_steps": 5}
    ahead.prepare(seed=11, options=wanted)
    assert made == [Family.LOW]
    seen, _ = ahead.reset(seed=11, options=wanted)
    assert len(made) == 1
    expected, _ = later.reset(seed=11, options=wanted)
    assert len(made) == 2
    assert all(np.array_equal(seen[name], expected[name]) for name in expected)


def test_making_ahead_what_is_no_task_is_refused():
    with pytest.raises(ValueError, match="option 'goal' is none of"):
        CoverNavEnv().prepare(seed=1, options={"goal": 3})
