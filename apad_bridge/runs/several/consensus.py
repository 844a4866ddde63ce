"""Several aPads agree by themselves on who serves which aMussel, over a radio network that loses and delays messages.

Each aPad decides by its own beliefs and by what others sent it (`planning/jurisdiction.py`); nothing here knows more. It
serves the aMussels whose claims are granted. Without a grant it docks no aMussel, and brings back those in its docks.

A dock of an aPad that fell silent may have closed on an aMussel since its last message, and no other aPad knows it. So an
aPad that took an aMussel on docks it only after it has received a packet from it.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.assembly.division import Member
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.fleet_events import HandedOn, TookOn
from apad_bridge.planning.jurisdiction import Jurisdiction, OwnSight, PeerState, Terms, Vote
from apad_bridge.runs.several.assignment import busy_with, view_of
from apad_bridge.scenario.another_apad import ASSIGNMENT_PERIOD_S, Consensus
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.supervisor import Supervisor


@dataclass(frozen=True, slots=True)
class Message:
    """The newest that an aPad knows of every aPad, and the newest belief of each aMussel that it has or was sent."""

    states: tuple[PeerState, ...]
    beliefs: Mapping[int, Belief]


class Mesh:
    """The network between the aPads, drawn from `seed`. A message to each other aPad is lost or kept by itself."""

    def __init__(self, consensus: Consensus, names: Sequence[str], seed: int) -> None:
        self._consensus = consensus
        self._random = random.Random(f"{seed} mesh")
        self._under_way: dict[str, list[tuple[int, Message]]] = {name: [] for name in names}

    def send(self, sender: str, message: Message, now_ms: int) -> None:
        due_ms = now_ms + round(1000 * self._consensus.delay_s)
        for name, under_way in self._under_way.items():
            is_lost = self._random.random() < self._consensus.loss
            if name != sender and not is_lost and not self._is_silent(sender, now_ms):
                under_way.append((due_ms, message))

    def take(self, name: str, now_ms: int) -> list[Message]:
        """Returns the messages that have arrived since the last call; a silent aPad misses them."""
        arrived = [it for due_ms, it in self._under_way[name] if due_ms <= now_ms]
        self._under_way[name] = [it for it in self._under_way[name] if it[0] > now_ms]
        return [] if self._is_silent(name, now_ms) else arrived

    def _is_silent(self, name: str, now_ms: int) -> bool:
        return any(
            it.apad == name and it.from_s <= now_ms / 1000 and (it.to_s is None or now_ms / 1000 < it.to_s)
            for it in self._consensus.silences
        )


class ByConsensus:
    """The part of each aPad. All begin with the scenario's shares: each has all votes for its own until a lease is over."""

    def __init__(self, members: Sequence[Member], consensus: Consensus) -> None:
        scenario, names = members[0].scenario, [it.name for it in members]
        lease_ms, clock_error_ms = round(1000 * consensus.lease_s), round(1000 * consensus.clock_error_s)
        margin_ms = round(1000 * (ASSIGNMENT_PERIOD_S + scenario.mission.docking.longest_s))
        votes = {
            agent_id: Vote(it.name, -1, lease_ms) for it in members for agent_id in it.scenario.fleet.ids
        }
        states = [
            PeerState(
                it.name,
                it.scenario.apad.start_m,
                places_m={start.agent_id: (-1, (start.north_m, start.east_m)) for start in it.starts},
                claims=dict.fromkeys(it.scenario.fleet.ids, -1),
                votes=votes,
            )
            for it in members
        ]
        terms = Terms(lease_ms, clock_error_ms, margin_ms)
        self.parts = {name: Jurisdiction(name, states, names, terms) for name in names}
        self._mesh = Mesh(consensus, names, scenario.seed)
        self._exchanged: dict[str, dict[int, Belief]] = {name: {} for name in names}
        self._taken_ms: dict[str, dict[int, int]] = {name: {} for name in names}
        """The time at which each aPad took an aMussel on."""

    def look(
        self, name: str, start_m: tuple[float, float], flight: Flight, now_ms: MissionMs
    ) -> list[HandedOn | TookOn]:
        """Exchanges messages, and has the flight serve the aMussels that are granted. Returns the changes."""
        supervisor, part, exchanged = flight.supervisor, self.parts[name], self._exchanged[name]
        for message in self._mesh.take(name, now_ms):
            part.receive(message.states)
            _merge(exchanged, message.beliefs.values())
        _merge(exchanged, supervisor.allocation.all())
        view, state = view_of(name, start_m, supervisor), supervisor.mission.state
        busy, docked = busy_with(state), frozenset(dict(state.docked).values())
        movable_m = {it: view.places_m[it] for it in view.movable}
        part.advance(OwnSight(view.is_down, movable_m, busy, docked), now_ms)
        self._mesh.send(name, Message(tuple(part.known.values()), dict(exchanged)), now_ms)
        left = sorted(supervisor.allocation.served - part.granted - busy)
        for agent_id in left:
            flight.stop_serving(agent_id)
        taken = sorted(part.granted - supervisor.allocation.served)
        for agent_id in taken:
            supervisor.start_serving(agent_id, exchanged.get(agent_id))
            self._taken_ms[name][agent_id] = now_ms
        supervisor.allocation.barred = self._barred(name, supervisor) - docked
        return [*map(HandedOn, left), *map(TookOn, taken)]

    def _barred(self, name: str, supervisor: Supervisor) -> frozenset[int]:
        served, granted = supervisor.allocation.served, self.parts[name].granted
        unheard = {
            agent_id
            for agent_id, taken_ms in self._taken_ms[name].items()
            if (belief := supervisor.beliefs.get(agent_id)) is None or belief.heard_ms <= taken_ms
        }
        return served - (granted - unheard)


def _merge(exchanged: dict[int, Belief], beliefs: Iterable[Belief]) -> None:
    """Keeps the newest belief of each aMussel."""
    for it in beliefs:
        if it.agent_id not in exchanged or exchanged[it.agent_id].at_ms < it.at_ms:
            exchanged[it.agent_id] = it
