"""Interpreters as vehicles have them, older than this machine's, with rospy.

Their rospy is that of this machine's Debian, with the lines that only Python 3 reads put in an older form. pip brings what
it needs beside, in the last releases that such an interpreter runs. All of it lies in the test environment.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DEBIAN = Path("/usr/lib/python3/dist-packages")
PACKAGES = ("rospy", "rosgraph", "roslib", "genpy", "genmsg", "rospkg", "catkin", "catkin_pkg")
MESSAGES = ("std_msgs", "rosgraph_msgs", "geometry_msgs", "actionlib_msgs", "std_srvs", "roscpp")
_COMMON = (
    "PyYAML==5.4.1",
    "netifaces==0.11.0",
    "pyparsing==2.4.7",
    "six==1.16.0",
    "distro==1.6.0",
    "defusedxml==0.7.1",
)
NEEDS = {"2.7": (*_COMMON, "numpy==1.16.6"), "3.8": (*_COMMON, "numpy==1.24.4")}
"""The packages beside rospy, by the interpreter's version."""
_REST_OF_A_TUPLE = re.compile(r"^(\s*)\((\w+), (\w+), \*_\) = (\w+)\.args", re.MULTILINE)
"""`(number, text, *_) = error.args`"""


class NoOlderPython(Exception):
    """This machine has no such interpreter, or cannot install what it needs; the text has the reason."""


def older_python(version: str) -> str:
    """The path of a program that is Python `version` ("2.7", "3.8") with rospy, made where it is not there yet."""
    folder = Path(sys.prefix) / "share" / "musselbed" / "older_pythons" / version
    program = folder / "python"
    if not program.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as temporary:
            made = Path(temporary) / version
            _make(_interpreter(version), version, made, folder)
            try:
                made.rename(folder)
            except OSError:
                assert program.exists()  # another process has made it meanwhile
    return str(program)


def _interpreter(version: str) -> str:
    """By the name on PATH or among pyenv's; a name that pyenv only forwards may lead nowhere, so it is asked."""
    pyenv = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python{version}"))
    for it in (*map(str, pyenv), shutil.which(f"python{version}")):
        if (
            it is not None
            and subprocess.run([it, "-m", "pip", "--version"], capture_output=True).returncode == 0
        ):
            return it
    raise NoOlderPython(f"no Python {version} with pip on PATH or among pyenv's")


def _make(interpreter: str, version: str, into: Path, target: Path) -> None:
    site = into / "site"
    words = [interpreter, "-m", "pip", "install", "--quiet", "--target", str(site), *NEEDS[version]]
    try:
        subprocess.run(words, capture_output=True, text=True, timeout=300, check=True)
    except subprocess.TimeoutExpired:
        raise NoOlderPython(f"pip of Python {version} did not end within 300 s") from None
    except subprocess.CalledProcessError as error:
        raise NoOlderPython(f"pip of Python {version}: {error.stderr.strip()[-200:]}") from None
    for name in (*PACKAGES, *MESSAGES):
        shutil.copytree(DEBIAN / name, site / name, ignore=shutil.ignore_patterns("__pycache__"))
        for source in (site / name).rglob("*.py"):
            source.write_text(_REST_OF_A_TUPLE.sub(r"\1(\2, \3) = \4.args[:2]", source.read_text()))
    program = into / "python"
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{target / "site"}:$PYTHONPATH" exec "{interpreter}" "$@"\n')
    program.chmod(0o755)
