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


def changed(tmp_path: Path, name: str, **changes: Any) -> Path:
    """Twelve whole boards at theta 30."""
    data = yaml.safe_load(WHOLE_FILE.read_text())
    data["fleet"]["start"] = str(SCENARIO_FILES / "pool.csv")
    path = tmp_path / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**data, **changes}))
    return path


REAL = "--modem /dev/null --theta 1"


@pytest.mark.parametrize(
    ("command", "water", "words", "why"),
    [
        ("run", True, "--open-modem 99", "no such aMussel; the fleet's are 1 to 12"),
        ("run", True, "--open-modem 7 --time asap", "use --time wall"),
        ("run", True, "--modem /dev/null", "theta is 30: say --theta 1"),
        ("run", True, f"{REAL} --speed 2", "real sound takes real time"),
        ("run", True, f"{REAL} --time asap", "real sound takes real time"),
        ("run", True, REAL, "take the block `water` out"),
        ("run", True, f"{REAL} --open-modem 7", "exclude each other"),
        ("run", False, "--open-modem 7", "add the block `water: {}`"),
        ("mission", True, "--open-modem 7", "a mission alone"),
        ("run", False, "--theta 1 --modem ./ttyUSB9", "ttyUSB9: there is no such device"),
    ],
)
def test_what_cannot_be_is_told_with_its_mend(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: str,
    water: bool,
    words: str,
    why: str,
) -> None:
    scenario, out = changed(tmp_path, "boards", **({"water": {}} if water else {})), tmp_path / "run"
    assert main([command, str(scenario), "--out", str(out), *words.split()]) == 2
    said, errors = capsys.readouterr()
    assert why in errors and (said, errors.count("\n"), out.exists()) == ("", 1, False)


def test_v2_modems_carry_no_timeslots_and_need_their_time(tmp_path: Path) -> None:
    water = {"modems": "v2", "talk": {"assigns": True, "beacon_period_s": 600}}
    with pytest.raises(ScenarioError) as refused:
        load(changed(tmp_path, "v2", water=water))
    for line in (
        "water.talk.assigns: a v2 modem carries 7 bytes",
        "water.talk.beacon_period_s: a v2 modem carries 7 bytes",
        "board.whole.transmit_ms: must be no shorter than a v2 modem's status, which lasts 1830 ms",
    ):
        assert line in str(refused.value)
