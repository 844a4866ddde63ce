"""The routing rules of packets between processes, row by row, and as laws over several processes."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from flying import play
from hypothesis import given
from hypothesis import strategies as st

from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved
from agents.packet_medium import Medium
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.mission.facts import AMusselHeard, Send
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

    assert told(AMUSSEL, Medium.SOUND) == {RelayOutcome.PUBLISH_PACKET}
    assert told(AMUSSEL, Medium.WIFI) == {RelayOutcome.PUBLISH_WIFI}
    assert not told(SUPERVISOR, RANGE)
    assert told(SUPERVISOR, Medium.SOUND) == told(SUPERVISOR, Medium.WIFI) == {RelayOutcome.PUBLISH_COMMAND}
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


CONTACTS = {"opens": ContactOpened(), "closes": ContactClosed(1, 2), "moves": DockMoved(3, 4)}


class Told:
    """A process of a transcript. A line's answer is what it receives, publishes and drops."""

    def __init__(self, division: Division) -> None:
        self.process = Process(division)
        self.relay = self.process.relay
        self.dropped: Counter[str] = Counter()

    def answer(self, move: str) -> str:
        name, *words = move.split()
        received: list[Any] = []
        match name:
            case "hears":  # a source, an aMussel, a medium and what it carries
                source, agent_id, medium, *text = words
                data = " ".join(text).encode("latin-1").decode("unicode-escape").encode("latin-1")
                of = {"wifi": Medium.WIFI, "sound": Medium.SOUND, "range": RANGE, "none": None}[medium]
                self.process.arrived.append(
                    RelayedPacket(PacketOrigin[source.upper()], int(agent_id), of, data, 5_000)
                )
            case "at":
                received = self.relay.advance(1000 * int(words[0]))
            case "commands":
                self.relay.forward(Send(Medium.SOUND, int(words[0]), b"command"), 6_000)
            case "speaks":
                self.relay.transmit(Medium.WIFI, int(words[0]), b"status", 6_000)
            case "pings":
                self.relay.ping(int(words[0]), 1000 * int(words[1]))
            case "dock":
                self.relay.send_contact(RemoteContact(7, CONTACTS[words[0]]), 1_000)
            case "reported":  # a state, when it was heard, and the time of the look
                state, heard_ms, now_ms = State[words[0]], 1000 * int(words[1]), 1000 * int(words[2])
                self.relay.repeat_contacts(lambda it: Belief(it, heard_ms, state, 0.5, 1.0, 0.0, 0.0), now_ms)
            case "unheard":
                self.relay.repeat_contacts(lambda it: None, 2_000)
            case "without_outlets":
                self.relay = self.relay.without_outlets()
        dropped = self.process.relay.dropped - self.dropped
        self.dropped = Counter(self.process.relay.dropped)
        sent = [
            f"{it.source.name.lower()} to {it.agent_id}: {(it.data or b'ping').decode()}"
            for it in self.process.published
        ]
        self.process.published.clear()
        return "; ".join(
            [*map(str, received), *sent, *(f"{count} x {why}" for why, count in dropped.items())]
        )


