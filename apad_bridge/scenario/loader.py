"""Loads a scenario from YAML, applies the command line's overrides, and writes it back with every default.

Types are strict: "12" is not a number, 1 is not a boolean, 30.0 is not an integer; an integer may stand for a float.
All mistakes are reported at once, a line each, before anything starts.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from agents.mussel.port.board_link import SERIAL
from apad_bridge.planning.dispatch_rule import MAX_DOCKS
from apad_bridge.planning.registry import InFile
from apad_bridge.scenario.area.fence import check_size, corners_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.area.paper_charts import PAPER_CHARTS
from apad_bridge.scenario.choices import PAPER_DOCKS
from apad_bridge.scenario.cross_checks import contradictions
from apad_bridge.scenario.errors import ScenarioError, in_ranges
from apad_bridge.scenario.profiles import with_profiles
from apad_bridge.scenario.quantities import FILE, VALUES
from apad_bridge.scenario.run_options import OPTIONS_NAME
from apad_bridge.scenario.schema import Origin, Scenario
from apad_bridge.scenario.starts_table import read_ids, table_of
from apad_bridge.scenario.text.key_mistakes import abbreviated, explain
from apad_bridge.scenario.text.text_file import write_atomically
from apad_bridge.scenario.text.yaml_text import parse_yaml, yaml_of
from firmware_model.sampling.sensors import BROUGHT

_SCENARIO = TypeAdapter(Scenario)
_ORIGIN = TypeAdapter(Origin)


def launch_scripts(name: str) -> Path:
    """A folder of the clone's launch_scripts, or of the copy that a wheel puts into the environment (setup.cfg)."""
    clone, *above = Path(__file__).parents[2:]
    places = [it / "launch_scripts" / name for it in (clone, *(it / "share/musselbed" for it in above))]
    return next((it for it in places if it.is_dir()), places[0])


SHIPPED = launch_scripts("scenarios")
"""The folder of the scenarios that come with musselbed."""

# Keys that hold the name of a file or directory, relative to the scenario's own; `*` is each entry of a list.
_FILE_KEYS = (
    ("fleet", "start"),
    ("fleet", "drift", "current_file"),
    ("fleet", "firmware", "*", "executable"),
    ("water", "links_file"),
    ("water", "current", "file"),
    ("apad", "interface"),
    ("area", "polygon"),
    ("area", "fence"),
    ("area", "keep_out"),
    ("area", "chart"),
)
_STRATEGY_KEYS = (("mission", "collection"), ("mission", "redeployment"))
"""Keys whose value may be `FILE.py:Class`; its file is relative to the scenario's own, too."""


def load(path: Path) -> Scenario:
    """Loads the scenario of a YAML file and makes the file names in it absolute.

    A name without a folder and an ending is that of a shipped scenario, unless there is such a file. Raises ScenarioError
    with a line for each mistake, also if there is no such file.
    """
    path = file_of(path)
    data = _with_firmware(yaml_of(path))
    _make_absolute(data, path.parent.absolute())
    if isinstance(data, dict) and (path.parent / OPTIONS_NAME).is_file():
        data.setdefault("sensors", [])  # a run of a version in which no package brought any
    return from_data(data, str(path))


def file_of(path: Path) -> Path:
    """The file that `load` reads: a shipped scenario's for its name. ScenarioError for the name of none."""
    if path.name == str(path) and not path.suffix and not path.exists():
        return _shipped(path.name)
    return path


def files_named(text: str) -> list[str]:
    """The names of files and directories in a scenario's text, as they are written there. ValueError if it is no YAML."""
    return [it.path for it in _file_entries(_with_firmware(parse_yaml(text)))]


def _shipped(name: str) -> Path:
    """The file of a shipped scenario; ScenarioError with the names of those that there are."""
    names = sorted(it.stem for it in SHIPPED.glob("*.yaml"))
    if name not in names:
        near = get_close_matches(name, names, n=1)
        meant = f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"
        raise ScenarioError([f"{name}: neither a file nor a shipped scenario: {meant}"])
    return SHIPPED / f"{name}.yaml"


