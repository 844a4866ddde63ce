"""Orders the simulated aPad of generation B by services, simple services and its action; prints the outcomes as JSON.

Use: order_by_every_road.py SCENARIO, on the master at ROS_MASTER_URI, where the aPad's node runs and nobody else publishes
/clock. A link of ours is subscribed all the while, as a mission's is, and at the end orders a go-to itself.
"""

from __future__ import annotations

import json
import sys
import threading
import xmlrpc.client
from pathlib import Path
from typing import Any

import rosgraph
import rospy
from actionlib.action_client import ActionClient, CommState
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point
from programs import wait_until
from std_msgs.msg import Float32, Int32, String

from agents.time_scale import TimeScale
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.ros.generation_b.link import GenerationBLink
from apad_bridge.ros.system.ros_pace import OwnMasterClock
from apad_bridge.ros.types.any_listener import AnyListener
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.scenario import loader
from apad_bridge.vehicle.commands import (
    DockClosed,
    DockOpened,
    Hold,
    HoldWanted,
)
from apad_bridge.vehicle.guards.gate import Gate, plain_safety
from apad_bridge.vehicle.vehicle_link import Cleared
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.generation_b.docks import BenchDocks

use_generated_messages()

from misc_msgs.srv import (  # noqa: E402
    DockingService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
    Go2pointService,
)
from navcon_msgs.msg import (  # noqa: E402
    GoToPointAction,
    GoToPointActionFeedback,
    GoToPointActionResult,
    GoToPointGoal,
)

PATIENCE_S = 180.0


class Goal:
    """A goal of the action, and its state by the client."""

    def __init__(self, client: ActionClient, north_m: float, east_m: float) -> None:
        goal = GoToPointGoal(speed=0.5, victory_radius=0.5)
        goal.T2.point.x, goal.T2.point.y = north_m, east_m
        self._handle = client.send_goal(goal)

    @property
    def key(self) -> str:
        return str(self._handle.comm_state_machine.action_goal.goal_id.id)

    def begun(self) -> Goal:
        wait_until(lambda: self._handle.get_comm_state() == CommState.ACTIVE)
        return self

    def cancel(self) -> None:
        self._handle.cancel()

    def outcome(self) -> dict[str, Any]:
        wait_until(lambda: self._handle.get_comm_state() == CommState.DONE)
        result, state = self._handle.get_result(), self._handle.get_goal_status()
        return {
            "state": GoalStatus.to_string(state),
            "distance_m": result.distance,
            "bearing_rad": result.bearing,
            "place_m": [result.position.point.x, result.position.point.y],
            "stamp_s": result.position.header.stamp.to_sec(),
        }