OURS = whole_flight(lambda: frozenset({1, 2}))
STORIES: dict[str, tuple[Division, str]] = {
    "a whole flight hears real aMussels, and refuses a second voice of a simulated one": (
        OURS,
        """
        hears remote_amussel 3 sound real         |
        hears remote_amussel 1 sound second voice |
        hears remote_amussel 4 wifi also          |
        at 5                                      | AMusselHeard(medium=<Medium.SOUND: 'sound'>, at_ms=5000, data=b'real');
                                                  | AMusselHeard(medium=<Medium.WIFI: 'wifi'>, at_ms=5000, data=b'also');
                                                  | 1 x a packet of a real aMussel whose id is simulated here
        commands 1                                |
        commands 3                                | local_supervisor to 3: command
        commands 65535                            | local_supervisor to 65535: command
        speaks 1                                  |
        speaks 3                                  |
        """,
    ),
    "a ping of a real aMussel gets its range once, and one that is under way is enough": (
        OURS,
        """
        pings 3 1                           | local_supervisor to 3: ping
        pings 3 4                           |
        hears remote_amussel 3 range 29.600 |
        hears remote_amussel 3 range 29.600 |
        hears remote_amussel 1 range 29.600 |
        at 5                                | RangeHeard(at_ms=5000, agent_id=3, range_m=29.6);
                                            | 1 x range: no ping awaits it;
                                            | 1 x a packet of a real aMussel whose id is simulated here
        pings 3 6                           | local_supervisor to 3: ping
        """,
    ),
    # 30 s in the modem's queue, and the modem's 4 s.
    "a range that is none is dropped, and the ping is unanswered after 34 s": (
        whole_flight(frozenset),
        """
        pings 3 1                             | local_supervisor to 3: ping
        hears remote_amussel 3 range          |
        hears remote_amussel 3 range near     |
        hears remote_amussel 3 range nan      |
        hears remote_amussel 3 range inf      |
        hears remote_amussel 3 range -0.1     |
        hears remote_amussel 3 range 100000.1 |
        hears remote_amussel 3 range \xff     |
        hears remote_amussel 3 range 1 2      |
        at 5                                  | 8 x range: range_m is outside 0 to 100000
        at 35                                 |
        at 36                                 | RangeHeard(at_ms=36000, agent_id=3, range_m=None)
        at 99                                 |
        """,
    ),
    "a fleet with docks speaks, and hears a mission's commands and contacts": (
        FLEET_WITH_DOCKS,
        """
        speaks 7                                   | local_amussel to 7: status
        hears remote_supervisor 7 sound permission |
        hears remote_supervisor 65535 sound beacon |
        hears remote_dock 7 none [0, 1, 2]         |
        at 5                                       | Send(...agent_id=7, data=b'permission'...);
                                                   | Send(...agent_id=65535, data=b'beacon'...);
                                                   | RemoteContact(agent_id=7, stimulus=ContactClosed(...1, ...2))
        """,
    ),
    "a mission commands and carries, and hears a fleet": (
        MISSION_ALONE,
        """
        commands 7                         | local_supervisor to 7: command
        commands 65535                     | local_supervisor to 65535: command
        dock closes                        | local_dock to 7: [0, 1, 2]
        hears remote_amussel 7 wifi status |
        at 5                               | AMusselHeard(medium=<Medium.WIFI: 'wifi'>, at_ms=5000, data=b'status')
        """,
    ),
    # The first report came before it; the second at the same look is no newer; once it is felt, it is its own doing.
    "a release that a cut link has lost is told again after a report of the aMussel": (
        MISSION_ALONE,
        """
        dock opens              | local_dock to 7: [2]
        unheard                 |
        reported CHARGING 0 3   |
        reported CHARGING 60 60 | local_dock to 7: [2]
        reported CHARGING 60 70 |
        reported RELEASED 70 70 |
        reported CHARGING 90 90 |
        """,
    ),
    "one that sinks has felt its release, and one that reports has not": (
        MISSION_ALONE,
        """
        dock opens               | local_dock to 7: [2]
        reported REPORTING 60 60 | local_dock to 7: [2]
        reported SINKING 70 70   |
        reported REPORTING 90 90 |
        """,
    ),
    "a docking that a cut link has lost is told again": (
        MISSION_ALONE,
        """
        dock closes             | local_dock to 7: [0, 1, 2]
        reported FLOATING 60 60 | local_dock to 7: [0, 1, 2]
        reported CHARGING 70 70 |
        reported FLOATING 90 90 |
        """,
    ),
    "an aMussel that is told again of its dock is where the dock is now": (
        MISSION_ALONE,
        """
        dock closes             | local_dock to 7: [0, 1, 2]
        dock moves              | local_dock to 7: [1, 3, 4]
        reported FLOATING 60 60 | local_dock to 7: [0, 3, 4]
        """,
    ),
    "an aMussel that never feels its dock is told three times": (
        MISSION_ALONE,
        """
        dock closes             | local_dock to 7: [0, 1, 2]
        reported FLOATING 10 10 | local_dock to 7: [0, 1, 2]
        reported FLOATING 20 20 | local_dock to 7: [0, 1, 2]
        reported FLOATING 30 30 |
        reported FLOATING 90 90 |
        """,
    ),
    # A medium of none is for contacts.
    "a packet without a medium that is no contact is dropped and counted": (
        MISSION_ALONE,
        """
        hears remote_amussel 1 none [0, 1, 2] |
        at 5                                  | 1 x packet: no such medium
        """,
    ),
    "a relay without outlets receives and transmits nothing": (
        MISSION_ALONE,
        """
        hears remote_amussel 1 wifi status |
        without_outlets                    |
        commands 1                         |
        at 5                               | AMusselHeard(medium=<Medium.WIFI: 'wifi'>, at_ms=5000, data=b'status')
        """,
    ),
}


@pytest.mark.parametrize(("division", "story"), STORIES.values(), ids=STORIES)
def test_story(division: Division, story: str) -> None:
    play(story, Told(division).answer)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{",
        b"[]",
        b"[0, 1]",
        b'["x"]',
        b"[99]",
        b"\xff",
        b"null",
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
