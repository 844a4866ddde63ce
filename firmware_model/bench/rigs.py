"""The words of a conformance script, and the rig that plays them on one board of the worst case."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from firmware_model.actions import Dropped, RunBuoyancy, SendBytes, StateChanged, StateReported
from firmware_model.bench.bench import Bench
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.command_packets import TRIGGERS
from firmware_model.packets.wire import PLAIN
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow
from firmware_model.states import State
from firmware_model.stimuli import BottomReached, PacketHeard, ResetCause, SurfaceReached, WifiReceived

_UNITS_MS = {"ms": 1, "s": 1000, "min": 60_000, "h": 3_600_000}
COMMANDS = {kind.name.lower(): kind for kind in TRIGGERS}
"""By word, the commands that a state takes."""
_RESETS = {cause.name.lower(): cause for cause in (ResetCause.BROWN_OUT, ResetCause.WATCHDOG)}
_WAIT = re.compile(r"(\d+)(ms|s|min|h)")
_CHATTER = re.compile(r"chatter:(\d+):(\d+):(\d+)")
_TRAVEL = re.compile(r"travel:(\d+)(s|min|h)")
STIMULI = (
    *COMMANDS,
    "rises",
    "falls",
    "rises_unseen",
    "falls_unseen",
    *_RESETS,
    "sound:HEX and wifi:HEX, any bytes",
    "chatter:HIGH:LOW:TIMES, the pin in ms",
    "surfaced and landed, by a hand or a net",
    "travel:60s, the time that the body takes from now on",
)
"""The words that every rig plays, besides waits."""
STATE = "state "
"""Before the name of a state, in an event that tells it."""


@dataclass(frozen=True, slots=True)
class RigEvent:
    """Something that the outside of a board shows: the motors, the charger, or bytes."""

    at_ms: int
    what: str

    def __str__(self) -> str:
        return f"{self.at_ms / 1000:.3f} s {self.what}"


@dataclass(frozen=True, slots=True)
class RigHistory:
    """A board's deeds in a case."""

    events: tuple[RigEvent, ...]
    charge: int | None
    """The primary's at the end, in grains. None in a captured trace, which has no charge."""
    flowed: int
    """The grains that flowed into and out of its primary battery."""
    failure: str | None = None
    """The reason why its firmware could do no more; None if it lived."""
    secondary: int | None = None
    """The secondary's charge at the end, on a whole board."""
    secondary_flowed: int = 0
    ends: tuple[RigEvent, ...] = ()
    """When its batteries became full or empty."""
    refused: int | None = None
    """The inputs that its hardware or its firmware refused. None in a captured trace."""
    states: tuple[RigEvent, ...] | None = None
    """The states that it told, and since when. None in a trace that has none."""


class Rig(ABC):
    """A board on which a script is played, word by word."""

    def play(self, word: str) -> None:
        """Carries out one word of a script; ValueError for one that is none."""
        if found := _WAIT.fullmatch(word):
            self.run(int(found[1]) * _UNITS_MS[found[2]])
        elif found := _CHATTER.fullmatch(word):
            high_ms, low_ms, times = map(int, found.groups())
            for _ in range(times):
                self.pin(True, noticed=True)
                self.run(high_ms)
                self.pin(False, noticed=True)
                self.run(low_ms)
        elif word in COMMANDS:
            self.command(COMMANDS[word])
        elif word in _RESETS:
            self.reset(_RESETS[word])
        elif word.startswith(("rises", "falls")) and word[5:] in ("", "_unseen"):
            self.pin(word.startswith("rises"), noticed=not word[5:])
        elif word.startswith(("sound:", "wifi:")):
            by, _, data = word.partition(":")
            self.receive(bytes.fromhex(data), by_sound=by == "sound")
        elif found := _TRAVEL.fullmatch(word):
            self.travels_in(int(found[1]) * _UNITS_MS[found[2]])
        elif word in ("surfaced", "landed"):
            self.arrives(at_surface=word == "surfaced")
        elif not self.play_own(word):
            raise ValueError(
                f"{word!r} is neither a wait nor one of {', '.join((*STIMULI, *self.own_stimuli()))}"
            )

    @abstractmethod
    def run(self, ms: int) -> None:
        """Lets time pass."""

    @abstractmethod
    def pin(self, high: bool, *, noticed: bool) -> None:
        """Gives the charger's pin a level; `noticed` False loses the edge's interrupt."""

    @abstractmethod
    def receive(self, data: bytes, *, by_sound: bool) -> None:
        """Delivers a packet by sound, or by Wi-Fi."""

    @abstractmethod
    def reset(self, cause: ResetCause) -> None: ...

    @abstractmethod
    def travels_in(self, ms: int) -> None:
        """Sets the time that the body takes from the bottom to the surface, and back."""

    @abstractmethod
    def arrives(self, *, at_surface: bool) -> None:
        """Brings the body to the surface or to the bottom at once, whatever its motors did."""

    def play_own(self, word: str) -> bool:
        """Carries out a word that this rig alone has; False for one that is none."""
        return False

    def own_stimuli(self) -> Sequence[str]:
        """The words that this rig alone has."""
        return ()

    @abstractmethod
    def shown(self) -> RigHistory:
        """Everything that the outside of the board has shown; the program on it ends."""

    def command(self, kind: Kind) -> None:
        """Sends a command to the board (id 1): by the medium of its kind."""
        self.receive(CommandPacket(kind, 1).encode(), by_sound=not PLAIN[kind].by_wifi)


