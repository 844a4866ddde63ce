"""`musselbed preflight` as a person runs it, beside a simulated aPad of each generation that stands in for a real one."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "apad_bridge.commands.main")
REAL_APAD = ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"
PATIENCE_S = 200


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """The real aPad's, at full charge for its 40 minutes, at a speed that proves a stop soon."""
    data = loader.resolve(loader.load(REAL_APAD))
    data["mission"]["speed_m_s"] = 0.5
    data["duration_s"] = 600
    path = tmp_path / "scenario.yaml"
    loader.write_resolved(path, loader.from_data(data, "real"))
    return path


@contextmanager
def apad(tmp_path: Path, scenario: Path, generation: str) -> Iterator[dict[str, str]]:
    """An aPad in real time on somebody's master; yields the shell's variables."""
    master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=300)
    environment = loopback_environment(tmp_path / "ros", master.uri) | {"PYTHONPATH": str(ROOT)}
    vehicle = subprocess.Popen(
        [*COMMAND, "apad", str(scenario), "--generation", generation],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert vehicle.stdout is not None and vehicle.stdout.readline() == "ready\n"
        yield environment
    finally:
        vehicle.terminate()
        vehicle.communicate(timeout=180)
        master.stop()


@contextmanager
def watchdog(environment: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """The vehicle's watchdog, by the machine's own Python."""
    command = ["/usr/bin/python3", str(ROOT / "launch_scripts" / "vehicle_watchdog")]
    process = subprocess.Popen(command, env=environment | {"PYTHONPATH": str(generated_folder())})
    try:
        yield process
    finally:
        process.terminate()
        process.wait(180)


def musselbed(environment: dict[str, str], cwd: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """Runs a command in `cwd`, where its `runs/` are."""
    return subprocess.run(
        [*COMMAND, *map(str, words)],
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def findings(done: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    return {it["check"]: it for it in json.loads(done.stdout)["findings"]}


@pytest.mark.parametrize("generation", ["a", "b"])
def test_an_apad_is_checked_and_its_stop_proven_and_a_run_starts_on_green_alone(
    tmp_path: Path, scenario: Path, generation: str
) -> None:
    with apad(tmp_path, scenario, generation) as environment:
        asked = ["--prove-stop", "--lookout", "Ana", "--json"]
        asked += ["--prove-docks", "--hands-clear"] if generation == "a" else []
        done = musselbed(environment, tmp_path, "preflight", scenario, *asked)
        found = findings(done)
        # A busy machine's own delay is a warning.
        assert found["delay"]["status"] != "FAIL", found["delay"]
        for check in ("call back", "lookout", "/apad1 position", "/apad1 fence", "/apad1 reaction"):
            assert found[check]["status"] == "OK", found[check]
        assert found["/apad1 energy"]["status"] == "OK", found["/apad1 energy"]
        for check in ("GPS", "origin", "lag", "clearance", "generation", "off", "reserve", "battery"):
            assert found[f"/apad1 {check}"]["status"] == "OK", found[f"/apad1 {check}"]
        stop = found["/apad1 stop"]
        assert stop["status"] == "OK" and "came to rest" in stop["found"], stop
        red = {it["check"] for it in found.values() if it["status"] == "FAIL"}
        assert red == ({"/apad1 watchdog"} if generation == "b" else set()), red
        assert done.returncode == (3 if generation == "b" else 0)
        if generation == "a":
            docks = found["/apad1 docks opened"]
            assert docks["status"] == "OK" and "4 docks closed and opened" in docks["found"], docks

        fly = [
            "run",
            scenario,
            "--apad",
            "ros",
            "--hosting",
            "one_process",
            "--json",
            "--manual",
            "--out",
            "run",
        ]
        if generation == "b":
            refused = musselbed(environment, tmp_path, *fly)
            assert refused.returncode == 2, refused.stderr
            assert "does not start on red" in refused.stderr and "--despite watchdog" in refused.stderr
            assert not (tmp_path / "run").exists()
            with watchdog(environment):
                again = musselbed(environment, tmp_path, "preflight", scenario, "--json")
            told = findings(again)["/apad1 watchdog"]["found"]
            assert told.startswith("it runs, and says WAITING; it listens to /musselbed/heartbeat"), told
            assert again.returncode == 0 and findings(again)["/apad1 stop"] == stop
        run = subprocess.Popen(
            [*COMMAND, *map(str, fly), *(("--despite", "watchdog") if generation == "b" else ())],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            # Its own checks are kept, with what the preflight before it had proven.
            wait_for(run, tmp_path / "run" / "preflight.json")
            kept = {
                it["check"]: it
                for it in json.loads((tmp_path / "run" / "preflight.json").read_text())["findings"]
            }
            assert kept["/apad1 stop"] == stop
            wait_for(run, tmp_path / "run" / "control.sock")
            refuse_second_bench(environment, tmp_path, scenario)
            ended = musselbed(environment, tmp_path, "abort", "run")
            assert ended.returncode == 0, ended.stderr
        finally:
            _, told = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == 0, told
        assert ("a person decided to start despite it" in told) is (generation == "b")


def refuse_second_bench(environment: dict[str, str], tmp_path: Path, scenario: Path) -> None:
    """Beside a flying bench, another fleet's is red and does not start."""
    data = loader.resolve(loader.load(scenario))
    data["fleet"] |= {"first_id": 101, "start": {"charge": [0.6, 0.9]}}
    second = tmp_path / "second.yaml"
    loader.write_resolved(second, loader.from_data(data, "second"))
    bench = findings(musselbed(environment, tmp_path, "preflight", second, "--json"))["/apad1 bench"]
    assert bench["status"] == "FAIL" and "/musselbed_1 publishes /musselbed/heartbeat" in bench["found"]
    words = ["--despite", "watchdog", "--out", "second"]
    refused = musselbed(environment, tmp_path, "run", second, "--apad", "ros", *words)
    assert refused.returncode == 2 and "another bench flies this aPad" in refused.stderr, refused.stderr
    assert not (tmp_path / "second").exists()


def test_a_watchdog_that_dies_in_flight_is_told_and_the_aPad_held_and_its_successor_is_green(
    tmp_path: Path, scenario: Path
) -> None:
    """The dead one's registrations stay with the master: it was killed."""
    data = loader.resolve(loader.load(scenario))
    data["guards"]["watchdog"] = "hold"
    loader.write_resolved(scenario, loader.from_data(data, "watched"))
    fly = ["run", scenario, "--apad", "ros", "--hosting", "one_process", "--json", "--manual", "--out", "run"]
    with apad(tmp_path, scenario, "a") as environment:
        missing = findings(musselbed(environment, tmp_path, "preflight", scenario, "--json"))
        assert missing["/apad1 watchdog"]["found"] == "none, and guards.watchdog demands one"
        with watchdog(environment) as first:
            run = subprocess.Popen(
                [*COMMAND, *map(str, fly)],
                cwd=tmp_path,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            try:
                journal = tmp_path / "run" / "journal.jsonl"
                wait_for(run, tmp_path / "run" / "control.sock")
                first.kill()
                wait_for(run, journal, '"cause":"watchdog","reaction":"hold"')
                assert '"kind":"watchdog","watches":false' in journal.read_text()
                with watchdog(environment):
                    wait_for(run, journal, '"kind":"watchdog","watches":true')
                    done = musselbed(environment, tmp_path, "preflight", scenario, "--json")
                    again = findings(done)["/apad1 watchdog"]
                    assert again["status"] == "OK" and "says WATCHING" in again["found"], again
                assert musselbed(environment, tmp_path, "abort", "run").returncode == 0
            finally:
                run.terminate()
                out, _ = run.communicate(timeout=PATIENCE_S)
    told = "\n".join(json.loads(out)["events"])
    assert "nothing stops the aPad" in told
    assert "stop 1 (hold, by guard: watchdog) has brought the aPad to rest" in told


def wait_for(run: subprocess.Popen[str], path: Path, text: str = "") -> None:
    """Waits until the run has made the file, with the text; a run that has ended makes none."""
    until_s = time.monotonic() + PATIENCE_S

    def is_there() -> bool:
        return path.exists() and text in path.read_text()

    while not (is_there() if text else path.exists()):
        assert time.monotonic() < until_s, text
        try:
            run.wait(0.2)
        except subprocess.TimeoutExpired:
            continue
        assert is_there() if text else path.exists(), run.communicate()[1]


def test_what_cannot_be_overridden_and_docks_without_a_person_are_refused(
    tmp_path: Path, scenario: Path
) -> None:
    data = loader.resolve(loader.load(scenario))
    data["apad"]["start_m"] = [70, 70]
    outside = tmp_path / "outside.yaml"
    data["area"]["fence"] = [[50, 50], [90, 50], [90, 90], [50, 90]]
    data["area"]["home_m"] = [70, 70]
    loader.write_resolved(outside, loader.from_data(data, "outside"))
    with apad(tmp_path, scenario, "a") as environment:
        hands = musselbed(environment, tmp_path, "preflight", scenario, "--prove-docks")
        assert hands.returncode == 2 and "--hands-clear" in hands.stderr
        # The aPad lies in the pool, and the fence is elsewhere: nothing is tried.
        done = musselbed(environment, tmp_path, "preflight", outside, "--prove-stop", "--json")
        found = findings(done)
        assert done.returncode == 3 and found["/apad1 fence"]["status"] == "FAIL"
        assert found["/apad1 stop"]["found"].startswith("not tried")
        for despite in ((), ("--despite", "fence")):
            run = musselbed(environment, tmp_path, "run", outside, "--apad", "ros", "--out", "run", *despite)
            assert (run.returncode == 2 and "m outside" in run.stderr) or "never overridden" in run.stderr
        page = musselbed(environment, tmp_path, "preflight", outside)
        assert "RED" in page.stdout and "cannot be overridden" in page.stdout
