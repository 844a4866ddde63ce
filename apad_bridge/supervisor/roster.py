"""Who an aMussel is at the moment: simulated, a real one, or none; and what people may ask of a fleet while it flies.

A simulated aMussel that is handed over to a real one goes on beside it, unheard, as its twin: it feels the same docks, and
its truth is recorded beside what is believed of the real one. Taken back, it begins where the real one is believed to be.
A retired one is out of the water.

What claims on the graph mean for a fleet that was there before and comes back: the graph goes before the journal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from agents.coordinator import Coordinator
from agents.mussel.stimuli import CoilSlipped, Placed, Stimulus, WasReset
from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.mission.orders import Note
from apad_bridge.scenario.local_frame import FARTHEST_M
from firmware_model.power.charge import grains
from firmware_model.state_groups import DOCKED
from firmware_model.stimuli import ResetCause


class Presence(StrEnum):
    SIMULATED = "simulated"
    REAL = "real"
    RETIRED = "retired"


class Trigger(StrEnum):
    HAND_OVER = "hand over"
    TAKE_BACK = "take back"
    RETIRE = "retire"
    SPAWN = "spawn"


TABLE: dict[tuple[Presence, Trigger], Presence] = {
    (Presence.SIMULATED, Trigger.HAND_OVER): Presence.REAL,
    (Presence.REAL, Trigger.TAKE_BACK): Presence.SIMULATED,
    (Presence.SIMULATED, Trigger.RETIRE): Presence.RETIRED,
    (Presence.REAL, Trigger.RETIRE): Presence.RETIRED,
    (Presence.RETIRED, Trigger.SPAWN): Presence.SIMULATED,
    (Presence.RETIRED, Trigger.HAND_OVER): Presence.REAL,
}
"""A pair that is missing is refused, with a word for who asked."""


@dataclass(frozen=True, slots=True)
class Became:
    """What an aMussel became at mission time `at_ms`, and at whose word, as the journal of a run tells it."""

    at_ms: int
    agent_id: int
    presence: Presence
    by: str


class Fault(StrEnum):
    """What can be done to a simulated aMussel to see what follows."""

    BROWN_OUT = "brown_out"
    WATCHDOG = "watchdog"
    COIL_SLIP = "coil_slip"


@dataclass(frozen=True, slots=True)
class Moved:
    """Somebody asked that the aMussel be another. `by` is for the journal."""

    agent_id: int
    trigger: Trigger
    by: str
    at: tuple[float, float] | None = None
    """(north, east) in local metres, for one that is spawned."""
    charges: tuple[float, float] = (1.0, 1.0)
    """Primary and secondary in [0, 1], for one that is spawned."""


@dataclass(frozen=True, slots=True)
class Failed:
    """Somebody asked for a fault."""

    agent_id: int
    fault: Fault


Asked = Moved | Failed


class RosterRequests(Protocol):
    """Where it is asked."""

    def take(self) -> list[Asked]: ...

    def answer(self, asked: Asked, refusal: str | None) -> None:
        """What became of it; None when it was done."""
        ...


_STIMULI: dict[Fault, Stimulus] = {
    Fault.BROWN_OUT: WasReset(ResetCause.BROWN_OUT),
    Fault.WATCHDOG: WasReset(ResetCause.WATCHDOG),
    Fault.COIL_SLIP: CoilSlipped(),
}


class Presences:
    """Of a fleet's aMussels. Its thread is the flight's; `simulated` may be asked by any."""

    def __init__(self, agent_ids: Iterable[int], bottom_m: float, before: Iterable[Became] = ()) -> None:
        """All are simulated, but for what they became under a former supervisor of the run; the newest comes last."""
        self._bottom_m = bottom_m
        self._now = dict.fromkeys(agent_ids, Presence.SIMULATED)
        self.before = {it.agent_id: it for it in before if it.agent_id in self._now}
        """By aMussel, the newest change before this supervisor."""
        self._now |= {it.agent_id: it.presence for it in self.before.values()}
        self.simulated = self._who_is_simulated()

    def mute_as_before(self, coordinator: Coordinator) -> None:
        """To be said before any time passes: twins and retired ones go on unheard under a new supervisor."""
        for it in self.before.values():
            if it.presence is Presence.SIMULATED:
                coordinator.unmute(it.agent_id, it.at_ms)
            else:
                coordinator.mute(it.agent_id)

    def of(self, agent_id: int) -> Presence | None:
        """None for an id that is not of this fleet."""
        return self._now.get(agent_id)

    def do(
        self, asked: Asked, coordinator: Coordinator, beliefs: FleetBeliefs, now_ms: int
    ) -> tuple[list[tuple[int, Stimulus]], Note] | str:
        """What the aMussels feel of it, and the line for the journal; or why it is refused, and nothing has changed."""
        before = self._now.get(asked.agent_id)
        if before is None:
            return f"aMussel {asked.agent_id} is not of this fleet"
        if isinstance(asked, Failed):
            if before is not Presence.SIMULATED:
                return f"aMussel {asked.agent_id} is {before}: faults are for simulated ones"
            if asked.fault is Fault.COIL_SLIP and not _is_docked(beliefs, asked.agent_id):
                return f"aMussel {asked.agent_id} is in no dock, as far as is heard: a coil slips only there"
            return [(asked.agent_id, _STIMULI[asked.fault])], Note(
                "fault", {"id": asked.agent_id, "fault": asked.fault.value}
            )
        if _is_docked(beliefs, asked.agent_id):
            return f"aMussel {asked.agent_id} is in a dock: undock it first"
        after = TABLE.get((before, asked.trigger))
        if after is None:
            return f"aMussel {asked.agent_id} is {before}: it cannot {asked.trigger}"
        if asked.trigger is Trigger.SPAWN and (why := _no_spawn(asked)) is not None:
            return why
        stimuli: list[tuple[int, Stimulus]] = []
        if after is Presence.SIMULATED:
            placed = self._placed(asked, beliefs)
            if placed is None:
                return f"nothing was heard of the real aMussel {asked.agent_id}: retire it, and spawn it somewhere"
            stimuli.append((asked.agent_id, placed))
            coordinator.unmute(asked.agent_id, now_ms)
        else:
            coordinator.mute(asked.agent_id)
        if asked.trigger is not Trigger.TAKE_BACK:
            beliefs.forget(asked.agent_id)
        self._now[asked.agent_id] = after
        self.simulated = self._who_is_simulated()
        return stimuli, Note("presence", {"id": asked.agent_id, "is": after.value, "by": asked.by})

    def _who_is_simulated(self) -> frozenset[int]:
        return frozenset(it for it, presence in self._now.items() if presence is Presence.SIMULATED)

    def _placed(self, asked: Moved, beliefs: FleetBeliefs) -> Placed | None:
        """On the bottom: where it was asked for, or where the real one is believed to be."""
        if asked.trigger is Trigger.TAKE_BACK:
            belief = beliefs.get(asked.agent_id)
            if belief is None:
                return None
            north_m, east_m = belief.north_m, belief.east_m
            charges = belief.primary, belief.secondary
        else:
            north_m, east_m = asked.at or (0.0, 0.0)
            charges = asked.charges
        return Placed(
            round(north_m * 1e6),
            round(east_m * 1e6),
            round(self._bottom_m * 1e6),
            grains(charges[0]),
            grains(charges[1]),
        )


def _is_docked(beliefs: FleetBeliefs, agent_id: int) -> bool:
    belief = beliefs.get(agent_id)
    return belief is not None and belief.state in DOCKED


def _no_spawn(asked: Moved) -> str | None:
    """Why it cannot be put into the water so, or None. ROS 1 has 0 for what is left out: nobody spawns an empty one."""
    if not all(0.0 < charge <= 1.0 for charge in asked.charges):
        return "primary and secondary are charges above 0 and up to 1 (one that is left out is 0): say both"
    if not math.hypot(*(asked.at or (0.0, 0.0))) <= FARTHEST_M:
        return f"a place is metres north and east of the scenario's origin, {FARTHEST_M:.0f} m away at most"
    return None


class Roster:
    """Who is who in a flight's fleet, and where changes of that are asked for."""

    def __init__(self, presences: Presences, desk: RosterRequests) -> None:
        self.presences = presences
        self._desk = desk
        self._answers: list[tuple[Asked, str | None]] = []

    def advance(
        self, coordinator: Coordinator, beliefs: FleetBeliefs, now_ms: int
    ) -> list[tuple[int, Stimulus] | Note]:
        """Does what was asked since the last tick. Nobody is told so before `answer`."""
        done: list[tuple[int, Stimulus] | Note] = []
        for asked in self._desk.take():
            outcome = self.presences.do(asked, coordinator, beliefs, now_ms)
            if isinstance(outcome, str):
                self._answers.append((asked, outcome))
                continue
            stimuli, note = outcome
            done += [*stimuli, note]
            self._answers.append((asked, None))
        return done

    def answer(self) -> None:
        """To be called when what was done is on disk: what was accepted outlives a crash."""
        answers, self._answers = self._answers, []
        for asked, refusal in answers:
            self._desk.answer(asked, refusal)


