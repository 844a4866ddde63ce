"""Collects only the samples of a fleet: python sample_ashore.py RUN_DIR EPOCH UNTIL_S

The fleet in RUN_DIR dives, surfaces and is docked in turns of two minutes. Each line of standard output is a tick: its time
and the processes. The next tick comes when a line of standard input has answered it. The last line of output has the number
of samples that each aMussel has ever taken.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

from agents.coordinator import Coordinator
from agents.fleet import FleetConfig, resting_on_bottom
from agents.hosting.process_host import ProcessHost
from agents.mussel.body import BodyConfig
from agents.mussel.outputs import WifiSent
from agents.mussel.reporter import ReportConfig
from agents.mussel.stimuli import ContactClosed, ContactOpened, SoundArrived, WifiArrived
from agents.time_scale import TimeScale
from apad_bridge.records.sample_file import SampleFile
from apad_bridge.supervisor.sample_collection import SampleCollection, Taken
from firmware_model.config import BoardConfig, FullFirmware, LastResort
from firmware_model.packets import CommandPacket, Kind, LogRecords
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.sinking import Sinking
from firmware_model.table_one import HOURLY, MODEL, power

IDS = (1, 2, 3)
TURN_S = 120
CODEC = MusselbedCodec()
CYCLE = replace(HOURLY, alarm_ms=10_000, sample_ms=2000, listen_ms=2000, report_ms=3000)
FLEET = FleetConfig(
    theta=1,
    seed=3,
    codec="musselbed-1",
    board=BoardConfig(
        agent_id=0,
        charge=MODEL,
        pin_debounce_ms=50,
        boot_ms=2000,
        float_timeout_ms=600_000,
        release_wait_ms=10_000,
        whole=FullFirmware(power(LastResort.WAIT), CYCLE, transmit_ms=500, call_ms=60_000, hover_ms=120_000),
    ),
    body=BodyConfig(Sinking(3_000_000, 5000, 5000), drifts_always=False, drift_amplitude_um=0),
    reports=ReportConfig(10_000, heard_always=False),
)


def story(clock: Coordinator, now_s: int) -> None:
    """In every turn: the permission, repeated because an aMussel may be booting; a dock; and down again."""
    for agent_id in IDS:
        match (now_s + 7 * agent_id) % TURN_S:
            case 60 | 64 | 68:
                data = CODEC.encode(CommandPacket(Kind.PERMISSION, agent_id))
                clock.receive(agent_id, SoundArrived(data), 1000 * now_s)
            case 80 | 84:
                clock.receive(agent_id, ContactClosed(0, 0), 1000 * now_s)
            case 105:
                clock.receive(agent_id, ContactOpened(), 1000 * now_s)


def main(run_dir: Path, epoch: int, until_s: int) -> None:
    initial_states = {agent_id: resting_on_bottom(agent_id, 0.0, 3.0, 0.9, 1.0) for agent_id in IDS}
    host = (
        ProcessHost.start(str(run_dir / "fleet"), FLEET, initial_states)
        if epoch == 1
        else ProcessHost.adopt(str(run_dir / "fleet"), epoch)
    )
    granted_ms = host.granted_ms or dict.fromkeys(IDS, 0)
    now_s = max(granted_ms.values()) // 1000
    clock = Coordinator(host, granted_ms, TimeScale(1), 1000 * now_s)
    file = SampleFile(run_dir / "samples.jsonl", FLEET.time_scale)
    collection = SampleCollection(IDS, file.kept)
    taken = dict.fromkeys(IDS, 0)
    while now_s < until_s:
        now_s += 1
        story(clock, now_s)
        for event in clock.advance(1000 * now_s):
            if isinstance(event, WifiSent):
                packet = CODEC.decode(event.data)
                if isinstance(packet, LogRecords):
                    found = collection.take(packet)
                    assert isinstance(found, Taken)
                    file.append(packet.agent_id, found.samples)
        for ack in collection.acknowledgements():
            clock.receive(ack.agent_id, WifiArrived(CODEC.encode(ack)), 1000 * now_s)
        taken |= {truth.agent_id: truth.physical.samples for truth in host.take_truths()}
        print(json.dumps([now_s, host.nursery_pid, host.pids]), flush=True)
        sys.stdin.readline()
    print(json.dumps(taken), flush=True)
    host.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
