"""The one loop: sense, perceive, decide, act; every tick leaves a frame."""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planner.frames import Decision, Frame, Metrics, Percept, Perception, Status, WalkerPose
from planner.leg import Leg, in_cover, usual_time_limit
from planner.line_of_sight import views_at, visible_fraction
from planner.methods import DEFAULT_METHOD, Briefed, Driving, Learned, make_method, policies_of
from planner.perception import Perceiver
from scenes.physics import World
from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.scenario import Point, Scenario, Start, Terrain, Walker, why_not_standing
from scenes.world import DrivenWorld, RobotLostError

TICK_S = 0.1
REACHED_DISTANCE, REACHED_SPEED = 0.3, 0.12
ROLLED_OVER_UP = math.cos(math.radians(60.0))
DRAWN_SCAN_POINTS = 4000


@dataclass(frozen=True)
class MissionSnapshot:
    """Enough to go on with a mission in another process, from a standstill: simulated time and tick, the true
    pose, and as pickles of our own making the leg, the perceiver's map and random numbers and the method's
    state.
    """

    time_s: float
    tick: int
    pose: Pose
    goal: tuple[float, float]
    status: Status
    method: str
    memory: bytes


class Mission:
    """A scenario being driven. Same scenario, method, seed and perception give bit-identical frames but for
    `planner_ms`.

    time_limit_s : for each leg; by default 30 s and 6 s a metre of the straight line
    decision_period_s : how often the method decides, at least a tick of 0.1 s; its command holds in between
    snapshot : of a mission of the same terrain, to go on from; scenario, method and perception given here win
    weights : of a training, instead of the learned method's own
    world : makes what is driven in; `scenes.kinematics.KinematicWorld` for drives by the dozen
    rays : of this very ground and cover, for whoever has made them already; the mission moves its figures

    Raises ValueError for an unknown method, weights that cannot be used or a decision period below a tick.
    """

    def __init__(
        self,
        scenario: Scenario,
        method: str = DEFAULT_METHOD,
        seed: int = 0,
        perception: Perception = Perception.LIDAR,
        time_limit_s: float | None = None,
        snapshot: MissionSnapshot | None = None,
        *,
        decision_period_s: float = TICK_S,
        weights: Path | None = None,
        world: Callable[..., DrivenWorld] = World,
        rays: RayScene | None = None,
    ):
        if not (math.isfinite(decision_period_s) and decision_period_s >= TICK_S):
            raise ValueError(f"the decision period must be at least {TICK_S} s, got {decision_period_s}")
        self.tick_s = TICK_S
        self.scenario, self.seed, self.method_name = scenario, seed, method
        self._time_limit_s = time_limit_s
        self._ticks_per_decision = round(decision_period_s / TICK_S)
        self._method = make_method(method, seed, weights)
        self._perceiver = Perceiver(scenario, perception, np.random.default_rng(seed))
        self._heightmap = scenario.terrain.heightmap()
        self._rays = rays or RayScene(self._heightmap, scenario.cover)
        start, begun_s = scenario.start, 0.0
        if snapshot is not None:
            pose = snapshot.pose
            start = Start(x=pose.x, y=pose.y, yaw=math.degrees(pose.yaw))
            begun_s = snapshot.time_s
        self._world = world(self._heightmap, scenario.cover, scenario.obstacles, start, time_s=begun_s)
        self._placed: tuple | None = None
        self._tick = 0
        self._decision: Decision | None = None
        self._decided_tick = 0
        self._touched: frozenset = frozenset()
        self._begin_leg()
        if snapshot is not None:
            self._resume(snapshot, perception)
        self._watch(0.0)
        self._brief()
        self.frame = self._make_frame(None, None, "ready", False, 0.0)

    def close(self) -> None:
        """Free the physics; safe to call twice."""
        self._world.close()

    def __enter__(self) -> Mission:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- driving ---------------------------------------------------------------------------------

    @property
    def perception(self) -> Perception:
        return self._perceiver.perception

    @property
    def metrics(self) -> Metrics:
        """Totals of the present leg."""
        return self._leg.metrics

    def frames(self) -> Iterator[Frame]:
        """Tick until the drive is over."""
        while not self.status.final:
            yield self.tick()

    def tick(self) -> Frame:
        """Sense, perceive, decide, act for 0.1 s; the frame of the moment after. A drive that is over stays
        as it is."""
        if self.status.final:
            return self.frame
        begun, begun_s = time.perf_counter(), self._world.time_s
        percept = self._perceive()
        decision = self._decide(percept)
        planner_ms = 1e3 * (time.perf_counter() - begun)
        self._tick += 1
        message = decision.note
        if decision.failure is not None:
            self.status = decision.failure
        else:
            message = self._act(decision.command) or message
        covered = in_cover(percept)
        contacts = frozenset(self._world.touching())
        self._leg.add(self._world.pose, covered, len(contacts - self._touched), planner_ms)
        self._touched = contacts
        self._watch(self._world.time_s - begun_s)
        self.frame = self._make_frame(percept, decision, message, covered, planner_ms)
        return self.frame

    def _perceive(self) -> Percept:
        world = self._world
        self._place_walkers()
        return self._perceiver.perceive(self._rays, world.pose, world.twist, world.time_s, self._leg.goal)

    def _place_walkers(self) -> None:
        """Put the figures in the ray scene where they are now, unless they stand there already."""
        placed = self._world.time_s, self.scenario.obstacles, self.scenario.observers
        if placed != self._placed:
            self._rays.set_walkers(placed[1], placed[2], placed[0])
            self._placed = placed

    def _watch(self, seconds: float) -> None:
        """Count what the observers have seen of the robot for `seconds`."""
        observers = self.scenario.observers
        if observers:
            self._place_walkers()
        views = views_at(observers, self._heightmap, self._world.time_s)
        pose = self._world.pose
        self._leg.exposure.add(seconds, views, visible_fraction(self._rays, views, pose), pose)

    def _decide(self, percept: Percept) -> Decision:
        decision = self._decision
        if decision is None or self._tick - self._decided_tick >= self._ticks_per_decision:
            self._decision = decision = self._method.decide(percept)
            self._leg.command(decision.command, percept.twist)
            self._decided_tick = self._tick
        return decision

    def _act(self, command: Twist) -> str:
        """Move the world; the words for an end of the drive, empty while it goes on."""
        try:
            self._world.step(command, self.tick_s)
        except RobotLostError as error:
            self.status = Status.STOPPED
            return str(error)
        self.status, message = self._judge()
        return message

    def _judge(self) -> tuple[Status, str]:
        world, leg = self._world, self._leg
        pose, elapsed = world.pose, world.time_s - leg.begun_s
        if world.up < ROLLED_OVER_UP:
            return Status.ROLLED_OVER, "the robot has rolled over"
        touching = world.touching()
        if touching:
            names = ", ".join(f"{contact.kind} {contact.id}" for contact in touching)
            return Status.COLLIDED, f"the robot has run into {names}"
        distance = math.hypot(leg.goal[0] - pose.x, leg.goal[1] - pose.y)
        if distance <= REACHED_DISTANCE and abs(world.twist.v) <= REACHED_SPEED:
            return Status.REACHED, f"reached the goal in {elapsed:.1f} s"
        if elapsed >= leg.time_limit_s - 1e-6:
            return Status.TIMEOUT, f"out of time after {elapsed:.0f} s, {distance:.1f} m from the goal"
        return Status.RUNNING, ""

    def _make_frame(
        self,
        percept: Percept | None,
        decision: Decision | None,
        message: str,
        covered: bool,
        planner_ms: float,
    ) -> Frame:
        world, time_s = self._world, self._world.time_s
        cloud = self._perceiver.cloud
        return Frame(
            tick=self._tick,
            time_s=time_s,
            status=self.status,
            pose=world.pose,
            twist=world.twist,
            wheel_angles=world.wheel_angles,
            goal=self._leg.goal,
            percept=percept,
            decision=decision,
            metrics=self._leg.metrics,
            observers=tuple(
                self._stand(observer.id, observer, time_s) for observer in self.scenario.observers
            ),
            obstacles=tuple(
                self._stand(obstacle.id, obstacle, time_s) for obstacle in self.scenario.obstacles
            ),
            scan_points=np.zeros((0, 3), np.float32) if cloud is None else cloud.in_world(DRAWN_SCAN_POINTS),
            message=message,
            in_cover=covered,
            exposure=self._leg.exposure.exposure,
            planner_ms=planner_ms,
        )

    def _stand(self, identifier: int, walker: Walker, time_s: float) -> WalkerPose:
        x, y, yaw = walker.pose_at(time_s)
        return WalkerPose(identifier, x, y, float(self._heightmap.height_at(x, y)), yaw)

    def summary(self) -> dict:
        """The present leg as `covernav run --json` has it."""
        policies = policies_of(self._method)
        motion = self._method.driver.motion if isinstance(self._method, Driving) else None
        of_motion = policies[-1] if isinstance(motion, Learned) else None
        return self._leg.summary(
            self.scenario.name, self.method_name, self.perception, self.seed, self.status, self._world.time_s
        ) | {
            "policy": policies[0] if policies else None,
            "motion": motion.name if motion else None,
            "motion_policy": of_motion,
        }

    # --- changes while driving -------------------------------------------------------------------

    def set_goal(self, x: float, y: float) -> None:
        """Begin a new leg to (x, y) from where the robot is.

        Raises ValueError where a Husky cannot stand there, or where this one cannot drive any more.
        """
        reason = why_not_standing(self._heightmap, self.scenario.cover, x, y)
        if reason is not None:
            raise ValueError(f"the goal {reason}")
        self._check_drivable()
        self.scenario = self.scenario.model_copy(update={"goal": Point(x=x, y=y)})
        self._begin_leg()
        self._renew_frame()

    def set_pose(self, x: float, y: float, yaw: float) -> None:
        """Put the robot at (x, y) facing `yaw` (radians) and begin a new leg to the same goal.

        Raises ValueError where a Husky cannot stand there.
        """
        reason = why_not_standing(self._heightmap, self.scenario.cover, x, y, yaw)
        if reason is not None:
            raise ValueError(f"the robot's place {reason}")
        self._world.place_robot(x, y, yaw)
        self._begin_leg()
        self._watch(0.0)
        self.frame = self._make_frame(None, None, "put somewhere else", False, 0.0)

    def set_method(self, name: str, weights: Path | None = None) -> None:
        """Plan with another method from now on, or with weights of a training.

        Raises ValueError for an unknown one, and for weights that cannot be used."""
        self._method, self.method_name = make_method(name, self.seed, weights), name
        self._brief()
        self._decision = None

    def set_perception(self, mode: Perception) -> None:
        """Sense or know from now on. Raises ValueError for an unknown mode."""
        self._perceiver.perception = Perception(mode)
        self._method.reset()
        self._decision = None

    def edit(self, scenario: Scenario) -> None:
        """Take over changed cover, observers, obstacles or goal; the robot stays where it is. A changed goal
        begins a new leg, unless the robot cannot drive any more.

        Raises ValueError where the terrain differs.
        """
        if not _same_ground(self.scenario.terrain, scenario.terrain):
            raise ValueError("the terrain differs; open the scenario anew instead of editing it")
        old, self.scenario = self.scenario, scenario
        if scenario.cover != old.cover:
            self._rays.set_cover(scenario.cover)
            self._world.set_cover(scenario.cover)
        if scenario.obstacles != old.obstacles:
            self._world.set_obstacles(scenario.obstacles)
        self._perceiver.edit(scenario)
        self._method.reset()
        self._brief()
        self._decision = None
        if scenario.goal != old.goal and not self.status.final:
            self._begin_leg()
        self._renew_frame()

    def _renew_frame(self) -> None:
        """Show at once what has changed around the robot; it senses and decides at the next tick."""
        self._watch(0.0)
        old = self.frame
        self.frame = self._make_frame(old.percept, old.decision, old.message, old.in_cover, old.planner_ms)

    def stop(self) -> None:
        """End the drive here."""
        if not self.status.final:
            self.status = Status.STOPPED

    def _brief(self) -> None:
        if isinstance(self._method, Briefed):
            self._method.brief(self.scenario, self._rays)

    def _check_drivable(self) -> None:
        if self.status in (Status.COLLIDED, Status.ROLLED_OVER):
            what = "has collided" if self.status is Status.COLLIDED else "has rolled over"
            raise ValueError(f"the robot {what}; put it somewhere else or reset the mission first")

    def _begin_leg(self) -> None:
        pose, goal = self._world.pose, (self.scenario.goal.x, self.scenario.goal.y)
        limit = self._time_limit_s
        if limit is None:
            limit = usual_time_limit(math.hypot(goal[0] - pose.x, goal[1] - pose.y))
        self._leg = Leg(self._world.time_s, pose, goal, limit)
        self.status = Status.RUNNING
        self._method.reset()
        self._decision = None
        self._touched = frozenset()

    # --- going on elsewhere ----------------------------------------------------------------------

    def snapshot(self) -> MissionSnapshot:
        """The present moment for a new `Mission`, in this or another process."""
        memory = pickle.dumps((self._leg, self._perceiver, self._method), pickle.HIGHEST_PROTOCOL)
        return MissionSnapshot(
            self._world.time_s,
            self._tick,
            self._world.pose,
            self._leg.goal,
            self.status,
            self.method_name,
            memory,
        )

    def _resume(self, snapshot: MissionSnapshot, perception: Perception) -> None:
        leg, self._perceiver, method = pickle.loads(snapshot.memory)
        self._perceiver.perception = perception
        self._perceiver.edit(self.scenario)
        self._tick = self._decided_tick = snapshot.tick
        if snapshot.method == self.method_name:
            self._method = method
        if leg.goal == (self.scenario.goal.x, self.scenario.goal.y):
            self._leg, self.status = leg, snapshot.status


def _same_ground(one: Terrain, other: Terrain) -> bool:
    return one is other or (
        (one.resolution, one.surface, one.quality) == (other.resolution, other.surface, other.quality)
        and np.array_equal(one.heights, other.heights)
    )
