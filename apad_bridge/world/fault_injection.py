"""Carries out the faults of a run, from their begin to their end: those of the scenario, and those that people cause.

A row of `apad_bridge.scenario.timed_faults` says what it tells the aMussel's body. Other rows have their effects on links
and processes here, by the `FaultyHost`; the `FaultyLink` has the effects of the aPad's faults.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from agents.hosting.faulty_host import FaultyHost, LinkDefect
from agents.mussel.stimuli import AgentStimulus, ChargeLost, PinDisturbed
from agents.time_scale import TimeScale
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import FaultBegan, FaultEnded
from apad_bridge.scenario.timed_faults import Injection, TimedFault
from apad_bridge.vehicle.vehicle_link import VehicleLink
from apad_bridge.world.faulty_link import FaultyLink
from firmware_model.power.charge import grains
from firmware_model.state_groups import DOCKED

if TYPE_CHECKING:
    from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs


REAL_HULL = "a real aPad flies: faults are for runs with the simulated one"
_LEAK_MS = 10_000
"""A leaking battery loses its charge in steps of so much mission time."""

_DEFECTS = {
    TimedFault.LINK_CUT: LinkDefect.CUT,
    TimedFault.LINK_DELAY: LinkDefect.DELAY,
    TimedFault.BIT_FLIP: LinkDefect.FLIPS,
    TimedFault.MODEM_DEAF: LinkDefect.DEAF,
}

Action = tuple[int, AgentStimulus] | Event
_Key = tuple[TimedFault, int | None, float | None]


@dataclass(frozen=True, slots=True)
class Ongoing:
    """A fault that had begun and not ended when a former supervisor died."""

    injection: Injection
    until_ms: int


class FaultInjection:
    """The faults of one flight. It belongs to the flight's thread."""

    def __init__(
        self,
        host: FaultyHost | None,
        scale: TimeScale,
        planned: Sequence[tuple[int, Injection]] = (),
        ongoing: Iterable[Ongoing] = (),
        *,
        real_hull: bool = False,
    ) -> None:
        """`host` None: no aMussel is simulated here. `planned` are (mission ms, fault), rising; those before are left out.

        With a `real_hull` every fault is refused.
        """
        self._host = host
        self._scale = scale
        self._planned = list(planned)
        self._real_hull = real_hull
        self._link: FaultyLink | None = None
        self._active: dict[_Key, Ongoing] = {}
        self._again: list[Ongoing] = list(ongoing)
        """Faults that begin once more at the next tick, without a word: their end is in the journal already or to come."""

    def behind(self, vehicle: VehicleLink) -> VehicleLink:
        """The vehicle with the faults of the aPad in front of it. Call it once."""
        if self._real_hull:
            return vehicle
        self._link = FaultyLink(vehicle)
        return self._link

    def restarted(self, agent_id: int) -> None:
        """The process of an aMussel is another one: what the former one was told begins in it once more."""
        self._again += [it for (_, of, _), it in self._active.items() if of == agent_id]

    def advance(
        self, now_ms: int, beliefs: FleetBeliefs, is_simulated: Callable[[int], bool]
    ) -> list[Action]:
        """Ends and begins what is due at this tick."""
        actions: list[Action] = []
        again, self._again = self._again, []
        for fault in again:
            self._active[_key(fault.injection)] = fault
            actions += self._switch(fault.injection, begins=True)
        for key, fault in list(self._active.items()):
            if fault.until_ms <= now_ms:
                del self._active[key]
                actions += [*self._switch(fault.injection, begins=False), _ended(fault.injection)]
        while self._planned and self._planned[0][0] <= now_ms:
            _, injection = self._planned.pop(0)
            if (agent_id := injection.agent_id) is not None and not is_simulated(agent_id):
                outcome: list[Action] | str = f"aMussel {agent_id} is not simulated now"
            else:
                outcome = self.cause(injection, beliefs, now_ms)
            if isinstance(outcome, str):
                outcome = [_began(injection, now_ms, refused=outcome)]
            actions += outcome
        if now_ms % _LEAK_MS == 0:
            for (kind, _, _), fault in self._active.items():
                if kind is TimedFault.BATTERY_AGEING:
                    loss = grains(fault.injection.value * _LEAK_MS / 60_000)
                    actions += _to(fault.injection, ChargeLost(loss, 0))
        return actions

    def cause(self, injection: Injection, beliefs: FleetBeliefs, now_ms: int) -> list[Action] | str:
        """Begins a fault: the stimuli and the event for the journal, or the reason for a refusal, without a change."""
        if (refusal := self._refusal(injection, beliefs)) is not None:
            return refusal
        actions = self._switch(injection, begins=True)
        if injection.span_ms:
            self._active[_key(injection)] = Ongoing(injection, now_ms + injection.span_ms)
        return [*actions, _began(injection, now_ms)]

    def _refusal(self, injection: Injection, beliefs: FleetBeliefs) -> str | None:
        row, agent_id = injection.row, injection.agent_id
        whose = "the aPad" if agent_id is None else f"aMussel {agent_id}"
        if self._real_hull:
            return REAL_HULL
        if _key(injection) in self._active:
            return f"{whose} has the fault {injection.fault} already"
        if agent_id is None:
            return None if self._link is not None else "this run gives no aPad orders"
        if self._host is None:
            return "no fleet is simulated in this run"
        if row.needs_dock and not is_docked(beliefs, agent_id):
            return f"aMussel {agent_id} is in no dock, by its reports: {injection.fault} happens only there"
        if row.needs_process and agent_id not in self._host.pids:
            return f"aMussel {agent_id} has no process of its own: {injection.fault} needs one"
        return None

    def _switch(self, injection: Injection, *, begins: bool) -> list[Action]:
        """Begins a fault, or heals it."""
        if injection.agent_id is None:
            if self._link is not None:
                (self._link.begin if begins else self._link.end)(injection)
            return []
        if injection.fault in (TimedFault.EDGE_FALSE, TimedFault.EDGE_MISSED):
            return self._pin(injection, begins=begins)
        if (row := injection.row).begins is not None:
            stimulus = row.begins(injection.value) if begins else row.heals
            return [] if stimulus is None else _to(injection, stimulus)
        if self._host is not None:
            self._switch_at_host(self._host, injection, injection.agent_id, begins=begins)
        return []

    def _switch_at_host(self, host: FaultyHost, injection: Injection, agent_id: int, *, begins: bool) -> None:
        fault, value = injection.fault, injection.value
        if fault is TimedFault.KILLED and begins:
            host.kill(agent_id)
        elif fault is TimedFault.STOPPED and begins:
            host.stop(agent_id)
        elif fault is TimedFault.MEMORY_LIMIT:
            host.limit_memory(agent_id, value if begins else None)
        elif (defect := _DEFECTS.get(fault)) is not None and begins:
            delays = defect is LinkDefect.DELAY
            host.set_defect(
                agent_id, defect, self._scale.agent_span(round(1000 * value)) if delays else value
            )
        elif defect is not None:
            host.heal(agent_id, defect)

    def _pin(self, injection: Injection, *, begins: bool) -> list[Action]:
        """The pin's two defects share its state: each keeps the other as it is."""

        def has(fault: TimedFault) -> int:
            return int(
                begins if fault is injection.fault else (fault, injection.agent_id, None) in self._active
            )

        return _to(injection, PinDisturbed(has(TimedFault.EDGE_FALSE), has(TimedFault.EDGE_MISSED)))


