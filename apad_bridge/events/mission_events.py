"""Events of the mission: its state, plans and ways, and what became of each aMussel that it serves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated, NotRequired, TypedDict

from apad_bridge.events.event import AMussel, Category, DockIndex, Event, Meaning, Reason
from apad_bridge.events.run_events import EndReason
from apad_bridge.planning.solution import Step
from apad_bridge.scenario.choices import PAPER_DOCKS

PRE_EMPTED = "pre-empted"
"""The reason of a primitive that makes way for another: it has not failed."""


class Phase(StrEnum):
    """The boxes of the paper's Fig. 7, with each routine split into its parts."""

    IDLE = "idle wait"
    GO_COLLECT = "go to aMussel"
    AWAIT_SURFACING = "await surfacing"
    DOCK = "dock"
    CHARGE = "charging wait"
    GO_DEPLOY = "go to deployment"
    UNDOCK = "undock"
    GO_HOME = "go home"
    """No box of the figure, nor the next: the aPad is to be charged, or is unavailable."""
    AT_HOME = "at home"
    COMMANDED = "by hand or script"
    """No box of the figure: a script or a person gives the orders."""
    STANDS_DOWN = "stands down"
    """No box either: one of several aPads cannot go on, and others take over its aMussels."""
    ENDED = "ended"


class PrimitivePhase(StrEnum):
    STARTED = "started"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    NOTHING_CAUGHT = "nothing_caught"


class ExchangePhase(StrEnum):
    PLANNED = "planned"
    UNDONE = "undone"
    """The one that was to be released has its own place again, as the other one was not collected."""
    HALF_DONE = "half done"
    """Both are at one place: one was released there, and the other one was not collected."""
    FINISHED = "finished"
    """The other one was collected after all, and is brought to the place that is empty."""


_Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class MissionEnd:
    """A reason, and the text for people where it says more than the reason; the text alone is `str(end)`."""

    reason: EndReason
    text: str = ""

    def __str__(self) -> str:
        return self.text or self.reason.value


@dataclass(frozen=True, slots=True)
class Leg:
    """The way of the go-to under way. Points are (north, east) in metres."""

    primitive_id: int
    start: _Point
    goal: _Point
    counted: _Point
    """The point up to which the driven way is counted."""

    @property
    def planned_m(self) -> float:
        return math.dist(self.start, self.goal)


@dataclass(frozen=True, slots=True)
class MissionState:
    """The mission's whole state, journaled at every change. Times are mission milliseconds."""

    phase: Phase = Phase.IDLE
    since_ms: int = 0
    plan: tuple[Step, ...] = ()
    """The steps not yet finished, the one under way first."""
    dock_count: int = PAPER_DOCKS
    docked: tuple[tuple[int, int], ...] = ()
    """The docks as the docking port last told them: (dock index, agent)."""
    homes: tuple[tuple[int, float, float], ...] = ()
    """(agent, north, east): the place to which each aMussel is brought back. It was first heard there, or has taken it from
    another one."""
    primitive_id: int = 0
    """The id of the primitive under way."""
    leg: Leg | None = None
    """The leg under way, for a go-to."""
    cost_m: float = 0.0
    """Metres driven on legs."""
    planned_m: float = 0.0
    """Metres of the straight legs; see `OrderBook`."""
    services: int = 0
    leaves_full: bool = False
    """The aMussel being undocked was believed full at the order, which counts because sinking costs charge."""
    failed_tries: tuple[tuple[int, int], ...] = ()
    """(agent, number of tries to serve it that failed since one last helped), by agent; only those above 0."""
    failed_undockings: tuple[tuple[int, int], ...] = ()
    """(agent, number of failed tries to open the dock that holds it), by agent; only those above 0."""
    released: tuple[tuple[int, int], ...] = ()
    """(agent, mission ms of its last release), by agent."""
    exchanged: tuple[tuple[int, int, ExchangePhase], ...] = ()
    """(released, collected, phase) of each exchange of places that is not over: planned, or half done."""
    ended_by: str | None = None
    """The reason of the mission's end, for people."""
    end_reason: EndReason | None = None

    @property
    def end(self) -> MissionEnd | None:
        """The mission's end; None before it."""
        return None if self.end_reason is None else MissionEnd(self.end_reason, self.ended_by or "")

    @property
    def served(self) -> frozenset[int]:
        """The aMussels that it brought back at least once."""
        return frozenset(agent_id for agent_id, _ in self.released)

    def phase_text(self, unheard: str) -> str:
        """The phase, by the name that people use. Nothing is done before what is `unheard` of the aPad was heard."""
        waits = unheard and self.phase is not Phase.ENDED
        return f"waits for the aPad's {unheard}" if waits else self.phase.value

    def stood_down(self) -> MissionState:
        """The same state without a plan and with nothing under way."""
        return replace(self, phase=Phase.STANDS_DOWN, plan=())


