"""The supervisor's core on its own: ticks, the order of facts, dropped packets, and the end of a flight."""

import random

import pytest
from scenario_files import POOL_FILE, SOUND_FILE

from agents.packet_medium import Medium
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.fleet_events import AMusselSuspected, SuspicionOver
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.mission.facts import AMusselHeard, EndRequested, Fact, Send, SupervisorAction
from apad_bridge.scenario.loader import load
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.commands import BatteryReported, DockClosed, GoTo, Hold, PoseReported
from firmware_model.packets import (
    AcousticStatus,
    CommandPacket,
    Kind,
    ShortStatus,
    StatusPacket,
    WifiStatus,
    decode,
)
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

SCENARIO = load(POOL_FILE)
SOUND = load(SOUND_FILE)


def status(agent_id: int, charge: float, agent_ms: int = 30_000) -> bytes:
    place = (float(agent_id), 2.0)
    return StatusPacket(agent_id, 0, State.ACTIVE, charge, 1.0, *place, 3.0, agent_ms).encode()


def facts_of_tick(*more: Fact) -> list[Fact]:
    """The facts of a tick: four candidates, a pose and a battery."""
    return [
        *(AMusselHeard(Medium.WIFI, 1000, status(agent_id, 0.5)) for agent_id in (1, 2, 3, 4)),
        PoseReported(900, 0.0, 0.0, 0.0),
        BatteryReported(1000, 16.0, 1.0),
        *more,
    ]


def acts(facts: list[Fact], now_ms: int = 1000) -> list[SupervisorAction]:
    supervisor = flight_parts.supervisor(flight_config(SCENARIO))
    for fact in facts:
        supervisor.receive(fact)
    return supervisor.advance(now_ms)


def test_it_plans_goes_and_permits_at_the_tick() -> None:
    actions = acts(facts_of_tick())
    goto = next(action for action in actions if isinstance(action, GoTo))
    assert (goto.north_m, goto.east_m, goto.speed_m_s) == (1.0, 2.0, 0.5)
    sent = [action for action in actions if isinstance(action, Send)]
    assert [(it.medium, it.agent_id, decode(it.data)) for it in sent] == [
        (Medium.SOUND, 1, CommandPacket(Kind.PERMISSION, 1))
    ]


def test_facts_of_one_tick_act_alike_in_whatever_order_they_came() -> None:
    facts = facts_of_tick()
    expected = acts(list(facts))
    for seed in range(10):
        random.Random(seed).shuffle(facts)
        assert acts(list(facts)) == expected


@pytest.fixture
def supervisor() -> Supervisor:
    return flight_parts.supervisor(flight_config(SCENARIO))


def test_a_docked_amussel_that_reports_to_lie_on_the_bottom_is_told_once_until_it_charges(
    supervisor: Supervisor,
) -> None:
    supervisor.receive(PoseReported(900, 0.0, 0.0, 0.0))
    supervisor.receive(DockClosed(900, 1, 7))
    charging = StatusPacket(7, 0, State.CHARGING, 0.5, 1.0, 7.0, 2.0, 3.0, 30_000).encode()
    told = []
    for now_ms, data in enumerate(
        [charging, status(7, 0.5), status(7, 0.5), status(8, 0.5), charging, status(7, 0.5)], 1
    ):
        supervisor.receive(AMusselHeard(Medium.WIFI, 1000 * now_ms, data))
        actions = supervisor.advance(1000 * now_ms)
        told += [(now_ms, it.data) for it in actions if isinstance(it, DocksDisagree)]
    reason = "dock 2 holds it by the vehicle's report, and it reports ACTIVE, on the bottom"
    assert told == [(2, {"id": 7, "reason": reason}), (6, {"id": 7, "reason": reason})]


def test_a_fact_of_the_future_waits_for_its_tick_and_time_does_not_go_back(supervisor: Supervisor) -> None:
    supervisor.receive(PoseReported(1500, 7.0, 7.0, 0.0))
    supervisor.advance(1000)
    assert supervisor.pose is None
    supervisor.advance(2000)
    assert supervisor.pose is not None
    with pytest.raises(ValueError, match="time went back"):
        supervisor.advance(1000)


def test_bytes_that_are_nothing_are_counted_and_disturb_nothing(supervisor: Supervisor) -> None:
    for data in (b"", b"\xff" * 40, b"x" * 100_000, CommandPacket(Kind.RELEASE, 1).encode(), status(99, 0.5)):
        supervisor.receive(AMusselHeard(Medium.WIFI, 500, data))
    supervisor.receive(AMusselHeard(Medium.WIFI, 500, status(1, 0.5)))
    supervisor.advance(1000)
    assert supervisor.dropped == {
        "bytes that are no status packet": 4,
        "a status of an unknown aMussel": 1,
    }
    assert [belief.agent_id for belief in supervisor.beliefs.all()] == [1]


