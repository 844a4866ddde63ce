"""What a supervisor knew when it was killed, its successor knows: who is real, and what is believed of those who sleep."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import called
from killing import kill_9, pid_of_supervisor, standing_still
from patient import PATIENT_MUSSELBED
from programs import MUSSELBED, ROOT, Begin, ended_well, lines_of, wait_until
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.beliefs.belief import Source
from apad_bridge.records.bag_messages import BELIEFS, typestore
from apad_bridge.records.journal import read_journal
from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.ros.types.messages import generated_folder
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

pytestmark = pytest.mark.system
THE_REAL, THETA, PERIOD_MS = 3, 30, 50_000
HOUR_MS = 3_600_000 // THETA
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


def noted(run: Path) -> dict[int, int]:
    """Returns the time at which each board was heard last, by the checkpoint; one that another replaced is left out."""
    path, heard = run / "checkpoint.jsonl", dict[int, int]()
    for text in path.read_text().splitlines() if path.exists() else []:
        line = json.loads(text)
        heard |= {
            agent_id: data["heard_ms"]
            for agent_id, _, data in line.get("beliefs", ())
            if Source.HAND_OVER not in Source(data["learned_from"])
        }
        for kind, agent_id, *rest in line.get("learned", ()):
            if kind.startswith("heard"):
                heard[agent_id] = rest[0]
            elif kind in ("forgot", "handed over"):
                heard.pop(agent_id, None)
    return heard


def all_quiet(run: Path) -> bool:
    """Nobody reports, or wakes and says so, for a while to come; and those who reported did so long ago."""
    now_ms = read_journal(run / "journal.jsonl").last_ms
    is_between = 10_000 <= now_ms % PERIOD_MS < 20_000 and 25_000 <= now_ms % HOUR_MS < HOUR_MS - 25_000
    return is_between and max(noted(run).values()) < now_ms - 10_000


def killed_in_quiet(run: Path) -> bool:
    """Kills the supervisor if all is quiet, also when it has come to stand still."""
    if not all_quiet(run):
        return False
    supervisor = pid_of_supervisor(run)
    with standing_still(supervisor):
        if is_quiet := all_quiet(run):
            kill_9(supervisor)
    return is_quiet


def test_the_next_supervisor_knows_who_is_real_and_who_sleeps_and_for_how_long(
    begin: Begin, scenario: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    first = begin(*MUSSELBED, "run", scenario, "--speed", 20, "--out", run)
    wait_until(lambda: noted(run).keys() >= SLEEPERS, first)
    uri = json.loads((run / "run.json").read_text())["master_uri"]
    tools = loopback_environment(tmp_path / "ros", uri) | {"PYTHONPATH": str(generated_folder())}

    assert called(tools, "hand_over", f"{{id: {THE_REAL}}}")["accepted"]
    journal = run / "journal.jsonl"
    assert '"kind":"presence"' in journal.read_text(), "who was told so may rely on it"
    agent_ms = THETA * read_journal(journal).last_ms
    packet = StatusPacket(THE_REAL, 0, State.SLEEPING, 0.45, 0.8, 9.0, 8.0, 3.0, agent_ms)
    heard = f"{{agent: {THE_REAL}, medium: wifi, data: {list(MusselbedCodec().encode(packet))}}}"
    topic = ("/musselbed/heard", "musselbed_msgs/Packet", heard)
    bridge = begin("/usr/bin/rostopic", "pub", "-r", 5, *topic, env=tools)
    wait_until(lambda: THE_REAL in noted(run), first)
    bridge.terminate()
    bridge.wait()
    wait_until(lambda: killed_in_quiet(run), first)
    first_knew = wait_until(lambda: noted(run))
    spoken = begin("/usr/bin/rostopic", "echo", "-n", 1, "/musselbed/beliefs", env=tools)

    resumed = begin(*PATIENT_MUSSELBED, "resume", run)
    said = yaml.safe_load(ended_well(spoken)[0].split("---")[0])
    assert {it["id"] for it in said["agents"]} == SLEEPERS | {THE_REAL}
    fault = called(tools, "inject_fault", f"{{id: {THE_REAL}, fault: brown_out}}")
    assert fault["message"] == "aMussel 3 is real: faults are for simulated ones"
    resumed.send_signal(signal.SIGINT)
    _, told = ended_well(resumed, 130)
    first.communicate()
    assert "still real: aMussel 3" in told
    assert "believed as before: 4 aMussels" in told

    # The first sample of the next supervisor's bag is its first tick's.
    with Reader(run / "run-1.bag") as bag:
        (connection,) = [it for it in bag.connections if it.topic == "/musselbed/beliefs"]
        _, _, data = next(bag.messages([connection]))
    message: Any = typestore().deserialize_ros1(data, BELIEFS)
    beliefs = {it.id: it for it in message.agents}
    ages_s = {id_: (message.mission_time_ms - at_ms) / 1000 for id_, at_ms in first_knew.items()}
    assert {id_: it.age_s for id_, it in beliefs.items()} == pytest.approx(ages_s, abs=1e-3)
    assert min(ages_s.values()) > 10
    real = beliefs[THE_REAL]
    assert (real.north, real.east, real.charge) == pytest.approx((9.0, 8.0, 0.45), abs=0.02)
    assert beliefs.keys() == SLEEPERS | {THE_REAL}
    assert all(
        it.state == State.SLEEPING and it.charge > 0.85 for id_, it in beliefs.items() if id_ in SLEEPERS
    )
    assert [line["is"] for line in lines_of(run, "presence")] == ["real"]
    assert not (run / "checkpoint.jsonl").exists(), "the run has ended"
