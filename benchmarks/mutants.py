"""Mutants of the boards in C, judged by the conformance kit: the changes that its cases catch, and those that they miss.

A mutant is a board with one change: an operator, a constant, or a deleted statement, at `tries` places of each board that
a hash chooses. Places that only change texts and states for people are left out. `caught` ones fail a case of `musselbed mu
conform`. `differing` ones only differ in a case that cites our own choice, and `by_chance` ones in a random script alone.
`equivalent` ones show nothing outside, for the reason in `EQUIVALENT`; `survivors` are missed. Firmware that asks for ever
is caught after the 8 s that a turn may take.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

from native_boards import NATIVE
from rich.console import Console
from rich.table import Table

from agents.mussel.firmware_failure import FirmwareFailed
from apad_bridge.commands.firmware.mu_program import our_rig, rig_of
from benchmarks.rows import told
from firmware_model.bench.conformance import Case, Source, Verdict, judged, random_cases
from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.rigs import lasts_ms
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES

TRIES, SHORT_TRIES = 60, 3
RANDOM = 60
_CC = (
    "cc",
    "-std=c99",
    "-D_POSIX_C_SOURCE=200809L",
    "-O1",
    "-w",
    f"-I{NATIVE}",
    f"-I{NATIVE / 'whole'}",
    "-o",
)
_FOR_PEOPLE = re.compile(
    r"STATES\[\]|TRIGGERS\[\]|_NAMES|[a-z]+_refuse|mu_state|hal_fault|hal_tell_state|snprintf|return \d|, -1}|mu_open"
)
_CHANGES = (
    (r"==", "!="),
    (r"!=", "=="),
    (r"&&", "||"),
    (r"\|\|", "&&"),
    (r" < ", " >= "),
    (r"\+=", "-="),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r"\b(?:IN|S|R)\(\w+\) \| ", ""),
    (r"(?<![\w.\"])(\d+)(?=[u ;,)\]}])", None),
    (r"^    .*;$", ""),
)
"""Patterns in a line, and what replaces them; None adds 1 to a number."""


@dataclass(frozen=True)
class Board:
    """A board in C: the files that are changed, and the cases that judge it."""

    files: tuple[Path, ...]
    cases: Sequence[Case]
    is_whole: bool = False


BOARDS = {
    "worst case": Board((NATIVE / "worst_case.c",), CASES),
    "whole": Board(
        tuple(
            sorted(
                it for it in (NATIVE / "whole").glob("*.c") if it.stem not in ("hal_musselbed", "whole_board")
            )
        ),
        WHOLE_CASES,
        is_whole=True,
    ),
}
_TEXT = "only a text for people: nothing outside follows from a refused trigger"
_NO_STATE = "a state that outside equals the other one: both take the same triggers"
_SMALL = "below every tolerance"
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
    ): "of two equal times either",
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
}
"""Changes that nothing outside of the board can show, each with its reason."""


def measure(tries: int = TRIES, short: bool = False) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="musselbed-") as folder:
        return {
            "boards": [
                told({"board": name} | _judge_mutants(board, Path(folder), SHORT_TRIES if short else tries))
                for name, board in BOARDS.items()
            ]
        }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="Mutants of the boards in C, judged by the conformance kit")
    for name in ("board", "mutants", "caught", "differ", "by random scripts", "equivalent", "missed"):
        table.add_column(name, justify="left" if name == "board" else "right")
    for row in result["boards"]:
        figures = (
            row["mutants"],
            row["caught"],
            row["differing"],
            row["by_chance"],
            len(row["equivalent"]),
            len(row["survivors"]),
        )
        table.add_row(row["board"], *map(str, figures))
    console.print(table)
    for row in result["boards"]:
        for survivor in (*(f"missed: {it}" for it in row["survivors"]), *row["equivalent"]):
            console.print(f"  {row['board']}, {survivor}", markup=False, highlight=False, soft_wrap=True)


def _judge_mutants(board: Board, folder: Path, tries: int) -> dict[str, Any]:
    count, caught, differing, by_chance = 0, 0, 0, 0
    survivors, equivalent = [], []
    # Short cases first: most mutants are caught by one of them.
    cases = sorted(board.cases, key=lambda it: (it.source is Source.CHOICE, lasts_ms(it.script)))
    for path, line, old, new in _changes(board.files):
        if count == tries:
            break
        if not _compiled(board, folder, path, line, new):
            continue
        count += 1
        where = f"{path.name}:{line + 1}: {old.strip()}  ->  {new.strip() or 'nothing'}"
        if (case := _first_failed(folder / "mutant", cases)) is not None:
            caught += case.source is not Source.CHOICE
            differing += case.source is Source.CHOICE
            told({"mutant": where, "caught_by": case.name})
        elif (
            case := _first_failed(folder / "mutant", random_cases(RANDOM, 1, is_whole=board.is_whole))
        ) is not None:
            by_chance += 1
            told({"mutant": where, "caught_by": case.name})
        elif (reason := EQUIVALENT.get((old.strip(), new.strip()))) is not None:
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


def _changes(files: Sequence[Path]) -> Iterator[tuple[Path, int, str, str]]:
    """Every (file, line, text, changed text), in the order of a hash; tables of texts and comments apart."""
    sites = []
    for path in files:
        for line, text in enumerate(path.read_text().splitlines()):
            code = text.partition("/*")[0].rstrip()
            if not code or text.lstrip().startswith(("*", "#include")) or _FOR_PEOPLE.search(text):
                continue
            for pattern, new in _CHANGES:
                for found in re.finditer(pattern, code):
                    replaced = str(int(found[1]) + 1) if new is None else new
                    sites.append((path, line, text, text[: found.start()] + replaced + text[found.end() :]))
    yield from sorted(
        sites, key=lambda it: blake2b(repr((it[0].name, *it[1:])).encode(), digest_size=8).digest()
    )


def _compiled(board: Board, folder: Path, path: Path, line: int, changed: str) -> bool:
    """Compiles the board with this line into `mutant`; False if it is no C."""
    source = path.read_text().splitlines()
    (folder / path.name).write_text("\n".join([*source[:line], changed, *source[line + 1 :], ""]))
    others = [it for it in path.parent.glob("*.c") if it != path] if board.is_whole else []
    command = [
        *_CC,
        str(folder / "mutant"),
        str(folder / path.name),
        *map(str, others),
        str(NATIVE / "musselbed.c"),
    ]
    return subprocess.run(command, capture_output=True, timeout=120, check=False).returncode == 0


def _first_failed(program: Path, cases: Iterator[Case] | Sequence[Case]) -> Case | None:
    """The first case that the program does not pass."""
    for case in cases:
        result = judged(case, our_rig, lambda it: rig_of(program, it), FirmwareFailed, {})
        if result.verdict is not Verdict.PASSED:
            return case
    return None
