"""The parts of a flight that lacks something: each does nothing, and what it cannot do is counted."""

from __future__ import annotations

from scenario_files import POOL_FILE

from agents.mussel.stimuli import SoundArrived, WifiArrived
from agents.packet_medium import Medium
from agents.time_scale import MissionMs
from apad_bridge.acoustics.serial.lines import SerialLines
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.sound_events import PlaceFixed
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.facts import Ping, RangeHeard, Send
from apad_bridge.mission.orders import PingAgent
from apad_bridge.mission.stand_down_rule import NeverStandsDown
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.runs.start_state import restore_allocation
from apad_bridge.scenario.loader import load
from apad_bridge.supervisor.packet_relay import no_relay
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.supervisor.sample_collection import NoSampleCollection
from apad_bridge.vehicle.outcomes import PrimitiveFailed
from apad_bridge.world.simulated_fleet import NoFleet
from firmware_model.packets import LogRecords

POOL = load(POOL_FILE)
PING = "a ping without water to send it through"
SOUND, WIFI = Send(Medium.SOUND, 4, b"up"), Send(Medium.WIFI, 4, b"down")


def test_a_mission_alone_reaches_no_body_and_counts_a_ping() -> None:
    fleet = NoFleet()
    fleet.ping(4, 0)
    assert fleet.send(SOUND, 1000) is None and fleet.receive(4, WifiArrived(b""), 1000) is None
    assert (fleet.advance(1000), fleet.take_truths(), fleet.dropped) == ((), [], {PING: 1})


def test_without_water_packets_arrive_at_once_and_strangers_are_counted() -> None:
    flight, _ = open_flight(POOL)
    fleet = flight._fleet
    assert fleet.send(SOUND, 0) == SoundArrived(b"up") and fleet.send(WIFI, 0) == WifiArrived(b"down")
    assert fleet.receive(4, WifiArrived(b""), 0) == 0 and fleet.receive(99, WifiArrived(b""), 0) is None
    fleet.water.ping(4, 0)
    assert flight.all_dropped == {PING: 1, "for an aMussel that is not of this fleet": 1}


def test_a_supervisor_without_water_delays_no_packet_and_counts_a_ping() -> None:
    supervisor = flight_parts.supervisor(flight_config(POOL), RunSpec(calls=CallQueue()))
    assert [supervisor.send(it, MissionMs(0)) for it in (SOUND, WIFI)] == [[SOUND], [WIFI]]
    supervisor.mission.order(PingAgent(4))
    supervisor.receive(RangeHeard(MissionMs(0), 4, 12.0))
    assert not any(isinstance(it, Ping | PlaceFixed) for it in supervisor.advance(MissionMs(0)))
    assert supervisor.dropped == {"pings without a modem in the water": 1}


def test_one_aPad_never_stands_down_and_ends_with_its_battery() -> None:
    rule = NeverStandsDown()
    for number in range(100):
        rule.go_to_ended(PrimitiveFailed(0, number, "stalled"))
    assert rule.reason_to_stand_down(EndReason.APAD_BATTERY) is None
    assert (
        rule.reason_to_end(EndReason.APAD_BATTERY) is EndReason.APAD_BATTERY
        and rule.reason_to_end(None) is None
    )


def test_no_lines_no_relay_and_no_samples_take_nothing() -> None:
    lines, relay, samples = SerialLines(), no_relay(), NoSampleCollection()
    assert (
        not lines.any_open and lines.poll(0) == [] and not lines.command(4, b"up", 0) and lines.take() == []
    )
    relay.forward(SOUND, 0)
    relay.transmit(Medium.WIFI, 4, b"", 0)
    assert relay.advance(1000) == []
    taken = samples.take(LogRecords(4, 0, 0, 0, ()))
    assert (taken.samples, taken.gone, samples.acknowledgements()) == ((), (), [])


def test_a_single_aPad_serves_its_own_fleet_and_so_does_its_successor() -> None:
    learned = flight_parts.initial_learned_state(flight_config(POOL))
    restore_allocation(learned, ())
    assert learned.allocation.served == learned.allocation.own == frozenset(POOL.fleet.ids)
    assert not learned.allocation.served_for_others
