"""The status of a running flight, once a tick, from the supervisor to the process that shows it to a person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import fsum
from typing import TYPE_CHECKING

from apad_bridge.supervisor.forecast import Forecast
from firmware_model.state_groups import DOCKED

if TYPE_CHECKING:
    from apad_bridge.supervisor.supervisor import Supervisor


@dataclass(frozen=True, slots=True)
class RunStatus:
    """`agents` is the number of aMussels served here of which a packet was received; `active` is the number of these
    that are believed to be in the water with charge left."""

    now_ms: int
    phase: str
    primitive: str
    agents: int
    active: int
    docked: tuple[int, ...]
    """Their ids, in the order of the docks."""
    services: int
    cost_m: float
    apad_fraction: float | None
    behind_s: float
    forecast: Forecast | None = None
    """None for several aPads, whose forecasts have no sum."""
    stopped: str = ""
    """The stop in force, and who ordered it; empty where the aPad may move."""

    @classmethod
    def of(cls, supervisor: Supervisor, now_ms: int, behind_s: float, forecast: Forecast) -> RunStatus:
        allocation = supervisor.allocation
        beliefs = [it for it in supervisor.beliefs.all() if it.agent_id not in allocation.served_elsewhere]
        state = supervisor.mission.state
        return cls(
            now_ms=now_ms,
            phase=state.phase_text(supervisor.mission.unheard),
            primitive=supervisor.primitive,
            agents=len(beliefs),
            active=sum(b.state not in DOCKED and b.primary > 0 for b in beliefs),
            docked=tuple(agent_id for _, agent_id in sorted(state.docked)),
            services=state.services,
            cost_m=state.cost_m,
            apad_fraction=None if supervisor.battery is None else supervisor.battery.fraction,
            behind_s=behind_s,
            forecast=forecast,
            stopped="" if supervisor.stop is None else f"{supervisor.stop.kind} by {supervisor.stop.by}",
        )

    @classmethod
    def combined(cls, each: Sequence[RunStatus], apads: int) -> RunStatus:
        """Sums the figures of several aPads; the time is that of the slowest flight, because the run ends with it."""
        if apads == 1:
            return each[0]
        return cls(
            now_ms=min(it.now_ms for it in each),
            phase=f"{apads} aPads",
            primitive="",
            agents=sum(it.agents for it in each),
            active=sum(it.active for it in each),
            docked=tuple(agent_id for it in each for agent_id in it.docked),
            services=sum(it.services for it in each),
            cost_m=fsum(it.cost_m for it in each),
            apad_fraction=None,
            behind_s=max(it.behind_s for it in each),
            stopped=", ".join(it.stopped for it in each if it.stopped),
        )
