"""The mission's whole state: one frozen value, journaled at every change, from which a resumed run goes on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, cast

from apad_bridge.events.mission import ExchangePhase, MissionSnapshot, Phase
from apad_bridge.events.run import EndReason
from apad_bridge.planning.solution import Solution
from apad_bridge.scenario.schema import PAPER_DOCKS
from apad_bridge.vehicle.docks import Occupancy


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
    start: tuple[float, float]
    goal: tuple[float, float]
    counted: tuple[float, float]
    """The point up to which the driven way is counted."""

    @property
    def planned_m(self) -> float:
        return math.dist(self.start, self.goal)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Leg:
        start, goal, counted = (data[key] for key in ("start", "goal", "counted"))
        return cls(data["primitive_id"], tuple(start), tuple(goal), tuple(counted))


@dataclass(frozen=True, slots=True)
class MissionState:
    """Times are mission milliseconds. `plan` holds the steps not yet finished, the one under way first."""

    phase: Phase = Phase.IDLE
    since_ms: int = 0
    plan: Solution = field(default_factory=lambda: Solution(()))
    dock_count: int = PAPER_DOCKS
    docked: Occupancy = ()
    """The docks as the docking port last told them."""
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
    ended_by: MissionEnd | None = None

    @property
    def served(self) -> frozenset[int]:
        """The aMussels that it brought back at least once."""
        return frozenset(agent_id for agent_id, _ in self.released)

    def phase_text(self, unheard: str) -> str:
        """The phase, by the name that people use. Nothing is done before what is `unheard` of the aPad was heard."""
        waits = unheard and self.phase is not Phase.ENDED
        return f"waits for the aPad's {unheard}" if waits else self.phase.value

    def to_json(self) -> MissionSnapshot:
        ended_by, leg = self.ended_by, self.leg
        snapshot: Any = {
            # Not `asdict`, which would copy each tuple of a value that is journaled at every change.
            **{it.name: getattr(self, it.name) for it in fields(self)},
            "leg": None if leg is None else asdict(leg),
            "plan": self.plan.encode(),
            "ended_by": None if ended_by is None else str(ended_by),
            "end_reason": None if ended_by is None else ended_by.reason.value,
        }
        return cast(MissionSnapshot, snapshot)

    def stood_down(self) -> MissionState:
        """The same state without a plan and with nothing under way."""
        return replace(self, phase=Phase.STANDS_DOWN, plan=Solution(()))

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> MissionState:
        """The inverse of `to_json`; KeyError, TypeError or ValueError for anything else."""
        known, leg = dict(data), data["leg"]
        text, reason = data["ended_by"], known.pop("end_reason")
        rows = ("failed_tries", "failed_undockings", "released", "docked", "homes")
        return cls(
            **{
                **known,
                **{name: tuple(tuple(row) for row in data[name]) for name in rows},
                "leg": None if leg is None else Leg.from_json(leg),
                "phase": Phase(data["phase"]),
                "exchanged": tuple(
                    (one, other, ExchangePhase(phase)) for one, other, phase in data["exchanged"]
                ),
                "plan": Solution.decode(data["plan"]),
                "ended_by": None if reason is None else MissionEnd(EndReason(reason), text),
            }
        )
