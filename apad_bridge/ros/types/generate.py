"""Turns the definitions shipped here into Python messages, with Debian's genpy, which computes each md5, and genaction,
without catkin.

`python -m apad_bridge.ros.types.generate DEST` writes one folder per package. DEST serves as an entry of PYTHONPATH and,
because each folder also holds a package.xml and the texts, of ROS_PACKAGE_PATH, so that rostopic, rosmsg and rosbag know
them.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import genmsg
from genmsg.gentools import compute_full_type_name
from genmsg.msg_loader import MsgNotFound
from genpy.generate_initpy import write_modules
from genpy.generator import MsgGenerator, SrvGenerator

from apad_bridge.ros.types.messages import DEFINITIONS, STAMP, definitions_digest

SYSTEM_DEFINITIONS = Path("/usr/share")
GENACTION = Path("/usr/lib/actionlib_msgs/genaction.py")
DEBIAN_PACKAGE_OF = {
    "std_msgs": "ros-std-msgs",
    "geometry_msgs": "ros-geometry-msgs",
    "actionlib_msgs": "ros-actionlib-msgs",
}
"""Packages that our definitions refer to, and the Debian package with their texts."""

PACKAGE_XML = """\
<?xml version="1.0"?>
<package format="2">
  <name>{name}</name>
  <version>0.1.0</version>
  <description>Message definitions that musselbed speaks, laid here by its installation</description>
  <maintainer email="nobody@musselbed.invalid">musselbed</maintainer>
  <license>BSD-3-Clause</license>
</package>
"""


class GenerationFailed(Exception):
    """The text is one line that a user can act on."""


def generate(destination: Path, definitions: Path = DEFINITIONS) -> list[Path]:
    """Generates every package of `definitions` into `destination` and returns the package folders.

    It replaces `destination` as a whole, and only after everything was generated.

    Raises:
        GenerationFailed: a definition is wrong, or a Debian package that it needs is missing.
    """
    packages = sorted(folder for folder in definitions.iterdir() if folder.is_dir())
    if not packages:
        raise GenerationFailed(f"no definitions in {definitions}")
    made = destination.with_name(destination.name + ".new")
    shutil.rmtree(made, ignore_errors=True)
    for package in packages:
        _write_texts(package, made / package.name)
    search_path = _search_path(made)
    for package in packages:
        _write_python(made / package.name, search_path)
    (made / STAMP).write_text(definitions_digest(definitions) + "\n")
    shutil.rmtree(destination, ignore_errors=True)
    made.rename(destination)
    return [destination / package.name for package in packages]


def _write_texts(source: Path, package: Path) -> None:
    """Writes the package's texts and package.xml, and the seven messages of each action.

    package.xml is made here and not kept beside the sources: a clone inside somebody's catkin workspace would otherwise
    offer that workspace a second auv_msgs.
    """
    shutil.copytree(source, package)
    (package / "package.xml").write_text(PACKAGE_XML.format(name=source.name))
    for action in sorted(package.glob("action/*.action")):
        if not GENACTION.exists():
            raise GenerationFailed(f"{GENACTION} is missing: apt-get install libactionlib-msgs-dev")
        command = [sys.executable, "-I", str(GENACTION), str(action), "-o", str(package / "msg")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        if done.returncode != 0:
            raise GenerationFailed(f"{action.name}: {(done.stderr or done.stdout).strip().splitlines()[-1]}")


def _search_path(made: Path) -> dict[str, list[str]]:
    search_path = {folder.name: [str(folder / "msg")] for folder in made.iterdir()}
    for name, debian_package in DEBIAN_PACKAGE_OF.items():
        texts = SYSTEM_DEFINITIONS / name / "msg"
        if not texts.is_dir():
            raise GenerationFailed(f"{texts} is missing: apt-get install {debian_package}")
        search_path[name] = [str(texts)]
    return search_path


def _write_python(package: Path, search_path: dict[str, list[str]]) -> None:
    (package / "__init__.py").write_text("")
    for kind, generator in (("msg", MsgGenerator()), ("srv", SrvGenerator())):
        folder = package / kind
        if not folder.is_dir():
            continue
        context = genmsg.MsgContext.create_default()
        for text in _texts(folder, kind):
            try:
                full_type = compute_full_type_name(package.name, text.name)
                generator.generate(context, full_type, str(text), str(folder), search_path)
            except MsgNotFound as error:
                missing = f"{error.package}/{error.base_type}"
                raise GenerationFailed(
                    f"{package.name}/{kind}/{text.name}: {missing} is defined neither here nor by Debian"
                ) from error
            except (genmsg.InvalidMsgSpec, genmsg.MsgGenerationException) as error:
                raise GenerationFailed(f"{package.name}/{kind}/{text.name}: {error}") from error
        write_modules(str(folder))


def _texts(folder: Path, kind: str) -> Iterable[Path]:
    return sorted(folder.glob(f"*.{kind}"))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m apad_bridge.ros.types.generate", description=__doc__)
    parser.add_argument("destination", type=Path, metavar="DEST", help="replaced as a whole")
    destination: Path = parser.parse_args().destination.absolute()
    if destination.exists() and not (destination / STAMP).exists():
        parser.error(f"{destination} exists and was not made by this command: name another folder")
    destination.parent.mkdir(parents=True, exist_ok=True)
    try:
        packages = generate(destination)
    except GenerationFailed as error:
        print(f"musselbed: {error}", file=sys.stderr)
        return 1
    print(f"{len(packages)} message packages in {destination}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
