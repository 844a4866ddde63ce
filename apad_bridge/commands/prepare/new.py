"""`musselbed new FILE`: a commented scenario to begin with."""

from __future__ import annotations

import argparse
import filecmp
import json
import re
import shutil
from pathlib import Path
from random import Random
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.text.text_file import write_atomically

_SCENARIO = """\
# Metres north and east of the origin, and seconds of the mission. Every key: docs/reference/scenario-keys.md
name: {name}
seed: 1
duration_s: 1800
theta: 30 # the aMussels' time runs 30 times as fast as the aPad's; 1 with real ones
area:
  origin: {{latitude_deg: {origin[0]}, longitude_deg: {origin[1]}}} # where north 0, east 0 lies
  {polygon}
  depth_m: 3.0
fleet:
  {start}
  drift: {{mode: paper, amplitude_m: 0.005}} # metres at most in each real second
board: {{profile: worst-case, surfacing_failure_probability: 0}} # the paper's battery
hearing: {{mode: paper, positioning: ground_truth, report_period_s: 1}} # or by sound: see sound-12
mission: # collects four at or below 0.8, charges them, and brings them back
  {{collection: cautious, redeployment: greedy-redeploy, pool_threshold: 0.8, full_threshold: 0.99,
   docking: {{profile: virtual, dock_s: 15, undock_s: 5, timeout_s: 60, catch_radius_m: 3}}, speed_m_s: 0.5,
   victory_radius_m: 0.5, permission_repeat_s: 10, surfacing_attempts: 6, silence_timeout_s: 120}}
apad: {{profile: paper, start_m: {start_m}, dock_miss_probability: 0}}
"""
_PARTS = {
    "origin": (43.9330937, 15.4443468),
    "polygon": "polygon_m: [[0, 0], [30, 0], [30, 20], [0, 20]] # corners, each [north, east]",
    "start": "count: 8\n  start: {charge: [0.6, 0.9]} # places by chance inside the area; or the name of a CSV file",
    "start_m": [15, 10],
}
_CHARGES = (0.6, 0.9)
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "new",
        description="Writes a scenario of 20 lines with a comment for each part: the paper's aPad and eight aMussels in 30 "
        "by 20 m. It flies as it is. With --from it takes the area from a GeoJSON file, and with --starts the places from "
        "a CSV. With --like it copies a scenario and the files that it names. A file that is there stays as it is.",
        epilog=ending(
            "musselbed new mine.yaml",
            "musselbed new mine.yaml --like sound-12",
            "musselbed new mine.yaml --from harbour.geojson --starts phone.csv",
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
    parser.add_argument(
        "--from",
        dest="area",
        type=Path,
        metavar="AREA.geojson",
        help="the area: a file with one polygon in degrees",
    )
    parser.add_argument(
        "--starts",
        type=Path,
        metavar="PLACES.csv",
        help="the aMussels' places, with the columns lat and lon; a file without id or battery gets them in a copy "
        f"(1, 2, 3...; by chance in {_CHARGES[0]} to {_CHARGES[1]})",
    )


def run(arguments: argparse.Namespace) -> int:
    file: Path = arguments.file
    if arguments.like is not None and (arguments.area or arguments.starts):
        raise UserError("--like copies a scenario as it is: leave --from and --starts out")
    if file.exists():
        raise UserError(f"{file} is there already: choose another name")
    if not _NAME.fullmatch(file.stem):
        raise UserError(
            f"{file.name}: a scenario's name has letters, digits, dots, hyphens and underscores only"
        )
    written = [file]
    if arguments.like is None:
        text = _from_template(file, arguments.area, arguments.starts, written)
    else:
        text, copies = _copied(arguments.like, file)
        for source, copy in copies.items():
            shutil.copy(source, copy)
        written += copies.values()
    write_atomically(file, text)
    print(*written, sep="\n")
    print(f"Next:\n  musselbed run {file} --time asap")
    return Exit.DONE


def _from_template(file: Path, area: Path | None, starts: Path | None, written: list[Path]) -> str:
    """The text of a scenario about an area and starts of the user's. A file that it writes for that joins `written`."""
    parts = dict(_PARTS)
    if area is not None:
        parts |= _about(area, file.parent)
    if starts is not None:
        if (whole := _completed(starts)) is not None:
            starts, source = file.with_name(f"{file.stem}-starts.csv"), starts
            if starts.exists():
                raise UserError(f"{starts} is there already: remove it, or choose another name for {file}")
            write_atomically(starts, f"# {source.name}, with what it lacked: correct it here\n{whole}")
            written.append(starts)
        parts["start"] = f"start: {_named(starts, file.parent)}"
    return _SCENARIO.format(name=file.stem, **parts)


def _about(area: Path, folder: Path) -> dict[str, Any]:
    """The parts of a scenario about a GeoJSON polygon: its origin is the south-western corner of the box around it."""
    from apad_bridge.scenario.area.fence import corners_of, rings_deg
    from apad_bridge.scenario.area.local_frame import LocalFrame
    from apad_bridge.scenario.area.polygon import inner_point

    try:
        latitudes, longitudes = zip(*rings_deg(area)[0], strict=True)
        origin = (round(min(latitudes), 7), round(min(longitudes), 7))
        north_m, east_m = inner_point(corners_of(str(area), LocalFrame(*origin)))
    except ValueError as error:
        raise UserError(f"{area}: {error}") from error
    return {
        "origin": origin,
        "polygon": f"polygon: {_named(area, folder)}",
        "start_m": [round(north_m, 1), round(east_m, 1)],
    }


def _completed(starts: Path) -> str | None:
    from apad_bridge.scenario.starts_table import completed

    draws = Random(1)
    return completed(starts, lambda: draws.uniform(*_CHARGES))


def _named(file: Path, folder: Path) -> str:
    """The file's name in a scenario of that folder, in the quotes of YAML."""
    whole, folder = file.absolute(), folder.absolute()
    name = whole.relative_to(folder) if whole.is_relative_to(folder) else whole
    return json.dumps(str(name), ensure_ascii=False)


def _copied(like: Path, file: Path) -> tuple[str, dict[Path, Path]]:
    """The text of a scenario under its new name, and the copies, beside `file`, of the files that it names relatively.

    UserError if another file has a copy's name. ScenarioError for a scenario that cannot be flown.
    """
    from apad_bridge.scenario.loader import file_of, files_named, load
    from apad_bridge.scenario.text.text_file import read_text

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
