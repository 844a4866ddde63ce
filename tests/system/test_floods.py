"""A stranger's connections beside a run, and processes beside it that die: a person's stop comes through all the same."""

from __future__ import annotations

import json
import os
import re
import resource
import socket
import sys
import urllib.request
import xmlrpc.client
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from killing import kill_9, standing_still
from patient import PATIENCE_S
from programs import (
    MUSSELBED,
    ROOT,
    Begin,
    begun,
    done,
    line_of,
    lines_of,
    musselbed,
    processes_of,
    wait_until,
)
from scenario_files import write_scenario

from apad_bridge.commands.look.console import console_service
from apad_bridge.imc.commands.imc import imc_service
from apad_bridge.records.journal import read_journal
from apad_bridge.ros.system.master import Master, loopback_environment
from apad_bridge.supervisor.control_protocol import SOCKET_NAME, listens

pytestmark = pytest.mark.system
HARD_LIMIT = 512
STRANGERS = 1100


@dataclass(frozen=True, slots=True)
class Flown:
    path: Path
    page: str
    master: str
    said: Path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    """A run of six aMussels with its console, whose processes may have few descriptors. No test here ends it."""
    folder = tmp_path_factory.mktemp("flooded")
    fleet = {"count": 6, "start": {"charge": [0.5, 0.75]}}
    scenario = write_scenario(folder / "flooded.yaml", duration_s=14_400, fleet=fleet)
    out, said = folder / "run", folder / "said"
    command = (*MUSSELBED, "run", scenario, "--speed", 10, "--out", out, "--console")
    few: dict[str, Any] = {
        "preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (HARD_LIMIT, HARD_LIMIT))
    }
    with said.open("wb") as output, begun(*command, stdout=output, stderr=output, **few) as process:
        wait_until(lambda: out.is_dir() and listens(out), process, why=said.read_text())
        page = re.search(r"live page: (\S+)", said.read_text())
        master = re.search(r"ROS_MASTER_URI=(\S+)", said.read_text())
        assert page and master, said.read_text()
        yield Flown(out, page[1], master[1], said)


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


def remarks(run: Flown) -> list[str]:
    return [it["text"] for it in lines_of(run.path, "remark")]


def test_1100_connections_to_each_door_take_no_stop_from_a_person(run: Flown) -> None:
    with ExitStack() as strangers:
        with xmlrpc.client.ServerProxy(run.master) as master:
            _, _, services = master.lookupService("/test", "/musselbed_1/get_loggers")  # type: ignore[misc]
            _, _, calls = master.lookupNode("/test", "/musselbed_1")  # type: ignore[misc]
        for url in (str(services), str(calls), run.page):
            flood(strangers, socket.AF_INET, (urlsplit(url).hostname, urlsplit(url).port))
        folder = os.open(run.path, os.O_DIRECTORY)
        strangers.callback(os.close, folder)
        flood(strangers, socket.AF_UNIX, f"/proc/self/fd/{folder}/{SOCKET_NAME}")

        musselbed("stop", run.path, "--json")
        assert order(run.page, "continue")["accepted"]
        assert order(run.page, "stop")["accepted"]
        wait_until(lambda: len(lines_of(run.path, "operator")) == 3)
    # The graph hears again, or has heard all the time.
    done(sys.executable, "-c", ASK, env={**os.environ, "ROS_MASTER_URI": run.master, "ROS_IP": "127.0.0.1"})
    assert remarks(run) == []  # the console lived through it


ASK = f"""
import rospy
from roscpp.srv import GetLoggers
rospy.wait_for_service("/musselbed_1/get_loggers", {PATIENCE_S})
assert rospy.ServiceProxy("/musselbed_1/get_loggers", GetLoggers)().loggers
"""


def test_a_deaf_node_is_told_and_a_shortage_of_files_deafens_none(tmp_path: Path, master: Master) -> None:
    environment = {**os.environ, **loopback_environment(tmp_path / "ros", master.uri)}
    told = done(sys.executable, ROOT / "tests/system/open_a_deaf_node.py", env=environment).stdout
    hears, outlasted, deaf, again = map(json.loads, told.splitlines())
    assert hears is outlasted is None
    assert [kind for kind, _ in deaf] == ["graph_deaf"] and "timed out" in deaf[0][1]["why"]
    assert again == ["graph_hears"]


