"""A row of the campaign, and a try of it: what is done to a vehicle under way, and what its stop owes.

A row's function does it to a flight and returns the case that `judge` judges. Even tries heal what can heal, because a
vehicle that begins to move again by itself is as bad as one that never stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from safety.flight import FENCE, IMC_PORT, Flight, Setup
from safety.judge import Case, Kind, Told

WATCHDOG_LIMIT_S = 12.0
TETHER_LIMIT_S = 13.0
"""10 s without half a metre of progress, and 3 s."""
LOSSY_LIMIT_S = 30.0
"""30 % of the packets are lost and a way there and back takes 1 s: as soon as TCP can."""
SHOWN_S, AFTER_S = 12.0, 15.0
"""A fault that can heal does so after SHOWN_S, and the flight goes on for AFTER_S."""
GUSTS_M = 0.4
"""The gusts of the counterpart carry its hull so far in three seconds, without thrust."""
BOTH = ("a", "b")
SUPERVISOR = ("runs.supervisor_process",)
"""Words in the command lines of the laptop's processes."""
TABLE_TRIES, TRIES, LATCH_TRIES, SHORT_TRIES = 20, 5, 3, 2


@dataclass(slots=True)
class Try:
    """One try of a row: its flight, and its number from 0."""

    flight: Flight
    number: int
    minutes: float
    told: list[Told] = field(default_factory=list)

    @property
    def heals(self) -> bool:
        return self.number % 2 == 0

    def case(self, begun_s: float, **how: Any) -> Case:
        how |= {"told": tuple(self.told), "current_m_s": self.flight.setup.current_m_s}
        if self.flight.is_counterpart:
            how["rest_m"] = GUSTS_M
        return Case(self.flight.generation, FENCE, begun_s, **how)

    def order(self, *words: str) -> float:
        """A person's command and its answer; returns when it was given."""
        pressed = self.flight.person(*words, "--by", "judge")
        pressed.press()
        self.told.append(pressed.answer())
        return pressed.asked_s


Act = Callable[[Try], Case | dict[str, Case]]
"""One case, or several by name: an aPad's, and after a comma the disturbance's."""
Before = Callable[[Try], None]
PLAIN = Setup()


@dataclass(frozen=True, slots=True)
class Row:
    what: str
    act: Act
    setup: Setup = PLAIN
    generations: tuple[str, ...] = BOTH
    why_not: str = ""
    """The reason for a generation that is missing."""
    tries: int = TRIES
    is_short: bool = False
    """Among the rows of the short tier."""


def unless(good: bool, fault: str) -> tuple[str, ...]:
    return () if good else (fault,)


def nothing(it: Try) -> None:
    """Precedes a plain act."""


def stopped(
    *words: str,
    must_be: Kind | None = None,
    before: Before = nothing,
    after_s: float = AFTER_S,
    **how: Any,
) -> Act:
    """A person's order, after something that does not end the flight."""

    def act(it: Try) -> Case:
        before(it)
        begun_s = it.order(*words)
        it.flight.pause(after_s)
        return it.case(begun_s, must_be=must_be, **how)

    return act


SCRIPT, CALLS = Setup(flies="script"), Setup(flies="calls")
CONSOLES = Setup(run_words=("--console", "--imc", "--neptus", f"0x4001@127.0.0.1:{IMC_PORT}"))
LATE = "generation A answers by its topics, and has no services that could answer late"
