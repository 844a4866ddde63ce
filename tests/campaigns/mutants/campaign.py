"""Mutants of the boards in C, judged by the conformance kit: the changes that its cases catch, and those that they miss.

A mutant is a board with one change, at `tries` places of each board on each route of `mutations.py` (`--row`: on
this one alone). Cases were added for what the first route found, and a few for the held out one. The fresh one was
chosen before a run, from places that no other route has judged, and no case was added for it. `caught` ones fail a case
of `musselbed mu conform`. `differing` ones only differ in a case that cites our own choice, and `by_chance` ones in a
random script alone. `equivalent` ones show nothing outside, for the reason in `EQUIVALENT`, or because the compiler makes
the same machine code; `survivors` are missed. Firmware that asks for ever is caught after the minute that a turn may take.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from native_boards import NATIVE

from agents.mussel.firmware_failure import FirmwareFailed
from apad_bridge.commands.firmware.mu_program import our_rig, rig_of
from benchmarks.rows import told
from firmware_model.bench.conformance import Case, RequirementSource, Verdict, history, judged, random_cases
from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.rigs import RigHistory, lasts_ms
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES
from mutants.mutations import Change, first_changes, fresh_changes, held_out_changes

TRIES, SHORT_TRIES = 42, 1
RANDOM = 150
_CC = ("cc", "-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O2", f"-I{NATIVE}", f"-I{NATIVE / 'whole'}", "-o")


@dataclass(frozen=True)
class Board:
    """A board in C: the files that are changed, and the cases that judge it."""

    files: tuple[Path, ...]
    others: tuple[Path, ...]
    """The files that are not changed."""
    cases: Sequence[Case]
    headers: tuple[Path, ...] = ()
    is_whole: bool = False


@dataclass(frozen=True)
class Route:
    """A way to make mutants. `warnings` are the compiler's options for its warnings."""

    changes: Callable[[Board], Iterator[Change]]
    warnings: tuple[str, ...]


# A mistake that the Makefile's compiler finds needs no kit.
_STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
ROUTES = {
    "first": Route(lambda it: first_changes(it.files), ("-w",)),
    "held out": Route(lambda it: held_out_changes(it.files, it.headers), _STRICT),
    "fresh": Route(lambda it: fresh_changes(it.files, it.headers), _STRICT),
}


