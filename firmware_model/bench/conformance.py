"""The conformance kit: cases for firmware on a board of the worst case, and their judge, which sees the outside of a board.

A case is a script of stimuli. The judge compares what two boards do in it, ours and the one under test: when their motors
run, when their batteries charge, which bytes they send, and their charge at the end. It sees no state. Passing is a least
filter: it shows that no case failed, and not that the firmware is right.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from hashlib import blake2b

from firmware_model.actions import RunBuoyancy, SendBytes
from firmware_model.bench.bench import Bench
from firmware_model.packets import CommandPacket, Kind
from firmware_model.power.charge import FULL, Flow
from firmware_model.stimuli import BottomReached, PacketHeard, ResetCause, SurfaceReached, WifiReceived

_UNITS_MS = {"ms": 1, "s": 1000, "min": 60_000, "h": 3_600_000}
_COMMANDS = {
    kind.name.lower(): kind for kind in (Kind.PERMISSION, Kind.RELEASE, Kind.PING, Kind.HOVER, Kind.SINK)
}
_RESETS = {cause.name.lower(): cause for cause in (ResetCause.BROWN_OUT, ResetCause.WATCHDOG)}
_WAIT = re.compile(r"(\d+)(ms|s|min|h)")
_CHATTER = re.compile(r"chatter:(\d+):(\d+):(\d+)")
_TRACED = re.compile(r"(\d+(?:\.\d+)?)\s*([<>])\s*(.+)")
_TRAVEL = re.compile(r"travel:(\d+)(s|min|h)")
_END_MS = 500
"""The time after a script in which its last word still has an effect."""
_ENERGY = 0.003
"""The charges at a case's end may differ by so much of what flowed."""
_FASTEST = FULL * 4 // 1000 // 60_000
"""Grains a millisecond that no charge or load of the worst case exceeds: an event within its tolerance moves so much."""


class Source(StrEnum):
    """The origin of a requirement; firmware that differs from our own choice does not fail."""

    PAPER = "paper"
    PACKETS = "docs/packets.md"
    STATES = "docs/firmware-states.md"
    CHOICE = "our choice"
    CAPTURED = "a captured trace"


class Verdict(StrEnum):
    PASSED = "passed"
    FAILED = "FAILED"
    DIFFERS = "differs"
    WAIVED = "waived"


@dataclass(frozen=True, slots=True)
class Case:
    """`script`: waits (`50ms`, `2s`, `5min`, `1h`) and stimuli (`STIMULI`), from power-on on the bottom."""

    name: str
    source: Source
    requirement: str
    script: str
    primary: float = 1.0
    """The charge at power-on."""
    tolerance_ms: int = 20


@dataclass(frozen=True, slots=True)
class Event:
    """Something that the outside of a board shows: the motors, the charger, or bytes."""

    at_ms: int
    what: str

    def __str__(self) -> str:
        return f"{self.at_ms / 1000:.3f} s {self.what}"


@dataclass(frozen=True, slots=True)
class History:
    """A board's deeds in a case."""

    events: tuple[Event, ...]
    charge: int | None
    """None in a captured trace, which has no charge."""
    flowed: int
    """The grains that flowed into and out of its battery."""
    failure: str | None = None
    """The reason why its firmware could do no more; None if it lived."""


@dataclass(frozen=True, slots=True)
class Result:
    case: Case
    verdict: Verdict
    reason: str
    ours: History
    theirs: History


STIMULI = (
    *_COMMANDS,
    "rises",
    "falls",
    "rises_unseen",
    "falls_unseen",
    *_RESETS,
    "sound:HEX and wifi:HEX, any bytes",
    "chatter:HIGH:LOW:TIMES, the pin in ms",
    "surfaced",
    "landed",
    "travel:60s, the time that the body takes from now on",
)


def judged(
    case: Case,
    ours: Callable[[float], Bench] | History,
    theirs: Callable[[float], Bench],
    failures: type[Exception],
    waivers: dict[str, str],
    late_ms: int = 0,
) -> Result:
    """Runs the case on both boards.

    `ours` and `theirs` make a board of a charge, or `ours` is a captured history. Dead firmware raises `failures`.

    `late_ms`: each event may delay those that follow from it by so much more than the case's tolerance.
    """
    expected = ours if isinstance(ours, History) else history(case, ours, failures)
    found = history(case, theirs, failures)
    reason = _difference(case, expected, found, late_ms)
    if reason is None:
        verdict = Verdict.PASSED
    elif case.name in waivers:
        verdict, reason = Verdict.WAIVED, f"{waivers[case.name]} ({reason})"
    else:
        verdict = Verdict.DIFFERS if case.source is Source.CHOICE and not found.failure else Verdict.FAILED
    return Result(case, verdict, reason or "", expected, found)


