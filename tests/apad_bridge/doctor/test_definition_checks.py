"""Other people's definitions of our types: distinguished by md5, never run."""

from __future__ import annotations

from pathlib import Path

import pytest

from apad_bridge.doctor.definitions import Definitions, check_definitions, python_md5s
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.ros import doctor_checks
from apad_bridge.ros.doctor_checks import check_other_definitions
from apad_bridge.ros.types.generate import generate

OURS, THEIRS = "d1c2e3fd518b63978e72fa7409f4ba71", "0" * 32
PYTHON_2 = """
import os
print 'this is Python 2, and it runs:', os.remove(__file__)
class NavSts(genpy.Message):
  _md5sum = "{md5}"
  _type = "auv_msgs/NavSts"
"""


def lay_python_2(entry: Path, md5: str) -> Path:
    module = entry / "auv_msgs" / "msg" / "_NavSts.py"
    module.parent.mkdir(parents=True)
    module.write_text(PYTHON_2.format(md5=md5))
    return module


def test_md5s_of_generated_code_are_those_of_the_live_server(tmp_path: Path) -> None:
    generate(tmp_path / "ros")
    md5s = python_md5s(tmp_path / "ros", ["auv_msgs", "misc_msgs", "apad"])
    # As read from a running aPad of the simulator generation.
    assert md5s["auv_msgs/NavSts"] == OURS
    assert md5s["misc_msgs/GetDockingInfo"] == "139c8b6b67bdb35759761ea3d907700d"
    assert md5s["apad/aPadGoal"] == "eca4d4e6ce7927bca8845cd4424fc301"


def test_code_of_python_2_is_read_and_not_run(tmp_path: Path) -> None:
    module = lay_python_2(tmp_path, THEIRS)
    assert python_md5s(tmp_path, ["auv_msgs"]) == {"auv_msgs/NavSts": THEIRS}
    assert module.exists()


def test_a_difference_names_both_places_and_both_md5s() -> None:
    ours = Definitions("/ours", {"auv_msgs/NavSts": OURS})
    (finding,) = check_definitions(ours, [Definitions("/theirs", {"auv_msgs/NavSts": THEIRS})])
    assert finding.status is CheckStatus.WARN
    for part in ("/ours", "/theirs", OURS, THEIRS, "auv_msgs/NavSts"):
        assert part in finding.found


def test_a_workspace_that_agrees_is_no_trouble() -> None:
    ours = Definitions("/ours", {"auv_msgs/NavSts": OURS})
    (finding,) = check_definitions(ours, [Definitions("/theirs", {"auv_msgs/NavSts": OURS})])
    assert finding.status is CheckStatus.OK and "/theirs" in finding.found


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Sets up a user's workspace in a shell without others; the installation's messages lie beside it."""
    generate(tmp_path / "ros")
    monkeypatch.setattr(doctor_checks, "generated_folder", lambda: tmp_path / "ros")
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    return tmp_path / "workspace"


def test_a_workspace_on_pythonpath_is_found(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lay_python_2(workspace, THEIRS)
    monkeypatch.setenv("PYTHONPATH", str(workspace))
    lines = [finding.line() for finding in check_other_definitions()]
    assert any(line.startswith("WARN") and str(workspace) in line and THEIRS in line for line in lines)


def lay_text(workspace: Path, nav_sts: str) -> None:
    package = workspace / "src" / "auv_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>auv_msgs</name></package>")
    (package / "msg" / "NavSts.msg").write_text(nav_sts)


def test_texts_on_ros_package_path_are_compared_by_md5(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lay_text(workspace, "Header header\nfloat64 north\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(workspace))
    lines = [finding.line() for finding in check_other_definitions()]
    assert any(line.startswith("WARN") and str(workspace) in line and OURS in line for line in lines)


def test_a_text_that_cannot_be_read_is_named(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lay_text(workspace, "no_such_msgs/Thing thing\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(workspace))
    lines = [finding.line() for finding in check_other_definitions()]
    assert any(line.startswith("WARN") and "NavSts.msg (no no_such_msgs/Thing)" in line for line in lines)
