"""A run with modems on serial lines refuses wrong options in one line before anything starts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from scenario_files import SCENARIO_FILES, WHOLE_FILE

from apad_bridge.commands.main import main
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import (
    OPTIONS_NAME,
    APadKind,
    BenchPart,
    OnDeath,
    RunOptions,
    TimeSource,
)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Twelve whole boards in water, at theta 30."""
    return changed(tmp_path, "with-water", water={})


def changed(tmp_path: Path, name: str, **changes: Any) -> Path:
    data = yaml.safe_load(WHOLE_FILE.read_text())
    data["fleet"]["start"] = str(SCENARIO_FILES / "pool.csv")
    path = tmp_path / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**data, **changes}))
    return path


def refused(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(main([str(word) for word in words]))
    said = capsys.readouterr()
    assert ended.value.code == 2 and said.out == ""
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--open-modem", "99"], "no such aMussel; the fleet's are 1 to 12"),
        (["--open-modem", "7", "--time", "asap"], "use --time wall"),
        (["--modem", "/dev/null"], "theta is 30: say --theta 1"),
        (["--modem", "/dev/null", "--theta", "1", "--speed", "2"], "real sound takes real time"),
        (["--modem", "/dev/null", "--theta", "1", "--time", "asap"], "real sound takes real time"),
        (["--modem", "/dev/null", "--theta", "1"], "take the block `water` out"),
        (["--modem", "/dev/null", "--theta", "1", "--open-modem", "7"], "exclude each other"),
    ],
)
def test_what_cannot_be_is_told_with_its_mend(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], why: str
) -> None:
    out = tmp_path / "run"
    assert why in refused(capsys, "run", scenario, "--out", out, *words)
    assert not out.exists()


def test_opening_needs_water_and_a_fleet(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "add the block `water: {}`" in refused(
        capsys, "run", changed(tmp_path, "dry"), "--open-modem", "7"
    )
    assert "a mission alone" in refused(capsys, "mission", scenario, "--open-modem", "7")


def test_a_modem_that_is_not_there_is_missed_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dry = changed(tmp_path, "dry")
    told = refused(capsys, "run", dry, "--theta", "1", "--modem", tmp_path / "ttyUSB9")
    assert "ttyUSB9: there is no such device" in told


def test_a_resumed_run_opens_the_same_modems(tmp_path: Path) -> None:
    options = RunOptions(
        BenchPart.WHOLE,
        APadKind.SIM,
        TimeSource.WALL,
        1.0,
        OnDeath.WAIT,
        open_modems=(3, 7),
        modem="/dev/ttyUSB0",
    )
    options.save(tmp_path)
    assert (tmp_path / OPTIONS_NAME).exists()
    assert RunOptions.load(tmp_path) == options


def test_v2_modems_carry_no_timeslots_and_need_their_time(tmp_path: Path) -> None:
    water = {"modems": "v2", "talk": {"assigns": True, "beacon_period_s": 600}}
    with pytest.raises(ScenarioError) as refused_as:
        load(changed(tmp_path, "v2", water=water))
    told = str(refused_as.value)
    assert "water.talk.assigns: a v2 modem carries 7 bytes" in told
    assert "water.talk.beacon_period_s: a v2 modem carries 7 bytes" in told
    assert "board.whole.transmit_ms: must be no shorter than a v2 modem's status, which lasts 1830 ms" in told