def from_data(data: Any, source: str) -> Scenario:
    """Builds the scenario from plain data (mappings, lists, texts, numbers); messages begin with `source`.

    Raises ScenarioError with all mistakes of form or, if there are none, with all contradictions.
    """
    if not isinstance(data, dict):
        raise ScenarioError([f"{source}: a scenario is a mapping of keys to values, not {abbreviated(data)}"])
    if "fleet" not in data and {"scenarios", "strategies"} <= data.keys():
        raise ScenarioError([f"{source}: this is a study: fly it by `musselbed study`"])
    if unreachable := list(_unreachable_files(data)):
        raise ScenarioError(f"{source}: {line}" for line in unreachable)
    data = with_profiles(_with_firmware(_with_polygon(data, source)))
    if refusal := _refusal_of_sensors(data):
        raise ScenarioError([f"{source}: sensors: {refusal}"])
    try:
        # JSON on the way, because only there the strict mode accepts lists for tuples and texts for enumerations.
        scenario = _SCENARIO.validate_json(json.dumps(_with_batch(_with_ids(data))), strict=True)
    except ValidationError as error:
        lines = [_error_line(source, details) for details in _without_profile_keys(error.errors())]
        raise ScenarioError(dict.fromkeys(lines)) from error
    except ValueError as error:  # json: a list or mapping that holds itself by an alias
        raise ScenarioError([f"{source}: {error}"]) from error
    if found := contradictions(scenario):
        raise ScenarioError(f"{source}: {key}: {message}" for key, message in found)
    return scenario


def resolve(scenario: Scenario) -> dict[str, Any]:
    """Returns the scenario as plain data with all defaults; `from_data` makes the same scenario of it again."""
    resolved: dict[str, Any] = _SCENARIO.dump_python(scenario, mode="json")
    return resolved


def with_strategy_copies(scenario: Scenario, directory: Path) -> Scenario:
    """Copies the files of strategies into the directory, and returns the scenario that names the copies.

    A run flies the same rule to its end, whatever becomes of a user's file. OSError for a file that is gone.
    """
    data = resolve(scenario)
    for entry in _file_entries(data):
        if ("mission", entry.key) in _STRATEGY_KEYS:
            copy = directory.absolute() / entry.key / Path(entry.path).name
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(entry.path, copy)
            entry.path = str(copy)
    return from_data(data, str(directory))


def write_resolved(path: Path, scenario: Scenario) -> None:
    """Writes the resolved scenario as YAML, so that `load(path)` returns the same scenario.

    File names below the directory of `path` become relative to it, so that a run's directory that holds its own
    starts can be moved. The file appears whole or not at all.
    """
    _write(path, resolve(scenario))


def _write(path: Path, data: dict[str, Any]) -> None:
    directory = path.parent.absolute()
    for entry in _file_entries(data):
        name = Path(entry.path)
        if name.is_relative_to(directory):
            entry.path = str(name.relative_to(directory))
    write_atomically(path, yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120))


def write_with_files(path: Path, scenario: Scenario) -> None:
    """Writes the resolved scenario, and copies of the files that it names.

    The copies lie in a folder beside `path` with its stem as name, so the directory of `path` can be moved elsewhere.
    OSError for a file that is gone.
    """
    data = resolve(scenario)
    for entry in _file_entries(data):
        named = Path(entry.path)
        if entry.key == "start":
            named = table_of(named)
        # Two entries of a list may name files alike, in folders of their own.
        folder = entry.whole_key if "[" in entry.whole_key else entry.key
        copy = path.parent / path.stem / folder / named.name
        if copy.exists() and copy.samefile(named):
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        if named.is_dir():
            shutil.copytree(named, copy, dirs_exist_ok=True)
        else:
            shutil.copy(named, copy)  # with its mode: firmware is to be executed
        entry.path = str(copy.absolute())
    _write(path, data)


def with_overrides(
    scenario: Scenario,
    *,
    theta: int | None = None,
    agents: int | None = None,
    strategy: str | None = None,
    seed: int | None = None,
    hosting: str | None = None,
    generation: str | None = None,
) -> Scenario:
    """Replaces values by those of the command line and checks the scenario again; None leaves a value as it is.

    `agents` is the fleet's count, of its lowest ids; `strategy` the collection strategy's name, `generation` the aPad's.
    Raises ScenarioError.
    """
    in_file = None if strategy is None else InFile.of(strategy)
    values: dict[str, Any] = {
        "theta": theta,
        "fleet.count": agents,
        "mission.collection": strategy
        if in_file is None
        else str(in_file._replace(path=os.path.abspath(in_file.path))),
        "seed": seed,
        "fleet.hosting": hosting,
        "apad.generation": generation,
    }
    ids = scenario.fleet.agent_ids
    if agents is not None and ids:
        if agents > len(ids):
            raise ScenarioError(
                [f"command line: --agents {agents}: the fleet has {len(ids)}, {in_ranges(ids)}"]
            )
        values["fleet.agent_ids"] = ids[:agents]
    given = {key: value for key, value in values.items() if value is not None}
    return with_values(scenario, given, "command line") if given else scenario