@pytest.mark.parametrize(
    ("fact", "now_ms", "reason"),
    [
        (EndRequested(1000, MissionEnd(EndReason.OPERATOR)), 1000, "the operator"),
        (BatteryReported(1000, 16.0, 1.0), 2_400_000, "mission time"),
    ],
)
def test_a_flight_ends_by_the_operator_or_the_time(
    supervisor: Supervisor, fact: Fact, now_ms: int, reason: str
) -> None:
    supervisor.receive(PoseReported(900, 3.0, 4.0, 0.0))
    supervisor.receive(fact)
    actions = supervisor.advance(now_ms)
    assert supervisor.has_ended and str(supervisor.mission.state.ended_by) == reason
    held = [action for action in actions if isinstance(action, Hold)]
    assert (held[-1].north_m, held[-1].east_m) == (3.0, 4.0)


@pytest.mark.parametrize(
    ("told", "heard"),
    [
        pytest.param(
            (0.9, 0.0, 0.89, 0.3, 0.3, 0.3, 0.3, 0.27, 0.8),
            (0.9, 0.89, 0.3, 0.27, 0.8),
            id="it sends no aPad home",
        ),
        pytest.param((0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0), (0.9, 0.0), id="it ends a flight"),
    ],
)
def test_a_sudden_fall_of_the_battery_counts_after_three_seconds_of_readings(
    supervisor: Supervisor, told: tuple[float, ...], heard: tuple[float, ...]
) -> None:
    """The mission hears it then, and a fall that creeps at once."""
    kept: list[float] = []
    supervisor.mission.battery_heard = kept.append  # type: ignore[method-assign]
    supervisor.receive(PoseReported(900, 3.0, 4.0, 0.0))
    for at_s, fraction in enumerate(told, start=1):
        assert not supervisor.has_ended
        supervisor.receive(BatteryReported(1000 * at_s, 12.0, fraction))
        supervisor.advance(1000 * at_s)
    assert tuple(kept) == heard
    assert supervisor.mission.state.ended_by == ("the aPad's battery" if told[-1] == 0 else None)


BASIC = (1, 8, State.EMPTY, 0.0, 0.8, 1.0, 2.0, 3.0, 60_000)
SINCE = (9, 0, 0, 0, 0, ResetCause.POWER_ON, ActiveBattery.SECONDARY, 0, 0)


@pytest.mark.parametrize(
    ("medium", "packet"),
    [
        (Medium.WIFI, WifiStatus(*BASIC, (1, 2, 3, 4), *SINCE)),
        (Medium.SOUND, AcousticStatus(*BASIC, (1, 2, 3, 4), 9, 9)),
        (Medium.SOUND, ShortStatus(1, State.EMPTY, 0.0, 0.8)),
    ],
    ids=["wifi", "sound", "short"],
)
def test_every_kind_of_status_is_believed(
    supervisor: Supervisor, medium: Medium, packet: WifiStatus | AcousticStatus | ShortStatus
) -> None:
    supervisor.receive(AMusselHeard(Medium.WIFI, 1000, status(1, 0.5)))
    supervisor.receive(AMusselHeard(medium, 2000, packet.encode()))
    supervisor.advance(2000)
    it = supervisor.beliefs.get(1)
    assert (it.heard_ms, it.state, it.primary, it.north_m, it.east_m) == (2000, State.EMPTY, 0.0, 1.0, 2.0)
    assert it.secondary == pytest.approx(0.8, abs=1e-5) and supervisor.dropped == {}


def test_an_amussel_becomes_suspect_once_until_it_is_over_and_another_supervisor_tells_nothing_anew() -> None:
    """It rises without a charger; another one's reading stands for twelve hours, and moves again."""

    def told(supervisor: Supervisor, agent_id: int, hour: int, charge: float) -> list[str]:
        packet = StatusPacket(agent_id, hour, State.SLEEPING, charge, 1.0, 7.0, 2.0, 3.0, 3_600_000 * hour)
        supervisor.receive(AMusselHeard(Medium.SOUND, 120_000 * hour, packet.encode()))
        actions = supervisor.advance(120_000 * hour)
        return [it.text() for it in actions if isinstance(it, AMusselSuspected | SuspicionOver)]

    first, other, next_one = (flight_parts.supervisor(flight_config(SOUND)) for _ in range(3))
    rises = [told(first, 7, hour, 0.2 + 0.2 * hour) for hour in (1, 2, 3)]
    assert rises == [
        [],
        ["aMussel 7 is suspect: its charge rises without a charger: 0.40, and 0.60 after 60 min of its time"],
        [],
    ]
    next_one.beliefs.restore(first.beliefs.kept())
    assert told(next_one, 7, 4, 1.0) == []
    (stands,) = [text for hour in range(1, 13) for text in told(other, 7, hour, 0.8)]
    assert stands.startswith("aMussel 7 is suspect: its reading stands: 0.80 for")
    moves = [told(other, 7, hour, charge) for hour, charge in ((13, 0.7), (14, 0.69))]
    assert moves == [["aMussel 7 is no longer suspect: its reading moves again"], []]
