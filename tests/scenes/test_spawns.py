import numpy as np
import pytest

from scenes.families import generate
from scenes.physics import World
from scenes.pose import Twist
from scenes.scenario import Family, Scenario
from scenes.survey import import_survey


def survive(scenario: Scenario, seed: int, spawns: int = 3, seconds: float = 3.0) -> None:
    """Spawn at random, idle or driving at random; nothing explodes, falls through or stops being a number."""
    rng = np.random.default_rng(seed)
    heightmap, cover = scenario.terrain.heightmap(), scenario.cover
    west, east, south, north = heightmap.bounds
    with World(heightmap, cover, scenario.obstacles, scenario.start) as world:
        for spawn in range(spawns):
            while True:
                x, y = rng.uniform(west + 0.8, east - 0.8), rng.uniform(south + 0.8, north - 0.8)
                if all(item.footprint.distance(np.array([[x, y]]))[0] > 0.7 for item in cover):
                    break
            world.place_robot(x, y, rng.uniform(-np.pi, np.pi))
            for _ in range(round(seconds / 0.5)):
                command = Twist(rng.uniform(-0.3, 1.0), rng.uniform(-1.5, 1.5)) if spawn % 3 else Twist()
                world.step(command, 0.5)  # raises where the robot is lost
                pose = world.pose
                assert abs(world.twist.v) < 5.0
                assert abs(world.twist.w) < 15.0
                ground_height = float(heightmap.height_at(pose.x, pose.y))
                assert -0.5 < pose.z - ground_height < 2.0


@pytest.mark.parametrize("family", list(Family))
def test_the_robot_survives_random_places_on_every_terrain(family: Family) -> None:
    survive(generate(family, 5), 1)


def test_the_robot_survives_random_places_on_a_survey(survey_file) -> None:
    survive(import_survey(survey_file, resolution=1.0), 2)
