"""Real and simulated aMussels on one master: services and claims, by ROS's own tools beside a run that flies."""

from __future__ import annotations

import json
import re
import signal
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import called, echoed, latched
from killing import kill_supervisor
from programs import MUSSELBED, Begin, begun, done, ended_well, lines_of, wait_until
from scenario_files import write_scenario

from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.ros.types.messages import generated_folder
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

pytestmark = pytest.mark.system
SAME_NAME = """
import sys
from apad_bridge.ros.gateway.fleet_guard import refuse_second_fleet
refuse_second_fleet("/musselbed_1", [101], sys.argv[1])
"""


@dataclass(frozen=True)
class Flown:
    """A run of aMussels 1 to 5, and the shell of the tools beside it."""

    scenario: Path
    run: Path
    shell: dict[str, str]

    def called(self, service: str, request: str) -> dict[str, Any]:
        return called(self.shell, service, request)

    def told(self, agent_id: int, *kinds: str) -> list[tuple[str, str]]:
        """What one was made, or its fault, and by whom."""
        lines = lines_of(self.run, *kinds or ("presence",))
        return [(it.get("is") or it["fault"], it.get("by", "")) for it in lines if it["id"] == agent_id]

    def claimed(self, node: str, ids: str, more: str = "real: true") -> AbstractContextManager[None]:
        """A claim that stays on its topic meanwhile."""
        message = f"{{node: {node}, {more}, lease_s: 60.0, ids: {ids}}}"
        return latched(self.shell, "/musselbed/claims", "musselbed_msgs/FleetClaim", message)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    folder = tmp_path_factory.mktemp("fleet")
    # So slowly that nobody falls below the mission's threshold by itself: the alerts are the test's own.
    scenario = write_scenario(
        folder / "desk.yaml",
        duration_s=36_000,
        fleet={"count": 5, "start": {"charge": [0.95, 0.95]}},
        board={"discharge_per_min": 1e-7},
    )
    run = folder / "run"
    with begun(*MUSSELBED, "run", scenario, "--speed", 20, "--out", run) as flight:
        wait_until(lambda: lines_of(run, "belief"), flight)
        uri = json.loads((run / "run.json").read_text())["master_uri"]
        paths = dict.fromkeys(("PYTHONPATH", "ROS_PACKAGE_PATH"), str(generated_folder()))
        yield Flown(scenario, run, loopback_environment(folder / "ros", uri) | paths)


def test_services_change_who_an_amussel_is(begin: Begin, flown: Flown) -> None:
    assert flown.called("retire", "{id: 2}") == {"accepted": True, "message": ""}
    again = flown.called("retire", "{id: 2}")
    assert again == {"accepted": False, "message": "aMussel 2 is retired: it cannot retire"}
    # The rostopic is on the graph some time after it was started; each spawning falls anew.
    heard = begin("/usr/bin/rostopic", "echo", "-n", 1, "/battery_alert", env=flown.shell)

    def spawn_low() -> bool:
        flown.called("retire", "{id: 2}")
        spawned = flown.called("spawn", "{id: 2, north_m: 5, east_m: 6, primary: 0.7, secondary: 1}")
        assert spawned["accepted"]
        return heard.poll() is not None

    wait_until(spawn_low)
    by = "a service call"
    assert flown.told(2)[:2] == [("retired", by), ("simulated", by)]
    alert = next(yaml.safe_load_all(heard.communicate()[0]))
    assert alert["header"]["frame_id"] == "/amussel2/"
    assert alert["position"] == {"north": 5.0, "east": 6.0, "depth": 3.0}
    assert flown.called("inject_fault", "{id: 2, fault: brown_out}")["accepted"]
    assert flown.told(2, "fault") == [("brown_out", "")]
    wrong = flown.called("inject_fault", "{id: 2, fault: kraken}")["message"]
    assert wrong.startswith("no fault 'kraken': there are brown_out, watchdog, killed, ")


