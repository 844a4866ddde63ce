"""Debian's own ROS tools, in a shell that sourced setup.bash, know our messages and leave a user's workspace alone."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from apad_bridge.commands.main import main
from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.ros.types.generate import generate
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.ros_names import table
from apad_bridge.scenario.loader import load, write_resolved

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
POOL = ROOT / "launch_scripts/scenarios/pool-12.yaml"

PUBLISHER = """
import sys
from pathlib import Path
from apad_bridge.ros.types.messages import use_generated_messages
use_generated_messages(Path(sys.argv[1]))
import rospy
from musselbed_msgs.msg import AgentTruth, FleetTruth
rospy.init_node("publisher", disable_signals=True)
topic = rospy.Publisher("/musselbed/truth", FleetTruth, queue_size=1, latch=True)
topic.publish(FleetTruth(mission_time_ms=61000, agents=[AgentTruth(id=7, north=1.5, docked=True)]))
print("ready", flush=True)
sys.stdin.read()
rospy.signal_shutdown("the test is over")
"""

SHOW = """
import sys, rosmsg
for tool, name in zip(sys.argv[1::2], sys.argv[2::2]):
    asked, sys.argv = sys.argv, [tool, "show", name]
    try:
        rosmsg.rosmsgmain({"rosmsg": rosmsg.MODE_MSG, "rossrv": rosmsg.MODE_SRV}[tool])
    except SystemExit as ended:
        print("code", ended.code or 0, tool, name)
    sys.argv = asked
"""
"""Runs Debian's rosmsg and rossrv for many types in one process: an interpreter for each took a minute."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder laid out as an installed clone, as far as setup.bash looks."""
    root = tmp_path_factory.mktemp("clone")
    (root / "launch_scripts").mkdir()
    for name in ("setup.bash", "package.xml"):
        shutil.copy(ROOT / "launch_scripts" / name, root / "launch_scripts")
    messages = generated_folder(root / ".venv")
    messages.parent.mkdir(parents=True)
    generate(messages)
    return root


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=0)
    yield running
    running.stop()