class NoFaults:
    """A flight in which nothing is made to fail."""

    def behind(self, vehicle: VehicleLink) -> VehicleLink:
        return vehicle

    def restarted(self, agent_id: int) -> None:
        pass

    def advance(
        self, now_ms: int, beliefs: FleetBeliefs, is_simulated: Callable[[int], bool]
    ) -> Sequence[Action]:
        return ()

    def cause(self, injection: Injection, beliefs: FleetBeliefs, now_ms: int) -> list[Action] | str:
        return "this flight takes no faults"


def is_docked(beliefs: FleetBeliefs, agent_id: int) -> bool:
    """True for an aMussel that is in a dock, by its reports."""
    belief = beliefs.get(agent_id)
    return belief is not None and belief.state in DOCKED


def _key(injection: Injection) -> _Key:
    """One of a kind happens at a time to an aMussel or to the aPad; each dock jams by itself."""
    dock_index = injection.value if injection.fault is TimedFault.DOCK_JAMMED else None
    return injection.fault, injection.agent_id, dock_index


def _to(injection: Injection, stimulus: AgentStimulus) -> list[Action]:
    assert injection.agent_id is not None
    return [(injection.agent_id, stimulus)]


def _began(injection: Injection, now_ms: int, refused: str | None = None) -> FaultBegan:
    return FaultBegan(
        id=injection.agent_id,
        fault=injection.fault,
        value=None if injection.row.parameter is None else injection.value,
        until_ms=now_ms + injection.span_ms,
        refused=refused,
    )


def _ended(injection: Injection) -> FaultEnded:
    return FaultEnded(id=injection.agent_id, fault=injection.fault)
