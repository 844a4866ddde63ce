"""`musselbed new FILE`: a commented scenario to begin with."""

from __future__ import annotations

import argparse
import filecmp
import re
import shutil
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.text_file import write_atomically

_SCENARIO = """\
# Lengths are metres north and east of the origin, durations are seconds of the mission. Every key: docs/scenarios.md
name: {name}
seed: 1
duration_s: 1800
theta: 30 # the aMussels' time runs 30 times as fast as the aPad's; 1 with real ones
area:
  origin: {{latitude_deg: 43.9330937, longitude_deg: 15.4443468}} # where north 0, east 0 lies
  polygon_m: [[0, 0], [30, 0], [30, 20], [0, 20]] # corners, each [north, east]
  depth_m: 3.0
fleet:
  count: 8
  start: {{charge: [0.6, 0.9]}} # places by chance inside the area; or the name of a CSV file
  drift: {{mode: paper, amplitude_m: 0.005}} # metres at most in each real second
board: {{profile: worst-case, surfacing_failure_probability: 0}} # the paper's battery
hearing: {{mode: paper, positioning: ground_truth, report_period_s: 1}} # or by sound: see sound-12
mission: # collects four at or below 0.8, charges them, and brings them back
  {{collection: cautious, redeployment: greedy-redeploy, pool_threshold: 0.8, batch: 4, full_threshold: 0.99,
   docking: {{profile: virtual, dock_s: 15, undock_s: 5, timeout_s: 60, catch_radius_m: 3}}, speed_m_s: 0.5,
   victory_radius_m: 0.5, permission_repeat_s: 10, surfacing_attempts: 6, silence_timeout_s: 120}}
apad: {{profile: paper, start_m: [15, 10], dock_miss_probability: 0}}
"""
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "new",
        description="Writes a scenario of 20 lines with a comment for each part: the paper's aPad and eight aMussels in 30 "
        "by 20 m. It flies as it is. With --like it copies a scenario and the files that it names. A file that is there "
        "stays as it is.",
        epilog=ending(
            "musselbed new mine.yaml",
            "musselbed new mine.yaml --like sound-12",
            note="Then fly it: musselbed run mine.yaml --time asap",
        ),
    )
    parser.add_argument("file", type=Path, metavar="FILE.yaml", help="the file to write")
    parser.add_argument(
        "--like",
        type=Path,
        metavar="SCENARIO.yaml",
        help="copy this one: its file, or the name of a shipped one, as sound-12",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    file: Path = arguments.file
    if file.exists():
        raise UserError(f"{file} is there already: choose another name")
    if not _NAME.fullmatch(file.stem):
        raise UserError(
            f"{file.name}: a scenario's name has letters, digits, dots, hyphens and underscores only"
        )
    written = [file]
    try:
        if arguments.like is None:
            text = _SCENARIO.format(name=file.stem)
        else:
            text, copies = _copied(arguments.like, file)
            for source, copy in copies.items():
                shutil.copy(source, copy)
            written += copies.values()
        write_atomically(file, text)
    except OSError as error:
        raise UserError(f"{error.filename or file}: {error.strerror}") from error
    print(*written, sep="\n")
    print(f"Next:\n  musselbed run {file} --time asap")
    return Exit.DONE


def _copied(like: Path, file: Path) -> tuple[str, dict[Path, Path]]:
    """The text of a scenario under its new name, and the copies, beside `file`, of the files that it names relatively.

    UserError if another file has a copy's name. ScenarioError for a scenario that cannot be flown.
    """
    from apad_bridge.scenario.loader import file_of, files_named, load
    from apad_bridge.scenario.text_file import read_text

    load(like)  # it tells each mistake
    source = file_of(like)
    text = re.sub(r"(?m)^name: .*$", f"name: {file.stem}", read_text(source), count=1)
    copies = {}
    for name in files_named(text):
        named, copy = source.parent / name, file.parent / Path(name).name
        if Path(name).is_absolute() or named.is_dir():
            text = text.replace(name, str(named.absolute()))
            continue
        if copy.exists() and not filecmp.cmp(named, copy, shallow=False):
            raise UserError(f"{copy} is there already, and is another file than {named}: use another folder")
        if not copy.exists():
            copies[named] = copy
        text = text.replace(name, copy.name)
    return text, copies