@dataclass(frozen=True, slots=True)
class Claim:
    """A node's word that it speaks for these aMussels, `real` ones or simulated ones."""

    node: str
    real: bool
    since_s: float
    """Of the wall clock."""
    ids: frozenset[int]
    until_s: float
    """Of the monotonic clock."""


def given_back(before: Mapping[int, Became], claims: Iterable[Claim]) -> dict[int, str]:
    """The real aMussels that their claimant, which still claims real ones, claims no more; and who that is."""
    real = {claim.node: claim.ids for claim in claims if claim.real}
    return {
        agent_id: it.by
        for agent_id, it in before.items()
        if it.presence is Presence.REAL and it.by in real and agent_id not in real[it.by]
    }


def conflicts(
    presence_of: Callable[[int], Presence | None], before: Mapping[int, Became], claims: Iterable[Claim]
) -> list[str]:
    """A line for a person on each aMussel of which living claims say something else than the journal does."""
    claims = list(claims)
    lines = [
        f"aMussel {agent_id} was real by {node}, which claims it no more: it is taken back"
        for agent_id, node in sorted(given_back(before, claims).items())
    ]
    for claim in claims:
        for agent_id in sorted(claim.ids):
            was, what = presence_of(agent_id), "real" if claim.real else "simulated"
            outcome = _OUTCOMES.get((was, claim.real))
            if outcome is not None:
                lines.append(
                    f"aMussel {agent_id} was {was}, and {claim.node} claims it as {what} now: {outcome}"
                )
    return lines


_OUTCOMES: dict[tuple[Presence | None, bool], str] = {
    (Presence.SIMULATED, True): "it is handed over",
    (Presence.RETIRED, True): "it is handed over",
    (Presence.SIMULATED, False): "ours is retired",
    (Presence.REAL, False): "here it stays real",
}
"""By what an aMussel was and whether the claim is of a real one; a retired one that others simulate is as it should be."""
