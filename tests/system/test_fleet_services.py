"""Real and simulated aMussels on one master: services and claims, by ROS's own tools beside a fleet that flies."""

from __future__ import annotations

import json
import signal
import sys
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import called, echoed, latched
from programs import Begin, begun, line_of, wait_until

from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

pytestmark = pytest.mark.system
HERE = Path(__file__).parent


class Fleet:
    """`fleet_at_a_desk`, and the tools beside it."""

    def __init__(self, begin: Begin, shell: dict[str, str], *arguments: str) -> None:
        self._shell = shell
        inside = shell | {"PYTHONPATH": str(HERE.parents[1])}
        program = (sys.executable, HERE / "fleet_at_a_desk.py", *arguments)
        self._process = begin(*program, env=inside, ends_by=signal.SIGTERM)

    def says(self) -> str:
        return line_of(self._process)

    def told(self, kind: str = "presence") -> dict[str, Any]:
        event: dict[str, Any] = json.loads(self.says())
        assert event.pop("kind") == kind
        return event

    def called(self, service: str, request: str) -> dict[str, Any]:
        return called(self._shell, service, request)


def claimed(
    shell: dict[str, str], node: str, ids: str, more: str = "real: true"
) -> AbstractContextManager[None]:
    """A claim that stays on its topic meanwhile."""
    message = f"{{node: {node}, {more}, lease_s: 60.0, ids: {ids}}}"
    return latched(shell, "/musselbed/claims", "musselbed_msgs/FleetClaim", message)


def test_services_change_who_an_amussel_is(begin: Begin, shell: dict[str, str]) -> None:
    fleet = Fleet(begin, shell, "ours", "1")
    assert fleet.says() == "flying"
    assert fleet.called("retire", "{id: 2}") == {"accepted": True, "message": ""}
    assert fleet.told() == {"id": 2, "is": "retired", "by": "a service call"}
    again = fleet.called("retire", "{id: 2}")
    assert again == {"accepted": False, "message": "aMussel 2 is retired: it cannot retire"}
    assert fleet.called("spawn", "{id: 2, north_m: 5, east_m: 5, primary: 0.9, secondary: 1}")["accepted"]
    assert fleet.told()["is"] == "simulated"
    assert fleet.called("inject_fault", "{id: 2, fault: brown_out}")["accepted"]
    fault = fleet.told("fault")
    assert fault.pop("until_ms") > 0  # it ends as it begins
    assert fault == {"id": 2, "fault": "brown_out"}
    # The rostopic is on the graph some time after it was started; each spawning falls anew.
    heard = begin("/usr/bin/rostopic", "echo", "-n", 1, "/battery_alert", env=shell)

    def spawn_low() -> bool:
        fleet.called("retire", "{id: 2}")
        fleet.called("spawn", "{id: 2, north_m: 5, east_m: 6, primary: 0.7, secondary: 1}")
        return heard.poll() is not None

    wait_until(spawn_low)
    alert = next(yaml.safe_load_all(heard.communicate()[0]))
    assert alert["header"]["frame_id"] == "/amussel2/"
    assert alert["position"] == {"north": 5.0, "east": 6.0, "depth": 3.0}
    wrong = fleet.called("inject_fault", "{id: 2, fault: kraken}")["message"]
    assert wrong.startswith("no fault 'kraken': there are brown_out, watchdog, killed, ")


def test_a_real_amussels_claim_makes_the_simulated_one_its_twin_until_it_is_given_back(
    begin: Begin, shell: dict[str, str]
) -> None:
    fleet = Fleet(begin, shell, "ours", "1")
    assert fleet.says() == "flying"
    with claimed(shell, "/lab", "[3]"):
        assert fleet.told() == {"id": 3, "is": "real", "by": "/lab"}
        refused = "/lab claims aMussel 3 as real, and would make it so again: end that first"
        for service in ("take_back", "retire"):
            assert fleet.called(service, "{id: 3}") == {"accepted": False, "message": refused}
    # The bridge of real ones says what it hears of it, in the fleet's own packets: 45 % at north 9, east 8.
    status = StatusPacket(3, 0, State.ACTIVE, 0.45, 1.0, 9.0, 8.0, 3.0, 10**9)
    heard = f"{{agent: 3, medium: wifi, data: {list(MusselbedCodec().encode(status))}}}"
    topic = ("/musselbed/heard", "musselbed_msgs/Packet", heard)
    with begun("/usr/bin/rostopic", "pub", "-r", 5, *topic, env=shell, ends_by=signal.SIGTERM):
        believed = "any(it.id == 3 and abs(it.north - 9) < 0.01 for it in m.agents)"
        seen = echoed(shell, "--filter", believed, "/musselbed/beliefs")
    beliefs = {it["id"]: it for it in seen["agents"]}
    assert (beliefs[3]["north"], beliefs[3]["charge"]) == pytest.approx((9.0, 0.45), abs=0.01)
    with claimed(shell, "/lab", "[]"):
        assert fleet.told() == {"id": 3, "is": "simulated", "by": "/lab"}


def test_one_that_comes_back_follows_what_is_claimed_by_then(begin: Begin, shell: dict[str, str]) -> None:
    with claimed(shell, "/lab", "[4]"):
        echoed(shell, "/musselbed/claims")
        fleet = Fleet(begin, shell, "ours", "1", "/lab")
        taken_back = "aMussel 3 was real by /lab, which claims it no more: it is taken back"
        handed_over = "aMussel 4 was simulated, and /lab claims it as real now: it is handed over"
        assert [fleet.says() for _ in range(3)] == [taken_back, handed_over, "flying"]
        assert fleet.told() == {"id": 4, "is": "real", "by": "/lab"}


def test_a_second_fleet_with_an_id_of_the_first_does_not_start_and_the_later_of_two_retires_its_own(
    begin: Begin, shell: dict[str, str]
) -> None:
    first = Fleet(begin, shell, "ours", "1")
    assert first.says() == "flying"
    assert Fleet(begin, shell, "theirs", "4").says() == (
        "node /ours simulates aMussel 4 already: two fleets on one master need disjoint ids "
        "(fleet.first_id, fleet.count) or a namespace each (ROS_NAMESPACE)"
    )
    assert Fleet(begin, shell, "others", "5").says() == "flying"
    with claimed(shell, "/earlier", "[4]", "real: false, since: {secs: 1, nsecs: 0}"):
        assert first.told() == {"id": 4, "is": "retired", "by": "/earlier"}
