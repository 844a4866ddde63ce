"""Sensors that packages bring, each in a process of its own: the table is made once, when it is imported."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from doc_blocks import install_template

ROW = "from firmware_model.sampling.sensor import Sensor\n{0} = Sensor({0!r}, 'u', (0, {1}), 0, 1, 0.1, {2}, 3)\n"
"""A module with one sensor: its name, its coefficient, and the value of a calm bay."""


def bring(site: Path, package: str, name: str, text: str) -> None:
    """Writes a package `package` 2.0 that brings a sensor under this name from a module with this text."""
    info = site / f"{package}-2.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 2.0\n\nName: another\n")
    (info / "entry_points.txt").write_text(f"[musselbed.sensors]\n{name} = {package}:{name}\n")
    (site / f"{package}.py").write_text(text)


def answer(site: Path, code: str) -> str:
    """The last line that this code prints where the folder's packages are installed."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "PYTHONPATH": str(site)},
    )
    return (done.stdout + done.stderr).splitlines()[-1]


def test_they_follow_the_boards_own_by_their_names(tmp_path: Path) -> None:
    bring(tmp_path, "a_lab", "zinc", ROW.format("zinc", 1, 0.5))
    bring(tmp_path, "b_lab", "chlorine", ROW.format("chlorine", 1, 0.5))
    code = (
        "from firmware_model.power.rails import Rail; from firmware_model.sampling.sensors import BROUGHT, SENSORS;"
        "from firmware_model.packets.sample_record import RECORD_BYTES; "
        "print(*(it.name for it in SENSORS), *map(int, (Rail.CHLORINE, Rail.ZINC)), RECORD_BYTES, *BROUGHT, sep=', ')"
    )
    # Two bytes a sensor beside the 24 of a record with four.
    assert answer(tmp_path, code) == (
        "oxygen, pressure, temperature, turbidity, chlorine, zinc, 14, 15, 28, chlorine of b_lab 2.0, zinc of a_lab 2.0"
    )


def test_a_packages_module_can_be_imported_by_itself(tmp_path: Path) -> None:
    install_template(tmp_path, "sensor")
    # -1 + 0.001 n: 36 psu is the count 37000.
    code = "import lab_sensors; print(lab_sensors.SALINITY.count(36.0), lab_sensors.SALINITY.value(37000))"
    assert answer(tmp_path, code) == "37000 36.0"


MEND = ": mend that package or uninstall it"


def lab(name: str, text: str, reason: str) -> tuple[list[tuple[str, str, str]], str]:
    return [("lab", name, text)], f"the sensor {name} of lab 2.0 (lab:{name}) {reason}{MEND}"


@pytest.mark.parametrize(
    ("brought", "line"),
    [
        lab("zinc", "import nowhere", "cannot be loaded: ModuleNotFoundError: No module named 'nowhere'"),
        lab("zinc", "raise SystemExit('one\\ntwo')", "cannot be loaded: SystemExit: one two"),
        lab("zinc", "", "cannot be loaded: AttributeError: module 'lab' has no attribute 'zinc'"),
        lab("zinc", "zinc = 4", "is no Sensor but a int"),
        lab("zinc", ROW.format("zinc", 1, None), "has no value of a calm bay"),
        lab(
            "zinc",
            ROW.format("iron", 1, 0.5) + "zinc = iron",
            "has the key 'iron_u', which must be its entry's name and a unit in small letters",
        ),
        lab(
            "Zinc",
            ROW.format("Zinc", 1, 0.5),
            "has the key 'Zinc_u', which must be its entry's name and a unit in small letters",
        ),
        lab("oxygen", ROW.format("oxygen", 1, 0.5), "has the name of one of musselbed itself"),
        (
            [("lab", "wifi", ROW.format("wifi", 1, 0.5))],
            f"the sensor wifi of lab 2.0 has the name of another module of the board{MEND}",
        ),
        (
            [(f"{it}_lab", "zinc", ROW.format("zinc", 1, 0.5)) for it in "ab"],
            f"the sensor zinc of b_lab 2.0 (b_lab:zinc) has the name of one of a_lab 2.0{MEND}",
        ),
    ],
    ids=lambda it: it[-60:] if isinstance(it, str) else "",
)
def test_one_that_no_board_can_have_is_refused_in_a_line_with_its_package(
    tmp_path: Path, brought: list[tuple[str, str, str]], line: str
) -> None:
    for package, name, text in brought:
        bring(tmp_path, package, name, text)
    code = "import firmware_model.packets, firmware_model.power.rails"
    assert answer(tmp_path, code) == f"ImportError: {line}"


def test_nine_are_too_many(tmp_path: Path) -> None:
    for n in range(5):
        bring(tmp_path, f"lab{n}", f"s{n}", ROW.format(f"s{n}", 1, 0.5))
    line = answer(tmp_path, "import firmware_model.sampling.sensors")
    assert line.startswith(
        "ImportError: 9 sensors are more than 8: uninstall one of s0 of lab0 2.0, s1 of lab1 2.0"
    )


WROTE = """
from firmware_model.packets import AcousticStatus, WifiStatus
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
place = 7, 9, State.SLEEPING, 0.5, 1.0, 0.0, 0.0, 3.0, 1000
counts = 1, 2, 3, 4, 5
log = 1, 0, 0, 0, 0, ResetCause(0), ActiveBattery(0), 0, 0
sent = AcousticStatus(*place, counts, 1, 1), WifiStatus(*place, counts, *log), SampleRecord(0, 1000, counts, 0)
print(*(it.encode().hex() for it in sent))
"""
READ = """
from firmware_model.packets import decode
from firmware_model.packets.sample_record import SampleRecord
*packets, record = map(bytes.fromhex, {0!r}.split())
print(*(it and it.counts for it in (*map(decode, packets), SampleRecord.decode(record))))
"""


def test_nobody_reads_the_counts_of_a_table_with_as_many_other_sensors(tmp_path: Path) -> None:
    """Another sensor, and the same one with another calibration: either would read a count as something else."""
    bring(tmp_path / "ours", "lab", "zinc", ROW.format("zinc", 1, 0.5))
    bring(tmp_path / "other", "lab", "iron", ROW.format("iron", 1, 0.5))
    bring(tmp_path / "later", "lab", "zinc", ROW.format("zinc", 2, 0.5))
    sent = answer(tmp_path / "ours", WROTE)
    read = READ.format(sent)
    assert answer(tmp_path / "ours", read) == " ".join(3 * ["(1, 2, 3, 4, 5)"])
    assert [answer(tmp_path / it, read) for it in ("other", "later")] == 2 * ["None None None"]


def test_a_scenario_of_the_papers_worst_case_lacks_none_and_has_none_too_many(tmp_path: Path) -> None:
    """Its boards have no sensors: a run of it is read, whichever are installed."""
    bring(tmp_path, "lab", "zinc", ROW.format("zinc", 1, 0.5))
    code = (
        "from pathlib import Path; from apad_bridge.scenario.loader import from_data, load, resolve\n"
        "for name in ('pool-12', 'whole-board-12'):\n"
        "    for listed in ([], ['zinc of lab 2.0'], ['iron of lab 1.0']):\n"
        "        data = resolve(load(Path('launch_scripts/scenarios') / f'{name}.yaml')) | {'sensors': listed}\n"
        "        try: from_data(data, name); print('read', end=' ')\n"
        "        except ValueError: print('refused', end=' ')\n"
    )
    assert answer(tmp_path, code) == "read read read refused read refused "
