"""The conformance kit: cases for somebody's firmware, and their judge, which sees the outside of a board.

A case is a script of stimuli. The judge compares what two boards do in it, ours and the one under test: when their motors
run, when their batteries charge, which bytes they send, which states they tell, and their charges at the end. Passing is a
least filter: it shows that no case failed, and not that the firmware is right.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import StrEnum
from hashlib import blake2b
from itertools import zip_longest
from typing import Any, TypeVar

from firmware_model import packets
from firmware_model.bench.rigs import STATE, Rig, RigEvent, RigHistory, is_wait, lasts_ms
from firmware_model.config import BoardConfig, LastResort
from firmware_model.packets import (
    CommandPacket,
    Kind,
    LogAck,
    LogRecords,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.power.charge import FULL
from firmware_model.states import State
from firmware_model.table_one import worst_case_board

_TRACED = re.compile(r"(\d+(?:\.\d+)?)\s*([<>])\s*(.+)")
_END_MS = 600
"""The time after a script in which its last word still has an effect: the answer to a ping comes after 500 ms and more."""
_ENERGY = 0.003
"""The charges at a case's end may differ by so much of what flowed; and so may the times of Table I from the paper's."""
_FASTEST = FULL * 4 // 1000 // 60_000
"""Grains a millisecond that no charge or load of the worst case exceeds: an event within its tolerance moves so much."""
_WHOLE_FASTEST = FULL * 3 // 100 // 60_000
"""The same for a whole board, whose motors draw most."""
_BY_CHARGE = tuple(f"{STATE}{state.name}" for state in (State.EMPTY, State.LOST))
"""The states that begin when a battery is empty: 0.3 % of the energy moves them so far."""
_LONGEST_SHOWN = 64
"""The letters of an event in a table of two histories."""
_CHARGE = 1 / 255
"""The charges that two packets tell may differ by a step of the shortest one."""
_NEAR_AN_EDGE = ("1ms", "49ms", "50ms", "51ms")
"""Waits that come so near to a debounce that firmware which takes time may decide otherwise."""


class RequirementSource(StrEnum):
    """The origin of a requirement; firmware that differs from our own choice does not fail."""

    PAPER = "paper"
    PACKETS = "docs/packets.md"
    STATES = "docs/firmware-states.md"
    PORT = "docs/firmware-port.md"
    CHOICE = "our choice"
    CAPTURED = "a captured trace"
    SCRIPT = "our firmware"
    """A script that somebody, or chance, wrote: ours is the judge."""


class Verdict(StrEnum):
    PASSED = "passed"
    FAILED = "FAILED"
    DIFFERS = "differs"
    WAIVED = "waived"


@dataclass(frozen=True, slots=True)
class Whole:
    """The whole board of a case, by the words of the fixture `mu`."""

    sleep: str = "hourly"
    secondary: float = 1.0
    """The charge of the backup battery at power-on."""
    docked: bool = False
    """It is powered on in a dock, at the surface."""
    last_resort: LastResort = LastResort.WAIT
    metered: bool = False
    low_level: float = 0.0
    drift_ppm: int = 0
    """The drift of its counter and of its clock chip's crystal."""
    doubt_ppm: int | None = None
    """The bound of the drift that it assumes; None for a board that trusts its clock."""
    float_min: int = 720
    """It sinks again after so many minutes afloat."""
    report_min: int | None = None
    """The minutes between the reports that the experiment asks for; None for none."""
    uneven: bool = False
    """Each of its times differs from every other one and from the usual one; `sleep` has no effect."""
    turbid: bool = False
    """The water is beyond the range of a sensor."""
    secondary_in_use: bool = False
    """It works on its backup battery, too."""
    short_modem: bool = False
    """A v2 nanomodem, whose packets have 7 bytes."""


