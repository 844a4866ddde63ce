"""`musselbed preflight` as a person runs it, beside a simulated aPad of each generation that stands in for a real one."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from programs import MUSSELBED, ROOT, Begin, begun, ended_well, line_of, lines_of, musselbed, wait_until
from scenario_files import write_scenario

from apad_bridge.ros.types.messages import generated_folder

pytestmark = pytest.mark.system
REAL_APAD = ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"
OF_APAD = (
    "position",
    "fence",
    "reaction",
    "energy",
    "GPS",
    "origin",
    "lag",
    "clearance",
    "generation",
    "off",
)
OF_APAD += ("reserve", "battery", "stop", "docks opened")
FLY = ("--apad", "ros", "--hosting", "one_process", "--json", "--manual", "--out", "run")


def beside_apad(
    tmp_path: Path, shell: dict[str, str], begin: Begin, generation: str, **changes: Any
) -> tuple[Path, dict[str, Any]]:
    """The real aPad's scenario, at a speed that proves a stop soon, with an aPad in real time; and how commands start."""
    scenario = write_scenario(
        tmp_path / "real.yaml", REAL_APAD, mission={"speed_m_s": 0.5}, duration_s=600, **changes
    )
    environment = shell | {"PYTHONPATH": str(ROOT)}
    there = {"env": environment, "cwd": tmp_path, "stdin": subprocess.DEVNULL}
    assert line_of(begin(*MUSSELBED, "apad", scenario, "--generation", generation, **there)) == "ready"
    return scenario, there


@contextmanager
def watchdog(environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """The vehicle's watchdog, by the machine's own Python."""
    command = ("/usr/bin/python3", ROOT / "launch_scripts" / "vehicle_watchdog")
    with begun(*command, env=environment | {"PYTHONPATH": str(generated_folder())}, stdout=sys.stderr) as it:
        yield it


def findings(output: str) -> dict[str, dict[str, Any]]:
    return {it["check"]: it for it in json.loads(output)["findings"]}


def test_an_apad_is_checked_and_its_stop_and_docks_are_proven_and_one_bench_alone_starts_on_green(
    tmp_path: Path, shell: dict[str, str], begin: Begin
) -> None:
    scenario, there = beside_apad(tmp_path, shell, begin, "a")
    asked = ("--prove-stop", "--lookout", "Ana", "--prove-docks", "--hands-clear", "--json")
    found = findings(musselbed("preflight", scenario, *asked, **there).stdout)
    # A busy machine's own delay is a warning.
    assert found["delay"]["status"] != "FAIL", found["delay"]
    for check in ("call back", "lookout", *(f"/apad1 {it}" for it in OF_APAD)):
        assert found[check]["status"] == "OK", found[check]
    stop = found["/apad1 stop"]
    assert "came to rest" in stop["found"], stop
    assert "4 docks closed and opened" in found["/apad1 docks opened"]["found"]
    assert "FAIL" not in {it["status"] for it in found.values()}
    # The aPad lies in the pool, and the fence is elsewhere: nothing is tried, and nobody may override that.
    fence = [[50, 50], [90, 50], [90, 90], [50, 90]]
    outside = write_scenario(
        tmp_path / "out.yaml", scenario, apad={"start_m": [70, 70]}, area={"fence": fence, "home_m": [70, 70]}
    )
    checks = begin(*MUSSELBED, "preflight", outside, "--prove-stop", "--json", **there)
    despite = ("--apad", "ros", "--out", "run", "--despite", "fence")
    refused = begin(*MUSSELBED, "run", outside, *despite, **there)
    assert "never overridden" in ended_well(refused, 2)[1]
    elsewhere = findings(ended_well(checks, 3)[0])
    assert elsewhere["/apad1 fence"]["status"] == "FAIL"
    assert elsewhere["/apad1 stop"]["found"].startswith("not tried")

    run = begin(*MUSSELBED, "run", scenario, *FLY, **there)
    # Its own checks are kept, with what the preflight before it had proven.
    kept = tmp_path / "run" / "preflight.json"
    wait_until(kept.exists, run)
    assert findings(kept.read_text())["/apad1 stop"] == stop
    wait_until((tmp_path / "run" / "control.sock").exists, run)
    # Beside a flying bench, another fleet's is red and does not start.
    other = {"first_id": 101, "start": {"charge": [0.6, 0.9]}}
    second = write_scenario(tmp_path / "second.yaml", scenario, fleet=other)
    checks = begin(*MUSSELBED, "preflight", second, "--json", **there)
    refused = musselbed(
        "run", second, "--apad", "ros", "--despite", "watchdog", "--out", "second", code=2, **there
    )
    assert "another bench flies this aPad" in refused.stderr, refused.stderr
    assert not (tmp_path / "second").exists()
    bench = findings(ended_well(checks, 3)[0])["/apad1 bench"]
    assert bench["status"] == "FAIL" and "/musselbed_1 publishes /musselbed/heartbeat" in bench["found"]
    musselbed("abort", "run", **there)
    ended_well(run)


def test_without_a_watchdog_a_person_decides_and_one_that_dies_is_told_and_the_aPad_held(
    tmp_path: Path, shell: dict[str, str], begin: Begin
) -> None:
    """The dead one's registrations stay with the master: it was killed. Its successor is seen."""
    scenario, there = beside_apad(tmp_path, shell, begin, "b", guards={"watchdog": "hold"})
    asked = ("--prove-stop", "--lookout", "Ana", "--json")
    found = findings(musselbed("preflight", scenario, *asked, code=3, **there).stdout)
    assert found["/apad1 stop"]["status"] == "OK" and "came to rest" in found["/apad1 stop"]["found"]
    refused = musselbed("run", scenario, *FLY, code=2, **there)
    assert "does not start on red" in refused.stderr and "--despite watchdog" in refused.stderr
    run = tmp_path / "run"
    assert not run.exists()
    red = [it for it in found.values() if it["status"] == "FAIL"]
    assert [(it["check"], it["found"]) for it in red] == [
        ("/apad1 watchdog", "none: on a lost link this aPad drifts as soon as a primitive ends")
    ]
    flight = begin(*MUSSELBED, "run", scenario, *FLY, "--despite", "watchdog", **there)
    wait_until((run / "preflight.json").exists, flight)

    def watched() -> list[bool]:
        return [it["watches"] for it in lines_of(run, "watchdog")]

    with watchdog(shell) as first:
        wait_until((run / "control.sock").exists, flight)
        first.kill()
        wait_until(lambda: [it for it in lines_of(run, "guard") if it["cause"] == "watchdog"], flight)
    assert lines_of(run, "guard")[-1]["reaction"] == "hold" and watched() == [False]
    with watchdog(shell):
        wait_until(lambda: watched()[1:] == [True], flight)
    musselbed("abort", "run", **there)
    out, told = ended_well(flight)
    assert "a person decided to start despite it" in told
    events = "\n".join(json.loads(out)["events"])
    assert "nothing stops the aPad" in events
    assert "stop 1 (hold, by guard: watchdog) has brought the aPad to rest" in events