def with_values(scenario: Scenario, values: Mapping[str, Any], source: str) -> Scenario:
    """The scenario with plain values in place of its own, by their keys such as `mission.batch`, checked again.

    Raises ScenarioError, whose lines begin with `source`.
    """
    data = resolve(scenario)
    for key, value in values.items():
        put(data, key, value, scenario.name)
    return from_data(data, source)


def put(data: dict[str, Any], key: str, value: Any, scenario: str) -> None:
    """Sets a key of the scenario's data, as `mission.batch`."""
    *blocks, last = key.split(".")
    place: Any = data
    for block in blocks:
        place = place.get(block) if isinstance(place, dict) else None
    if not isinstance(place, dict):
        raise ScenarioError([f"{key}: the scenario {scenario} has no such block"])
    place[last] = value


@dataclass(slots=True)
class _FileEntry:
    """A key of the data that names a file, or a strategy in a file."""

    whole_key: str
    block: dict[str, Any]
    key: str

    @property
    def path(self) -> str:
        text: str = self.block[self.key]
        return in_file.path if (in_file := InFile.of(text)) else text

    @path.setter
    def path(self, path: str) -> None:
        in_file = InFile.of(self.block[self.key])
        self.block[self.key] = path if in_file is None else str(in_file._replace(path=path))


def _file_entries(data: Any) -> list[_FileEntry]:
    """Every file name in the data, which may not be valid yet."""
    entries = []
    for *blocks, key in (*_FILE_KEYS, *_STRATEGY_KEYS):
        is_file = _is_file if (*blocks, key) in _FILE_KEYS else InFile.of
        places: list[tuple[tuple[str, ...], Any]] = [((), data)]
        for block in blocks:
            places = [found for place in places for found in _below(*place, block)]
        for path, place in places:
            if isinstance(place, dict) and isinstance(place.get(key), str) and is_file(place[key]):
                entries.append(_FileEntry(".".join((*path, key)), place, key))
    return entries


def _below(path: tuple[str, ...], place: Any, block: str) -> list[tuple[tuple[str, ...], Any]]:
    """The places (path, data) of a block's key; those of all entries for `*`."""
    if block != "*":
        return [((*path, block), place.get(block) if isinstance(place, dict) else None)]
    entries = place if isinstance(place, list) else []
    return [((*path[:-1], f"{path[-1]}[{n}]"), it) for n, it in enumerate(entries)]


def _is_file(name: str) -> bool:
    return name not in PAPER_CHARTS and not name.startswith(SERIAL)


def _make_absolute(data: Any, directory: Path) -> None:
    for entry in _file_entries(data):
        entry.path = os.path.normpath(directory / entry.path)


def _unreachable_files(data: Any) -> Iterator[str]:
    """A line for each file name about which every question raises: too long, or in a directory that is not ours.

    A file that is only missing is told later, with what its key means.
    """
    for entry in _file_entries(data):
        try:
            os.stat(entry.path)
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else "no name of a file"
            yield f"{entry.whole_key}: {reason}: {abbreviated(entry.path)}"


