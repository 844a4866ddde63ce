"""The routing rules of packets between processes, row by row, and as laws over several processes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, DockMoved, from_wire, to_wire
from agents.packet_medium import Medium
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.mission.facts import AMusselHeard, RangeHeard, Send
from apad_bridge.mission.sources import Allocation
from apad_bridge.supervisor.packet_relay import (
    FLEET_ALONE,
    FLEET_WITH_DOCKS,
    MISSION_ALONE,
    RANGE,
    AMusselStanding,
    Carriage,
    Division,
    PacketOrigin,
    PacketRelay,
    RelayedPacket,
    RelayOutcome,
    RemoteContact,
    one_of_several,
    outcomes,
    whole_flight,
)
from firmware_model.packets import EVERYONE
from firmware_model.states import State

FOR_OTHERS = {RelayOutcome.PUBLISH, RelayOutcome.RECEIVE, RelayOutcome.REFUSE}
AMUSSEL, SUPERVISOR, DOCK = PacketOrigin.LOCAL_AMUSSEL, PacketOrigin.LOCAL_SUPERVISOR, PacketOrigin.LOCAL_DOCK


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        #                            ours       real       lent       borrowed   foreign
        (AMUSSEL, ("", "", "PUBLISH", "", "")),
        (SUPERVISOR, ("", "PUBLISH", "", "PUBLISH", "PUBLISH")),
        (DOCK, ("", "", "", "PUBLISH", "")),
        (PacketOrigin.REMOTE_AMUSSEL, ("REFUSE", "RECEIVE", "", "RECEIVE", "")),
        (PacketOrigin.REMOTE_SUPERVISOR, ("", "", "RECEIVE", "", "")),
        (PacketOrigin.REMOTE_DOCK, ("RECEIVE", "RECEIVE", "RECEIVE", "", "")),
        (PacketOrigin.LABORATORY, ("RECEIVE",) * 5),
    ],
)
def test_each_rule_between_processes(source: PacketOrigin, expected: tuple[str, ...]) -> None:
    for medium in [None] if source in (DOCK, PacketOrigin.REMOTE_DOCK) else [*Medium, RANGE]:
        routed = [set(outcomes(source, it, medium)) & FOR_OTHERS for it in AMusselStanding]
        assert [",".join(it.name for it in row) for row in routed] == list(expected)


@pytest.mark.parametrize("standing", AMusselStanding)
def test_a_laboratory_is_told_what_this_process_sends_and_nothing_of_others(
    standing: AMusselStanding,
) -> None:
    def told(source: PacketOrigin, medium: Carriage) -> set[RelayOutcome]:
        return set(outcomes(source, standing, medium)) - FOR_OTHERS

    assert told(AMUSSEL, Medium.SOUND) == {RelayOutcome.TELL_PACKET}
    assert told(AMUSSEL, Medium.WIFI) == {RelayOutcome.TELL_WIFI}
    assert not told(SUPERVISOR, RANGE)
    assert told(SUPERVISOR, Medium.SOUND) == told(SUPERVISOR, Medium.WIFI) == {RelayOutcome.TELL_COMMAND}
    for source in set(PacketOrigin) - {AMUSSEL, SUPERVISOR}:
        assert not told(source, Medium.SOUND) and not told(source, Medium.WIFI)


class Process:
    """A relay whose packets to others are kept in `published`, and those from others put into `arrived`."""

    def __init__(self, division: Division) -> None:
        self.arrived: list[RelayedPacket] = []
        self.published: list[RelayedPacket] = []
        self.relay = PacketRelay(division, [self._take], {RelayOutcome.PUBLISH: self.published.append})

    def _take(self, now_ms: int) -> list[RelayedPacket]:
        arrived, self.arrived = self.arrived, []
        return arrived


def test_a_whole_flight_hears_real_amussels_and_refuses_a_second_voice_of_a_simulated_one() -> None:
    process = Process(whole_flight(lambda: frozenset({1, 2})))
    process.arrived = [
        RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 3, Medium.SOUND, b"real", 5),
        RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 1, Medium.SOUND, b"second voice", 5),
        RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 4, Medium.WIFI, b"real too", 5),
    ]
    assert process.relay.advance(5) == [
        AMusselHeard(Medium.SOUND, 5, b"real"),
        AMusselHeard(Medium.WIFI, 5, b"real too"),
    ]
    assert process.relay.dropped.total() == 1
    for agent_id in (1, 3, EVERYONE):
        process.relay.forward(Send(Medium.SOUND, agent_id, b""), 6)
        process.relay.transmit(Medium.WIFI, agent_id, b"", 6)
    assert [(it.source, it.agent_id) for it in process.published] == [(SUPERVISOR, 3), (SUPERVISOR, EVERYONE)]


def measured(agent_id: int, data: bytes) -> RelayedPacket:
    return RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, agent_id, RANGE, data, 5_000)


def test_a_ping_of_a_real_amussel_gets_its_range_once_and_one_that_is_under_way_is_enough() -> None:
    process = Process(whole_flight(lambda: frozenset({1, 2})))
    for at_ms in (1_000, 4_000):
        process.relay.ping(3, at_ms)
    assert process.published == [RelayedPacket(SUPERVISOR, 3, RANGE, b"", 1_000)]
    process.arrived = [measured(3, b"29.600"), measured(3, b"29.600"), measured(1, b"29.600")]
    assert process.relay.advance(5_000) == [RangeHeard(5_000, 3, 29.6)]
    assert process.relay.dropped == {
        "range: no ping awaits it": 1,
        "a packet of a real aMussel whose id is simulated here": 1,
    }
    process.relay.ping(3, 6_000)
    assert len(process.published) == 2


@pytest.mark.parametrize("data", [b"", b"near", b"nan", b"inf", b"-0.1", b"100000.1", b"\xff", b"1 2"])
def test_a_range_that_is_none_is_dropped_and_the_ping_is_unanswered_after_34_s(data: bytes) -> None:
    """30 s in the modem's queue, and the modem's 4 s."""
    process = Process(whole_flight(frozenset))
    process.relay.ping(3, 1_000)
    process.arrived = [measured(3, data)]
    assert process.relay.advance(5_000) == [] and process.relay.dropped.total() == 1
    assert process.relay.advance(35_000) == []
    assert process.relay.advance(36_000) == [RangeHeard(36_000, 3, None)]
    assert process.relay.advance(99_000) == []


def test_a_fleet_and_a_mission_alone_make_a_flight_together() -> None:
    fleet, mission = Process(FLEET_WITH_DOCKS), Process(MISSION_ALONE)
    fleet.relay.transmit(Medium.WIFI, 7, b"status", 1_000)
    mission.relay.forward(Send(Medium.SOUND, 7, b"permission"), 1_000)
    mission.relay.forward(Send(Medium.SOUND, EVERYONE, b"beacon"), 1_000)
    (status,), commands = fleet.published, list(mission.published)
    mission.relay.send_contact(RemoteContact(7, ContactClosed(1, 2)), 1_000)
    contact = mission.published[-1]
    mission.arrived = [RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 7, status.medium, status.data, 2_000)]
    fleet.arrived = [
        RelayedPacket(PacketOrigin.REMOTE_SUPERVISOR, it.agent_id, it.medium, it.data, 2_000)
        for it in commands
    ] + [RelayedPacket(PacketOrigin.REMOTE_DOCK, 7, contact.medium, contact.data, 2_000)]
    assert mission.relay.advance(2_000) == [AMusselHeard(Medium.WIFI, 2_000, b"status")]
    assert fleet.relay.advance(2_000) == [
        Send(Medium.SOUND, 7, b"permission"),
        Send(Medium.SOUND, EVERYONE, b"beacon"),
        RemoteContact(7, ContactClosed(1, 2)),
    ]


def reported(state: State, heard_ms: int) -> Callable[[int], Belief]:
    return lambda agent_id: Belief(agent_id, heard_ms, state, 0.5, 1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("contact", "felt", "unfelt"),
    [
        (ContactOpened(), State.RELEASED, State.CHARGING),
        (ContactOpened(), State.SINKING, State.REPORTING),
        (ContactClosed(1, 2), State.CHARGING, State.FLOATING),
    ],
)
def test_a_contact_that_a_cut_link_has_lost_is_told_again_after_a_report_of_the_aMussel(
    contact: AgentStimulus, felt: State, unfelt: State
) -> None:
    mission = Process(MISSION_ALONE)
    mission.relay.send_contact(RemoteContact(7, contact), 1_000)
    first = mission.published.pop()
    mission.relay.repeat_contacts(lambda agent_id: None, 2_000)
    mission.relay.repeat_contacts(reported(unfelt, 900), 3_000)  # it was sent before
    assert not mission.published
    mission.relay.repeat_contacts(reported(unfelt, 60_000), 60_000)
    mission.relay.repeat_contacts(reported(unfelt, 60_000), 70_000)  # no newer report
    (again,) = mission.published
    assert replace(again, at_ms=first.at_ms) == first
    mission.relay.repeat_contacts(reported(felt, 70_000), 70_000)
    mission.relay.repeat_contacts(reported(unfelt, 90_000), 90_000)  # it was confirmed: this is its own doing
    assert mission.published == [again]


def test_an_aMussel_that_is_told_again_of_its_dock_is_where_the_dock_is_now() -> None:
    mission = Process(MISSION_ALONE)
    for contact in (ContactClosed(1, 2), DockMoved(3, 4)):
        mission.relay.send_contact(RemoteContact(7, contact), 1_000)
    mission.relay.repeat_contacts(reported(State.FLOATING, 60_000), 60_000)
    contacts = [from_wire(json.loads(it.data)) for it in mission.published]
    assert contacts == [ContactClosed(1, 2), DockMoved(3, 4), ContactClosed(3, 4)]


def test_an_aMussel_that_never_feels_its_dock_is_told_three_times() -> None:
    mission = Process(MISSION_ALONE)
    mission.relay.send_contact(RemoteContact(7, ContactClosed(1, 2)), 0)
    for now_ms in range(10_000, 100_000, 10_000):
        mission.relay.repeat_contacts(reported(State.FLOATING, now_ms), now_ms)
    assert len(mission.published) == 3


NAMES = ("a", "b", "c")
IDS = range(1, 7)
PEER = {
    AMUSSEL: PacketOrigin.REMOTE_AMUSSEL,
    SUPERVISOR: PacketOrigin.REMOTE_SUPERVISOR,
    DOCK: PacketOrigin.REMOTE_DOCK,
}


def processes_of(servers: list[str], real: frozenset[int]) -> dict[str, Process]:
    """Three aPads, each with two aMussels of its own; `servers` names who serves each aMussel."""
    processes = {}
    for n, name in enumerate(NAMES):
        own = frozenset(IDS[2 * n : 2 * n + 2])
        allocation = Allocation(HoldLast(IDS), own)
        for agent_id, server in zip(IDS, servers, strict=True):
            if server == name:
                allocation.take(agent_id)
            else:
                allocation.give(agent_id)
        processes[name] = Process(one_of_several(allocation, lambda own=own: own - real))
    return processes


@given(
    servers=st.lists(st.sampled_from(NAMES), min_size=len(IDS), max_size=len(IDS)),
    real=st.frozensets(st.sampled_from(IDS)),
    agent_id=st.sampled_from(IDS),
)
def test_of_several_apads_exactly_the_one_concerned_receives_each_packet(
    servers: list[str], real: frozenset[int], agent_id: int
) -> None:
    """A topic brings each published packet to all processes, its own publisher included."""
    processes = processes_of(servers, real)
    home, server = NAMES[(agent_id - 1) // 2], servers[agent_id - 1]
    processes[home].relay.transmit(Medium.SOUND, agent_id, b"status", 0)
    processes[server].relay.forward(Send(Medium.SOUND, agent_id, b"command"), 0)
    processes[server].relay.send_contact(RemoteContact(agent_id, ContactClosed(1, 2)), 0)
    published = [packet for it in processes.values() for packet in it.published]
    received = {}
    for name, process in processes.items():
        process.arrived = [
            RelayedPacket(PEER[it.source], it.agent_id, it.medium, it.data, 1_000) for it in published
        ]
        received[name] = process.relay.advance(1_000)
    status = AMusselHeard(Medium.SOUND, 1_000, b"status")
    command = Send(Medium.SOUND, agent_id, b"command")
    contact = RemoteContact(agent_id, ContactClosed(1, 2))
    expected: dict[str, list[object]] = {name: [] for name in NAMES}
    if home != server:
        expected[server] = [status]
        expected[home] = [command, contact]
    assert received == expected
    assert not any(it.relay.dropped for it in processes.values())


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"{", b"[]", b"[0, 1]", b'["x"]', b"[99]", b"\xff", b"null"),
        b"[" * 1024,  # deeper than a parser may go
        b"[0,%d,0]" % 10**30,  # farther away than anything, and more than a link to an agent carries
        b"[8,99]",  # a reset is no contact; one by no cause would end the aMussel's process
        b"[10,600000000000000,0]",
    ],
)
def test_a_contact_that_is_none_is_dropped_and_counted(data: bytes) -> None:
    process = Process(FLEET_ALONE)
    process.arrived = [RelayedPacket(PacketOrigin.REMOTE_DOCK, 1, None, data, 0)]
    assert process.relay.advance(0) == [] and process.relay.dropped.total() == 1


def test_a_packet_without_a_medium_that_is_no_contact_is_dropped_and_counted() -> None:
    process = Process(MISSION_ALONE)
    data = json.dumps(to_wire(ContactClosed(1, 2))).encode()
    process.arrived = [RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 1, None, data, 0)]
    assert process.relay.advance(0) == [] and process.relay.dropped.total() == 1


def test_a_relay_without_outlets_receives_and_transmits_nothing() -> None:
    process = Process(MISSION_ALONE)
    process.arrived = [RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 1, Medium.WIFI, b"status", 0)]
    silent = process.relay.without_outlets()
    silent.forward(Send(Medium.SOUND, 1, b""), 0)
    assert silent.advance(0) == [AMusselHeard(Medium.WIFI, 0, b"status")]
    assert process.published == []
