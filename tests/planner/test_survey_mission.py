from planner.frames import Status
from planner.mission import Mission
from scenes.survey import import_survey


def test_a_mission_in_a_hundred_metres_of_the_real_survey_succeeds(survey_file):
    scenario = import_survey(survey_file, crop=(273500.0, 5274500.0, 100.0))
    with Mission(scenario, "least_cost", seed=0) as mission:
        *_, last = mission.frames()
    assert last.status is Status.REACHED