def _without_profile_keys(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Drops missing keys that a profile would have supplied if it were named, and named right."""
    misnamed = [details["loc"][:-1] for details in errors if details["loc"][-1:] == ("profile",)]
    return [
        details
        for details in errors
        if details["type"] != "missing"
        or details["loc"][-1] == "profile"
        or not any(details["loc"][: len(block)] == block for block in misnamed)
    ]


def _with_batch(data: dict[str, Any]) -> dict[str, Any]:
    """A mission without a `batch` collects as many aMussels as the aPad has docks."""
    mission, apad = data.get("mission"), data.get("apad")
    if not isinstance(mission, dict) or "batch" in mission or not isinstance(apad, dict):
        return data
    docks = apad.get("docks")
    # Only a number of docks that the schema accepts, so that a wrong one is told of once.
    batch = docks if type(docks) is int and 1 <= docks <= MAX_DOCKS else PAPER_DOCKS
    return {**data, "mission": {**mission, "batch": batch}}


def _with_firmware(data: Any) -> Any:
    """The fleet's firmware as a list: the name of a program, or one mapping, stands for a list of it alone."""
    fleet = data.get("fleet") if isinstance(data, dict) else None
    if not isinstance(fleet, dict) or "firmware" not in fleet or isinstance(fleet["firmware"], list):
        return data
    firmware = fleet["firmware"]
    if isinstance(firmware, str):
        firmware = {"executable": firmware}
    return {**data, "fleet": {**fleet, "firmware": [] if firmware is None else [firmware]}}


def _with_polygon(data: dict[str, Any], source: str) -> dict[str, Any]:
    """An `area.polygon` in degrees, or in a file, becomes `polygon_m`. ScenarioError for one that cannot."""
    area = data.get("area")
    if not isinstance(area, dict) or "polygon" not in area:
        return data
    if "polygon_m" in area:
        raise ScenarioError([f"{source}: area.polygon: area.polygon_m is there, too: leave one out"])
    found = {key: value for key, value in area.items() if key != "polygon"}
    try:
        frame = LocalFrame.about(_ORIGIN.validate_python(area.get("origin")))
        corners = corners_of(area["polygon"], frame)
        check_size(corners, "the polygon", "a list has [latitude, longitude]")
    except ValidationError:
        corners = (
            (0, 0),
            (1, 0),
            (0, 1),
        )  # of a scenario that is refused: what is wrong with its origin is told
    except (OSError, TypeError, ValueError) as error:
        raise ScenarioError([f"{source}: area.polygon: {_reason(area['polygon'], error)}"]) from error
    return {**data, "area": {**found, "polygon_m": [list(it) for it in corners]}}


def _reason(polygon: Any, error: Exception) -> str:
    if isinstance(error, TypeError):
        return f"must be a file, or a list of [latitude, longitude], not {abbreviated(polygon)}"
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return f"{polygon}: {reason}" if isinstance(polygon, str) else str(reason)


def _refusal_of_sensors(data: dict[str, Any]) -> str | None:
    """The reason why this environment's boards are not those that the data name; None for data that name none.

    Boards of the paper's worst case have no sensors: none is lacking, or too many, there.
    """
    here, board = list(BROUGHT), data.get("board")
    if not (isinstance(board, dict) and board.get("whole")):
        return None
    named = it if isinstance(it := data.get("sensors"), list) else here
    if lacking := [it for it in named if it not in here]:
        return f"flown with the sensor {str(lacking[0])[:80]}, which is not installed here: install it"
    surplus = next((it for it in here if it not in named), None)
    return surplus and f"flown without the sensor {surplus}, which is installed here: uninstall it"


def _with_ids(data: dict[str, Any]) -> dict[str, Any]:
    """A fleet without a `count` has the ids of `agent_ids`, or those of the file that `start` names from `first_id` on."""
    fleet = data.get("fleet")
    if not isinstance(fleet, dict) or "count" in fleet:
        return data
    ids = fleet.get("agent_ids") or _ids_of_file(fleet)
    if not isinstance(ids, list):
        return data
    first_id = ids[0] if ids else 1
    has_gaps = type(first_id) is not int or ids != list(range(first_id, first_id + len(ids)))
    found = {"count": len(ids), "first_id": first_id}
    return {**data, "fleet": {**found, **fleet, "agent_ids": ids if has_gaps else []}}


def _ids_of_file(fleet: dict[str, Any]) -> list[int] | None:
    """Returns the ids of the file from `first_id` on; None for a random start."""
    start, first_id = fleet.get("start"), fleet.get("first_id", 1)
    if not isinstance(start, str) or type(first_id) is not int:
        return None
    try:
        return [it for it in read_ids(table_of(Path(start))) if it >= first_id]
    except ScenarioError:
        return []  # what is wrong with the file is told when the starts are read


def _error_line(source: str, details: ErrorDetails) -> str:
    path = [it for it in details["loc"] if it not in (VALUES, FILE)]
    return f"{source}: {explain(Scenario, details, path)}"
