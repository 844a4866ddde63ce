"""A real aPad is refused before it moves where its origin or its camera's topics are not ours alone."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from unittest.mock import MagicMock

import pytest
import rospy
from scenario_files import POOL_FILE

from apad_bridge.beliefs.belief import Belief
from apad_bridge.doctor.finding import Finding, cannot_tell, fail, ok
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.ros import flight_opening
from apad_bridge.ros.generation_a.contacts_link import ContactsLink
from apad_bridge.ros.generation_b import link
from apad_bridge.ros.generation_b.link import GenerationBLink
from apad_bridge.ros.relay import division_of
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.supervisor.packet_relay import PacketOrigin
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.link_errors import PeerFailed, VehicleNotReady
from apad_bridge.world.simulated_fleet import NoFleet
from apad_bridge.world.world import World
from firmware_model.states import State

OPTIONS = RunOptions(
    BenchPart.WHOLE, APadKind.ROS, TimeSource.WALL, 1.0, OnDeath.WAIT, master_uri="http://h:1"
)


@pytest.mark.parametrize(
    ("found", "refused"),
    [
        (fail("/apad1/LocalOriginLat says 45, 412 m from the scenario's", "area.origin: 45"), True),
        (ok("the same"), False),
        # The preflight before it has told that nobody says it, and a person has accepted that.
        (cannot_tell("nobody says", "ask"), False),
    ],
)
def test_a_vehicle_with_another_origin_is_refused(
    monkeypatch: pytest.MonkeyPatch, found: Finding, refused: bool
) -> None:
    monkeypatch.setattr(flight_opening, "check_origin", lambda uri, apad, ours: found)
    with refusal(r"412 m from the scenario's: area.origin: 45" if refused else ""):
        flight_opening._refuse_other_origin(load(POOL_FILE), OPTIONS)


def refusal(why: str) -> AbstractContextManager[object]:
    """The vehicle is refused for this reason; for none, it is not."""
    return pytest.raises(VehicleNotReady, match=why) if why else nullcontext()


@pytest.mark.parametrize(
    ("publishers", "why"),
    [
        (["/camera_driver"], "/apad1/docking_vertical has a publisher already, /camera_driver"),
        (["/musselbed_1"], ""),
        ([], ""),
    ],
)
def test_the_virtual_camera_does_not_publish_beside_another(
    monkeypatch: pytest.MonkeyPatch, publishers: list[str], why: str
) -> None:
    graph = Graph("http://h:1", {"/apad1/docking_vertical": publishers}, {}, {}, {})
    monkeypatch.setattr(link.Graph, "read", lambda uri: graph)
    monkeypatch.setattr(rospy, "get_name", lambda: "/musselbed_1")
    with refusal(why):
        link._refuse_second_camera("apad1")


@pytest.mark.parametrize(
    ("apad", "time", "part", "is_real"),
    [
        (APadKind.ROS, TimeSource.WALL, BenchPart.WHOLE, True),
        (APadKind.ROS, TimeSource.WALL, BenchPart.MISSION, True),
        (APadKind.ROS, TimeSource.WALL, BenchPart.FLEET, False),
        (APadKind.ROS, TimeSource.ROS, BenchPart.WHOLE, False),
        (APadKind.SIM, TimeSource.WALL, BenchPart.WHOLE, False),
    ],
)
def test_a_real_vehicle_is_one_that_we_did_not_start(
    apad: APadKind, time: TimeSource, part: BenchPart, is_real: bool
) -> None:
    assert RunOptions(part, apad, time, 1.0, OnDeath.WAIT).has_real_vehicle is is_real


def opening(
    monkeypatch: pytest.MonkeyPatch, options: RunOptions, tell: Callable[[str], None] = print, **parts: object
) -> None:
    """Opens a flight's context with these parts; it comes so far as one that says so."""
    stands_in = ("_refuse_other_origin", "_gateway", "_roster", "_laboratory", "_beside_the_gateway")
    for name, part in {**dict.fromkeys(stands_in, MagicMock()), **parts}.items():
        monkeypatch.setattr(flight_opening, name, part)
    opened = flight_opening.open_flight_context(
        load(POOL_FILE),
        options,
        world=World(NoFleet()),
        resume_point=None,
        truths_at=lambda now_ms: [],
        presences=MagicMock(),
        allocation=MagicMock(),
        tell=tell,
    )
    with pytest.raises(PeerFailed, match="far enough"), opened:
        pass