def test_a_real_amussels_claim_makes_the_simulated_one_its_twin_until_it_is_given_back(flown: Flown) -> None:
    with flown.claimed("/lab", "[3]"):
        wait_until(lambda: flown.told(3) == [("real", "/lab")])
        refused = "/lab claims aMussel 3 as real, and would make it so again: end that first"
        for service in ("take_back", "retire"):
            assert flown.called(service, "{id: 3}") == {"accepted": False, "message": refused}
    # The bridge of real ones says what it hears of it, in the fleet's own packets: 45 % at north 9, east 8.
    status = StatusPacket(3, 0, State.ACTIVE, 0.45, 1.0, 9.0, 8.0, 3.0, 10**9)
    heard = f"{{agent: 3, medium: wifi, data: {list(MusselbedCodec().encode(status))}}}"
    topic = ("/musselbed/heard", "musselbed_msgs/Packet", heard)
    with begun("/usr/bin/rostopic", "pub", "-r", 5, *topic, env=flown.shell):
        believed = "any(it.id == 3 and abs(it.north - 9) < 0.01 for it in m.agents)"
        seen = echoed(flown.shell, "--filter", believed, "/musselbed/beliefs")
    (charge,) = (it["charge"] for it in seen["agents"] if it["id"] == 3)
    assert charge == pytest.approx(0.45, abs=0.01)
    with flown.claimed("/lab", "[]"):
        wait_until(lambda: flown.told(3)[1:] == [("simulated", "/lab")])


def test_an_amussel_answers_for_its_battery_with_what_it_reported(flown: Flown) -> None:
    def asked(service: str, *arguments: str) -> str:
        told = done("/usr/bin/rosservice", "call", service, *arguments, env=flown.shell, code=None)
        return told.stdout or told.stderr

    wait_until(lambda: "battery_level: 9" in asked("/amussel1/charge_info"))
    assert re.search(
        r"(?s)x: .*y: .*z: 3\.0.*type: \"consumer\"\nconsumers: \[\]\n", asked("/amussel1/charge_info")
    )
    assert re.fullmatch(r"x: [\d.]+\ny: [\d.]+\nz: 3\.0\n", asked("/amussel1/get_position"))
    assert asked("/amussel1/get_sensory_reading") == "current: []\n"
    assert asked("/amussel1/send_energy", "1") == "done: False\n"


def test_a_second_fleet_with_an_id_of_the_first_does_not_start_and_the_later_of_two_retires_its_own(
    begin: Begin, flown: Flown, tmp_path: Path
) -> None:
    with flown.claimed("/earlier", "[4, 105]", "real: false, since: {secs: 1, nsecs: 0}"):
        refused = {
            5: "node /musselbed_1 already has /amussel5/",
            101: "node /earlier simulates aMussel 105 already: two fleets on one",
        }
        started = []
        for it in refused:
            other = write_scenario(tmp_path / f"{it}.yaml", flown.scenario, fleet={"first_id": it})
            asked = ("fleet", other, "--time", "wall", "--out", tmp_path / str(it))
            started.append(begin(*MUSSELBED, *asked, env=flown.shell))
        for process, words in zip(started, refused.values(), strict=True):
            assert words in ended_well(process, 3)[1]
        same_name = done(sys.executable, "-c", SAME_NAME, flown.shell["ROS_MASTER_URI"], code=1)
        assert "a node named /musselbed_1 runs on this master already" in same_name.stderr
        wait_until(lambda: flown.told(4) == [("retired", "/earlier")])


def test_a_fleet_that_comes_back_follows_what_is_claimed_by_then(begin: Begin, flown: Flown) -> None:
    """This ends the run's first supervisor."""
    with flown.claimed("/lab", "[3, 5]"):
        wait_until(lambda: [flown.told(it)[-1:] for it in (3, 5)] == [[("real", "/lab")]] * 2)
    kill_supervisor(flown.run)
    with flown.claimed("/lab", "[1, 5]"):
        echoed(flown.shell, "/musselbed/claims")
        resumed = begin(*MUSSELBED, "resume", flown.run)
        wait_until(lambda: flown.told(1) == [("real", "/lab")], resumed)
    resumed.send_signal(signal.SIGINT)
    said = " ".join(" ".join(ended_well(resumed, 130)).split())
    assert "aMussel 3 was real by /lab, which claims it no more: it is taken back" in said
    assert "aMussel 1 was simulated, and /lab claims it as real now: it is handed over" in said
    assert "aMussel 5 was" not in said