class PlanStep(TypedDict):
    agent: int
    dock: DockIndex


class PlanCosts(TypedDict):
    distance_m: float
    demand: float
    distance_cost: float
    energy_cost: float


class PlannedCandidate(TypedDict):
    id: int
    charge: float
    north_m: float
    east_m: float
    secondary: NotRequired[float]
    unserved_s: NotRequired[float]
    reported: NotRequired[dict[str, float]]


class PlannedExchange(TypedDict):
    released: int
    collected: int


class PlanOption(TypedDict):
    agents: list[int]
    cost: float
    parts: dict[str, float]


@dataclass(frozen=True)
class MissionChanged(Event):
    kind = "mission"
    when = "the mission's state changed; a resumed run continues from the newest"
    counted = ("phase",)

    phase: Annotated[Phase, Meaning("the box of the paper's Fig. 7")]
    snapshot: Annotated[MissionState, Meaning("the whole state", "m, mission ms")]


@dataclass(frozen=True)
class PlanMade(Event):
    kind = "plan"
    when = "a strategy made a plan"
    counted = ("what", "strategy", "steps", "exchanged")
    category = Category.PLAN

    what: Annotated[str, Meaning("`collect` or `redeploy`")]
    strategy: Annotated[str, Meaning("its name")]
    steps: Annotated[list[PlanStep], Meaning("in order")]
    costs: Annotated[
        PlanCosts, Meaning("equations (4) to (6): the way, the energy, and both scaled", "m, batteries")
    ]
    beliefs: Annotated[
        list[PlannedCandidate],
        Meaning("the beliefs of the candidates, and the time since each was released", "0 to 1, m, s"),
    ]
    from_: Annotated[_Point | None, Meaning("the aPad's place, north and east", "m")] = None
    exchanged: Annotated[
        list[PlannedExchange] | None,
        Meaning(
            "who exchange places: the one that is released takes that of the other, which is collected now or was before"
        ),
    ] = None
    options: Annotated[
        list[PlanOption] | None,
        Meaning(
            "what the strategy weighed, by its own costs, whose parts have names: the plan itself, its runner-up, "
            "others; none without reasons"
        ),
    ] = None
    unexplained: Annotated[str | None, Meaning("the error of a strategy's own explanation")] = None

    def text(self) -> str:
        whom = ", ".join(str(step["agent"]) for step in self.steps) or "nobody"
        pairs = self.exchanged or ()
        places = "".join(f"; {it['released']} takes the place of {it['collected']}" for it in pairs)
        return f"plan to {self.what} by {self.strategy}: {whom}{places}"


@dataclass(frozen=True)
class PrimitiveChanged(Event):
    kind = "primitive"
    when = "a primitive started, succeeded or failed, or a docking caught nothing within the catch radius"
    counted = ("name", "phase", "agent", "dock", "north_m", "east_m")

    name: Annotated[str, Meaning("`go to point`, `hold position`, `dock` or `undock`")]
    phase: Annotated[PrimitivePhase, Meaning("the result")]
    agent: Annotated[int | None, Meaning("the aMussel")] = None
    dock: Annotated[DockIndex | None, Meaning("the dock, counted from 0")] = None
    north_m: Annotated[float | None, Meaning("the goal, north", "m")] = None
    east_m: Annotated[float | None, Meaning("the goal, east", "m")] = None
    reason: Annotated[str | None, Meaning("why it failed")] = None

    @property
    def category(self) -> Category:
        has_failed = self.phase is PrimitivePhase.FAILED and self.reason != PRE_EMPTED
        return Category.ALARM if has_failed else Category.NEWS

    def text(self) -> str | None:
        if self.phase is not PrimitivePhase.FAILED:
            return None
        of = ""
        if self.agent is not None and self.dock is not None:
            of = f" (aMussel {self.agent}, dock {self.dock + 1})"
        elif self.north_m is not None and self.east_m is not None:
            of = f" ({self.north_m:.1f} m north, {self.east_m:.1f} m east)"
        return f"{self.name}{of} failed: {self.reason}"


