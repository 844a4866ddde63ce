"""One table of the docks: the port's, which the mission, its journal and a resumed supervisor's port repeat."""

from __future__ import annotations

from unittest import mock

from hypothesis import given
from hypothesis import strategies as st
from journals import state_of
from scenario_files import POOL_FILE

from agents.time_scale import MissionMs
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.runs.start_state import find_resume_point
from apad_bridge.scenario.loader import load
from apad_bridge.supervisor.run_spec import ResumePoint, RunSpec
from apad_bridge.vehicle.commands import (
    CloseDock,
    CommandAccepted,
    DockClosed,
    DockOpened,
    OpenDock,
    PoseReported,
)
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.outcomes import DockChanged, PrimitiveSucceeded
from apad_bridge.vehicle.vehicle_link import APadSeen, Carried, LetGo, LinkFact, ListeningLink, VehicleLink

POOL = load(POOL_FILE)
CONFIG = flight_config(POOL)
REPORTS = st.lists(st.tuples(st.integers(0, 3), st.integers(1, 6), st.booleans()), max_size=20)


class Bench:
    """A port, and a mission's book that hears of the docks from it."""

    def __init__(self) -> None:
        self.port, self.book = DockingPort(POOL.mission.docking), OrderBook(MissionState())

    def report(self, at_ms: int, dock_index: int, agent_id: int, *, closed: bool) -> None:
        fact = (DockClosed if closed else DockOpened)(at_ms, dock_index, agent_id)
        for outcome in self.port.receive(fact, at_ms):
            assert isinstance(outcome, DockChanged)
            self.book.note_outcome(outcome)


@given(REPORTS, st.integers(0, 20))
def test_after_any_reports_and_a_kill_all_know_the_same_docks_and_no_amussel_is_in_two(
    reports: list[tuple[int, int, bool]], snapshot_after: int
) -> None:
    bench = Bench()
    for at_ms, (dock_index, agent_id, closed) in enumerate(reports):
        if at_ms == snapshot_after:
            bench.book.snapshot()
        bench.report(at_ms, dock_index, agent_id, closed=closed)
    held = [agent_id for _, agent_id in bench.port.docked]
    assert len(held) == len(set(held))
    notes = [it for it in bench.book.take_orders() if isinstance(it, Event)]
    lines = [{"t": at_ms, "kind": it.kind, **it.data} for at_ms, it in enumerate(notes)]
    state = find_resume_point(state_of(lines), epoch=2, gap_ms=0).state
    resumed = flight_parts.supervisor(CONFIG, RunSpec(ResumePoint(MissionMs(0), state, 0, None)))
    assert bench.port.docked == bench.book.state.docked == resumed.mission.state.docked == resumed.port.docked


def test_a_vehicle_s_later_report_moves_an_amussel_and_frees_no_other() -> None:
    """The last report: 7 was let go, and the vehicle is mistaken about the dock."""
    bench, known = Bench(), []
    for at_ms, (dock_index, agent_id, closed) in enumerate(
        [(0, 7, True), (1, 8, True), (2, 7, True), (1, 7, False)]
    ):
        bench.report(at_ms, dock_index, agent_id, closed=closed)
        known.append(bench.book.docks)
    assert known[2:] == [(None, 8, 7, None), (None, 8, None, None)]


def test_a_resumed_port_asks_for_no_amussel_twice_and_opens_the_dock_that_holds_it() -> None:
    port = flight_parts.supervisor(
        CONFIG, RunSpec(ResumePoint(MissionMs(0), MissionState(docked=((3, 9),)), 0, None))
    ).port
    assert port.receive(CloseDock(1, 2, 9), 0) == [PrimitiveSucceeded(0, 1)]
    assert port.receive(OpenDock(2, 2, 9), 0) == []
    assert [it for it in port.advance(60_000) if isinstance(it, OpenDock)] == [OpenDock(1, 3, 9)]


def test_a_fleet_alone_hears_of_the_docks_and_of_the_aPads_place_alone() -> None:
    heard: list[LinkFact] = [
        PoseReported(0, 1.0, 2.0, 0.0, 0),
        CommandAccepted(0, 1),
        Carried(0, 7, 1.0, 2.0),
        LetGo(0, 7),
        APadSeen(0, 3.0, 4.0),
    ]
    link = mock.create_autospec(VehicleLink, instance=True)
    link.advance.return_value = heard
    assert ListeningLink(link).advance(0) == [APadSeen(0, 1.0, 2.0), *heard[2:]]