def in_a_shell(root: Path, script: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run `script` in a bash with every check on, after `source setup.bash`."""
    sourced = f"set -eu; source '{root}/launch_scripts/setup.bash'; {script}"
    command = ["bash", "-c", sourced]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, cwd="/")


def test_rostopic_echoes_our_message_from_another_process(
    installed: Path, master: Master, tmp_path: Path
) -> None:
    environment = loopback_environment(tmp_path / "ros", master.uri)
    publisher = subprocess.Popen(
        [sys.executable, "-c", PUBLISHER, str(generated_folder(installed / ".venv"))],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    try:
        assert publisher.stdout is not None and publisher.stdout.readline() == "ready\n"
        echoed = in_a_shell(
            installed, "rostopic echo -n 1 /musselbed/truth; rostopic type /musselbed/truth", environment
        )
    finally:
        publisher.communicate(timeout=180)
    assert echoed.returncode == 0, echoed.stderr
    lines = [line.strip() for line in echoed.stdout.splitlines()]
    assert {"mission_time_ms: 61000", "id: 7", "north: 1.5", "docked: True"} <= set(lines)
    assert lines[-1] == "musselbed_msgs/FleetTruth"
    assert publisher.returncode == 0


def test_rosmsg_rossrv_and_rosbag_know_the_definitions(installed: Path, tmp_path: Path) -> None:
    script = """
    rosmsg show musselbed_msgs/FleetTruth
    rosmsg show apad/aPadGoal
    rossrv show misc_msgs/GetDockingInfo
    rosmsg md5 underwater_msgs/MediumTransmission
    rosbag help
    """
    shown = in_a_shell(installed, script, loopback_environment(tmp_path))
    assert shown.returncode == 0, shown.stderr
    assert "Unable to load" not in shown.stdout + shown.stderr
    for line in (
        "musselbed_msgs/AgentTruth[] agents",
        "geometry_msgs/Pose pose_offset",
        "int32[] available_slots",
    ):
        assert line in shown.stdout
    assert "11f270ad3c6a896e6e40b3ee541fbd39" in shown.stdout


def published_types() -> set[tuple[str, str]]:
    """(tool, type) for the types of all topics and services in the table of names."""
    sections = [it for it in vars(table).values() if isinstance(it, table.Section)]
    tools = {table.NameKind.TOPIC: "rosmsg", table.NameKind.SERVICE: "rossrv"}
    return {(tools[row.kind], row.type) for it in sections for row in it.rows if row.kind in tools}


def test_every_type_that_we_publish_can_be_shown(installed: Path, tmp_path: Path) -> None:
    types = published_types()
    assert ("rosmsg", "sensor_msgs/NavSatFix") in types
    (tmp_path / "show.py").write_text(SHOW)
    words = " ".join(f"{tool} {name}" for tool, name in sorted(types))
    script = f"/usr/bin/python3 '{tmp_path}/show.py' {words}"
    shown = in_a_shell(installed, script, loopback_environment(tmp_path))
    assert shown.returncode == 0, shown.stderr
    told = [line for line in shown.stdout.splitlines() if line.startswith("code ")]
    assert told == [f"code 0 {tool} {name}" for tool, name in sorted(types)], shown.stderr


def test_the_tools_that_read_every_package_xml_accept_ours(
    installed: Path, master: Master, tmp_path: Path
) -> None:
    """An e-mail address without a dot ended each of these tools in every shell that had sourced setup.bash."""
    run, scenario = tmp_path / "run", tmp_path / "short.yaml"
    write_resolved(scenario, replace(load(POOL), duration_s=60.0))
    words = ["run", str(scenario), "--time", "asap", "--hosting", "one_process", "--out", str(run), "--json"]
    assert main(words) == 0
    script = f"""
    rospack depends-on std_msgs
    rosbag check '{run}/run.bag'
    rosbag fix '{run}/run.bag' '{tmp_path}/fixed.bag'
    roswtf
    """
    told = in_a_shell(installed, script, loopback_environment(tmp_path / "ros", master.uri))
    output = told.stdout + told.stderr
    assert told.returncode == 0 and "Traceback" not in output and "InvalidPackage" not in output, output
    assert "migrated successfully" in output
    with Reader(run / "run.bag") as bag, Reader(tmp_path / "fixed.bag") as fixed:
        assert {it: topic.msgcount for it, topic in fixed.topics.items()} == {
            it: topic.msgcount for it, topic in bag.topics.items() if topic.msgcount
        }


def test_a_workspace_that_was_sourced_before_wins(installed: Path, tmp_path: Path) -> None:
    workspace = tmp_path / "workspace"
    (workspace / "auv_msgs").mkdir(parents=True)
    (workspace / "auv_msgs" / "__init__.py").write_text("")
    environment = loopback_environment(tmp_path) | {
        "PYTHONPATH": str(workspace),
        "ROS_PACKAGE_PATH": str(workspace),
        "CMAKE_PREFIX_PATH": str(workspace),
    }
    script = """
    /usr/bin/python3 -c 'import auv_msgs, misc_msgs; print(auv_msgs.__file__); print(misc_msgs.__file__)'
    echo "$ROS_PACKAGE_PATH"; echo "${PATH##*:}"; echo "$CMAKE_PREFIX_PATH"
    """
    told = in_a_shell(installed, script, environment)
    assert told.returncode == 0, told.stderr
    messages = generated_folder(installed / ".venv")
    theirs, ours, package_path, last_of_path, prefix_path = told.stdout.splitlines()
    assert Path(theirs).is_relative_to(workspace) and Path(ours).is_relative_to(messages)
    assert package_path == f"{workspace}:{messages}:{installed / 'launch_scripts'}"
    assert last_of_path == str(installed / ".venv" / "bin")
    assert prefix_path == f"{workspace}:{installed / '.venv'}"


def test_a_shell_without_a_workspace_has_the_prefix_without_which_rosnodejs_does_not_start(
    installed: Path, tmp_path: Path
) -> None:
    environment = {
        it: value for it, value in loopback_environment(tmp_path).items() if it != "CMAKE_PREFIX_PATH"
    }
    told = in_a_shell(installed, 'echo "$CMAKE_PREFIX_PATH"', environment)
    assert told.stdout == f"{installed / '.venv'}\n", told.stderr


def test_sourcing_again_changes_nothing(installed: Path, tmp_path: Path) -> None:
    again = f"before=$PYTHONPATH:$ROS_PACKAGE_PATH:$CMAKE_PREFIX_PATH:$PATH; source '{installed}/launch_scripts/setup.bash'"
    told = in_a_shell(
        installed,
        f'{again}; [ "$before" = "$PYTHONPATH:$ROS_PACKAGE_PATH:$CMAKE_PREFIX_PATH:$PATH" ]',
        loopback_environment(tmp_path),
    )
    assert told.returncode == 0, told.stderr


def test_sourcing_before_an_installation_says_so_and_keeps_the_shell(tmp_path: Path) -> None:
    (tmp_path / "launch_scripts").mkdir()
    setup = shutil.copy(ROOT / "launch_scripts" / "setup.bash", tmp_path / "launch_scripts")
    told = subprocess.run(
        ["bash", "-c", f"source '{setup}' || echo code $?; declare -F; compgen -v _musselbed || true"],
        capture_output=True,
        text=True,
        timeout=180,
    )
    assert told.stdout == "code 1\n"
    assert "run launch_scripts/install" in told.stderr and len(told.stderr.splitlines()) == 1
