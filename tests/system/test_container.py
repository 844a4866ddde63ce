"""The container's image, read by the OCI image format, and its command flown in its root file system.

It takes ten minutes on an idle machine, root and 4 GB of disk, so the suite leaves it out.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
from itertools import takewhile
from pathlib import Path
from threading import Timer
from typing import Any

import pytest
from programs import ROOT

IN_IMAGE = """
set -e
ip link set lo up
mount --bind "$0" "$0"
mount -t proc proc "$0/proc"
mount --rbind /dev "$0/dev"
exec chroot "$0" env -i "$@"
"""
"""As root in namespaces of its own, so that nothing of it outlasts it, and its port is nobody's."""

pytestmark = [
    pytest.mark.system,
    pytest.mark.field_kit,
    pytest.mark.skipif(os.geteuid() != 0, reason="a chroot needs root"),
    pytest.mark.skipif(shutil.which("mmdebstrap") is None, reason="mmdebstrap makes the image"),
]


def blob(image: Path, described: dict[str, Any]) -> Path:
    """The file of a descriptor, which its size and its sha256 prove."""
    kind, _, name = described["digest"].partition(":")
    path = image / "blobs" / kind / name
    assert path.stat().st_size == described["size"]
    with path.open("rb") as file:
        assert hashlib.file_digest(file, kind).hexdigest() == name
    return path


def test_the_image_is_whole_and_its_command_flies_the_demo(tmp_path: Path) -> None:
    archive, image, root = tmp_path / "image.tar", tmp_path / "image", tmp_path / "root"
    image.mkdir()
    root.mkdir()
    subprocess.run([str(ROOT / "launch_scripts" / "container"), str(archive)], check=True, timeout=1800)
    subprocess.run(["tar", "-xf", str(archive), "-C", str(image)], check=True, timeout=600)
    assert json.loads((image / "oci-layout").read_text()) == {"imageLayoutVersion": "1.0.0"}
    (entry,) = json.loads((image / "index.json").read_text())["manifests"]
    manifest = json.loads(blob(image, entry).read_text())
    config = json.loads(blob(image, manifest["config"]).read_text())
    (layer,) = manifest["layers"]
    # tar keeps owners, devices and links as a runtime would.
    subprocess.run(["tar", "-xzf", str(blob(image, layer)), "-C", str(root)], check=True, timeout=600)
    assert not (root / "opt/certificates.crt").exists()

    its = config["config"]
    command = [*its["Env"], f"--chdir={its['WorkingDir']}", *its["Cmd"]]
    alone = ["unshare", "--net", "--mount", "--pid", "--fork", "--kill-child", "bash", "-c", IN_IMAGE]
    with subprocess.Popen(
        [*alone, str(root), *command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as flight:
        assert flight.stdout is not None
        late = Timer(900, flight.kill)
        late.start()
        said = "".join(takewhile(lambda line: "until Ctrl-C" not in line, flight.stdout))
        (first,) = Path(f"/proc/{flight.pid}/task/{flight.pid}/children").read_text().split()
        os.kill(int(first), signal.SIGINT)
        assert flight.wait(60) == 0, said
        late.cancel()
    assert "http://0.0.0.0:8080/?token=" in said
    (run,) = (root / its["WorkingDir"].lstrip("/") / "runs").glob("demo-*")
    assert json.loads((run / "summary.json").read_text())["amussels_lost"] == 0