_WHOLE = NATIVE / "whole"
_NOT_CHANGED = (_WHOLE / "hal_musselbed.c", _WHOLE / "whole_board.c", NATIVE / "musselbed.c")
BOARDS = {
    "worst case": Board((NATIVE / "worst_case.c",), (NATIVE / "musselbed.c",), CASES),
    "whole": Board(
        tuple(sorted(it for it in _WHOLE.glob("*.c") if it not in _NOT_CHANGED)),
        _NOT_CHANGED,
        WHOLE_CASES,
        (_WHOLE / "board.h", _WHOLE / "hal.h"),
        is_whole=True,
    ),
}
_TEXT = "only a text for people: nothing outside follows from a refused trigger"
_NO_STATE = "a state that outside equals the other one: both take the same triggers"
_SMALL = "below every tolerance"
_TIE = "of two equal values either"
_ORDER = "the two do not depend on each other"
_EXCLUSIVE = "no state is two of them"
EQUIVALENT = {
    ("if (by == SURFACING_TIMED_OUT)", "if (by != SURFACING_TIMED_OUT)"): _TEXT,
    (
        "board.has_deadline = false;",
        "",
    ): "a deadline that is left over is refused in every state without one of its own",
    ("board.has_deadline = false;", "board.has_deadline = true;"): "likewise",
    (
        "mu_pin(MU_WATCH_BATTERY, board.state == ACTIVE);",
        "mu_pin(MU_WATCH_BATTERY, board.state != ACTIVE);",
    ): _NO_STATE,
    ("mu_pin(MU_WATCH_BATTERY, board.state == ACTIVE);", ""): _NO_STATE,
    ("pin.high_ticks = 0;", "pin.high_ticks = 1;"): _SMALL,
    (
        "pin.high_ticks += pin.seen ? now - pin.counted : 0;",
        "pin.high_ticks += pin.seen ? now - pin.counted : 1;",
    ): _SMALL,
    (
        "return (int32_t)(settled - chatters) < 0 ? settled : chatters;",
        "return (int32_t)(settled - chatters) < 1 ? settled : chatters;",
    ): _TIE,
    (
        "#define IN(state) (1u << (state))",
        "#define IN(state) (2u << (state))",
    ): "the same bits, one place higher",
    (
        "{PING_HEARD, IN(ACTIVE) | IN(EMPTY) | IN(SURFACING) | IN(SINKING), STAYS},",
        "{PING_HEARD, IN(ACTIVE) | IN(EMPTY) | IN(SINKING), STAYS},",
    ): _TEXT,
    (
        "{PING_HEARD, IN(ACTIVE) | IN(EMPTY) | IN(SURFACING) | IN(SINKING), STAYS},",
        "{PING_HEARD, IN(ACTIVE) | IN(SURFACING) | IN(SINKING), STAYS},",
    ): _TEXT,
    (
        "by_timer = false; /* a charger was there for a moment */",
        "by_timer = true; /* a charger was there for a moment */",
    ): "a timer rings once, and whoever sets it again sets this, too",
    ("hal_motors(HAL_FLOAT, 0);", "hal_motors(HAL_FLOAT, 1);"): "a run to the surface has no depth",
    ("return true;", "return false;"): _TEXT,
    ("return;", ""): _TEXT,
    ("#define BILLION 1000000000u", "#define BILLION 1000000001u"): _SMALL,
    (
        "if (board.state == OFF || board.state == BOOTING)",
        "if (board.state == OFF && board.state == BOOTING)",
    ): _TEXT,
    (
        "} else if (event.kind == MU_ALARM) {",
        "} if (event.kind == MU_ALARM) {",
    ): "a reset has the charger's port, whose level was read just before",
    (
        "pin.high_ticks = 0; pin_certain(more_high ? more_high > 0 : pin.high);",
        "pin_certain(more_high ? more_high > 0 : pin.high); pin.high_ticks = 0;",
    ): _ORDER,
    (
        "pin_certain(more_high ? more_high > 0 : pin.high);",
        "pin_certain(more_high ? more_high >= 0 : pin.high);",
    ): "it is not 0 there",
    (
        "certain(more_high ? more_high > 0 : pin.high);",
        "certain(more_high ? more_high >= 0 : pin.high);",
    ): "it is not 0 there",
    ("pin.flipped = now; pin.settling = true;", "pin.settling = true; pin.flipped = now;"): _ORDER,
    ("pin.counted = now; pin.seen = level;", "pin.seen = level; pin.counted = now;"): _ORDER,
    ("pin.seen = level; pin.flipped = now;", "pin.flipped = now; pin.seen = level;"): _ORDER,
    ("pin.unsettled = now; pin.high_ticks = 0;", "pin.high_ticks = 0; pin.unsettled = now;"): _ORDER,
    ("next_check += CHECK_TICKS; check_pin();", "check_pin(); next_check += CHECK_TICKS;"): _ORDER,
    (
        "pin.seen = pin.high = mu_level(MU_CHARGER); apply(POWER_CAME_ON);",
        "apply(POWER_CAME_ON); pin.seen = pin.high = mu_level(MU_CHARGER);",
    ): "a level that seems new settles in the boot, and is the known one",
    (
        "next_check = (mu_now() / CHECK_TICKS + 1) * CHECK_TICKS;",
        "next_check = (mu_now() / CHECK_TICKS) * CHECK_TICKS;",
    ): "one more look, at the reset, finds the level that was read just before",
    (
        "if (board.has_deadline && (int32_t)(board.deadline - at) < 0)",
        "if (board.has_deadline && (int32_t)(board.deadline - at) <= 0)",
    ): _TIE,
    (
        "return (int32_t)(settled - chatters) < 0 ? settled : chatters;",
        "return (int32_t)(settled - chatters) <= 0 ? settled : chatters;",
    ): _TIE,
    (
        "mu_pin(way, true); mu_pin(way, false); /* the driver ends a run by itself */",
        "mu_pin(way, false); /* the driver ends a run by itself */ mu_pin(way, true);",
    ): "a motor runs at the rising edge, which comes in both orders",
    ("if (by == SURFACING_TIMED_OUT)", "if (!(by == SURFACING_TIMED_OUT))"): _TEXT,
    ("char text[64];", "char text[640];"): _TEXT,
    (
        "board.clear_to_sink = false; apply(CHARGE_EDGE_ROSE);",
        "apply(CHARGE_EDGE_ROSE); board.clear_to_sink = false;",
    ): _ORDER,
    (
        "} else if (COMMANDS[n].trigger < 0) {",
        "} else if (COMMANDS[n].trigger <= 0) {",
    ): "no command has the first trigger, that of the power",
    (
        "if (pin.settling && (int32_t)(pin_due() - at) < 0)",
        "if (pin.settling && (int32_t)(pin_due() - at) <= 0)",
    ): _TIE,
    ("{BATTERY_EMPTIED, IN(ACTIVE), EMPTY},", "{BATTERY_EMPTIED, IN(SURFACING), EMPTY},"): _NO_STATE,
    (
        "if (board.state == OFF || board.state == BOOTING)",
        "if (board.state == BOOTING || board.state == BOOTING)",
    ): "no pin changes before the power comes on",
    (
        "return log_state.oldest > log_state.acknowledged ? log_state.oldest : log_state.acknowledged;",
        "return log_state.oldest >= log_state.acknowledged ? log_state.oldest : log_state.acknowledged;",
    ): _TIE,
    (
        "ends_at(at > board.stays_down_until ? at : board.stays_down_until, LAST_RESORT_SURFACE);",
        "ends_at(at >= board.stays_down_until ? at : board.stays_down_until, LAST_RESORT_SURFACE);",
    ): _TIE,
    (
        "else if (board.state == REPORTING)",
        "if (board.state == REPORTING)",
    ): "a board that reports has Wi-Fi",
    (
        "if (first == UNKNOWN || (found && first < newest))",
        "if (first == UNKNOWN || (found && first <= newest))",
    ): "no two pages begin with one record",
    (
        "is_answering = true; hal_timer(ANSWER_TASK, hal_now() + config->turnaround_ms);",
        "hal_timer(ANSWER_TASK, hal_now() + config->turnaround_ms); is_answering = true;",
    ): _ORDER,
    (
        "pin.flipped = hal_now(); pin.settling = true;",
        "pin.settling = true; pin.flipped = hal_now();",
    ): _ORDER,
    ("else if (state == HOVERING)", "if (state == HOVERING)"): _EXCLUSIVE,
    ("else if (state == SINKING)", "if (state == SINKING)"): _EXCLUSIVE,
    (
        "pin.check = (hal_now() / check_ms + 1) * check_ms;",
        "pin.check = (hal_now() / check_ms) * check_ms;",
    ): "one more look, at the reset, finds the level that was read just before",
    (
        "put_bytes(&at, waiting < UINT16_MAX ? waiting : UINT16_MAX, 2);",
        "put_bytes(&at, waiting < UINT16_MAX ? waiting : UINT8_MAX, 2);",
    ): "the flash has room for 2720 records",
    (
        "changed.slot_ms = (uint32_t)get_bytes(arguments + 4, 4); "
        "changed.guard_ms = (uint32_t)get_bytes(arguments + 8, 2);",
        "changed.guard_ms = (uint32_t)get_bytes(arguments + 8, 2); "
        "changed.slot_ms = (uint32_t)get_bytes(arguments + 4, 4);",
    ): _ORDER,
}
"""Changes that nothing outside of the board can show, each with its reason."""


