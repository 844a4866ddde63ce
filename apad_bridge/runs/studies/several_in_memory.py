"""Several aPads' flights in virtual time and in this process, without files: for studies of many configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from apad_bridge.assembly.division import Member
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.records.summary import uptime_figures
from apad_bridge.runs.in_memory import MemoryRecorder, open_flight
from apad_bridge.runs.several.assignment import Sharing
from apad_bridge.runs.several.lockstep import Exchange, Flown, LockstepRunner
from apad_bridge.scenario.another_apad import Sharing as Rules


@dataclass(frozen=True, slots=True)
class Opened:
    """A formation that is ready to `run`, and each one's records."""

    formation: LockstepRunner
    sharing: Sharing
    recorders: dict[str, MemoryRecorder]
    flown: dict[str, Flown]

    def figures(self) -> dict[str, dict[str, Any]]:
        """By aPad: those of `uptime_figures`, `cost_m` and `services`."""
        found = {}
        for name, it in self.flown.items():
            state = it.flight.supervisor.mission.state
            figures = uptime_figures(self.recorders[name].meter, it.flight.now_ms)
            found[name] = {**figures, "cost_m": state.cost_m, "services": state.services}
        return found


def open_lockstep(members: Sequence[Member], rules: Rules) -> Opened:
    served = {member.name: member.scenario.fleet.ids for member in members}
    exchange, sharing = Exchange(served), Sharing(served)
    recorders, flown = {}, {}
    for member in members:
        relay = exchange.ethers[member.name]
        flight, recorders[member.name] = open_flight(
            member.scenario,
            relay=relay,
            tell_served_elsewhere=relay.felt,
            breakdown=Breakdown(rules.failed_go_tos),
        )
        flown[member.name] = Flown(member.scenario.apad.start_m, flight, recorders[member.name])
    formation = LockstepRunner(flown, exchange, sharing if rules.transfers else None)
    return Opened(formation, sharing, recorders, flown)
