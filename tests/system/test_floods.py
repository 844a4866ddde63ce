"""A stranger's connections beside a run, and processes beside it that die: a person's stop comes through all the same."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import urllib.request
import xmlrpc.client
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import yaml
from journals import lines_in
from killing import kill_9, standing_still
from patient import PATIENCE_S
from selenium.webdriver.support.wait import WebDriverWait

from apad_bridge.commands.look.console import console_service
from apad_bridge.imc.commands.imc import imc_service
from apad_bridge.records.journal import read_journal
from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.supervisor.control_client import SOCKET_NAME, listens

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
HARD_LIMIT = 512
STRANGERS = 1100


@dataclass(frozen=True, slots=True)
class Flown:
    path: Path
    page: str
    master: str


@contextmanager
def flown(folder: Path) -> Iterator[Flown]:
    """A run of six aMussels with its console, whose processes may have few descriptors."""
    data = yaml.safe_load((ROOT / "launch_scripts/scenarios/pool-12.yaml").read_text())
    data.update(name="flooded", duration_s=14_400, theta=30)
    data["fleet"].update(count=6, start={"charge": [0.5, 0.75]})
    scenario, out, said = folder / "flooded.yaml", folder / "run", folder / "said"
    scenario.write_text(yaml.safe_dump(data))
    with said.open("wb") as output:
        process = subprocess.Popen(
            [*MUSSELBED, "run", scenario, "--speed", "10", "--out", out, "--console"],
            stdout=output,
            stderr=output,
            cwd=ROOT,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (HARD_LIMIT, HARD_LIMIT)),
        )
    try:
        wait_until(lambda: listens(out) if out.is_dir() else process.poll() is not None)
        assert process.poll() is None, said.read_text()
        page = re.search(r"live page: (\S+)", said.read_text())
        master = re.search(r"ROS_MASTER_URI=(\S+)", said.read_text())
        assert page and master, said.read_text()
        yield Flown(out, page[1], master[1])
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE_S)


def wait_until(holds: Callable[[], Any]) -> Any:
    """Polls what announces nothing."""
    return WebDriverWait(None, PATIENCE_S, 0.05).until(lambda _: holds())  # type: ignore[arg-type]


def flood(stack: ExitStack, family: int, address: Any) -> None:
    """Connects as often as a stranger may, and says nothing. What is not accepted yet waits."""
    for _ in range(STRANGERS):
        link = stack.enter_context(socket.socket(family))
        link.setblocking(False)
        link.connect_ex(address)


def order(page: str, act: str) -> dict[str, Any]:
    """An order as the page gives it, by a client of its own."""
    address, token = page.split("/?token=")
    request = urllib.request.Request(
        f"{address}/orders",
        data=json.dumps({"act": act, "by": "Anna"}).encode(),
        headers={"X-Musselbed-Token": token, "Origin": address},
    )
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        found: dict[str, Any] = json.loads(answer.read())
        return found


def noted(run: Path, kind: str) -> list[dict[str, Any]]:
    return [it for it in lines_in(run / "journal.jsonl") if it["kind"] == kind]


def test_1100_connections_to_each_door_take_no_stop_from_a_person(tmp_path: Path) -> None:
    with flown(tmp_path) as run, ExitStack() as strangers:
        with xmlrpc.client.ServerProxy(run.master) as master:
            _, _, services = master.lookupService("/test", "/musselbed_1/get_loggers")  # type: ignore[misc]
            _, _, calls = master.lookupNode("/test", "/musselbed_1")  # type: ignore[misc]
        for url in (str(services), str(calls), run.page):
            flood(strangers, socket.AF_INET, (urlsplit(url).hostname, urlsplit(url).port))
        folder = os.open(run.path, os.O_DIRECTORY)
        strangers.callback(os.close, folder)
        flood(strangers, socket.AF_UNIX, f"/proc/self/fd/{folder}/{SOCKET_NAME}")

        stopped = subprocess.run(
            [*MUSSELBED, "stop", run.path, "--json"], capture_output=True, text=True, timeout=PATIENCE_S
        )
        assert stopped.returncode == 0, stopped.stderr + stopped.stdout
        assert order(run.page, "continue")["accepted"]
        assert order(run.page, "stop")["accepted"]
        wait_until(lambda: len(noted(run.path, "operator")) == 3)
        strangers.close()

        # The graph hears again, or has heard all the time.
        asked = subprocess.run(
            [sys.executable, "-c", ASK],
            env={**os.environ, "ROS_MASTER_URI": run.master, "ROS_IP": "127.0.0.1"},
        )
        assert asked.returncode == 0
        assert noted(run.path, "remark") == []  # the console lived through it


ASK = f"""
import rospy
from roscpp.srv import GetLoggers
rospy.wait_for_service("/musselbed_1/get_loggers", {PATIENCE_S})
assert rospy.ServiceProxy("/musselbed_1/get_loggers", GetLoggers)().loggers
"""


def test_a_deaf_node_is_told_and_a_shortage_of_files_deafens_none(tmp_path: Path) -> None:
    with ExitStack() as stack:
        master = start_master(tmp_path / "ros", PATIENCE_S)
        stack.callback(master.stop)
        environment = {**os.environ, **loopback_environment(tmp_path / "ros", master.uri)}
        told = subprocess.run(
            [sys.executable, ROOT / "tests/system/open_a_deaf_node.py"],
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
    assert told.returncode == 0, told.stderr
    hears, outlasted, deaf, again = map(json.loads, told.stdout.splitlines())
    assert hears is outlasted is None
    assert [kind for kind, _ in deaf] == ["graph_deaf"] and "timed out" in deaf[0][1]["why"]
    assert again == ["graph_hears"]


def pid_beside(run: Path, command: str) -> int | None:
    """The process of ours that serves the run by this command, if there is one."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if command in words and str(run) in words and "apad_bridge.commands.main" in words:
            return int(entry.name)
    return None