@dataclass(frozen=True, slots=True)
class PaperTime:
    """A time of the paper's Table I: from the first `begins` (or power-on) until `ends`, in minutes."""

    ends: str
    """One of `RigHistory.ends`."""
    least_min: float
    most_min: float
    """Two numbers where the paper has two: Table I's, and that of its own equation."""
    begins: str | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """`script`: waits (`50ms`, `2s`, `5min`, `1h`) and stimuli (`STIMULI`), from power-on on the bottom."""

    name: str
    source: RequirementSource
    requirement: str
    script: str
    primary: float = 1.0
    """The charge at power-on."""
    tolerance_ms: int = 20
    whole: Whole | None = None
    """None for the board of the worst case."""
    paper: PaperTime | None = None
    """A time that the board must have by the paper, whatever ours does."""
    is_near_tie: bool = False
    """Milliseconds decide it, so firmware that takes time may rightly decide otherwise."""
    agent_id: int = 1
    """The board's id. The commands by name are for aMussel 1."""
    uneven: bool = False
    """Each time of its worst case differs from the usual one, as with `Whole.uneven`."""
    counts_refusals: bool = False
    """Its board refuses as many inputs as ours."""
    shows: str | Callable[[Any], bool] | None = None
    """Without it the expected history would show nothing of the requirement: the begin of an event or of a state, or a
    test of a packet that is sent. None for a case in which nothing is to happen."""


def worst_case_of(case: Case) -> BoardConfig:
    """The board of a case that is no whole one's."""
    config = worst_case_board(case.agent_id)
    if not case.uneven:
        return config
    return replace(
        config,
        pin_debounce_ms=80,
        boot_ms=5000,
        surfacing_timeout_ms=240_000,
        float_timeout_ms=28_800_000,
        release_wait_ms=75_000,
    )


@dataclass(frozen=True, slots=True)
class CaseReading:
    """Another way to read the paper than ours. A board that is right by it differs, and does not fail."""

    requirement: str
    script: str
    """Every board that follows this reading plays it so, and no other one."""
    ours: Callable[[Case], Rig]
    """Makes a board of ours that follows it."""


@dataclass(frozen=True, slots=True)
class CaseResult:
    case: Case
    verdict: Verdict
    reason: str
    ours: RigHistory
    theirs: RigHistory


def judged(
    case: Case,
    ours: Callable[[Case], Rig] | RigHistory,
    theirs: Callable[[Case], Rig],
    failures: type[Exception],
    waivers: dict[str, str],
    late_ms: int = 0,
    readings: Sequence[CaseReading] = (),
) -> CaseResult:
    """Runs the case on both boards, and, where they differ, on a board of ours for each other reading of the paper.

    `ours` and `theirs` make a rig for a case, or `ours` is a captured history. Dead firmware raises `failures`.

    `late_ms`: each event, and each packet that the board takes, may delay those that follow from it by so much more than
    the case's tolerance.
    """
    expected = ours if isinstance(ours, RigHistory) else history(case, ours, failures)
    if not _shows(case, expected):
        raise AssertionError(f"the case {case.name} expects nothing of what it cites")
    found = history(case, theirs, failures)
    reason = _difference(case, expected, found, late_ms)
    if reason is None:
        verdict = Verdict.PASSED
    elif (reading := _reading(case, theirs, found, readings, failures, late_ms)) is not None:
        verdict, reason = Verdict.DIFFERS, f"{reading} ({reason})"
    elif case.name in waivers:
        verdict, reason = Verdict.WAIVED, f"{waivers[case.name]} ({reason})"
    else:
        verdict = (
            Verdict.DIFFERS
            if case.source is RequirementSource.CHOICE and not found.failure
            else Verdict.FAILED
        )
    return CaseResult(case, verdict, reason or "", expected, found)


def _reading(
    case: Case,
    theirs: Callable[[Case], Rig],
    found: RigHistory,
    readings: Sequence[CaseReading],
    failures: type[Exception],
    late_ms: int,
) -> str | None:
    """The other reading of the paper by which the board is right; None for none."""
    for reading in readings:
        whole = None if case.whole is None else Whole()
        sign = Case("the reading's sign", case.source, reading.requirement, reading.script, whole=whole)
        judges = ((case, found), (sign, history(sign, theirs, failures)))
        if all(
            _difference(it, history(it, reading.ours, failures), shown, late_ms) is None
            for it, shown in judges
        ):
            return reading.requirement
    return None