class Bench:
    """The clock, the link, and the messages of the status topics since they were last taken."""

    def __init__(self, scenario: Path) -> None:
        data = loader.load(scenario)
        self.now_ms = 0
        self.facts: list[Any] = []
        self.start_m = data.apad.start_m
        self.floating: dict[int, tuple[float, float]] = {}
        self.link = GenerationBLink(
            data,
            BenchDocks([7], Misses(1, 0.0), lambda _: self.floating),
            plain_safety().gate,
            our_clock=True,
        )
        self.link.wait_until_ready(PATIENCE_S)
        self._clock = OwnMasterClock(None, self.link)
        self._messages: list[str] = []
        listener = AnyListener(lambda topic, node, why: self._messages.append(f"{topic}, {node}: {why}"))
        for topic, kind in (("goto_status", Int32), ("docking_status", Int32), ("eventString", String)):
            listener.listen(f"/apad1/{topic}", kind, ("data",), self._take, topic)
        self._feedback: list[Any] = []
        # Not the client's: it receives no feedback after the result, and topics keep no order.
        rospy.Subscriber("/apad1/go2point/feedback", GoToPointActionFeedback, self._feedback.append)
        self._detections = [
            rospy.Publisher(f"/apad1/docking_{it}", Float32, queue_size=1)
            for it in ("horizontal", "vertical")
        ]
        self.run(1)
        self._client = ActionClient("/apad1/go2point", GoToPointAction)
        assert self._client.wait_for_server()
        wait_until_connected("/apad1_simulated", "/apad1/eventString", "/apad1/go2point/feedback")

    def command(self, command: Hold) -> None:
        cleared = Gate.without_guards().clear(command, self.now_ms)
        assert isinstance(cleared, Cleared)
        self.link.command(cleared, self.now_ms)

    def feedback(self, goal: Goal, count: int) -> list[tuple[float, float]]:
        """Distance and bearing in the feedback of a goal, when there are `count` of them."""

        def of_goal() -> list[Any]:
            return [it.feedback for it in self._feedback if it.status.goal_id.id == goal.key]

        wait_until(lambda: len(of_goal()) >= count)
        return [(it.distance, it.bearing) for it in of_goal()]

    def goal(self, *there: float) -> Goal:
        return Goal(self._client, *there)

    def _take(self, message: Any, topic: str) -> None:
        line = f"{topic} {message.data}"
        if self._messages[-1:] != [line]:
            self._messages.append(line)

    def run(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now_ms += 1_000
            self._clock.reach(self.now_ms, threading.Event())
            self._advance()

    def _advance(self) -> None:
        """A hold that the link asks for is ordered, as the gate's owner does."""
        facts = self.link.advance(self.now_ms)
        for it in facts:
            if isinstance(it, HoldWanted):
                self.command(Hold(-1, it.north_m, it.east_m, it.heading_rad))
        self.facts += facts

    def place_m(self) -> list[float]:
        """The place at this second: its message may arrive after the one by which the aPad is done with the second."""
        readings = self.link._core.readings

        def is_here() -> bool:
            self._advance()
            return readings.position_ms >= self.now_ms

        wait_until(is_here, why=f"no place of {self.now_ms} ms")
        assert readings.pose is not None
        return [readings.pose.north_m, readings.pose.east_m]

    def drifts_m(self) -> list[float]:
        """North and east in ten seconds."""
        there_m = self.place_m()
        self.run(10)
        return [after - before for after, before in zip(self.place_m(), there_m, strict=True)]

    def take(self, topic: str) -> list[str]:
        """The changes of one topic's value since the last call, without the repetitions of each second."""
        values = [it.removeprefix(topic + " ") for it in self._messages if it.startswith(topic)]
        self._messages = [it for it in self._messages if not it.startswith(topic)]
        return [it for n, it in enumerate(values) if values[n - 1 : n] != [it]]

    def float_ahead(self) -> None:
        """aMussel 7 floats half a metre north of the aPad."""
        north_m, east_m = self.place_m()
        self.floating[7] = (north_m + 0.5, east_m)

    def detect_until_docked(self, horizontal: float, vertical: float) -> None:
        """Publishes the camera's detection at every tick: one published beside a tick may arrive after it."""
        for _ in range(20):
            for publisher, value in zip(self._detections, (horizontal, vertical), strict=True):
                publisher.publish(Float32(value))
            self.run(1)
            if "docking_status 3" in self._messages:
                return


def wait_until_connected(node: str, *topics: str) -> None:
    """Waits until the node itself has connections for the topics: a subscriber knows of its own a moment too soon."""
    with xmlrpc.client.ServerProxy(rosgraph.Master("/bench").lookupNode(node)) as publisher:

        def has_all() -> bool:
            _, _, connections = publisher.getBusInfo("/bench")  # type: ignore[misc]
            return set(topics) <= {it[4] for it in connections if it[2] == "o"}  # type: ignore[union-attr]

        wait_until(has_all, why=f"{node} does not tell {topics}")


def call(service: str, kind: Any, **request: Any) -> bool:
    answer = rospy.ServiceProxy(f"/apad1/commander/{service}", kind)(**request)
    return bool(answer.status if hasattr(answer, "status") else answer.success)


def go_by_action(bench: Bench, north_m: float, east_m: float) -> dict[str, Any]:
    goal = bench.goal(north_m + 3, east_m).begun()
    bench.run(15)
    outcomes = goal.outcome() | {"said": bench.take("goto_status"), "events": bench.take("eventString")}
    drifted_m = bench.drifts_m()
    feedback = bench.feedback(goal, round(10 * (outcomes["stamp_s"] - 1)) - 1)
    return outcomes | {"feedback": feedback, "drifted_m": drifted_m}


def main() -> None:
    gateway = open_gateway([7], TimeScale(1), node_name="bench")
    bench = Bench(Path(sys.argv[1]))
    north_m, east_m = bench.start_m
    outcomes: dict[str, Any] = {"action": go_by_action(bench, north_m, east_m)}

    far = bench.goal(north_m + 90, east_m).begun()
    bench.run(2)
    outcomes["simple_taken"] = call(
        "go2point", Go2pointService, point=Point(north_m, east_m + 6, 0), speed=0.5
    )
    outcomes["by_simple"] = far.outcome()["state"]
    bench.run(30)
    outcomes["simple_place_m"], outcomes["simple_said"] = bench.place_m(), bench.take("goto_status")

    far = bench.goal(north_m + 90, east_m).begun()
    outcomes["by_action"] = bench.goal(north_m + 90, east_m - 5).begun() and far.outcome()["state"]
    bench.run(2)
    bench.take("goto_status")

    far = bench.goal(north_m + 90, east_m).begun()
    bench.run(4)
    far.cancel()
    outcomes["cancelled"] = far.outcome()["state"]
    bench.run(60)
    outcomes["cancelled_drifted_m"] = bench.drifts_m()
    outcomes["cancelled_said"] = bench.take("goto_status")

    far = bench.goal(north_m + 90, east_m).begun()
    hold = {"north": north_m, "east": east_m, "north_enable": True, "east_enable": True}
    call("primitive/dynamic_positioning", DynamicPositioningPrimitiveService, **hold)
    outcomes["by_positioning"] = far.outcome()["state"]

    results: list[Any] = []
    rospy.Subscriber("/apad1/go2point/result", GoToPointActionResult, results.append)
    point = Point(north_m, east_m, 0)
    call("primitive/go2point", Go2pointPrimitiveService, point=point, speed=0.5, victory_radius=1.0)
    bench.run(90)
    outcomes["commanders"] = [[it.status.goal_id.id, it.status.status] for it in results]

    far = bench.goal(north_m + 90, east_m).begun()
    bench.facts.clear()
    bench.take("docking_status")
    bench.float_ahead()
    outcomes["docking_taken"] = call("docking", DockingService, action=True, slot=0)
    outcomes["by_docking"] = far.outcome()["state"]
    bench.run(28)
    bench.float_ahead()
    bench.detect_until_docked(0.0, 0.85)
    outcomes["docking_said"] = bench.take("docking_status")
    call("docking", DockingService, action=False, slot=0)
    bench.run(40)
    outcomes["docks"] = [
        [type(it).__name__, it.dock_index, it.agent_id]
        for it in bench.facts
        if isinstance(it, DockClosed | DockOpened)
    ]

    held_m = bench.place_m()
    bench.command(Hold(4, *held_m))
    bench.run(2)
    near = bench.goal(held_m[0] + 5, held_m[1]).begun()
    bench.run(60)
    came_back_m = [a - b for a, b in zip(bench.place_m(), held_m, strict=True)]
    outcomes["holding"] = {
        "came_back_m": came_back_m,
        **near.outcome(),
        "dropped": list(bench.link.dropped),
    }
    gateway.close()
    print(json.dumps(outcomes))


if __name__ == "__main__":
    main()