FAR_ENOUGH = VehicleNotReady("far enough")


@pytest.mark.parametrize(
    ("options", "waits"),
    [
        (OPTIONS, True),
        (replace(OPTIONS, manual=True), True),
        (replace(OPTIONS, script="/a/script.py"), True),
        (replace(OPTIONS, time=TimeSource.ROS), False),
    ],
)
def test_every_real_vehicle_that_was_stopped_waits_for_a_person_whoever_gives_the_orders(
    monkeypatch: pytest.MonkeyPatch, options: RunOptions, waits: bool
) -> None:
    safety_of = MagicMock(side_effect=FAR_ENOUGH)
    opening(monkeypatch, options, safety_of=safety_of)
    assert [it.kwargs for it in safety_of.call_args_list] == [{"needs_person": waits}]


@pytest.mark.parametrize(
    ("unanswered", "told"),
    [([], []), (["hold"], ["the aPad has not answered the last order within 3 s (hold), and may go on: "])],
)
def test_its_last_orders_are_answered_before_the_link_to_it_is_closed(
    monkeypatch: pytest.MonkeyPatch, unanswered: list[str], told: list[str]
) -> None:
    """A vehicle in roscpp drops a call that waits for its turn when its connection is closed."""
    vehicle, lines = MagicMock(spec=GenerationBLink), list[str]()
    vehicle.wait_until_taken.return_value = unanswered
    parts = {"OtherAPads": MagicMock(), "WatchdogStates": MagicMock(side_effect=FAR_ENOUGH)}
    opening(monkeypatch, OPTIONS, lines.append, _vehicle=lambda *_: (vehicle, ()), **parts)
    assert [name for name, _, _ in vehicle.method_calls] == ["wait_until_taken", "close"]
    assert [line[: len(begin)] for line, begin in zip(lines, told, strict=True)] == told


def test_a_fleet_is_told_of_docks_by_a_mission_where_its_aPad_does_not_report_them() -> None:
    fleet = replace(OPTIONS, part=BenchPart.FLEET)
    heard = [
        division_of(fleet, link, MagicMock(), MagicMock()).peers
        for link in (MagicMock(spec=ContactsLink), MagicMock(spec=GenerationBLink))
    ]
    assert [PacketOrigin.REMOTE_DOCK in it for it in heard] == [False, True]


def test_an_aMussel_in_a_dock_is_no_body_in_the_water_though_it_was_last_heard_afloat() -> None:
    gate, supervisor, others = Gate.without_guards(), MagicMock(), MagicMock()
    supervisor.beliefs.all.return_value = [
        Belief(agent_id, 0, state, 0.5, 1.0, 1.0, 2.0)
        for agent_id, state in ((3, State.FLOATING), (4, State.FLOATING), (5, State.SLEEPING))
    ]
    supervisor.mission.docks = (None, 4)
    others.bodies.return_value = ()
    options = replace(OPTIONS, part=BenchPart.MISSION)
    flight_opening._bodies_watcher(gate, supervisor, options, MagicMock(), others)(1000)
    assert [it.agent_id for it in gate.situation(1000).bodies] == [3]


@pytest.mark.parametrize(("part", "is_stopped"), [(BenchPart.FLEET, False), (BenchPart.WHOLE, True)])
def test_a_fleet_alone_commands_nothing_when_the_aPad_is_out_of_reach(
    part: BenchPart, is_stopped: bool
) -> None:
    """The aPad is heard for two seconds and then for a minute no more, as when the link to its machine is cut."""
    data = resolve(load(POOL_FILE))
    data["guards"] = {"position_age_s": 2}
    safety = flight_opening.safety_for(from_data(data, "guarded"), replace(OPTIONS, part=part))
    link = MagicMock()
    link.advance = lambda now_ms: [PoseReported(now_ms, 14.0, 10.5, 0.0)] if now_ms <= 2000 else []
    vehicle = GuardedVehicle(link, safety)
    for now_ms in range(0, 60_000, 1000):
        vehicle.advance(now_ms)
    assert link.command.called is is_stopped