def lasts_ms(script: str) -> int:
    """The time that a script takes on a board whose time is the wall's."""
    lasting_ms = _END_MS
    for token in script.split():
        if found := _WAIT.fullmatch(token):
            lasting_ms += int(found[1]) * _UNITS_MS[found[2]]
        elif found := _CHATTER.fullmatch(token):
            high_ms, low_ms, times = map(int, found.groups())
            lasting_ms += (high_ms + low_ms) * times
    return lasting_ms


def captured(text: str, name: str) -> tuple[Case, History]:
    """A case from a board's trace, and what the board did. ValueError names a line that is none.

    Each line has a time in seconds, `<` and a word of a script, or `>` and an event as `Event.what` has it.
    """
    words: list[str] = []
    events: list[Event] = []
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
            events.append(Event(at_ms, found[3]))
        if wait_ms := at_ms - end_ms:
            words.append(f"{wait_ms}ms")
        end_ms = at_ms
        if found[2] == "<":
            words.append(found[3])
    case = Case(name, Source.CAPTURED, "the board whose trace it is", " ".join(words))
    return case, History(tuple(events), charge=None, flowed=0)


def traced(case: Case, found: History) -> Iterator[str]:
    """The lines of a trace that `captured` reads: the script's words and the board's events, in the order of time."""
    now_ms = 0
    lines = []
    for token in case.script.split():
        waited_ms = lasts_ms(token) - _END_MS
        if not _WAIT.fullmatch(token):
            lines.append((now_ms, f"{now_ms / 1000:.3f} < {token}"))
        now_ms += waited_ms
    lines += [(it.at_ms, f"{it.at_ms / 1000:.3f} > {it.what}") for it in found.events]
    lines.append((now_ms, f"{now_ms / 1000:.3f} < 0ms"))
    yield from (line for _, line in sorted(lines, key=lambda it: it[0]))


def history(case: Case, make: Callable[[float], Bench], failures: type[Exception]) -> History:
    bench = make(case.primary)
    failure = None
    try:
        for token in case.script.split():
            _play(bench, token)
        bench.run(ms=_END_MS)
    except failures as raised:
        failure = str(raised)
    events = [Event(it.at_ms, f"motors {it.to.name.lower()}") for it in bench.did(RunBuoyancy)]
    events += [Event(it.at_ms, f"sends {it.data.hex()}") for it in bench.did(SendBytes)]
    flowed, before = 0, None
    charging = False
    for at_ms, primary, _ in bench.courses:
        if (primary.flow is Flow.CHARGING) is not charging:
            charging = not charging
            events.append(Event(at_ms, "charges" if charging else "stops charging"))
        flowed += abs(primary.charge - (primary.charge if before is None else before))
        before = primary.charge
    flowed += abs(bench.primary - (bench.primary if before is None else before))
    return History(tuple(sorted(events, key=lambda it: it.at_ms)), bench.primary, flowed, failure)


def _difference(case: Case, ours: History, theirs: History, late_ms: int) -> str | None:
    """The first difference, in words; None for none."""
    if theirs.failure is not None:
        return f"its firmware failed: {theirs.failure}"
    for n in range(max(len(ours.events), len(theirs.events))):
        expected = ours.events[n] if n < len(ours.events) else None
        found = theirs.events[n] if n < len(theirs.events) else None
        if expected is None or found is None or expected.what != found.what:
            return f"expected {expected or 'nothing more'}, found {found or 'nothing more'}"
        if abs(expected.at_ms - found.at_ms) > case.tolerance_ms + late_ms * (n + 2):
            return f"expected {expected}, found it at {found.at_ms / 1000:.3f} s"
    count = len(ours.events) + 1
    late = _FASTEST * (case.tolerance_ms + late_ms * (count + 1)) * count
    if ours.charge is None or theirs.charge is None:
        return None
    if abs(ours.charge - theirs.charge) > _ENERGY * ours.flowed + late:
        return f"expected a charge of {ours.charge / FULL:.4f} at the end, found {theirs.charge / FULL:.4f}"
    return None


