"""What a supervisor knew when it was killed, its successor knows: who is real, and what is believed of those who sleep."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import called
from killing import kill_supervisor
from patient import PATIENT_MUSSELBED
from programs import MUSSELBED, ROOT, Begin, begun, ended_well, lines_of, wait_until
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.records.bag_messages import BELIEFS, typestore
from apad_bridge.records.journal import read_journal
from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.ros.types.messages import generated_folder
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

pytestmark = pytest.mark.system
THE_REAL, THETA, PERIOD_MS = 3, 30, 50_000
SLEEPERS = {1, 2, 4}


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Four whole boards that sleep, full enough not to be fetched, of which twins hear every 25 minutes of theirs."""
    twin = {"drain_deviation": 0.1, "sensor_noise": 0.01, "bias_deviation": 0.01}
    return write_scenario(
        tmp_path / "asleep.yaml",
        ROOT / "launch_scripts/scenarios/whole-board-12.yaml",
        duration_s=3600,
        fleet={"count": 4, "start": {"charge": [0.9, 1.0]}},
        hearing={"report_period_s": PERIOD_MS / 1000},
        beliefs={"estimator": "twin", "twin": twin | {"unscheduled": 0.03, "fix_deviation_m": 1.0}},
    )


def heard_ms(run: Path) -> dict[int, int]:
    """When each was heard last, by the journal; without those that were not."""
    heard = {it["id"]: it["heard"] for it in lines_of(run, "belief")}
    return {agent_id: at_ms for agent_id, at_ms in heard.items() if at_ms is not None}


def checkpointed_ms(run: Path) -> dict[int, int]:
    """The same by the checkpoint, which has each packet: the journal leaves out those that change little."""
    heard = dict[int, int]()
    for line in map(json.loads, (run / "checkpoint.jsonl").read_text().splitlines()):
        heard |= {agent_id: data["heard_ms"] for agent_id, _, data in line.get("beliefs", ())}
        heard |= {it[1]: it[2] for it in line.get("learned", ()) if it[0].startswith("heard")}
    return heard


def test_the_next_supervisor_knows_who_is_real_and_who_sleeps_and_for_how_long(
    begin: Begin, scenario: Path, tmp_path: Path
) -> None:
    run, everybody = tmp_path / "run", SLEEPERS | {THE_REAL}
    first = begin(*MUSSELBED, "run", scenario, "--speed", 20, "--out", run)
    wait_until(lambda: heard_ms(run).keys() >= SLEEPERS, first)
    uri = json.loads((run / "run.json").read_text())["master_uri"]
    tools = loopback_environment(tmp_path / "ros", uri) | {"PYTHONPATH": str(generated_folder())}
    assert called(tools, "hand_over", f"{{id: {THE_REAL}}}")["accepted"]
    handed_over_ms = read_journal(run / "journal.jsonl").last_ms
    assert lines_of(run, "presence"), "who was told so may rely on it"
    packet = StatusPacket(THE_REAL, 0, State.SLEEPING, 0.45, 0.8, 9.0, 8.0, 3.0, THETA * handed_over_ms)
    heard = f"{{agent: {THE_REAL}, medium: wifi, data: {list(MusselbedCodec().encode(packet))}}}"
    topic = ("/musselbed/heard", "musselbed_msgs/Packet", heard)
    with begun("/usr/bin/rostopic", "pub", "-r", 5, *topic, env=tools):
        wait_until(lambda: heard_ms(run).get(THE_REAL, 0) > handed_over_ms, first)
    kill_supervisor(run)
    spoken = begin("/usr/bin/rostopic", "echo", "-n", 1, "/musselbed/beliefs", env=tools)
    knew_ms = checkpointed_ms(run)

    resumed = begin(*PATIENT_MUSSELBED, "resume", run)
    said = yaml.safe_load(ended_well(spoken)[0].split("---")[0])
    assert {it["id"] for it in said["agents"]} == everybody
    fault = called(tools, "inject_fault", f"{{id: {THE_REAL}, fault: brown_out}}")
    assert fault["message"] == "aMussel 3 is real: faults are for simulated ones"
    resumed.send_signal(signal.SIGINT)
    _, told = ended_well(resumed, 130)
    first.communicate()
    assert "still real: aMussel 3" in told and "believed as before: 4 aMussels" in told

    # The first sample of the next supervisor's bag is its first tick's.
    with Reader(run / "run-1.bag") as bag:
        (connection,) = [it for it in bag.connections if it.topic == "/musselbed/beliefs"]
        _, _, data = next(bag.messages([connection]))
    message: Any = typestore().deserialize_ros1(data, BELIEFS)
    beliefs = {it.id: it for it in message.agents}
    late_ms = [message.mission_time_ms - 1000 * it.age_s - knew_ms[id_] for id_, it in beliefs.items()]
    # One may have reported in the second in which the supervisor died.
    assert beliefs.keys() == everybody and sorted(map(abs, late_ms))[:3] == pytest.approx([0] * 3, abs=1)
    real = beliefs.pop(THE_REAL)
    assert (real.north, real.east, real.charge) == pytest.approx((9.0, 8.0, 0.45), abs=0.02)
    assert all(it.state == State.SLEEPING and it.charge > 0.85 for it in beliefs.values())
    assert [line["is"] for line in lines_of(run, "presence")] == ["real"]
    assert not (run / "checkpoint.jsonl").exists(), "the run has ended"
