"""Tests flights on the wall clock with modems as serial devices: opened modems, and a physical modem that carries sound."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import serial
from journals import facts_of
from scenario_files import WHOLE_FILE

from agents.hosting.in_process import InProcessHost
from agents.mussel.stimuli import SoundArrived, to_wire
from apad_bridge.acoustics.serial.lines import SerialLines, open_serial_lines
from apad_bridge.acoustics.serial.nanomodem import (
    AnswerReader,
    Framing,
    PacketDirection,
    ReceivedData,
    RoutedPacket,
)
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import WallClock
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.loop import Flight
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.world import World
from firmware_model.packets import AcousticStatus, CommandPacket, Kind, StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

Make = Callable[..., Any]
LONG_S = 600
SPEED = 3
"""Of mission time and of the modems' own."""


def whole_boards(**changes: Any) -> Scenario:
    data = resolve(load(WHOLE_FILE))
    data.update(duration_s=LONG_S, theta=1, **changes)
    data["hearing"]["mode"] = "physical"
    data["fleet"]["hosting"] = "one_process"
    return from_data(data, "with modems")


@contextmanager
def flying(
    scenario: Scenario, serial_lines: SerialLines, opened: tuple[int, ...] = ()
) -> Iterator[tuple[Flight, MemoryRecorder]]:
    """A flight in a thread of its own, ended in order."""
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    host = InProcessHost(fleet_parts.fleet_config(flight_config(scenario)), initial_states)
    recorder = MemoryRecorder(scenario)
    flight = flight_parts.flight(
        flight_config(scenario),
        FlightContext(
            vehicle=InProcessVehicle(flight_parts.simulated_apad(scenario)),
            pace=WallClock(SPEED),
            world=World(
                fleet_parts.fleet_of(
                    flight_config(scenario), host, dict.fromkeys(initial_states, 0), opened=opened
                )
            ),
            serial_lines=serial_lines,
        ),
        recorder,
    )
    thread = threading.Thread(target=flight.run)
    thread.start()
    try:
        yield flight, recorder
    finally:
        flight.stop(MissionEnd(EndReason.OPERATOR, "the test"))
        thread.join(60)
        assert not thread.is_alive()


def until(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    deadline_s, pause = time.monotonic() + timeout_s, threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s, "it did not come"
        pause.wait(0.02)


def status(agent_id: int) -> bytes:
    packet = StatusPacket(agent_id, 9, State.SLEEPING, 0.9, 0.9, 1.0, 2.0, 3.0, 1000)
    return MusselbedCodec().encode(packet)


def test_a_physical_modem_brings_packets_for_both_sides(physical: Make, tmp_path: Path) -> None:
    """Modem 1 is the fleet's; modem 2 belongs to others in the same water."""
    modems = physical(speed=SPEED)
    scenario = whole_boards()
    with (
        open_serial_lines(tmp_path, (), modems.path(1), 0, print) as serial_lines,
        flying(scenario, serial_lines) as (flight, recorder),
        serial.Serial(modems.path(2), 9600, timeout=60) as elsewhere,
    ):
        until(
            lambda: any(
                kind == "modem" and "address 1" in it.get("what", "") for _, kind, it in facts_of(recorder)
            )
        )

        def sends(direction: PacketDirection, agent_id: int, data: bytes) -> None:
            packet = Framing.HEADER.encode(RoutedPacket(direction, agent_id, data))
            elsewhere.write(b"$B%02d" % len(packet) + packet)
            assert elsewhere.read_until(b"\r\n") == b"$B%02d\r\n" % len(packet)

        # A real aMussel reports through modem 2, and a command permits a simulated one to surface.
        sends(PacketDirection.FROM_AMUSSEL, 4, status(4))
        until(lambda: flight.supervisor.beliefs.get(4) is not None)
        permission = MusselbedCodec().encode(CommandPacket(Kind.PERMISSION, 5))
        sends(PacketDirection.TO_AMUSSEL, 5, permission)
        wire = [it.hex() if isinstance(it, bytes) else it for it in to_wire(SoundArrived(permission))]
        until(
            lambda: any(
                kind == "stimulus" and it["id"] == 5 and it["wire"] == wire
                for _, kind, it in facts_of(recorder)
            )
        )
    assert modems.modems[1].address == 1


def test_reports_and_commands_go_into_the_water_with_their_ids(physical: Make, tmp_path: Path) -> None:
    """One aMussel wakes every 3 s with a low battery: it reports by sound, and the mission permits it to surface."""
    modems = physical(speed=SPEED)
    data = resolve(whole_boards())
    data["board"].update(boot_ms=500)
    cycle = {
        "alarm_s": 3,
        "sample_s": 0.5,
        "processing_s": 0,
        "listen_s": 0,
        "slots": {"frame_s": 1, "slot_s": 1},
    }
    data["board"]["whole"]["cycle"].update(cycle)
    data["fleet"].update(count=1, start={"charge": [0.3, 0.4]})
    data["mission"].update(batch=1)
    with (
        open_serial_lines(tmp_path, (), modems.path(1), 0, print) as serial_lines,
        flying(from_data(data, "short cycle"), serial_lines) as (flight, recorder),
        serial.Serial(modems.path(2), 9600, timeout=60) as elsewhere,
    ):
        reader, payloads = AnswerReader(), list[bytes]()

        def has_received(direction: bytes) -> bool:
            messages = reader.take(elsewhere.read(elsewhere.in_waiting or 1))
            payloads.extend(it.data for it in messages if isinstance(it, ReceivedData))
            return any(it.startswith(direction + b"\x01\x00") for it in payloads)

        until(lambda: has_received(b"\xb1"))
        # The report counts only when its last sound has left, and then the mission answers.
        until(lambda: has_received(b"\xb2"))
        assert flight.supervisor.beliefs.get(1) is not None
        # The flight looks at its modem now and then: it may learn later than others that the last sound has left.
        until(lambda: any(kind == "stimulus" and it["id"] == 1 for _, kind, it in facts_of(recorder)))
    packets = [MusselbedCodec().decode(it[3:]) for it in payloads]
    assert any(isinstance(it, AcousticStatus) and it.agent_id == 1 for it in packets)
    assert CommandPacket(Kind.PERMISSION, 1) in packets


@pytest.mark.parametrize("opened", [(), (7,)])
def test_without_anything_to_open_nothing_is_made(tmp_path: Path, opened: tuple[int, ...]) -> None:
    with open_serial_lines(tmp_path, opened, "", 0, print) as serial_lines:
        assert serial_lines.any_open == bool(opened)
        assert (tmp_path / "modems").exists() == bool(opened)
