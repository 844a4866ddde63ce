"""Real and simulated aMussels on one master: services and claims, by ROS's own tools beside a fleet that flies."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import yaml

from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.ros.types.messages import generated_folder

pytestmark = pytest.mark.system
HERE = Path(__file__).parent
PATIENCE_S = 180.0


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=0)
    yield running
    running.stop()


@pytest.fixture
def tools(tmp_path: Path, master: Master) -> dict[str, str]:
    """The environment of Debian's ROS tools with our messages."""
    return loopback_environment(tmp_path / "ros", master.uri) | {"PYTHONPATH": str(generated_folder())}


@pytest.fixture
def start(tmp_path: Path, master: Master) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    inside = loopback_environment(tmp_path / "ros", master.uri) | {"PYTHONPATH": str(HERE.parents[1])}
    with ExitStack() as stack:

        def begin(*arguments: str) -> subprocess.Popen[str]:
            command = [sys.executable, str(HERE / "fleet_at_a_desk.py"), *arguments]
            fleet = stack.enter_context(
                subprocess.Popen(command, env=inside, stdout=subprocess.PIPE, text=True)
            )
            stack.callback(fleet.terminate)
            return fleet

        yield begin


def line_of(fleet: subprocess.Popen[str]) -> str:
    assert fleet.stdout is not None
    return fleet.stdout.readline().strip()


def told(fleet: subprocess.Popen[str]) -> dict[str, Any]:
    event: dict[str, Any] = json.loads(line_of(fleet))
    return event


