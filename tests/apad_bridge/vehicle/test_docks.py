"""One occupancy of the docks, whoever keeps it: the port, the mission, a resumed supervisor and the replay."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.state import MissionState
from apad_bridge.records.journal import JournalContents
from apad_bridge.runs.resuming import find_resume_point
from apad_bridge.vehicle.commands import DockClosed, DockOpened
from apad_bridge.vehicle.docks import DockTable

REPORTS = st.lists(st.tuples(st.integers(0, 3), st.integers(1, 6), st.booleans()), max_size=20)


@given(REPORTS)
def test_after_any_reports_all_know_the_same_docks_and_no_amussel_is_in_two(
    reports: list[tuple[int, int, bool]],
) -> None:
    port, book, lines = DockTable(), OrderBook(MissionState()), []
    for at_ms, (dock_index, agent_id, closed) in enumerate(reports):
        port.take((DockClosed if closed else DockOpened)(at_ms, dock_index, agent_id))
        book.dock_changed(dock_index, agent_id, closed)
        lines.append({"t": at_ms, "kind": "dock", "dock": dock_index, "agent": agent_id, "closed": closed})
    resumed = find_resume_point(JournalContents(lines, 0), 2, 0).state
    held = [agent_id for _, agent_id in book.state.docked]
    assert len(held) == len(set(held))
    assert dict(port.docked) == dict(book.state.docked) == dict(resumed.docked)


def test_a_vehicle_s_later_report_moves_an_amussel_and_frees_no_other() -> None:
    book = OrderBook(MissionState())
    book.dock_changed(0, 7, closed=True)
    book.dock_changed(1, 8, closed=True)
    book.dock_changed(2, 7, closed=True)
    assert book.docks == (None, 8, 7, None)
    book.dock_changed(1, 7, closed=False)  # 7 was let go; the vehicle is mistaken about the dock
    assert book.docks == (None, 8, None, None)
