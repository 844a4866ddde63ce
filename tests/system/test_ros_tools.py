"""Debian's own ROS tools, in a shell that sourced setup.bash, know our messages and bags, and leave a workspace alone."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
from programs import ROOT, code_here, done
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from agents.time_scale import TimeScale
from apad_bridge.records.bag import BagWriter
from apad_bridge.records.samples import TruthSample
from apad_bridge.ros.system.master import Master, loopback_environment
from apad_bridge.ros.types.generate import generate
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.ros_names import names_table
from firmware_model.states import State

pytestmark = pytest.mark.system

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


def in_a_shell(root: Path, script: str, environment: dict[str, str]) -> str:
    """What a script prints in a bash with every check on, after `source setup.bash`; its errors are part of that."""
    sourced = f"set -eu; source '{root}/launch_scripts/setup.bash'; {script}"
    ended = done("bash", "-c", sourced, env=environment, cwd="/")
    return ended.stdout + ended.stderr


def test_every_type_that_we_publish_can_be_shown(installed: Path, tmp_path: Path) -> None:
    """Those of all topics and services in the table of names."""
    sections = [it for it in vars(names_table).values() if isinstance(it, names_table.Section)]
    tools = {names_table.NameKind.TOPIC: "rosmsg", names_table.NameKind.SERVICE: "rossrv"}
    rows = (row for it in sections for row in it.rows if row.kind in tools)
    types = sorted({f"{tools[row.kind]} {row.type}" for row in rows})
    assert "rosmsg sensor_msgs/NavSatFix" in types
    (tmp_path / "show.py").write_text(SHOW)
    script = f"/usr/bin/python3 '{tmp_path}/show.py' {' '.join(types)}"
    shown = in_a_shell(installed, script, loopback_environment(tmp_path))
    told = [line for line in shown.splitlines() if line.startswith("code ")]
    assert told == [f"code 0 {it}" for it in types], shown


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of a run of a minute."""
    folder = tmp_path_factory.mktemp("flown")
    scenario = write_scenario(folder / "short.yaml", duration_s=60, fleet={"hosting": "one_process"})
    assert code_here("run", scenario, "--time", "asap", "--out", folder / "run", "--json") == 0
    return folder / "run/run.bag"


def test_the_tools_that_read_every_package_xml_accept_ours(
    installed: Path, master: Master, bag: Path, tmp_path: Path
) -> None:
    """An e-mail address without a dot ended each of these tools in every shell that had sourced setup.bash."""
    script = f"""
    rospack depends-on std_msgs
    rosbag check '{bag}'
    rosbag fix '{bag}' '{tmp_path}/fixed.bag'
    roswtf
    """
    output = in_a_shell(installed, script, loopback_environment(tmp_path / "ros", master.uri))
    assert "Traceback" not in output and "InvalidPackage" not in output, output
    assert "migrated successfully" in output and "Bag file does not need any migrations." in output
    with Reader(bag) as ours, Reader(tmp_path / "fixed.bag") as fixed:
        assert {it: topic.msgcount for it, topic in fixed.topics.items()} == {
            it: topic.msgcount for it, topic in ours.topics.items() if topic.msgcount
        }


def test_rosbag_and_rostopic_read_every_tick_of_a_bag(installed: Path, bag: Path, tmp_path: Path) -> None:
    shell, truth = loopback_environment(tmp_path), "/musselbed/truth"
    said = in_a_shell(installed, f"rosbag info '{bag}'", shell).splitlines()
    # Before a first report nothing is believed.
    for topic, kind, count in (
        ("truth", "FleetTruth", "61"),
        ("beliefs", "FleetBeliefs", "60"),
        ("apad", "APadStatus", "61"),
    ):
        (line,) = [line for line in said if f"/musselbed/{topic} " in line]
        assert line.split()[-4:] == [count, "msgs", ":", f"musselbed_msgs/{kind}"]
    header, *rows = csv.reader(
        in_a_shell(installed, f"rostopic echo -b '{bag}' -p {truth}", shell).splitlines()
    )
    read = [dict(zip(header, row, strict=True)) for row in rows]
    fields = ("mission_time_ms", "agents0.id", "agents0.docked", "agent_time_ms")
    assert [[it[f"field.{name}"] for name in fields] for it in read] == [
        [str(now_ms), "1", "0", str(30 * now_ms)] for now_ms in range(0, 61_000, 1000)
    ]
    assert 0.5 < float(read[0]["field.agents0.primary"]) < 1 and float(read[0]["field.agents0.north"]) > 0


def test_rosbag_reindex_mends_a_bag_that_was_never_closed(installed: Path, tmp_path: Path) -> None:
    writer, shell = BagWriter(tmp_path / "run.bag", TimeScale(30)), loopback_environment(tmp_path)
    for now_ms in range(0, 30_000, 1000):
        truth = TruthSample(7, State.ACTIVE, 0.25, 1.0, 1.0 + now_ms, 2.0, 3.0, False, 30 * now_ms)
        writer.sample(now_ms, [truth], [], None)
    torn = shutil.copy(writer.path, tmp_path / "torn.bag")  # what a kill leaves of it
    writer.close()
    script = f"rosbag reindex '{torn}' && rosbag filter '{torn}' '{tmp_path}/all.bag' True"
    assert "100%" in in_a_shell(installed, script, shell)
    # Chunks of seconds 0 to 10 and 11 to 20 are whole.
    with Reader(tmp_path / "all.bag") as bag:
        stamps_ns = [stamp_ns for _, stamp_ns, _ in bag.messages()]
    assert stamps_ns == [max(1, second * 10**9) for second in range(21)]


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
    messages = generated_folder(installed / ".venv")
    theirs, ours, package_path, last_of_path, prefix_path = in_a_shell(
        installed, script, environment
    ).splitlines()
    assert Path(theirs).is_relative_to(workspace) and Path(ours).is_relative_to(messages)
    assert package_path == f"{workspace}:{messages}:{installed / 'launch_scripts'}"
    assert last_of_path == str(installed / ".venv" / "bin")
    assert prefix_path == f"{workspace}:{installed / '.venv'}"


def test_a_shell_without_a_workspace_has_the_prefix_for_rosnodejs_and_sourcing_again_changes_nothing(
    installed: Path, tmp_path: Path
) -> None:
    environment = loopback_environment(tmp_path)
    environment.pop("CMAKE_PREFIX_PATH", None)
    every = "$PYTHONPATH:$ROS_PACKAGE_PATH:$CMAKE_PREFIX_PATH:$PATH"
    again = f'before={every}; source \'{installed}/launch_scripts/setup.bash\'; [ "$before" = "{every}" ]'
    told = in_a_shell(installed, f'echo "$CMAKE_PREFIX_PATH"; {again}', environment)
    assert told == f"{installed / '.venv'}\n"


def test_sourcing_before_an_installation_says_so_and_keeps_the_shell(tmp_path: Path) -> None:
    (tmp_path / "launch_scripts").mkdir()
    setup = shutil.copy(ROOT / "launch_scripts" / "setup.bash", tmp_path / "launch_scripts")
    told = done("bash", "-c", f"source '{setup}' || echo code $?; declare -F; compgen -v _musselbed || true")
    assert told.stdout == "code 1\n"
    assert "run launch_scripts/install" in told.stderr and len(told.stderr.splitlines()) == 1
