"""A scenario is resolved once: every part of its flight gets the same values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from scenario_files import POOL_FILE, SOUND_FILE

from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly import flight_config as resolving
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.records.samples import TruthExtrapolator
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario

POOL = load(POOL_FILE)


def sound(change: Callable[[dict[str, Any]], None]) -> Scenario:
    data = resolve(load(SOUND_FILE))
    change(data)
    return from_data(data, "changed")


def test_the_way_up_is_equally_long_for_bodies_water_twins_and_records() -> None:
    scenario = sound(lambda data: data["board"].update(surfacing_s=61.007, float_timeout_s=33.25))
    config = flight_config(scenario)
    fleet = fleet_parts.fleet_config(config)
    assert fleet.maker().config(3).water.body.sinking.surfacing_ms == 61_007
    assert config.sea.sinking == fleet.body.sinking == TruthExtrapolator(scenario)._sinking
    assert config.twin.parameters.sinking == fleet.body.sinking
    assert config.twin.parameters.board == fleet.board and fleet.board.float_timeout_ms == 33_250


@pytest.mark.parametrize(("modems", "answer_ms"), [("v3", 393), ("v2", 1830)])
def test_board_and_apad_agree_on_the_modem_and_on_the_length_of_an_answer(
    modems: str, answer_ms: int
) -> None:
    """A short status has 7 bytes: 30 + 75 + (7 + 16) x 12.5 ms, and for V2 30 + 9 x 200 ms."""

    def with_modems(data: dict[str, Any]) -> None:
        data["water"]["modems"] = modems
        data["board"]["whole"].update(turnaround_ms=400, transmit_ms=2000)

    config = flight_config(sound(with_modems))
    assert config.board.whole.answer_ms == answer_ms
    assert config.acoustics.schedule.answer_ms == 400 + answer_ms
    assert config.reports.modem == config.sea.modems == config.acoustics.schedule.water.modems


def test_the_board_is_built_once_for_a_whole_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    built = []

    def counted(*args: Any) -> Any:
        built.append(args)
        return board_config(*args)

    board_config = resolving.board_config
    monkeypatch.setattr(resolving, "board_config", counted)
    open_flight(load(SOUND_FILE))
    assert len(built) == 1


def test_a_current_s_file_is_read_when_the_fleet_starts_and_not_before(tmp_path: Path) -> None:
    """So a supervisor that adopts a fleet does without the file."""
    drift = replace(POOL.fleet.drift, current_file=str(tmp_path / "gone.csv"))
    config = flight_config(replace(POOL, fleet=replace(POOL.fleet, drift=drift)))
    with pytest.raises(OSError, match=r"gone\.csv"):
        fleet_parts.fleet_config(config)


def test_without_water_there_is_no_sea_and_no_service() -> None:
    config = flight_config(POOL)
    assert (config.sea, config.acoustics, config.twin, config.timeslots) == (None, None, None, None)
