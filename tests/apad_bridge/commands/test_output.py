"""The output of commands: help without a command, and no traceback for a reader that is gone or a full disk."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, TextIO

import pytest
from rich.console import Console

from agents.time_scale import TimeScale
from apad_bridge.assembly.capacity_bounds import bounds_of
from apad_bridge.commands.main import all_groups, main
from apad_bridge.commands.outcome import report
from apad_bridge.commands.table_two_row import print_table
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.summary import Ending, apad_energy
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load, write_resolved
from apad_bridge.scenario.timed_faults import FaultAt, Faults, TimedFault

ROOT = Path(__file__).parents[3]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
POOL, REAL = (f"launch_scripts/scenarios/{name}.yaml" for name in ("pool-12", "real-apad"))


def test_the_help_has_every_command_once_in_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    said = capsys.readouterr().out
    for name in chain.from_iterable(all_groups().values()):
        assert len(re.findall(rf"(?m)^  {name} +\S", said)) == 1, name
    groups = re.findall(r"(?m)^([a-z ]+):$", said)
    assert groups[1:-1] == [
        "fly",
        "order",
        "look",
        "look into a run",
        "prepare",
        "real hardware",
        "firmware",
        "field",
        "imc",
        "studies",
        "viewers",
    ]
    assert max(map(len, said.splitlines())) <= 80


NEEDS = "a real aPad needs area.fence, area.home_m, guards.battery_reserve"
WRONG = "musselbed: there is no command "
MISTAKES = [
    ("", "", ""),
    ("reprot runs/x", f"{WRONG}reprot: did you mean `musselbed report`?\n", ""),
    ("zzz runs/x", f"{WRONG}zzz: `musselbed --help` lists all\n", ""),
    ("run pool-12 --stratgy greedy", "usage: musselbed run ", "no option --stratgy: did you mean --strategy?\n"),
    ("branch x --att=5", "usage: musselbed branch ", "there is no option --att: did you mean --at?\n"),
    ("order stop x --zzz", "usage: musselbed order stop ", "no option --zzz: `musselbed order stop --help` lists all\n"),
    ("run --theta fast pool-12", "usage: musselbed run ", "argument --theta"),
    ("replay a b c d", "usage: musselbed replay ", "unrecognized arguments: "),
    (f"mission {POOL} --time asap", "", "use --time wall or ros\n"),
    (f"run {POOL} --time asap --apad ros", "", "leave out --apad ros, or use --time wall\n"),
    (f"run {POOL} --time asap --speed 5", "", "leave it out; asap flies as fast as the machine goes\n"),
    (f"run {POOL} --apad ros", "", f"{NEEDS} in the scenario: see {REAL}\n"),
    (f"run {REAL} --apad ros --on-supervisor-death resume", "", "-death resume out, and call musselbed resume\n"),
    (f"mission {POOL}", "", f"see {REAL}\n"),
    (f"study {__file__}", "", "is no YAML but a Python script"),
    ("study pool-21", "", "nor a shipped scenario: did you mean pool-12?"),
    ("study tabel2", "", "tabel2: neither a file nor a built-in study (table2, sleep, capacity) nor"),
    ("study tabel2", "", ": did you mean table2?"),
    ("study xyz", "", "nor a shipped scenario: there are bay-120, bay-24, "),
    (f"study {POOL.replace('yaml', 'csv')}", "", "is no "),
    ("run launch_scripts/studies/pool.yaml --dry-run", "", "this is a study: fly it by"),
    ("capacity /dev/null", "", "/dev/null: is a device"),
    ("check /nowhere", "", "/nowhere: no such folder"),
    ("export x --to xlsx", "usage: ", "invalid choice: 'xlsx' (choose from "),
    ("beliefs x --from tape", "usage: ", "invalid choice: 'tape' (choose from "),
    (f"run {POOL} --agents 24", "", "let starts be drawn: start: {charge: [0.7, 1.0]}\n"),
]  # fmt: skip


@pytest.mark.parametrize(("typed", "begins", "mend"), MISTAKES, ids=[typed for typed, *_ in MISTAKES])
def test_a_mistake_is_answered_with_the_mend_that_fits(
    typed: str, begins: str, mend: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    with pytest.raises(SystemExit) as ended:
        sys.exit(main(typed.split()))
    out, told = capsys.readouterr()
    assert (ended.value.code, out.startswith("usage: musselbed")) == (2, not typed)
    assert told.startswith(begins) and mend in told and (told.count("\n") <= 1 or "usage: " in begins)


def test_a_command_has_its_own_options_before_those_of_every_flight(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for command, own in (("mission", "--strategy NAME|FILE.py:CLASS"), ("run", "--console")):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        _, options = capsys.readouterr().out.split("positional arguments:")
        assert options.index(own) < options.index("--theta N")


def test_a_shipped_scenario_is_found_by_its_name_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert load(Path("pool-12")) == load(ROOT / POOL)
    with pytest.raises(ScenarioError, match="neither a file nor a shipped scenario: did you mean pool-12"):
        load(Path("pool-13"))
    with pytest.raises(ScenarioError, match="No such file"):
        load(Path("pool-12.yaml"))
    Path("pool-12").write_text((ROOT / POOL).read_text().replace("name: pool-12", "name: mine"))
    shutil.copy(ROOT / POOL.replace("yaml", "csv"), tmp_path)
    assert load(Path("pool-12")).name == "mine"  # a file of one's own comes first


def test_a_new_scenario_flies_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    assert main(["new", str(file)]) == 0
    text = file.read_text()
    assert len(text.splitlines()) == 20 and text.count("#") >= 8
    assert main(["run", str(file), "--time", "asap", "--dry-run", "--json"]) == 0
    assert load(file).name == "mine"


def full() -> TextIO:
    return open("/dev/full", "w")


def left() -> TextIO:
    """A pipe whose reader left before the command can have said all."""
    reader, writer = os.pipe()
    os.close(reader)
    return open(writer, "w")


def musselbed(words: str, folder: Path = ROOT, **streams: Any) -> subprocess.CompletedProcess[str]:
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
    return subprocess.run([*MUSSELBED, *words.split()], cwd=folder, text=True, timeout=60, **streams)


@pytest.mark.parametrize(
    ("sink", "words", "told"),
    [
        *((left, it, "") for it in ("doctor", "mu states", "mu table1", f"layout foxglove {POOL}")),
        *(
            (full, it, r".*No space left on device\n")
            for it in ("doctor", "mu states", f"layout foxglove {POOL}")
        ),
    ],
)
def test_a_reader_that_leaves_is_silent_and_a_full_disk_one_line(
    sink: Callable[[], TextIO], words: str, told: str
) -> None:
    with sink() as out:
        done = musselbed(words, stdout=out)
    assert done.returncode == 3 and re.fullmatch(told, done.stderr)


@pytest.mark.parametrize("sink", [left, full])
def test_where_no_progress_can_be_shown_the_flight_ends_in_order_and_nothing_else_is_closed(
    sink: Callable[[], TextIO], tmp_path: Path
) -> None:
    with sink() as err:
        done = musselbed("run pool-12 --time asap --out flown", tmp_path, stderr=err)
    assert done.returncode == 130 and "the operator" in done.stdout
    assert json.loads((tmp_path / "flown" / "summary.json").read_text())["end_reason"] == "the operator"


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-"])
def test_a_run_that_begins_with_a_closed_descriptor_is_flown_and_kept(closed: str, tmp_path: Path) -> None:
    command = ["run", "pool-12", "--time", "asap", "--out", "flown"]
    script = ["sh", "-c", f'exec "$0" "$@" {closed}', str(ROOT / "launch_scripts" / "musselbed"), *command]
    assert subprocess.run(script, cwd=tmp_path, capture_output=True, timeout=60).returncode == 0
    assert json.loads((tmp_path / "flown" / "summary.json").read_text())["end_reason"] == "mission time"


@pytest.mark.parametrize("command", ["bridge pool-12 udp:0", "shadow pool-12", "apad pool-12"])
def test_a_peer_that_fails_is_one_line_of_any_command(command: str) -> None:
    """Nothing listens at the discard port."""
    environment = os.environ | {"ROS_MASTER_URI": "http://127.0.0.1:9"}
    done = subprocess.run(
        [*MUSSELBED, *command.split()], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr.count("\n")) == (3, 1), done.stderr
    assert done.stderr.startswith("musselbed: no ROS master answers at http://127.0.0.1:9")


def test_control_characters_of_others_are_shown_and_not_written() -> None:
    done = musselbed("check run\x1b]0;title\x07")
    assert r"run\x1b]0;title\x07" in done.stderr and "\x1b" not in done.stderr + done.stdout


SUMMARY = {
    "theta": 30,
    "seed": 1,
    "agents": 12,
    "mission_s": 2400.0,
    "excluded": None,
    "ended_by": "mission time",
    "end_reason": "mission time",
    "stopped_s": 0.0,
    "uptime_paper": {"mean": 74.3, "max": 85.0, "min": 61.9},
    "cost_m": 262.1,
    "planned_m": 276.9,
    "causes": {},
    "steps_given_up": 0,
    **{"left_alone": [], "beyond_reach": [], "failed_docks": []},
    "active_mean": 8.92,
    "samples_uploaded": None,
    "amussels_lost": 0,
    "emptied": 0,
    "gave_up": 0,
    "services": 16,
    "apad_energy_fraction": 0.2,
    "apad_energy_missing": None,
}


PAPER, ROW, NO_ROW = "(paper)", ": a row of the paper's", ": no row of the paper's Table II"
FAILED = {"ended_by": "failure of the script: x", "end_reason": "failure of the script"}
OPERATOR = dict.fromkeys(("ended_by", "end_reason"), "the operator")
JAMMED = Faults(at=(FaultAt(fault=TimedFault.DOCK_JAMMED, at_s=0.0, value=1.0),))
USED, UNKNOWN = "The aPad used 25.0 % of its battery", "No figure of the aPad's energy (no figure there is)"
OUTCOMES: dict[str, tuple[dict[str, Any], list[str], list[str]]] = {
    "the paper's flight": (
        {},
        [ROW, PAPER, "0 lost, 0 emptied. End", "4 docks sustain at most"],
        ["Each docking failed", "Interrupted"],
    ),
    "another theta": ({"theta": 15}, [ROW], [PAPER]),
    "another seed": ({"seed": 2}, [ROW], [PAPER]),
    "another fleet": ({"agents": 8}, [ROW], [PAPER]),
    "without truth": ({"uptime_paper": None}, [], [PAPER]),
    "stopped": ({"stopped_s": 1260.0}, [NO_ROW, "Interrupted: stopped for 1260 s of 2400 s."], [PAPER]),
    "its script failed": (FAILED, [NO_ROW, "Interrupted: ended by failure of the script: x."], [PAPER]),
    "ended by a person": (OPERATOR, [NO_ROW, "Interrupted: ended by the operator."], [PAPER]),
    "boards dead for good are counted": ({"gave_up": 2}, ["0 lost, 0 emptied, 2 dead for good. End"], []),
    "a block without faults": ({"faults": Faults()}, [ROW, PAPER], []),
    # Two jammed docks raise the uptime by 2 points: aMussels stay in the water, and empty themselves.
    "a dock is jammed": ({"faults": JAMMED}, [NO_ROW], [PAPER]),
    "docks in which nothing docked sustain nobody": (
        {"failed_docks": [1, 3]},
        ["2 docks sustain at most", "Each docking failed in dock 2, 4:"],
        [],
    ),
    "energy of the aPad": ({"apad_energy_fraction": 0.25}, [USED], ["No figure of the aPad's energy"]),
    "no such energy": (
        {"apad_energy_fraction": None, "apad_energy_missing": "no figure there is"},
        [UNKNOWN],
        [USED],
    ),
}
"""What differs from the paper's flight, of the summary or the faults; what is told of it, and what is not."""


