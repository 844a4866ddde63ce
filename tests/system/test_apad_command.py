"""`musselbed apad`: the simulated aPad alone, on a master that is there already."""

from __future__ import annotations

import signal
import xmlrpc.client
from pathlib import Path
from typing import Any

import pytest
from programs import MUSSELBED, Begin, code_here, ended_well, line_of

from apad_bridge.ros.system.master import Master, loopback_environment

pytestmark = pytest.mark.system
WORDS = ("apad", "launch_scripts/scenarios/pool-12.yaml")


@pytest.mark.parametrize(
    ("generation", "service", "number"),
    [
        ("a", "/apad1/get_battery_level", signal.SIGHUP),
        ("b", "/apad1/commander/primitive/go2point", signal.SIGTERM),
    ],
)
def test_it_offers_its_generation_alone_and_ends_when_it_is_asked_to(
    generation: str, service: str, number: signal.Signals, tmp_path: Path, master: Master, begin: Begin
) -> None:
    environment = loopback_environment(tmp_path / "ros", master.uri)
    apad = begin(*MUSSELBED, *WORDS, "--generation", generation, env=environment)
    assert line_of(apad) == "ready"
    with xmlrpc.client.ServerProxy(master.uri) as proxy:
        asked: Any = proxy
        _, _, offered = asked.getSystemState("/test")
        _, _, parameters = asked.getParam("/test", "/apad1")
        # As the legacy stack gives Biograd.
        assert [parameters[f"LocalOrigin{it}"] for it in ("Lat", "Lon")] == [43.9330937, 15.4443468]
        nodes = {node for kind in offered for _, nodes in kind for node in nodes}
        assert service in {name for name, _ in offered[2]}
        assert nodes - {"/rosout"} == {"/apad1_simulated"}
        apad.send_signal(number)
        ended_well(apad, 130)
        _, _, names = asked.getParamNames("/test")
    assert not [it for it in names if "LocalOrigin" in it]


def test_without_a_master_it_says_so_in_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert code_here(*WORDS) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "no ROS master answers at http://127.0.0.1:9" in line