def called(tools: dict[str, str], service: str, request: str) -> dict[str, Any]:
    command = ["/usr/bin/rosservice", "call", f"/musselbed/{service}", request]
    done = subprocess.run(command, env=tools, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = yaml.safe_load(done.stdout)
    return answer


def spawn_low_until_somebody_hears_it(tools: dict[str, str]) -> None:
    """The rostopic of /battery_alert is on the graph some time after it was started; each spawning falls anew."""
    echo = ["/usr/bin/rostopic", "echo", "-n", "1", "/battery_alert"]
    with subprocess.Popen(echo, env=tools, stdout=subprocess.PIPE, text=True) as heard:
        until_s = time.monotonic() + PATIENCE_S
        while heard.poll() is None and time.monotonic() < until_s:
            called(tools, "retire", "{id: 2}")
            called(tools, "spawn", "{id: 2, north_m: 5, east_m: 6, primary: 0.7, secondary: 1}")
        heard.terminate()
        alert = next(yaml.safe_load_all(heard.communicate(timeout=PATIENCE_S)[0]))
    assert alert["header"]["frame_id"] == "/amussel2/"
    assert alert["position"] == {"north": 5.0, "east": 6.0, "depth": 3.0}


def test_services_change_who_an_amussel_is(
    start: Callable[..., subprocess.Popen[str]], tools: dict[str, str]
) -> None:
    fleet = start("ours", "1")
    assert line_of(fleet) == "flying"
    assert called(tools, "retire", "{id: 2}") == {"accepted": True, "message": ""}
    assert told(fleet) == {"kind": "presence", "id": 2, "is": "retired", "by": "a service call"}
    again = called(tools, "retire", "{id: 2}")
    assert again == {"accepted": False, "message": "aMussel 2 is retired: it cannot retire"}
    assert called(tools, "spawn", "{id: 2, north_m: 5, east_m: 5, primary: 0.9, secondary: 1}")["accepted"]
    assert told(fleet)["is"] == "simulated"
    assert called(tools, "inject_fault", "{id: 2, fault: brown_out}")["accepted"]
    fault = told(fleet)
    assert fault.pop("until_ms") > 0  # it ends as it begins
    assert fault == {"kind": "fault", "id": 2, "fault": "brown_out"}
    spawn_low_until_somebody_hears_it(tools)
    wrong = called(tools, "inject_fault", "{id: 2, fault: kraken}")["message"]
    assert wrong.startswith("no fault 'kraken': there are brown_out, watchdog, killed, ")


def test_a_real_amussels_claim_makes_the_simulated_one_its_twin_until_it_is_given_back(
    start: Callable[..., subprocess.Popen[str]], tools: dict[str, str]
) -> None:
    fleet = start("ours", "1")
    assert line_of(fleet) == "flying"

    def claim(ids: str) -> subprocess.Popen[str]:
        message = f"{{node: /lab, real: true, lease_s: 60.0, ids: {ids}}}"
        command = [
            "/usr/bin/rostopic",
            "pub",
            "--latch",
            "/musselbed/claims",
            "musselbed_msgs/FleetClaim",
            message,
        ]
        return subprocess.Popen(command, env=tools, stdout=subprocess.DEVNULL, text=True)

    with claim("[3]") as publisher:
        try:
            assert told(fleet) == {"kind": "presence", "id": 3, "is": "real", "by": "/lab"}
        finally:
            publisher.terminate()
    # The bridge of real ones says what it hears of it, in the fleet's own packets: 45 % at north 9, east 8.
    status = subprocess.run(
        [sys.executable, "-c", STATUS], capture_output=True, text=True, cwd=HERE.parents[1], check=True
    ).stdout.strip()
    heard = f"{{agent: 3, medium: wifi, data: {status}}}"
    command = ["/usr/bin/rostopic", "pub", "-r", "5", "/musselbed/heard", "musselbed_msgs/Packet", heard]
    with subprocess.Popen(command, env=tools, stdout=subprocess.DEVNULL) as bridge:
        try:
            echo = ["/usr/bin/rostopic", "echo", "--filter", BELIEVED, "-n", "1", "/musselbed/beliefs"]
            seen = subprocess.run(echo, env=tools, capture_output=True, text=True, timeout=PATIENCE_S)
        finally:
            bridge.terminate()
    beliefs = {it["id"]: it for it in next(yaml.safe_load_all(seen.stdout))["agents"]}
    assert (beliefs[3]["north"], beliefs[3]["charge"]) == pytest.approx((9.0, 0.45), abs=0.01)
    with claim("[]") as publisher:
        try:
            assert told(fleet) == {"kind": "presence", "id": 3, "is": "simulated", "by": "/lab"}
        finally:
            publisher.terminate()


def test_one_that_comes_back_follows_what_is_claimed_by_then(
    start: Callable[..., subprocess.Popen[str]], tools: dict[str, str]
) -> None:
    message = "{node: /lab, real: true, lease_s: 60.0, ids: [4]}"
    topic = ["/usr/bin/rostopic", "pub", "--latch", "/musselbed/claims", "musselbed_msgs/FleetClaim", message]
    with subprocess.Popen(topic, env=tools, stdout=subprocess.DEVNULL) as lab:
        try:
            heard = ["/usr/bin/rostopic", "echo", "-n", "1", "/musselbed/claims"]
            subprocess.run(heard, env=tools, stdout=subprocess.DEVNULL, timeout=PATIENCE_S, check=True)
            fleet = start("ours", "1", "/lab")
            assert line_of(fleet) == "aMussel 3 was real by /lab, which claims it no more: it is taken back"
            assert (
                line_of(fleet) == "aMussel 4 was simulated, and /lab claims it as real now: it is handed over"
            )
            assert line_of(fleet) == "flying"
            assert told(fleet) == {"kind": "presence", "id": 4, "is": "real", "by": "/lab"}
        finally:
            lab.terminate()


STATUS = """
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets import StatusPacket
from firmware_model.states import State
print(list(MusselbedCodec().encode(StatusPacket(3, 0, State.ACTIVE, 0.45, 1.0, 9.0, 8.0, 3.0, 10**9))))
"""
BELIEVED = "any(it.id == 3 and it.north > 8.9 for it in m.agents)"


def test_a_second_fleet_with_an_id_of_the_first_does_not_start(
    start: Callable[..., subprocess.Popen[str]],
) -> None:
    first = start("ours", "1")
    assert line_of(first) == "flying"
    assert line_of(start("theirs", "4")) == (
        "node /ours simulates aMussel 4 already: two fleets on one master need disjoint ids "
        "(fleet.first_id, fleet.count) or a namespace each (ROS_NAMESPACE)"
    )
    assert line_of(start("others", "5")) == "flying"


def test_of_two_fleets_that_come_to_overlap_the_later_retires_its_own(
    start: Callable[..., subprocess.Popen[str]], tools: dict[str, str]
) -> None:
    fleet = start("ours", "1")
    assert line_of(fleet) == "flying"
    message = "{node: /earlier, real: false, since: {secs: 1, nsecs: 0}, lease_s: 60.0, ids: [4, 5, 6]}"
    command = [
        "/usr/bin/rostopic",
        "pub",
        "--latch",
        "/musselbed/claims",
        "musselbed_msgs/FleetClaim",
        message,
    ]
    with subprocess.Popen(command, env=tools, stdout=subprocess.DEVNULL) as earlier:
        try:
            assert told(fleet) == {"kind": "presence", "id": 4, "is": "retired", "by": "/earlier"}
        finally:
            earlier.terminate()
