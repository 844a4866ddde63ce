"""launch_scripts/install where it may not or cannot install: one line that says exactly what is missing.

The programs that it asks are replaced on PATH, so that nothing of this machine changes.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
INSTALL = ROOT / "launch_scripts" / "install"

LACKING_TWO = r"""
for name in "${@:4}"; do
  case $name in python3-actionlib) ;; rosbash) echo "config-files $name" ;; *) echo "installed $name" ;; esac
done
echo "dpkg-query: no packages found matching python3-actionlib" >&2
exit 1
"""


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    folder = tmp_path / "bin"
    folder.mkdir()
    return folder


def replace(programs: Path, name: str, script: str) -> None:
    (programs / name).write_text(f"#!/bin/bash\n{script}\n")
    (programs / name).chmod(0o755)


def run_install(programs: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PATH": f"{programs}:/usr/bin:/bin", "TMPDIR": str(programs.parent)}
    return subprocess.run(
        [str(INSTALL), *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_without_root_or_sudo_it_names_what_is_missing(programs: Path) -> None:
    replace(programs, "dpkg-query", LACKING_TWO)
    replace(programs, "id", "echo 1000")
    replace(programs, "sudo", "exit 1")
    replace(programs, "apt-get", f"touch {programs}/called")
    done = run_install(programs)
    assert done.returncode == 1
    assert done.stderr == (
        "musselbed: these Debian packages are missing, and installing them takes root or sudo: "
        "run as root: apt-get install --no-install-recommends python3-actionlib rosbash\n"
    )
    assert not (programs / "called").exists()


def test_without_network_it_updates_once_and_names_what_is_missing(programs: Path) -> None:
    replace(programs, "dpkg-query", LACKING_TWO)
    replace(programs, "id", "echo 0")
    replace(
        programs, "apt-get", f'echo "$DEBIAN_FRONTEND $*" >>{programs}/calls; echo "E: no network"; exit 100'
    )
    done = run_install(programs)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert "is there a network?" in done.stderr
    assert "apt-get install --no-install-recommends python3-actionlib rosbash " in done.stderr
    calls = (programs / "calls").read_text().splitlines()
    assert [call.split()[4] for call in calls] == ["install", "update"]
    assert all(call.startswith("noninteractive ") for call in calls)
    log = Path(done.stderr.rsplit("its log: ", 1)[1].rstrip(")\n"))
    assert "E: no network" in log.read_text()


def test_only_what_is_missing_is_asked_for_and_from_the_lists_at_hand_first(programs: Path) -> None:
    replace(programs, "dpkg-query", LACKING_TWO)
    replace(programs, "id", "echo 0")
    # Ending the script here keeps it from going on to the virtual environment that these tests run in.
    replace(programs, "apt-get", f'echo "$*" >>{programs}/calls; kill $PPID')
    run_install(programs)
    (call,) = (programs / "calls").read_text().splitlines()
    assert call.endswith("install --yes --no-install-recommends python3-actionlib rosbash")


def test_a_machine_without_debians_tools_is_told_so(programs: Path) -> None:
    for name in ("dirname", "flock", "mktemp", "rm"):
        (programs / name).symlink_to(f"/usr/bin/{name}")
    environment = {"PATH": str(programs), "TMPDIR": str(programs.parent)}
    done = subprocess.run(
        ["/bin/bash", str(INSTALL)], env=environment, capture_output=True, text=True, timeout=180
    )
    assert (done.returncode, done.stderr) == (
        1,
        "musselbed: Debian 12 is needed: this machine has no dpkg-query\n",
    )


def test_an_unknown_option_is_refused(programs: Path) -> None:
    done = run_install(programs, "--tests")
    assert (done.returncode, done.stderr) == (2, "use: launch_scripts/install [--test]\n")


@pytest.mark.skipif(Path(sys.prefix) != ROOT / ".venv", reason="these tests do not run in an installed .venv")
def test_an_installed_clone_has_nothing_to_do() -> None:
    ambient = os.environ | {
        "PYTHONPATH": "/nowhere",
        "PYTHONHOME": "/nowhere",
        "ROS_PACKAGE_PATH": "/nowhere",
    }
    done = subprocess.run([str(INSTALL), "--test"], env=ambient, capture_output=True, text=True, timeout=180)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