class BenchRig(Rig):
    """A board of the worst case on the bench."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench

    def run(self, ms: int) -> None:
        self.bench.run(ms=ms)

    def pin(self, high: bool, *, noticed: bool) -> None:
        (self.bench.charge_pin_rises if high else self.bench.charge_pin_falls)(noticed=noticed)

    def receive(self, data: bytes, *, by_sound: bool) -> None:
        self.bench.tell((PacketHeard if by_sound else WifiReceived)(data))

    def reset(self, cause: ResetCause) -> None:
        self.bench.reset(cause)

    def travels_in(self, ms: int) -> None:
        self.bench.travel_ms = ms

    def arrives(self, *, at_surface: bool) -> None:
        self.bench.arrives(SurfaceReached() if at_surface else BottomReached())

    def shown(self) -> RigHistory:
        bench = self.bench
        bench.close()
        course = [(at_ms, primary) for at_ms, primary, _ in bench.courses]
        # Of what happens at one time, the cause comes first: the charger's edge before the motors that it starts.
        events = list(charging(course))
        events += [RigEvent(it.at_ms, f"motors {it.to.name.lower()}") for it in bench.did(RunBuoyancy)]
        events += [RigEvent(it.at_ms, f"sends {it.data.hex()}") for it in bench.did(SendBytes)]
        model, now_ms = bench.config.charge, bench.now_ms
        return RigHistory(
            tuple(sorted(events, key=lambda it: it.at_ms)),
            bench.primary,
            flowed(course, bench.primary),
            ends=tuple(ends("the primary", course, model, now_ms)),
            refused=len(bench.did(Dropped)),
            states=tuple(
                states(
                    (it.at_ms, it.new) for it in bench.trace if isinstance(it, StateChanged | StateReported)
                )
            ),
        )


def states(steps: Iterable[tuple[int, State]]) -> Iterator[RigEvent]:
    """The states that a board told, each once; a step into the same state is none."""
    former = None
    for at_ms, state in steps:
        if state is not former:
            yield RigEvent(at_ms, f"{STATE}{state.name}")
        former = state


Course = Sequence[tuple[int, Battery]]
"""(from ms, battery): the course of a battery, piece by piece."""


def charging(course: Course) -> Iterator[RigEvent]:
    """When its charger began and stopped."""
    is_charging = False
    for at_ms, battery in course:
        if (battery.flow is Flow.CHARGING) is not is_charging:
            is_charging = not is_charging
            yield RigEvent(at_ms, "charges" if is_charging else "stops charging")


def flowed(course: Course, charge: int) -> int:
    """The grains that flowed in and out up to the present `charge`."""
    charges = [battery.charge for _, battery in course] + [charge]
    return sum(abs(after - before) for before, after in pairwise(charges))


def ends(name: str, course: Course, model: ChargeModel, until_ms: int) -> Iterator[RigEvent]:
    """When the battery became full or empty."""
    befores: Iterable[int] = [*(at_ms for at_ms, _ in course[1:]), until_ms]
    for (_, battery), before_ms in zip(course, befores, strict=True):
        for level, reached_ms, told in (
            (FULL, model.reaches_at_ms(battery, FULL), "full"),
            (0, model.empty_at_ms(battery), "empty"),
        ):
            if reached_ms is not None and reached_ms <= before_ms and battery.charge != level:
                yield RigEvent(reached_ms, f"{name} is {told}")


def lasts_ms(script: str) -> int:
    """The time that a script takes on a board whose time is the wall's."""
    lasting_ms = 0
    for word in script.split():
        if found := _WAIT.fullmatch(word):
            lasting_ms += int(found[1]) * _UNITS_MS[found[2]]
        elif found := _CHATTER.fullmatch(word):
            high_ms, low_ms, times = map(int, found.groups())
            lasting_ms += (high_ms + low_ms) * times
    return lasting_ms


def is_wait(word: str) -> bool:
    return _WAIT.fullmatch(word) is not None
