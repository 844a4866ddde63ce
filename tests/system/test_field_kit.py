"""A field kit: made here, then unpacked, installed and flown on a clean Debian of this release that has no network.

It takes ten minutes on an idle machine, root and 3 GB of disk, so the suite leaves it out. By itself:
.venv/bin/python -m pytest -m field_kit tests/system/test_field_kit.py
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest
from doc_blocks import file_of
from programs import ROOT

IN_CLEAN_DEBIAN = """
set -e
ip link set lo up
mount -t proc proc "$0/proc"
mount --rbind /dev "$0/dev"
exec env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin chroot "$0" /bin/bash -c "$1"
"""
"""As root in namespaces of its own, so that nothing of it outlasts it and no network is there."""

pytestmark = [
    pytest.mark.field_kit,
    pytest.mark.skipif(os.geteuid() != 0, reason="a clean Debian needs root"),
    pytest.mark.skipif(shutil.which("mmdebstrap") is None, reason="mmdebstrap makes the clean Debian"),
]


def in_clean_debian(debian: Path, command: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    alone = ["unshare", "--net", "--mount", "--pid", "--fork", "--kill-child"]
    return subprocess.run(
        [*alone, "bash", "-c", IN_CLEAN_DEBIAN, str(debian), command],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )


def test_a_kit_is_installed_and_flown_on_a_clean_debian_without_a_network(tmp_path: Path) -> None:
    archive, debian = tmp_path / "kit.tar", tmp_path / "debian"
    subprocess.run([str(ROOT / "launch_scripts" / "make-field-kit"), str(archive)], check=True, timeout=1800)
    subprocess.run(
        [
            "unshare",
            "--mount",
            "mmdebstrap",
            "--variant=minbase",
            platform.freedesktop_os_release()["VERSION_CODENAME"],
            str(debian),
        ],
        check=True,
        stdout=subprocess.DEVNULL,
        timeout=1800,
    )
    with tarfile.open(archive) as kit:
        names = kit.getnames()
    place = debian / "root" / "a place with spaces"
    place.mkdir()
    subprocess.run(["tar", "-xf", str(archive), "-C", str(place)], check=True)
    # Not by "/runs/" anywhere: a room of ours has that name.
    assert not {".git", "runs", ".venv"} & {name.split("/")[1] for name in names if "/" in name}

    alone = in_clean_debian(debian, "ls /sys/class/net /proc/net/route; cat /proc/net/route", 60)
    assert len(alone.stdout.strip().splitlines()) <= 3, "it has a route to somewhere"
    kit_folder = "cd '/root/a place with spaces/musselbed'"
    installed = in_clean_debian(debian, f"{kit_folder} && time launch_scripts/install", 1800)
    assert installed.returncode == 0, installed.stdout + installed.stderr
    again = in_clean_debian(debian, f"{kit_folder} && launch_scripts/install", 120)
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    flown = in_clean_debian(debian, f"{kit_folder} && launch_scripts/demo --json", 1200)
    assert flown.returncode == 0, flown.stderr
    summary = json.loads(flown.stdout)
    assert summary["services"] > 0 and summary["amussels_lost"] == 0

    # A strategy of the user's own, as its page installs it without a network.
    package, page = debian / "root" / "lab", ROOT / "docs" / "first-strategy.md"
    package.mkdir()
    for name in ("lab_strategies.py", "setup.cfg", "pyproject.toml"):
        (package / name).write_text(file_of(page, name))
    script = (
        f"{kit_folder} && source launch_scripts/setup.bash && cd /root/lab && "
        "musselbed python -m pip install --no-build-isolation . && "
        "musselbed run pool-12 --strategy farthest --time asap --out /root/farthest --json"
    )
    own = in_clean_debian(debian, script, 1200)
    assert own.returncode == 0, own.stdout + own.stderr
    assert '"farthest"' in (debian / "root" / "farthest" / "journal.jsonl").read_text()
