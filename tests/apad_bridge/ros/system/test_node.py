"""How a process of ours becomes a node."""

from __future__ import annotations

import ast
import queue
import select
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO

import pytest
import rospy.core
from killing import standing_still
from patient import PATIENCE_S

from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.ros.system.node import OrderedEnd

ROOT = Path(__file__).parents[4]
NODE = """
import sys
import rospy
from apad_bridge.ros.system.node import start_node

start_node("talker")
print("ready", flush=True)
sys.stdin.readline()
rospy.logwarn("a line for /rosout")
print("logged", flush=True)
"""


def line_of(stream: IO[str]) -> str:
    readable, _, _ = select.select([stream], [], [], PATIENCE_S)
    assert readable, "it said nothing"
    return stream.readline()


@pytest.mark.system
def test_a_line_of_the_log_does_not_wait_for_a_master_that_stands_still(tmp_path: Path) -> None:
    master = start_master(tmp_path / "ros", PATIENCE_S, orphan_s=0)
    node = subprocess.Popen(
        [sys.executable, "-c", NODE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=loopback_environment(tmp_path / "ros", master.uri),
        cwd=ROOT,
        text=True,
    )
    try:
        assert node.stdin is not None and node.stdout is not None
        assert line_of(node.stdout) == "ready\n"
        with standing_still(master.pid):
            node.stdin.write("log\n")
            node.stdin.flush()
            assert line_of(node.stdout) == "logged\n"
    finally:
        node.kill()
        node.communicate()
        master.stop()


@pytest.mark.system
def test_a_log_that_rospy_cannot_write_is_named_with_the_mend(tmp_path: Path) -> None:
    master = start_master(tmp_path / "ros", PATIENCE_S, orphan_s=0)
    environment = loopback_environment(tmp_path / "ros", master.uri)
    log = Path(environment["ROS_HOME"], "log", "talker.log")
    log.mkdir(parents=True)  # root may write any file
    try:
        ended = subprocess.run(
            [sys.executable, "-c", NODE],
            env=environment,
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
    finally:
        master.stop()
    assert f"PeerFailed: rospy cannot write its log {log} (Is a directory): set ROS_LOG_DIR" in ended.stderr


def test_all_nodes_of_ours_start_by_the_same_rules() -> None:
    starting = [
        path.name
        for path in sorted((ROOT / "apad_bridge").rglob("*.py"))
        for it in ast.walk(ast.parse(path.read_text()))
        if isinstance(it, ast.Attribute) and it.attr == "init_node"
    ]
    assert starting == ["node.py"]


@pytest.mark.parametrize("is_told_first", [False, True])
def test_an_end_that_another_orders_waits_for_the_flight_and_no_longer(
    monkeypatch: pytest.MonkeyPatch, is_told_first: bool
) -> None:
    hooks: list[Callable[[str], None]] = []
    after: list[Callable[[str], None]] = []
    monkeypatch.setattr(rospy.core, "add_preshutdown_hook", hooks.append)
    monkeypatch.setattr(rospy.core, "add_shutdown_hook", after.append)
    end, told = OrderedEnd(PATIENCE_S), queue.Queue[str]()
    (hook,) = hooks
    hook("the flight is over")  # our own end of the node: it waits for nothing
    assert told.empty() and after == []
    ordering = threading.Thread(target=hook, args=("a person's kill",))
    for act in (ordering.start, lambda: end.stop_by(told.put))[:: 1 if is_told_first else -1]:
        act()
    assert told.get(timeout=PATIENCE_S) == "a person's kill"
    assert ordering.is_alive() and after == [], "the topics are open until the flight is over"
    leaving = threading.Thread(target=end.close)
    leaving.start()
    ordering.join(PATIENCE_S)
    after[0]("rospy has left")
    leaving.join(PATIENCE_S)
    assert not ordering.is_alive() and not leaving.is_alive() and told.empty()