@dataclass(frozen=True)
class DockSwitched(Event):
    kind = "dock"
    when = "a dock closed around an aMussel, or opened"
    counted = ("dock", "agent", "closed")
    category = Category.PLAN

    dock: Annotated[DockIndex, Meaning("the dock, counted from 0")]
    agent: AMussel
    closed: Annotated[bool, Meaning("true when it closed")]

    def text(self) -> str:
        return f"dock {self.dock + 1} {'closed around' if self.closed else 'let go'} aMussel {self.agent}"


@dataclass(frozen=True)
class LegBegan(Event):
    kind = "leg"
    when = "the aPad was ordered to another place"
    counted = ("metres",)

    metres: Annotated[float, Meaning("in a straight line from where it was", "m")]


@dataclass(frozen=True)
class AMusselReleased(Event):
    kind = "released"
    when = "an aMussel left its dock and was ordered to sink"
    counted = ("agent", "full")

    agent: AMussel
    full: Annotated[bool, Meaning("true if it was believed full at that order: it counts as a service")]


@dataclass(frozen=True)
class StepGivenUp(Event):
    kind = "given_up"
    when = "a step of the mission was given up"
    counted = ("agent", "what")
    category = Category.ALARM

    agent: AMussel
    what: Annotated[str, Meaning("`collect`, `deploy`, `charge` or `dock`")]
    reason: Reason

    def text(self) -> str | None:
        fates = {
            "collect": "is not collected this time",
            "deploy": "is not returned this time",
            "charge": "is not charged any further",
            "dock": "is not docked",
        }
        fate = fates.get(self.what)
        return None if fate is None else f"aMussel {self.agent} {fate}: {self.reason}"


@dataclass(frozen=True)
class ExchangeChanged(Event):
    kind = "exchange"
    when = "an exchange of places failed, or one that was half done has ended"
    counted = ("released", "collected", "phase")

    released: Annotated[int, Meaning("the aMussel that was to take the other one's place")]
    collected: Annotated[int, Meaning("the aMussel that was to be collected there")]
    phase: Annotated[ExchangePhase, Meaning("what became of it")]

    @property
    def category(self) -> Category:
        return Category.RELIEF if self.phase is ExchangePhase.FINISHED else Category.ALARM

    def text(self) -> str:
        one, other = f"aMussel {self.released}", f"aMussel {self.collected}"
        return {
            ExchangePhase.UNDONE: f"{one} does not take the place of {other}, which is not collected",
            ExchangePhase.HALF_DONE: f"{one} and {other} are at one place, and the one from where {one} came is empty",
            ExchangePhase.FINISHED: f"{other} is collected after all, for the place from where {one} came",
        }.get(self.phase, f"{one} is to take the place of {other}")


@dataclass(frozen=True)
class LeftAlone(Event):
    kind = "left_alone"
    when = "the mission stopped its tries to serve an aMussel"
    counted = ("agent", "tries")
    category = Category.ALARM

    agent: AMussel
    tries: Annotated[int, Meaning("number of failed tries in a row")]
    reason: Reason

    def text(self) -> str:
        return (
            f"aMussel {self.agent} is left alone from now on: {self.tries} tries in a row failed, "
            f"the last one: {self.reason}"
        )


@dataclass(frozen=True)
class BeyondReach(Event):
    kind = "beyond_reach"
    when = "the mission will not serve an aMussel for the present, because of the way to it"
    counted = ("agent",)
    category = Category.ALARM

    agent: AMussel
    reason: Reason

    def text(self) -> str:
        return f"aMussel {self.agent} is beyond reach: {self.reason}"


@dataclass(frozen=True)
class InReach(Event):
    kind = "in_reach"
    when = "such an aMussel can be served again"
    counted = ("agent",)
    category = Category.RELIEF

    agent: AMussel

    def text(self) -> str:
        return f"aMussel {self.agent} is in reach again"


@dataclass(frozen=True)
class Stuck(Event):
    kind = "stuck"
    when = "the aPad cannot do its work: several go-tos in a row failed, or its battery was not heard"
    counted = ()
    category = Category.ALARM

    reason: Reason

    def text(self) -> str:
        return f"the aPad is stuck: {self.reason}"


@dataclass(frozen=True)
class StandsDown(Event):
    kind = "stands_down"
    when = "one of several aPads leaves its aMussels to the others"
    counted = ()
    category = Category.TROUBLE

    reason: Reason

    def text(self) -> str:
        return f"the aPad stands down: {self.reason}"