def test_what_serves_beside_a_run_is_started_again_when_it_dies_and_that_is_told(tmp_path: Path) -> None:
    with flown(tmp_path) as run:
        told: list[str] = []
        with (
            console_service().beside(run.path, told.append) as page,
            imc_service(("--port", "0")).beside(run.path, told.append),
        ):
            own = wait_until(lambda: pid_beside(run.path, "imc"))
            kill_9(own)
            wait_until(lambda: told == ["the imc died (SIGKILL)", "the imc was started again"])
            assert pid_beside(run.path, "imc") not in (None, own)
            kill_9(serving(page))
            wait_until(lambda: told[2:] == ["the console died (SIGKILL)", "the console was started again"])
            # At the same address, with the same token.
            assert order(page, "stop")["accepted"]
            wait_until(lambda: [it["text"] for it in noted(run.path, "remark")] == told)
        # Ended in order, nothing is started again.
        assert len(told) == 4 and pid_beside(run.path, "imc") is None


def test_a_master_that_stands_still_is_told_and_so_is_its_return(tmp_path: Path) -> None:
    """No tool finds the run meanwhile, and its simulated aPad waits. The flight goes on when the master answers."""

    def said(words: str) -> int:
        return " ".join((tmp_path / "said").read_text().split()).count(words)

    with flown(tmp_path) as run:
        with xmlrpc.client.ServerProxy(run.master) as master:
            _, _, pid = master.getPid("/test")  # type: ignore[misc]
        # Before its first tick the supervisor registers its services, and would wait for the master.
        wait_until(lambda: read_journal(run.path / "journal.jsonl").last_ms > 0)
        with standing_still(pid):
            wait_until(lambda: said("ROS master stands still"))
        wait_until(lambda: len(noted(run.path, "remark")) == 2)
        still, again = (it["text"] for it in noted(run.path, "remark"))
        assert still.startswith("the run's own ROS master stands still, so no ROS tool finds the run: ")
        assert again == "the run's own ROS master answers again"
        flown_ms = read_journal(run.path / "journal.jsonl").last_ms
        wait_until(lambda: read_journal(run.path / "journal.jsonl").last_ms > flown_ms + 5_000)
    assert said("ROS master stands still") == said("ROS master answers again") == 1


def serving(page: str) -> int:
    """The process that listens at the page's address."""
    found = subprocess.run(
        ["ss", "-Hltnp", f"sport = :{urlsplit(page).port}"], capture_output=True, text=True
    )
    pid = re.search(r"pid=(\d+)", found.stdout)
    assert pid, found.stdout
    return int(pid[1])


def test_a_console_of_a_flight_that_begins_late_waits_for_it(tmp_path: Path) -> None:
    with flown(tmp_path) as run, beside_a_late_flight(tmp_path, run.path, "console") as (late, process):
        assert process.stdout is not None and process.stderr is not None
        url = json.loads(process.stdout.readline())["url"]
        assert "no flight began" in process.stderr.readline()
        assert "has not begun" in page_of(url)
        (late / "journal.jsonl").write_bytes((run.path / "journal.jsonl").read_bytes())
        wait_until(lambda: 'id="stop"' in page_of(url))


def test_a_gateway_of_a_flight_that_begins_late_waits_for_it(tmp_path: Path) -> None:
    with flown(tmp_path) as run, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as console:
        console.bind(("127.0.0.1", 0))
        console.settimeout(PATIENCE_S)
        asked = ("--port", "0", "--neptus", f"127.0.0.1:{console.getsockname()[1]}")
        with beside_a_late_flight(tmp_path, run.path, "imc", *asked) as (late, process):
            assert process.stderr is not None
            assert "no flight began" in process.stderr.readline()
            (late / "journal.jsonl").write_bytes((run.path / "journal.jsonl").read_bytes())
            assert console.recv(65_536)


@contextmanager
def beside_a_late_flight(
    folder: Path, run: Path, command: str, *asked: str
) -> Iterator[tuple[Path, subprocess.Popen[str]]]:
    """A command that serves beside a flight, a copy of `run` without a journal, with little patience. It ends in order."""
    late = folder / "late"
    late.mkdir()
    for name in ("scenario.yaml", "run.json"):
        (late / name).write_bytes((run / name).read_bytes())
    patience = (
        "from apad_bridge.records import journal; journal._BEGINS_S = 0.1; "
        "from apad_bridge.console import server; server._BEGUN_S = 0.1"
    )
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"{patience}; from apad_bridge.commands.main import main; raise SystemExit(main())",
            *(command, late, "--json", *asked),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield late, process
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0


def page_of(url: str) -> str:
    """The page as a browser gets it."""
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        return str(answer.read().decode())