def _shows(case: Case, expected: RigHistory) -> bool:
    """True if the expected history has what the case cites."""
    if (shows := case.shows) is None:
        return True
    if isinstance(shows, str):
        told = (*expected.events, *(expected.states or ()), *expected.ends)
        return any(it.what.startswith(shows) for it in told)
    packets_sent = (_packet_of(it.what) for it in expected.events)
    return any(it is not None and shows(it) for it in packets_sent)


def captured(text: str, name: str) -> tuple[Case, RigHistory]:
    """A case from a board's trace, and what the board did. ValueError names a line that is none.

    Each line has a time in seconds, `<` and a word of a script, or `>` and an event as `RigEvent.what` has it.
    """
    words: list[str] = []
    events: list[RigEvent] = []
    states: list[RigEvent] = []
    end_ms = 0
    for number, line in enumerate(text.splitlines(), start=1):
        found = _TRACED.fullmatch(line.partition("#")[0].strip())
        if found is None:
            if line.partition("#")[0].strip():
                raise ValueError(f"line {number}: {line!r} is not a time, < or >, and a word or an event")
            continue
        at_ms = round(float(found[1]) * 1000)
        if at_ms < end_ms:
            raise ValueError(f"line {number}: time goes back to {found[1]} s")
        if found[2] == ">":
            (states if found[3].startswith(STATE) else events).append(RigEvent(at_ms, found[3]))
        if wait_ms := at_ms - end_ms:
            words.append(f"{wait_ms}ms")
        end_ms = at_ms
        if found[2] == "<":
            words.append(found[3])
    case = Case(name, RequirementSource.CAPTURED, "the board whose trace it is", " ".join(words))
    return case, RigHistory(tuple(events), charge=None, flowed=0, states=tuple(states) or None)


def traced(case: Case, found: RigHistory) -> Iterator[str]:
    """The lines of a trace that `captured` reads: the script's words and the board's events, in the order of time."""
    now_ms = 0
    lines = []
    for token in case.script.split():
        if not is_wait(token):
            lines.append((now_ms, f"{now_ms / 1000:.3f} < {token}"))
        now_ms += lasts_ms(token)
    lines += [
        (it.at_ms, f"{it.at_ms / 1000:.3f} > {it.what}") for it in (*found.events, *(found.states or ()))
    ]
    lines.append((now_ms, f"{now_ms / 1000:.3f} < 0ms"))
    yield from (line for _, line in sorted(lines, key=lambda it: it[0]))


def history(case: Case, make: Callable[[Case], Rig], failures: type[Exception]) -> RigHistory:
    """Plays the case. ValueError for a word that is none."""
    rig = make(case)
    try:
        for word in case.script.split():
            rig.play(word)
        rig.run(_END_MS)
    except failures as raised:
        return replace(rig.shown(), failure=str(raised))
    return rig.shown()


def _difference(case: Case, ours: RigHistory, theirs: RigHistory, late_ms: int) -> str | None:
    """The first difference, in words; None for none. A time of the paper is judged by the paper alone."""
    if theirs.failure is not None:
        return f"its firmware failed: {theirs.failure}"
    if case.paper is not None:
        return _paper_difference(case.paper, theirs)
    packets_taken = case.script.count("sound:") + case.script.count("wifi:")
    for n, (expected, found) in enumerate(zip_longest(ours.events, theirs.events), start=packets_taken):
        tolerance_ms = case.tolerance_ms + late_ms * (n + 2)
        if expected is None or found is None or not _is_alike(expected.what, found.what, tolerance_ms):
            return f"expected {_event_text(expected)}, found {_event_text(found)}{_other_values(expected, found)}"
        if abs(expected.at_ms - found.at_ms) > tolerance_ms:
            return f"expected {expected}, found it at {found.at_ms / 1000:.3f} s"
    if (difference := _state_difference(case, ours, theirs, late_ms)) is not None:
        return difference
    counts = case.counts_refusals and not late_ms  # a late turn sees several edges as one, or none
    if counts and ours.refused is not None and ours.refused != theirs.refused:
        return f"expected {ours.refused} refused inputs, found {theirs.refused}"
    count = len(ours.events) + 1
    fastest = _FASTEST if case.whole is None else _WHOLE_FASTEST
    late = fastest * (case.tolerance_ms + late_ms * (count + 1)) * count
    for battery, expects, finds, flowed in (
        ("", ours.charge, theirs.charge, ours.flowed),
        (" of the backup battery", ours.secondary, theirs.secondary, ours.secondary_flowed),
    ):
        if expects is not None and finds is not None and abs(expects - finds) > _ENERGY * flowed + late:
            return f"expected a charge{battery} of {expects / FULL:.4f} at the end, found {finds / FULL:.4f}"
    return None


