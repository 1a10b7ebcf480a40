"""The view as a whole: what it draws of the studio's state, what panel, gizmo and layers make of commands."""

import asyncio
import contextlib
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from meadows import meadow_scene

from app.changes import Change, Kind, Selection, StudioError
from app.view.glb import Surface, glb
from app.view.keys import TOOL_KEYS
from app.view.layers import STYLES, Layer
from app.view.nodes import PARSE_S, SLOTS, SwapGlb
from app.view.panel_drive import live_numbers
from app.view.properties import FIELDS
from app.view.tools import HINTS, Tool
from app.view.viewer import Viewer
from planner.frames import (
    Arcs,
    CostPatch,
    CoverEstimate,
    Decision,
    Detection,
    Frame,
    Metrics,
    Percept,
    Perception,
    Status,
    WalkerPose,
)
from scenes.catalogue import CoverKind
from scenes.pose import Pose, Twist
from scenes.scenario import CoverSpec, ObstacleSpec


class Guest:
    """A browser's side of a viewer: the server's widgets, and notes of what it was told."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.client_id, self.gui, self.scene, self.told, self.files = 1, server.gui, server.scene, [], {}
        self.camera = SimpleNamespace(position=np.array([0.0, -9.0, 5.0]), look_at=np.zeros(3))

    atomic = staticmethod(contextlib.nullcontext)

    def add_notification(self, title, body, **_):
        self.told.append(f"{title}: {body}")
        return SimpleNamespace(remove=lambda: None)

    def send_file_download(self, filename, content, **_):
        self.files[filename] = content


@pytest.fixture
def viewer(view, server):
    viewer = Viewer(view, Guest(server))
    view._viewers[1] = viewer
    return viewer


def node(server, name):
    return server.scene.get_handle_by_name(name)


def frame(tick=1, x=-2.0, status=Status.RUNNING) -> Frame:
    pose = Pose(x, 0.5, 0.0, yaw=0.3)
    steps = np.linspace(0.0, 1.0, 8)
    poses = np.zeros((3, 8, 3))
    poses[:, :, 0], poses[:, :, 1] = x + steps, 0.5 + np.array([[-0.3], [0.0], [0.3]]) * steps
    zeros = np.zeros(3)
    terms = dict.fromkeys(("heading", "clearance", "velocity", "goal", "ground", "total"), zeros)
    arcs = Arcs(
        v=zeros + 1.0, w=zeros, poses=poses, rejection=np.array([0, 0, 4], np.int8), chosen=1, **terms
    )
    cost = CostPatch(-4.0, -4.0, 0.5, np.full((16, 16), 30.0, np.float32))
    tree = CoverEstimate(1, CoverKind.TREE, 0.0, 5.0, 0.0, 3.0, 6.0, 0.9)
    seen = Detection(1, 0, "tree", 0.93, 10, 10, 40, 60, 1, 0.0, 5.0, 0.0)
    blank = np.zeros((0, 2))
    percept = Percept(
        0.1 * tick, Perception.LIDAR, pose, Twist(0.8, 0.0), (3.0, 0.0), None, blank, blank, blank, blank,
        detections=(seen,), cover=(tree,),
    )  # fmt: skip
    decision = Decision(
        Twist(0.8, 0.0), (0.0, 0.2), np.array([[x, 0.5], [3.0, 0.0]]), cost, arcs, cover_id=1, note="driving"
    )
    return Frame(
        tick, 0.1 * tick, status, pose, Twist(0.8, 0.0), (0.4,) * 4, (3.0, 0.0), percept, decision,
        Metrics(trajectory_length_m=1.0), (WalkerPose(1, 0.0, 8.0, 0.0, -1.5),), (),
        np.array([[1.0, 0.0, 0.2], [1.0, 1.0, 0.4]], np.float32),
        message="driving to the goal", planner_ms=12.0,
    )  # fmt: skip


def draw(view, newest: Frame) -> None:
    """Hand a frame to the view as the studio does, and wait until it is drawn."""

    async def go():
        view.studio._drive.frame = newest
        view.studio.tell(Change.FRAME)
        await asyncio.sleep(0.2)

    asyncio.run(go())


def edit(view, command, *arguments):
    """Run a studio command on a loop, as the studio does."""

    async def go():
        return command(*arguments)

    return asyncio.run(go())


def test_the_scene_stands_before_anybody_looks(view, server):
    for name in ("/terrain/ground/0", "/cover/tree_0/0", "/figures/observers/known", "/sight/outlines",
                 "/goal", "/start", "/robot/body", "/robot/front_left_wheel"):  # fmt: skip
        assert node(server, name) is not None, name
    assert tuple(node(server, "/robot").position) == (-3.0, 0.0, 0.0)


def test_a_frame_moves_the_robot_and_turns_its_wheels(view, server):
    draw(view, frame(x=-1.0))
    np.testing.assert_allclose(node(server, "/robot").position, (-1.0, 0.5, 0.0))
    np.testing.assert_allclose(
        node(server, "/robot/rear_left_wheel").wxyz, (np.cos(0.2), 0.0, np.sin(0.2), 0.0), atol=1e-6
    )


def test_a_frame_draws_what_the_robot_sensed_and_decided(view, server):
    draw(view, frame(tick=1, x=-2.0))
    draw(view, frame(tick=2, x=-1.5))
    for name in ("/scan/points", "/arcs/candidates", "/arcs/rejected", "/arcs/chosen", "/route/line",
                 "/route/waypoint", "/path/line", "/detections/chosen"):  # fmt: skip
        assert node(server, name).visible, name
    assert len(node(server, "/scan/points").points) == 2
    assert view.scene._cost._drawn is not None


def test_a_mesh_is_replaced_without_a_gap_and_without_piling_up(server):
    server.scene.reset()
    mesh = glb(Surface(np.eye(3), np.array([[0, 1, 2]])))

    async def go():
        swapped = SwapGlb(server.scene, "/swapped")
        for _ in range(30):
            swapped.show(mesh)
            await asyncio.sleep(0.01)
            assert any(node(server, f"/swapped/{slot}") is not None for slot in range(SLOTS))
        await asyncio.sleep(PARSE_S + 0.2)
        left = [slot for slot in range(SLOTS) if node(server, f"/swapped/{slot}") is not None]
        assert len(left) == 1
        swapped.show(None)
        assert node(server, f"/swapped/{left[0]}") is None

    asyncio.run(go())


def test_the_path_begins_anew_with_a_new_mission(view, server):
    for tick, x in ((1, -2.0), (2, -1.5), (3, -1.0)):
        draw(view, frame(tick, x))
    assert len(node(server, "/path/line").points) == 2
    draw(view, frame(1, -3.0))
    assert not node(server, "/path/line").visible


def test_a_hidden_layer_is_hidden_for_all_and_costs_nothing(view, server, viewer):
    edit(view, view.show_layer, Layer.ARCS, False)
    draw(view, frame())
    assert not node(server, "/arcs").visible
    assert not node(server, "/arcs/chosen").visible
    assert viewer.panel.layers._boxes[Layer.ARCS].value is False
    assert 'data-layers="' in viewer.panel._held.content and "arcs" not in viewer.panel._held.content


def test_opacity_is_checked(view):
    with pytest.raises(ValueError, match="0 to 1"):
        view.set_opacity(Layer.COST, 1.5)


def test_an_edit_moves_what_was_edited(view, server):
    edit(view, view.studio.set_goal, -4.0, 2.0)
    np.testing.assert_allclose(node(server, "/goal").position[:2], (-4.0, 2.0))
    edit(view, view.studio.delete_observer, 1)
    assert node(server, "/figures/observers/known") is None


def test_the_selected_object_is_a_node_of_its_own_that_a_drag_moves(view, server):
    edit(view, view.studio.select, Selection(Kind.COVER, 1))
    single = node(server, "/cover/selected")
    edit(view, view.studio.update_cover, 1, {"x": 2.0})
    assert node(server, "/cover/selected") is single and single.position[0] == 2.0
    edit(view, view.studio.select, None)
    assert node(server, "/cover/selected") is None


STRAIGHT = (1.0, 0.0, 0.0, 0.0)


def test_a_drag_of_the_gizmo_is_one_undo_entry(view, viewer):
    studio = view.studio
    edit(view, studio.select, Selection(Kind.OBSERVER, 1))
    for phase, x in (("start", 0.0), ("update", 1.0), ("update", 2.0), ("end", 3.0)):
        edit(view, viewer.gizmo._drag, studio.selection, phase, (x, 8.0, 0.1), STRAIGHT)
    moved = studio.scenario.observers[0]
    assert (moved.x, moved.yaw) == (3.0, 0.0)
    edit(view, studio.undo)
    assert studio.scenario.observers == meadow_scene().observers and not studio.can_undo


def test_a_drag_to_where_it_cannot_be_ends_where_it_was_allowed(view, viewer, server):
    studio = view.studio
    edit(view, studio.select, Selection(Kind.GOAL))
    edit(view, viewer.gizmo._drag, studio.selection, "start", (3.0, 0.0, 0.1), STRAIGHT)
    edit(view, viewer.gizmo._drag, studio.selection, "update", (99.0, 0.0, 0.1), STRAIGHT)
    with pytest.raises(StudioError, match="off the map"):
        edit(view, viewer.gizmo._drag, studio.selection, "end", (99.0, 0.0, 0.1), STRAIGHT)
    assert studio.scenario.goal.x == 3.0
    assert node(server, "/gizmo").position[0] == 3.0


def test_the_gizmo_is_out_of_the_way_of_a_tool_that_places(view, viewer, server):
    edit(view, view.studio.select, Selection(Kind.GOAL))
    assert node(server, "/gizmo") is not None
    edit(view, viewer.arm, Tool.COVER)
    assert node(server, "/gizmo") is None
    edit(view, viewer.arm, Tool.MOVE)
    assert node(server, "/gizmo") is not None


def test_a_refusal_is_told_to_its_viewer_with_the_reason(view, viewer):
    viewer.refuse("goal is inside a <house>")
    assert viewer.client.told == ["Not done: Goal is inside a <house>"]
    assert "&lt;house&gt;" in viewer.panel._held.content and "<house>" not in viewer.panel._held.content


def test_a_reset_takes_the_last_drive_off_the_scene(view, server):
    draw(view, frame(1, -2.0))
    draw(view, frame(2, -1.5))
    edit(view, view.studio.reset)
    for name in ("/scan/points", "/arcs/chosen", "/route/line", "/path/line", "/detections/chosen"):
        assert not node(server, name).visible, name
    assert tuple(node(server, "/robot").position) == (-3.0, 0.0, 0.0)


def test_another_scenario_is_drawn_and_looked_at_anew(view, server, viewer):
    async def go():
        other = meadow_scene().revised(cover=())
        await view.studio.open_document(other)
        for _ in range(200):
            if node(server, "/terrain/ground/1") is not None:
                return
            await asyncio.sleep(0.05)

    asyncio.run(go())
    assert node(server, "/terrain/ground/1") is not None
    assert node(server, "/cover/tree_0/0") is None


@pytest.mark.parametrize("kind", list(Kind))
def test_the_panel_shows_and_edits_every_property(view, viewer, kind):
    studio = view.studio
    edit(view, studio.add_obstacle, ObstacleSpec(kind="person", x=5.0, y=-5.0))
    thing = Selection(kind, 0 if kind in (Kind.START, Kind.GOAL) else 1)
    edit(view, studio.select, thing)
    plan = viewer.panel.plan
    fields = [field for field in FIELDS[kind] if not field.of_patrol]
    assert list(plan._widgets) == [field.name for field in fields]
    for field in fields:
        if field.kind is float and field.choices is None and field.name in ("x", "yaw"):
            edit(view, plan._enter, thing, field, plan._widgets[field.name].value + 0.25)
            assert plan._widgets[field.name].value == getattr(studio.find(thing), field.name)


def test_a_property_that_is_refused_goes_back(view, viewer):
    studio = view.studio
    edit(view, studio.select, Selection(Kind.GOAL))
    plan = viewer.panel.plan
    plan._widgets["x"].value = 77.0
    with pytest.raises(ValueError, match="off the map"):
        edit(view, plan._enter, studio.selection, FIELDS[Kind.GOAL][0], 77.0)
    assert plan._widgets["x"].value == 3.0


def test_arming_a_tool_shows_in_the_panel_and_again_puts_it_down(viewer):
    viewer.arm(Tool.COVER)
    assert HINTS[Tool.COVER] in viewer.panel._held.content
    assert viewer.panel.plan._cover_kind.visible
    viewer.arm(Tool.COVER)
    assert viewer.armed.tool is None and 'data-tool=""' in viewer.panel._held.content


def test_escape_puts_down_the_tool_first_then_deselects(view, viewer):
    edit(view, view.studio.select, Selection(Kind.GOAL))
    viewer.arm(Tool.GOAL)
    edit(view, viewer.disarm_or_deselect)
    assert viewer.armed.tool is None and view.studio.selection is not None
    edit(view, viewer.disarm_or_deselect)
    assert view.studio.selection is None


def test_names_that_people_type_are_text_in_the_panel(view):
    spiteful = "<img src=x onerror=alert(1)>"
    view.studio._drive.message = spiteful
    view.studio._drive.frame = frame()
    assert "<img" not in live_numbers(view.studio) and "&lt;img" in live_numbers(view.studio)


def test_the_scenario_can_be_taken_home(view, viewer):
    viewer.panel.scenarios._download()
    assert viewer.client.files["meadow-test.json"] == meadow_scene().to_json().encode()


def test_following_goes_along_with_the_robot(viewer):
    viewer.eye.toggle_follow(Pose(0.0, 0.0, 0.0))
    before = viewer.client.camera.position.copy()
    viewer.eye.keep_up(Pose(1.0, 2.0, 0.5))
    np.testing.assert_allclose(viewer.client.camera.position - before, (1.0, 2.0, 0.5))
    viewer.eye.toggle_follow(Pose(1.0, 2.0, 0.5))
    assert not viewer.eye.following


def test_the_view_from_above_goes_back_to_where_it_was(viewer):
    before = viewer.client.camera.position.copy()
    viewer.look_from_above()
    assert viewer.client.camera.position[2] > 20.0
    viewer.look_from_above()
    np.testing.assert_allclose(viewer.client.camera.position, before)


def test_many_objects_are_few_nodes(view, server):
    bushes = [CoverSpec(kind="bush", x=-9.0 + 0.3 * i, y=-9.0) for i in range(50)]
    for bush in bushes:
        edit(view, view.studio.add_cover, bush)
    chunks = [n for n in view.scene._cover._nodes if n[0] == "bush"]
    assert len(chunks) == 3


def test_keys_and_tools_belong_together():
    keys = [style.key for style in STYLES.values() if style.key]
    assert [key for key in keys if key.isdigit()] == list("123456789")
    assert len({*keys, *TOOL_KEYS}) == len(keys) + len(TOOL_KEYS)
    assert set(TOOL_KEYS.values()) | {Tool.ROBOT} == set(Tool) and set(HINTS) == set(Tool)