def measure(tries: int = TRIES, short: bool = False, row: Sequence[str] | None = None) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="musselbed-") as folder:
        return {
            "boards": [
                told(
                    {"board": name, "route": route}
                    | _judge_mutants(board, route, Path(folder), SHORT_TRIES if short else tries)
                )
                for route in row or ROUTES
                for name, board in BOARDS.items()
            ]
        }


def _judge_mutants(board: Board, route: str, folder: Path, tries: int) -> dict[str, Any]:
    count, caught, differing, by_chance = 0, 0, 0, 0
    survivors, equivalent = [], []
    # Short cases first, and then those that caught one before: most mutants need few cases.
    cases = sorted(board.cases, key=lambda it: (it.source is RequirementSource.CHOICE, lasts_ms(it.script)))
    by_hash = list(random_cases(RANDOM, 1, is_whole=board.is_whole))
    ours: dict[Case, RigHistory] = {}
    mutants = _Mutants(board, folder)
    for change in _chosen(board, route, mutants, tries):
        count, where = count + 1, str(change)
        if mutants.is_same_code(change):
            equivalent.append(f"{where}: the same machine code")
        elif (case := _first_failed(mutants.program, cases, ours)) is not None:
            caught += case.source is not RequirementSource.CHOICE
            differing += case.source is RequirementSource.CHOICE
            told({"mutant": where, "caught_by": case.name})
            cases.remove(case)
            cases.insert(0, case)
            cases.sort(key=lambda it: it.source is RequirementSource.CHOICE)
        elif (case := _first_failed(mutants.program, by_hash, ours)) is not None:
            by_chance += 1
            told({"mutant": where, "caught_by": case.name})
        elif (reason := EQUIVALENT.get(change.key)) is not None:
            equivalent.append(f"{where}: {reason}")
        else:
            survivors.append(where)
            told({"mutant": where, "caught_by": None})
    return {
        "mutants": count,
        "caught": caught,
        "differing": differing,
        "by_chance": by_chance,
        "equivalent": equivalent,
        "survivors": survivors,
    }