@pytest.mark.parametrize(("change", "told", "untold"), OUTCOMES.values(), ids=OUTCOMES)
def test_the_outcome_of_a_run_compares_with_the_paper_only_what_is_alike(
    change: dict[str, Any],
    told: list[str],
    untold: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    scenario = replace(load(ROOT / POOL), faults=change.get("faults"))
    report(scenario, "cautious", RunDirectory(Path("run")), SUMMARY | change, as_json=False)
    shown = capsys.readouterr().out
    assert [it for it in (*told, *untold) if it in shown] == told


@pytest.mark.parametrize(("theta", "used", "figure"), [(1, 0.25, 0.25), (30, 0.25, None), (1, None, None)])
def test_the_apads_energy_is_a_figure_at_theta_1_alone(
    theta: int, used: float | None, figure: float | None
) -> None:
    found = apad_energy(Ending(MissionEnd(EndReason.MISSION_TIME), 1.0, 1.0, 2, used, {}), TimeScale(theta))
    assert (found["apad_energy_fraction"], found["apad_energy_missing"] is None) == (
        figure,
        figure is not None,
    )


def test_an_apad_that_must_run_empty_is_warned_of_before_it_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """230 Wh at 25 W of computers and sensors last 9.2 h; the shipped scenarios ask for 4 h at most."""
    shipped = (ROOT / "launch_scripts/scenarios/whole-board-12.yaml").read_text()
    # They need a charge from the beginning, so that the first plan comes at once.
    rows = (ROOT / "launch_scripts/scenarios/pool-12.csv").read_text().splitlines()
    low = [",".join([*row.split(",")[:-1], "0.5"]) if row[0].isdigit() else row for row in rows]
    (tmp_path / "pool-12.csv").write_text("\n".join(low) + "\n")
    for duration_s, warned in ((14400, 0), (33119, 0), (33121, 1)):
        path = tmp_path / "long.yaml"
        path.write_text(shipped.replace("duration_s: 14400", f"duration_s: {duration_s}"))
        assert main(["run", str(path), "--theta", "1", "--dry-run"]) == 0
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == warned and all("within 9.2 h" in line and "hotel_w" in line for line in lines)
        main(["doctor", str(path)])
        assert capsys.readouterr().out.count("WARN scenario: ") == warned


TROUBLE = {
    "excluded": {"amussels": 1, "beside_real_s": 31.0, "retired_s": 1773.0},
    "causes": {
        f"go to point: cause {n} that is told in a long line, which a terminal folds": n for n in range(1, 8)
    },
    "steps_given_up": 4,
    "left_alone": [3, 7],
    "beyond_reach": [],
}


def test_the_end_of_a_run_fits_80_columns_and_names_each_failure_with_its_count(
    capsys: pytest.CaptureFixture[str],
) -> None:
    console = Console(width=80, force_terminal=True, color_system=None)
    print_table(console, "pool-12", "cautious", SUMMARY | TROUBLE, bounds_of([load(ROOT / POOL)]))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    shown = " ".join(" ".join(lines).split())
    assert "Excluded (1 aMussel): 31 s shadowing a real one, 1773 s retired." in shown
    assert "Failures (4 steps given up): 7 x go to point: cause 7" in shown
    assert "3 x go to point: cause 3" in shown and "2 x go to point" not in shown
    assert "2 more causes: see summary.json" in shown
    assert "No strategy exceeds 91.4 % uptime" in shown


@pytest.mark.parametrize(
    ("change", "second"),
    [
        ({}, ["beliefs", "{run}"]),
        ({"uptime_paper": None}, ["runs", "{folder}"]),
        ({"apads": {"apad1": {**SUMMARY, "end_reason": "mission time"}}}, ["beliefs", "{run}/apad1"]),
    ],
)
def test_a_run_ends_with_its_files_and_two_commands_that_parse(
    change: dict[str, object],
    second: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = RunDirectory(tmp_path / "a run of a long name that no terminal folds" / "r")
    assert report(load(ROOT / POOL), "cautious", run, SUMMARY | change, as_json=False) == 0
    files, title, *commands = capsys.readouterr().out.splitlines()[-4:]
    assert files == f"Files: {run.path}" and title == "Next:"
    assert [shlex.split(command) for command in commands] == [
        ["musselbed", "replay", f"{run.path}"],
        ["musselbed", *(word.format(run=run.path, folder=run.path.parent) for word in second)],
    ]


class Ticking:
    """Stands in for a timer: the tests let its time pass."""

    made: ClassVar[list[Ticking]] = []

    def __init__(self, after_s: float, function: Callable[[], None]) -> None:
        self.after_s, self.function, self.is_cancelled = after_s, function, False
        Ticking.made.append(self)

    def start(self) -> None:
        pass

    def cancel(self) -> None:
        self.is_cancelled = True


@pytest.mark.parametrize("quiet", [False, True])
def test_work_without_a_count_is_told_where_no_terminal_shows_it(
    quiet: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading, "Timer", Ticking)
    monkeypatch.setattr(Ticking, "made", [])
    with WorkProgress(quiet) as progress:
        progress.step("reading runs/a")
        progress.step("drawing [a, b]")
        assert len(Ticking.made) == (0 if quiet else 2)
        fired = []
        for _ in range(3):
            for timer in [it for it in Ticking.made if not it.is_cancelled and it not in fired]:
                assert timer.after_s <= (30 if fired else 2)
                timer.function()
                fired.append(timer)
    assert all(it.is_cancelled or it in fired for it in Ticking.made)
    made = len(Ticking.made)
    for timer in fired:  # a line that was on its way at the end
        timer.function()
    assert len(Ticking.made) == made
    told = capsys.readouterr()
    lines = ["drawing [a, b] ...", "drawing [a, b] ... 32 s", "drawing [a, b] ... 62 s"]
    assert (told.out, told.err.splitlines()) == ("", [] if quiet else [*lines, *lines])


@pytest.mark.parametrize(
    "command",
    [
        "report",
        "export --to mat",
        "replay",
        "pack",
        "branch --at 100 --lose-apad apad1",
        "beliefs",
        "check",
        "explain",
    ],
)
def test_no_command_that_takes_long_is_silent(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(WorkProgress, "step", lambda self, text: said.append(text))
    run, scenario = tmp_path / "run", tmp_path / "short.yaml"
    short = replace(load(ROOT / POOL), duration_s=120)
    write_resolved(scenario, replace(short, fleet=replace(short.fleet, hosting=Hosting.ONE_PROCESS)))
    assert main(["run", str(scenario), "--time", "asap", "--out", str(run)]) == 0
    name, *options = command.split()
    out = ["--out", str(tmp_path / "out.tar.gz")] if name in ("report", "pack") else []
    main([name, str(run), *options, *out])
    assert said and str(run) in said[0]


@pytest.mark.parametrize(
    "words",
    ["logs merge {bag} {bag} --out {out}", "calibrate {bag} --scenario {pool}", "shadow {pool} {bag}"],
)
def test_no_command_that_reads_a_bag_is_silent(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(WorkProgress, "step", lambda self, text: said.append(text))
    bag = tmp_path / "log.bag"
    bag.write_bytes(b"no bag")
    assert main(words.format(bag=bag, out=tmp_path / "out.bag", pool=ROOT / POOL).split()) == 2
    assert said and str(bag) in said[0]
