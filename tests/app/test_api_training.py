"""`/api/training`: orders, curves, and what is refused."""

import pytest
from meadows import meadow_scene
from served import BEARER, TOKEN, browser, silent_studio

from app.api.training import curves
from app.server import create_app
from app.settings import Settings
from app.training_plan import TrainingPlan, TrainingStatus
from app.training_service import TrainingService


@pytest.fixture
def studio(tmp_path):
    return silent_studio(tmp_path, meadow_scene())


@pytest.fixture
def service(studio):
    return TrainingService(studio)


@pytest.fixture
def client(studio, service, monkeypatch):
    """The interface with a process that never says anything in the trainer's place."""

    def begin(self, training, document):
        self._running = Silent(training)
        self._become(training, TrainingStatus.RUNNING)

    monkeypatch.setattr(TrainingService, "_begin", begin)
    app = create_app(studio, Settings.make(token=TOKEN), trainings=service)
    with browser(app, **BEARER) as client:
        yield client


class Silent:
    """Stands where the running process would."""

    def __init__(self, training):
        self.training, self.orders = training, []
        self.pipe = self.process = self.over = self

    def send(self, order):
        self.orders.append(order)

    def terminate(self):
        self.orders.append("terminate")

    async def wait(self):
        return True


def row(number, total=1.0, critic=0.5):
    losses = None if critic is None else {"critic": critic, "actor": -critic}
    return {
        "number": number, "total": total, "terms": {"goal": total}, "success": number % 2 == 1,
        "exposed_s": 2.0, "losses": losses,
    }  # fmt: skip


def test_a_training_is_started_paused_resumed_stopped_and_removed(client, service):
    answer = client.post("/api/training", json={"task": "ground", "reward": "paper", "episodes": 5})
    assert answer.status_code == 201 and answer.headers["location"] == "/api/training/1"
    started = answer.json()
    assert started["status"] == "running" and started["scenario"] == "Test meadow"
    assert started["plan"] == TrainingPlan(task="ground", reward="paper", episodes=5).model_dump(mode="json")
    second = client.post("/api/training", json={})
    assert second.status_code == 409 and "one learns at a time" in second.json()["detail"]
    assert client.post("/api/training/1/pause").json()["status"] == "paused"
    assert client.post("/api/training/1/resume").json()["status"] == "running"
    assert client.post("/api/training/1/stop").json()["status"] == "stopping"
    assert service._running.orders == ["pause", "resume", "stop"]
    assert client.delete("/api/training/1").status_code == 204
    assert client.get("/api/training").json() == []


def test_curves_hold_every_term_and_the_list_has_them_thinned(client, service):
    client.post("/api/training", json={})
    service.training(1).episodes = [row(number, float(number), None) for number in range(1000)]
    alone = client.get("/api/training/1").json()
    assert alone["episodes"] == 1000 and alone["curves"]["terms"]["goal"] == alone["curves"]["return"]
    assert alone["curves"]["losses"] == {} and alone["checkpoints"] == []
    listed = client.get("/api/training").json()[0]["curves"]
    assert len(listed["return"]) == len(listed["episode"]) == 200 and listed["episode"][-1] == 1000
    assert listed["return"][0] == 2.0 and listed["success"][0] == 0.4


def test_thinned_curves_leave_out_what_is_not_there():
    thin = curves([row(0, 1.0, None), row(1, 3.0, 0.5), row(2, 5.0, 0.7)], 2)
    assert thin["episode"] == [2, 3] and thin["return"] == [2.0, 5.0]
    assert thin["losses"]["critic"] == [0.5, 0.7]


@pytest.mark.parametrize(
    ("method", "path", "body", "status"),
    [
        ("POST", "", {"reward": "literal"}, 422),
        ("POST", "", {"task": "everything"}, 422),
        ("POST", "", {"episodes": 0}, 422),
        ("POST", "", {"episodes": 1e400}, 422),
        ("POST", "", {"seed": True}, 422),
        ("POST", "", {"steps": -1}, 422),
        ("POST", "", {"demonstrations": 91}, 422),
        ("POST", "", {"demonstrations": 0.3}, 422),
        ("POST", "", {"gpu": True}, 422),
        ("POST", "", [], 422),
        ("GET", "/7", None, 404),
        ("GET", "/0", None, 422),
        ("GET", "/seven", None, 422),
        ("GET", "/99999999999999999999", None, 422),
        ("POST", "/7/pause", None, 404),
        ("POST", "/7/use", {"checkpoint": "policy"}, 404),
        ("POST", "/7/use", {"checkpoint": ""}, 422),
        ("DELETE", "/7", None, 404),
    ],
)
def test_what_cannot_be_asked_is_refused_in_words(client, method, path, body, status):
    content = {} if body is None else {"json": body} if body != {"episodes": 1e400} else {
        "content": b'{"episodes": 1e400}', "headers": {"content-type": "application/json"},
    }  # fmt: skip
    answer = client.request(method, f"/api/training{path}", **content)
    assert answer.status_code == status and answer.json()["detail"]


def test_a_checkpoint_is_named_by_what_there_is(client, service):
    client.post("/api/training", json={})
    for name in ("policy", "../../settings", "episode_000010"):
        answer = client.post("/api/training/1/use", json={"checkpoint": name})
        assert answer.status_code == 404 and "it has none yet" in answer.json()["detail"]