def _state_difference(case: Case, ours: RigHistory, theirs: RigHistory, late_ms: int) -> str | None:
    """The first state that differs; those that held for no time are left out.

    A late turn may prolong or shorten a state. So one that holds about as long as a turn may be on one board alone.
    """
    if ours.states is None or theirs.states is None:
        return None
    least_ms = 1 + 2 * late_ms
    more_ms = least_ms + 2 * late_ms
    differences = [
        _first_difference(case, _lasting(ours.states, expects_ms), _lasting(theirs.states, finds_ms), late_ms)
        for expects_ms, finds_ms in dict.fromkeys(
            ((least_ms, least_ms), (least_ms, more_ms), (more_ms, least_ms))
        )
    ]
    return None if None in differences else differences[0]


def _first_difference(
    case: Case, expects: Iterator[RigEvent], finds: Iterator[RigEvent], late_ms: int
) -> str | None:
    for n, (expected, found) in enumerate(zip_longest(expects, finds)):
        if expected is None or found is None or expected.what != found.what:
            return f"expected {_event_text(expected)}, found {_event_text(found)}"
        by_charge_ms = _ENERGY * expected.at_ms if expected.what in _BY_CHARGE else 0
        if abs(expected.at_ms - found.at_ms) > case.tolerance_ms + late_ms * (n + 2) + by_charge_ms:
            return f"expected {expected}, found it at {found.at_ms / 1000:.3f} s"
    return None


def _lasting(states: Sequence[RigEvent], least_ms: int) -> Iterator[RigEvent]:
    """The states that held for `least_ms` or more. One board may pass through a state that another leaves out."""
    former = ""
    for state, after in zip_longest(states, states[1:]):
        if (after is None or after.at_ms - state.at_ms >= least_ms) and state.what != former:
            yield state
            former = state.what


def _paper_difference(paper: PaperTime, theirs: RigHistory) -> str | None:
    began_ms = next((it.at_ms for it in theirs.events if it.what == paper.begins), 0)
    at_ms = next((it.at_ms for it in theirs.ends if it.what == paper.ends and it.at_ms >= began_ms), None)
    told = (
        f"{paper.most_min:g} min"
        if paper.least_min == paper.most_min
        else f"{paper.least_min:g} to {paper.most_min:g} min"
    )
    if at_ms is None:
        return f"after {told} {paper.ends} in the paper, and here never"
    found_min = (at_ms - began_ms) / 60_000
    if (1 - _ENERGY) * paper.least_min <= found_min <= (1 + _ENERGY) * paper.most_min:
        return None
    return f"after {told} {paper.ends} in the paper, and here after {found_min:.1f} min"


def _event_text(event: RigEvent | None) -> str:
    """The event in a few words: of a long packet its beginning and its size."""
    if event is None:
        return "nothing more"
    text = str(event)
    if len(text) <= _LONGEST_SHOWN:
        return text
    size = len(text.rpartition(" ")[2]) // 2
    return f"{text[: _LONGEST_SHOWN - 12]}... ({size} bytes)"


def _other_values(expected: RigEvent | None, found: RigEvent | None) -> str:
    """The values in which two packets of one kind differ."""
    if expected is None or found is None:
        return ""
    ours, theirs = _packet_of(expected.what), _packet_of(found.what)
    return "" if ours is None or type(ours) is not type(theirs) else "".join(_differing(ours, theirs))


def _differing(ours: Any, theirs: Any) -> Iterator[str]:
    for name in (it.name for it in fields(ours) if it.name != "data"):
        one, other = getattr(ours, name), getattr(theirs, name)
        if is_dataclass(one) and type(one) is type(other):
            yield from _differing(one, other)
        elif one != other:
            yield f"; its {name} is {getattr(other, 'name', other)} and not {getattr(one, 'name', one)}"


