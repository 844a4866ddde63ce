"""`fleet.firmware`: its short forms, mixed fleets, and what is refused with its mend."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from apad_bridge.assembly.fleet_parts import fleet_config
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.commands.main import main
from apad_bridge.planning.registry import Trust
from apad_bridge.runs.nurseries import begin_nursery
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load, write_resolved, write_with_files
from apad_bridge.scenario.schema import FirmwareProgram
from apad_bridge.scenario.starts import starts_of

POOL = Path(__file__).parents[3] / "launch_scripts" / "scenarios" / "pool-12.yaml"
LINE = "serial:/dev/ttyUSB0"


@pytest.fixture(autouse=True)
def programs(tmp_path: Path) -> None:
    for board in (tmp_path / "one/board", tmp_path / "two/board"):
        board.parent.mkdir()
        board.write_text(f"#!/bin/sh\n# {board.parent.name}\n")
        board.chmod(0o755)


def with_firmware(directory: Path, firmware: Any, **changes: Any) -> Path:
    data = yaml.safe_load(POOL.read_text()) | changes
    data["fleet"] |= {"firmware": firmware, "start": str(POOL.with_suffix(".csv"))}
    path = directory / "scenario.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(
    ("firmware", "count"),
    [
        ("one/board", 1),
        ({"executable": "one/board"}, 1),
        ([{"executable": "one/board"}], 1),
        (None, 0),
        ([], 0),
    ],
    ids=str,
)
def test_a_name_and_a_mapping_stand_for_a_list_of_one_and_none_is_ours(
    tmp_path: Path, firmware: Any, count: int
) -> None:
    program = FirmwareProgram(executable=str(tmp_path / "one" / "board"))
    assert load(with_firmware(tmp_path, firmware)).fleet.firmware == (program,) * count


MIXED = [
    {"executable": "one/board"},
    {"executable": "two/board", "arguments": ["-v"], "agents": [2, 4]},
    {"executable": LINE, "agents": [3]},
]


def test_in_a_mixed_fleet_each_board_has_its_own_and_one_without_agents_the_rest(tmp_path: Path) -> None:
    scenario = load(with_firmware(tmp_path, MIXED, theta=1))
    configs = fleet_config(flight_config(scenario, Trust())).maker()
    one, two = (str(tmp_path / it / "board") for it in ("one", "two"))
    of = {agent_id: configs.config(agent_id).firmware for agent_id in (1, 2, 3, 4, 5)}
    assert of == {1: (one,), 2: (two, "-v"), 3: (LINE,), 4: (two, "-v"), 5: (one,)}
    assert fleet_config(flight_config(scenario)).firmware == ()


def test_ours_does_not_fly_in_place_of_firmware_that_nobody_trusts(tmp_path: Path) -> None:
    config = flight_config(load(with_firmware(tmp_path, "one/board")))
    with pytest.raises(ValueError, match=r"fleet.firmware is code in a file: add --trust"):
        begin_nursery(config, starts_of(config.scenario), tmp_path)


def test_a_run_s_copy_has_both_programs_of_one_name(tmp_path: Path) -> None:
    scenario = load(with_firmware(tmp_path, MIXED, theta=1))
    copy = tmp_path / "copy"
    copy.mkdir()
    write_with_files(copy / "scenario.yaml", scenario)
    *found, line = (it.executable for it in load(copy / "scenario.yaml").fleet.firmware)
    own = [(Path(it).read_text()[-4:-1], Path(it).is_relative_to(copy)) for it in found]
    assert (own, line) == ([("one", True), ("two", True)], LINE)
    write_resolved(tmp_path / "resolved.yaml", scenario)
    assert load(tmp_path / "resolved.yaml") == scenario


REFUSED: dict[str, tuple[Any, int, str]] = {
    "another theta": (
        {"executable": LINE, "agents": [3]},
        30,
        r"a real board cannot be accel.* theta: 1",
    ),
    "a line for twelve": (LINE, 1, r"\[0\].agents: a serial line has one board: name its aMussel"),
    "a line for two": ({"executable": LINE, "agents": [3, 4]}, 1, "a serial line has one board"),
    "arguments": ({"executable": LINE, "agents": [3], "arguments": ["x"]}, 1, "a real board takes none"),
    "no device": ({"executable": "serial:", "agents": [3]}, 1, "a serial line is serial:DEVICE"),
    "a rate that is none": (
        {"executable": f"{LINE}@fast", "agents": [3]},
        1,
        "a serial line is serial:DEVICE",
    ),
    "an id twice": (
        [{"executable": "one/board", "agents": [3]}, {"executable": LINE, "agents": [3]}],
        1,
        r"\[1\].agents: aMussel 3 has another firmware already",
    ),
    "two for the rest": (["one/board"] * 2, 1, "must be"),
    "two mappings for the rest": (
        [{"executable": "one/board"}] * 2,
        1,
        r"\[1\]: another firmware has all aMussels",
    ),
    "an id that is not there": ({"executable": "one/board", "agents": [99]}, 1, "no aMussel 99"),
    "no program": ([{"executable": "nothing", "agents": [3]}], 1, r"\[0\].executable: no program .*nothing"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_contradiction_is_told_with_its_mend(tmp_path: Path, name: str) -> None:
    firmware, theta, why = REFUSED[name]
    with pytest.raises(ScenarioError, match=why):
        load(with_firmware(tmp_path, firmware, theta=theta))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--time", "asap"], "a real board takes real time: use --time wall"),
        (["--speed", "2"], "a real board takes real time: use --time wall"),
        ([], "there is no such device; is the board plugged in?"),
        (["--theta", "30"], "a real board cannot be accelerated, and theta is 30"),
    ],
)
def test_a_run_refuses_a_serial_line_that_cannot_be_flown_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], why: str
) -> None:
    path = with_firmware(tmp_path, {"executable": "serial:/dev/no-such-board", "agents": [3]}, theta=1)
    assert main(["run", str(path), "--out", str(tmp_path / "run"), *words]) == 2
    said = capsys.readouterr().err
    assert why in said and said.count("\n") == 1 and not (tmp_path / "run").exists()