def side_by_side(result: Result) -> Iterator[str]:
    """Both histories, a line an event: its mark, what was expected, what was found."""
    ours, theirs = (list(map(str, it.events)) for it in (result.ours, result.theirs))
    width = max([len(line) for line in ours] + [8])
    yield f"   {'expected':{width}}  found"
    for n in range(max(len(ours), len(theirs))):
        left, right = (lines[n] if n < len(lines) else "" for lines in (ours, theirs))
        yield f" {' ' if left == right else '!'} {left:{width}}  {right}"
    if result.theirs.failure is not None:
        yield f" ! {'':{width}}  {result.theirs.failure}"


def _play(bench: Bench, token: str) -> None:
    """Carries out one word of a script; ValueError for one that is none."""
    if found := _WAIT.fullmatch(token):
        bench.run(ms=int(found[1]) * _UNITS_MS[found[2]])
    elif found := _CHATTER.fullmatch(token):
        high_ms, low_ms, times = map(int, found.groups())
        bench.charge_pin_chatters(high_ms=high_ms, low_ms=low_ms, times=times)
    elif found := _TRAVEL.fullmatch(token):
        bench.travel_ms = int(found[1]) * _UNITS_MS[found[2]]
    elif token in _COMMANDS:
        bench.command(_COMMANDS[token])
    elif token in _RESETS:
        bench.reset(_RESETS[token])
    elif token.startswith(("rises", "falls")) and token[5:] in ("", "_unseen"):
        pin = bench.charge_pin_rises if token.startswith("rises") else bench.charge_pin_falls
        pin(noticed=not token[5:])
    elif token in ("surfaced", "landed"):
        bench.arrives(SurfaceReached() if token == "surfaced" else BottomReached())
    elif token.startswith(("sound:", "wifi:")):
        by, _, data = token.partition(":")
        bench.tell((PacketHeard if by == "sound" else WifiReceived)(bytes.fromhex(data)))
    else:
        raise ValueError(f"{token!r} is neither a wait nor one of {', '.join(STIMULI)}")


_RANDOM_TOKENS = (
    *(f"{n}ms" for n in (1, 20, 49, 50, 51, 400)),
    *(f"{n}s" for n in (1, 2, 30, 59, 60, 61, 120, 180)),
    *("5min", "1h", "3h", "13h"),
    *("permission", "release", "sink", "ping", "rises", "falls", "rises", "falls", "brown_out", "watchdog"),
    *("rises_unseen", "falls_unseen", "chatter:30:10:80"),
    *(f"sound:{CommandPacket(Kind.PERMISSION, agent_id).encode().hex()}" for agent_id in (0, 2)),
)


_NEAR_AN_EDGE = ("1ms", "49ms", "50ms", "51ms")
"""Waits that come so near to a debounce that firmware which takes time may decide otherwise."""


def random_cases(count: int, seed: int, takes_time: bool = False) -> Iterator[Case]:
    """Scripts of 4 to 19 random words, by a keyed hash of (seed, number).

    Those for firmware that `takes_time` have no wait near an edge, and 60 ms after each word, so that none of its turns
    coincides with a deadline of ours.
    """
    known = [it for it in _RANDOM_TOKENS if not takes_time or it not in _NEAR_AN_EDGE]
    for n in range(count):
        words = blake2b(f"{seed} {n}".encode(), digest_size=64).digest()
        tokens = [known[byte % len(known)] for byte in words[: 4 + words[63] % 16]]
        primary = (1.0, 0.5, 0.05)[words[62] % 3]
        requirement = "the same motors, charge and bytes as ours"
        script = (" 60ms " if takes_time else " ").join(["3s", "437ms", *tokens])
        yield Case(f"random-{seed}-{n}", Source.CHOICE, requirement, script, primary)


def shrunk(case: Case, differs: Callable[[Case], bool]) -> Case:
    """The case without all the words that it can lose while `differs` stays true."""
    tokens = case.script.split()
    n = 0
    while n < len(tokens):
        fewer = Case(
            case.name,
            case.source,
            case.requirement,
            " ".join(tokens[:n] + tokens[n + 1 :]),
            case.primary,
            case.tolerance_ms,
        )
        if differs(fewer):
            case, tokens = fewer, fewer.script.split()
        else:
            n += 1
    return case


def unknown_names(names: Iterable[str], cases: Iterable[Case]) -> list[str]:
    known = {case.name for case in cases}
    return [name for name in names if name not in known]