def _packet_of(what: str) -> Any:
    """The packet of an event that sends one; None for another, and for bytes that are none."""
    return packets.decode(bytes.fromhex(what.rpartition(" ")[2])) if what.startswith("sends ") else None


def _is_alike(expected: str, found: str, tolerance_ms: int) -> bool:
    """True for equal deeds, and for packets that differ in their time and in charges by their tolerances alone."""
    if expected == found:
        return True
    if expected.rpartition(" ")[0] != found.rpartition(" ")[0]:
        return False
    ours, theirs = _packet_of(expected), _packet_of(found)
    return ours is not None and _has_values_of(ours, theirs, tolerance_ms)


def _has_values_of(ours: Any, theirs: Any, tolerance_ms: int) -> bool:
    if type(ours) is not type(theirs):
        return False
    if isinstance(ours, LogRecords):
        head = all(
            getattr(ours, it) == getattr(theirs, it) for it in ("agent_id", "oldest", "first", "covered")
        )
        return (
            head
            and len(ours.records) == len(theirs.records)
            and all(
                _has_values_of(*pair, tolerance_ms) for pair in zip(ours.records, theirs.records, strict=True)
            )
        )
    for name in (it.name for it in fields(ours)):
        one, other = getattr(ours, name), getattr(theirs, name)
        if is_dataclass(one):
            same = _has_values_of(one, other, tolerance_ms)
        elif name in ("agent_ms", "clock_offset_ms"):
            same = abs(one - other) <= tolerance_ms
        elif name in ("primary", "secondary"):
            same = abs(one - other) <= _CHARGE
        else:
            same = one == other
        if not same:
            return False
    return True


def side_by_side(result: CaseResult) -> Iterator[str]:
    """Both histories, a line an event: its mark, what was expected, what was found. States follow where they differ."""
    ours, theirs = result.ours, result.theirs
    pairs = list(zip_longest(ours.events, theirs.events))
    if ours.states is not None and theirs.states is not None and ours.states != theirs.states:
        pairs += zip_longest(ours.states, theirs.states)
    lines = [
        ("" if left is None else _event_text(left), "" if right is None else _event_text(right))
        for left, right in pairs
    ]
    width = max([len(left) for left, _ in lines] + [8])
    yield f"   {'expected':{width}}  found"
    for (left, right), (expected, found) in zip(lines, pairs, strict=True):
        yield f" {' ' if expected == found else '!'} {left:{width}}  {right}"
        if values := _other_values(expected, found):
            yield f"     {values.removeprefix('; ')}"
    if theirs.failure is not None:
        yield f" ! {'':{width}}  {theirs.failure}"


_WAITS = (
    *(f"{n}ms" for n in (1, 20, 49, 50, 51, 400)),
    *(f"{n}s" for n in (1, 2, 30, 59, 60, 61, 120, 180)),
    *("5min", "20min", "1h", "3h", "13h"),
)
_AFTER_THE_HOUR_MS = (-1000, 5000, 30_000, 75_000, 200_000, 300_000)
"""From a whole hour: before a wake, in its parts, and in a timeslot."""
_LONGEST_MS = 46 * 3_600_000
_PINS = ("rises", "falls", "rises", "falls", "rises_unseen", "falls_unseen", "chatter:30:10:80")
_RANDOM_TOKENS = (
    *("permission", "permission", "release", "sink", "ping", "brown_out", "watchdog", "surfaced", "landed"),
    *_PINS,
    *(f"sound:{CommandPacket(Kind.PERMISSION, agent_id).encode().hex()}" for agent_id in (0, 2)),
)
_WHOLE_TOKENS = (
    *_RANDOM_TOKENS,
    *("hover", "slips", "beacon:90000000", "loses:20", "loses:90", "loses:100", "jam:1", "jam:0"),
    *(f"sound:{SleepSchedule(1, 600_000, wake_ms).encode().hex()}" for wake_ms in (20_000, 600_000)),
    *(f"sound:{SlotAssignment(1, 300_000, 3000, 500, index, 0).encode().hex()}" for index in (7, 99, 100)),
    *(f"sound:{SetThreshold(1, which, 0.5).encode().hex()}" for which in Threshold),
    *(f"wifi:{CommandPacket(kind, 1).encode().hex()}" for kind in (Kind.SINK, Kind.BACK_UP_LOG)),
    f"wifi:{LogAck(1, 2).encode().hex()}",
)
_BEACONS_MS = (-500, 0, 0, 30_000, 3_600_000)
"""The times that beacons tell, from the true one."""
T = TypeVar("T")


