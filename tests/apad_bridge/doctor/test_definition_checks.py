"""Other people's definitions of our types: distinguished by md5, never run."""

from __future__ import annotations

from collections.abc import Callable
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


@pytest.mark.parametrize(
    ("theirs", "status"), [(THEIRS, CheckStatus.WARN), (OURS, CheckStatus.OK)], ids=["differs", "agrees"]
)
def test_a_workspace_is_named_with_both_md5s_where_they_differ(theirs: str, status: CheckStatus) -> None:
    ours = Definitions("/ours", {"auv_msgs/NavSts": OURS})
    (finding,) = check_definitions(ours, [Definitions("/theirs", {"auv_msgs/NavSts": theirs})])
    assert finding.status is status and "/theirs" in finding.found
    named = {"/ours", OURS, THEIRS, "auv_msgs/NavSts"}
    assert status is CheckStatus.OK or all(it in finding.found for it in named)


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Sets up a user's workspace in a shell without others; the installation's messages lie beside it."""
    generate(tmp_path / "ros")
    monkeypatch.setattr(doctor_checks, "generated_folder", lambda: tmp_path / "ros")
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    return tmp_path / "workspace"


def lay_text(workspace: Path, nav_sts: str) -> None:
    package = workspace / "src" / "auv_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>auv_msgs</name></package>")
    (package / "msg" / "NavSts.msg").write_text(nav_sts)


@pytest.mark.parametrize(
    ("variable", "lay", "told"),
    [
        ("PYTHONPATH", lambda it: lay_python_2(it, THEIRS), THEIRS),
        ("ROS_PACKAGE_PATH", lambda it: lay_text(it, "Header header\nfloat64 north\n"), OURS),
        (
            "ROS_PACKAGE_PATH",
            lambda it: lay_text(it, "no_such_msgs/Thing thing\n"),
            "NavSts.msg (no no_such_msgs/Thing)",
        ),
    ],
    ids=["generated code", "texts, by md5", "a text that cannot be read"],
)
def test_a_workspace_in_the_environment_is_found(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, variable: str, lay: Callable[[Path], object], told: str
) -> None:
    lay(workspace)
    monkeypatch.setenv(variable, str(workspace))
    lines = [finding.line() for finding in check_other_definitions()]
    assert any(line.startswith("WARN") and str(workspace) in line and told in line for line in lines)