def _chosen(board: Board, chosen: str, mutants: _Mutants, tries: int) -> Iterator[Change]:
    """Yields `tries` changes of a route that compile, and that are not among the first of a route before it.

    The program of `mutants` has the one just yielded.
    """
    before: set[Change] = set()
    for name, route in ROUTES.items():
        if name == chosen:
            changes = (it for it in route.changes(board) if it not in before)
            yield from islice((it for it in changes if mutants.compiled(it, route.warnings)), tries)
            return
        # Twice as many as it tries: some do not compile.
        before |= set(islice(route.changes(board), 2 * tries))


class _Mutants:
    """Compiles the mutants of a board, one after the other: the file of each that is changed, and no other."""

    def __init__(self, board: Board, folder: Path) -> None:
        self._folder = folder
        self.program = folder / "mutant"
        self._changed = folder / "changed.o"
        self._objects = {path: folder / f"{path.stem}.o" for path in (*board.files, *board.others)}
        for path, compiled in self._objects.items():
            # A copy in the folder: an object has the name of its source.
            (folder / path.name).write_text(path.read_text())
            assert self._compiled(path, compiled, ("-Werror",)), path

    def compiled(self, change: Change, warnings: Sequence[str]) -> bool:
        """Makes the program with this change; False if the compiler refuses it."""
        (self._folder / change.path.name).write_text(change.applied())
        if not self._compiled(change.path, self._changed, warnings):
            return False
        objects = [self._changed if path == change.path else it for path, it in self._objects.items()]
        return _runs([*_CC, str(self.program), *map(str, objects)])

    def is_same_code(self, change: Change) -> bool:
        """True if the compiler made the same of its file with and without the change that was compiled last."""
        return self._changed.read_bytes() == self._objects[change.path].read_bytes()

    def _compiled(self, path: Path, into: Path, warnings: Sequence[str]) -> bool:
        return _runs([*_CC, str(into), "-c", *warnings, str(self._folder / path.name)])


def _runs(command: Sequence[str]) -> bool:
    return subprocess.run(command, capture_output=True, timeout=600, check=False).returncode == 0


def _first_failed(program: Path, cases: Iterable[Case], ours: dict[Case, RigHistory]) -> Case | None:
    """The first case that the program does not pass. `ours` keeps the histories of our board."""
    for case in cases:
        if case not in ours:
            ours[case] = history(case, our_rig, FirmwareFailed)
        result = judged(case, ours[case], lambda it: rig_of(program, it), FirmwareFailed, {})
        if result.verdict is not Verdict.PASSED:
            return case
    return None