class _Chance:
    """Draws by a keyed hash of (seed, number of the script, number of the draw)."""

    def __init__(self, seed: int, number: int) -> None:
        self._key = f"{seed} {number}"
        self._drawn = 0

    def one_of(self, *options: T) -> T:
        self._drawn += 1
        digest = blake2b(f"{self._key} {self._drawn}".encode(), digest_size=8).digest()
        return options[int.from_bytes(digest, "little") % len(options)]


def _random_board(chance: _Chance) -> Whole:
    return Whole(
        sleep=chance.one_of("field", "field", "hourly", "never"),
        secondary=chance.one_of(1.0, 1.0, 0.3, 0.19),
        last_resort=chance.one_of(*LastResort),
        low_level=chance.one_of(0.0, 0.0, 0.3),
        drift_ppm=chance.one_of(0, 0, 60),
        doubt_ppm=chance.one_of(None, 35, 200),
        float_min=chance.one_of(720, 60),
        secondary_in_use=chance.one_of(False, False, True),
    )


def _random_script(
    chance: _Chance, waits: Sequence[str], tokens: Sequence[str], is_whole: bool
) -> Iterator[str]:
    """From 6 to 30 waits, each with one or two stimuli, for 48 h at most. No word falls on a whole second."""
    now_ms = 3437
    yield from ("3s", "437ms")
    for _ in range(chance.one_of(*range(6, 31))):
        wait = chance.one_of(*waits)
        if is_whole and chance.one_of(True, False, False):
            hour_ms = -(-now_ms // 3_600_000) * 3_600_000 + 3_600_000 * chance.one_of(0, 0, 1, 3)
            wait = f"{max(0, hour_ms + chance.one_of(*_AFTER_THE_HOUR_MS) + 437 - now_ms)}ms"
        now_ms += lasts_ms(wait)
        if now_ms > _LONGEST_MS:
            break
        yield wait
        for _ in range(chance.one_of(1, 1, 2)):
            is_beacon = is_whole and chance.one_of(*range(8)) == 0
            word = f"beacon:{now_ms + chance.one_of(*_BEACONS_MS)}" if is_beacon else chance.one_of(*tokens)
            now_ms += lasts_ms(word)
            yield word
    yield "1h"


def random_cases(count: int, seed: int, takes_time: bool = False, is_whole: bool = False) -> Iterator[Case]:
    """Scripts of random words on random boards, for 48 h at most, by a keyed hash of (seed, number).

    Those for firmware that `takes_time` have no wait near an edge, and 60 ms after each word, so that none of its turns
    coincides with a deadline of ours.
    """
    tokens = _WHOLE_TOKENS if is_whole else _RANDOM_TOKENS
    waits = [it for it in _WAITS if not takes_time or it not in _NEAR_AN_EDGE]
    for n in range(count):
        chance = _Chance(seed, n)
        whole = _random_board(chance) if is_whole else None
        yield Case(
            f"random-{seed}-{n}",
            RequirementSource.SCRIPT,
            "the same as ours",
            (" 60ms " if takes_time else " ").join(_random_script(chance, waits, tokens, is_whole)),
            chance.one_of(1.0, 1.0, 0.5, 0.05),
            whole=whole,
            counts_refusals=True,
        )


def shrunk(case: Case, differs: Callable[[Case], bool]) -> Case:
    """The case without all the words that it can lose while `differs` stays true."""
    tokens = case.script.split()
    n = 0
    while n < len(tokens):
        fewer = replace(case, script=" ".join(tokens[:n] + tokens[n + 1 :]))
        if differs(fewer):
            case, tokens = fewer, fewer.script.split()
        else:
            n += 1
    return case


def unknown_names(names: Iterable[str], cases: Iterable[Case]) -> list[str]:
    known = {case.name for case in cases}
    return [name for name in names if name not in known]