def test_what_serves_beside_a_run_is_started_again_when_it_dies_and_that_is_told(run: Flown) -> None:
    def gateway() -> list[int]:
        """The process of ours that serves the run by IMC, if there is one."""
        return [*processes_of(f"commands.main imc {run.path}")]

    told, before = list[str](), len(remarks(run))
    with (
        console_service().beside(run.path, told.append) as page,
        imc_service(("--port", "0")).beside(run.path, told.append),
    ):
        (own,) = wait_until(gateway)
        kill_9(own)
        wait_until(lambda: told == ["the imc died (SIGKILL)", "the imc was started again"])
        assert gateway() not in ([], [own])
        kill_9(serving(page))
        wait_until(lambda: told[2:] == ["the console died (SIGKILL)", "the console was started again"])
        # At the same address, with the same token.
        assert order(page, "stop")["accepted"]
        wait_until(lambda: remarks(run)[before:] == told)
    # Ended in order, nothing is started again.
    assert len(told) == 4 and not gateway()


def test_a_master_that_stands_still_is_told_and_so_is_its_return(run: Flown) -> None:
    """No tool finds the run meanwhile, and its simulated aPad waits. The flight goes on when the master answers."""

    def said(words: str) -> int:
        return " ".join(run.said.read_text().split()).count(words)

    def now_ms() -> int:
        return int(read_journal(run.path / "journal.jsonl").last_ms)

    with xmlrpc.client.ServerProxy(run.master) as master:
        _, _, pid = master.getPid("/test")  # type: ignore[misc]
    # Before its first tick the supervisor registers its services, and would wait for the master.
    wait_until(lambda: now_ms() > 0)
    before = len(remarks(run))
    with standing_still(pid):
        wait_until(lambda: said("ROS master stands still"))
    still, again = wait_until(lambda: remarks(run)[before + 1 :] and remarks(run)[before:])
    assert still.startswith("the run's own ROS master stands still, so no ROS tool finds the run: ")
    assert again == "the run's own ROS master answers again"
    flown_ms = now_ms()
    wait_until(lambda: now_ms() > flown_ms + 5_000)
    assert said("ROS master stands still") == said("ROS master answers again") == 1


def serving(page: str) -> int:
    """The process that listens at the page's address."""
    found = done("ss", "-Hltnp", f"sport = :{urlsplit(page).port}").stdout
    (pid,) = re.findall(r"pid=(\d+)", found)
    return int(pid)


PATIENCE = (
    "from apad_bridge.records import journal; journal._BEGINS_S = 0.1; "
    "from apad_bridge.console import server; server._BEGUN_S = 0.1"
)
LATE = f"{PATIENCE}; from apad_bridge.commands.main import main; raise SystemExit(main())"
"""The command, with little patience for a flight that has not begun."""


def test_a_console_and_a_gateway_of_a_flight_that_begins_late_wait_for_it(
    tmp_path: Path, run: Flown, begin: Begin
) -> None:
    late = tmp_path / "late"
    late.mkdir()
    for name in ("scenario.yaml", "run.json"):
        (late / name).write_bytes((run.path / name).read_bytes())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as neptus:
        neptus.bind(("127.0.0.1", 0))
        neptus.settimeout(PATIENCE_S)
        asked = ("--port", 0, "--neptus", f"127.0.0.1:{neptus.getsockname()[1]}")
        console, gateway = (
            begin(sys.executable, "-c", LATE, *words, late, "--json")
            for words in (("console",), ("imc", *asked))
        )
        url = json.loads(line_of(console))["url"]
        for process in (console, gateway):
            assert process.stderr is not None and "no flight began" in process.stderr.readline()
        assert "has not begun" in page_of(url)
        (late / "journal.jsonl").write_bytes((run.path / "journal.jsonl").read_bytes())
        wait_until(lambda: 'id="stop"' in page_of(url))
        assert neptus.recv(65_536)
        for process in (console, gateway):
            process.terminate()
            assert process.wait(PATIENCE_S) == 0


def page_of(url: str) -> str:
    """The page as a browser gets it."""
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        return str(answer.read().decode())
