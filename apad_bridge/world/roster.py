"""The presence of each aMussel (simulated, real or retired), and the requests that change a fleet in flight.

A simulated aMussel that is handed over to a real one continues beside it as its muted twin: it feels the same docks, and
its truth is recorded beside the belief of the real one. Taken back, it begins at the believed place of the real one, with
its believed charges. The belief lives on in both directions, and no clock does. A retired one is out of the water.

Nodes claim aMussels on the ROS graph. When a run is resumed, these claims take precedence over its journal.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

from agents.coordinator import Coordinator
from agents.mussel.stimuli import Placed
from agents.time_scale import MissionMs
from apad_bridge.beliefs.input_ranges import FARTHEST_M
from apad_bridge.beliefs.measurement import HandedOver
from apad_bridge.events.fleet_events import Presence, PresenceChanged
from apad_bridge.scenario.timed_faults import TimedFault, injection
from apad_bridge.world.fault_injection import Action, FaultInjection, NoFaults, is_docked
from firmware_model.power.charge import grains

if TYPE_CHECKING:
    from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs

ANSWER_S = 10.0
"""A tick comes once a mission second. After so long without one, a request is withdrawn, and answered without it."""


class PresenceTrigger(StrEnum):
    HAND_OVER = "hand over"
    TAKE_BACK = "take back"
    RETIRE = "retire"
    SPAWN = "spawn"


TABLE: dict[tuple[Presence, PresenceTrigger], Presence] = {
    (Presence.SIMULATED, PresenceTrigger.HAND_OVER): Presence.REAL,
    (Presence.REAL, PresenceTrigger.TAKE_BACK): Presence.SIMULATED,
    (Presence.SIMULATED, PresenceTrigger.RETIRE): Presence.RETIRED,
    (Presence.REAL, PresenceTrigger.RETIRE): Presence.RETIRED,
    (Presence.RETIRED, PresenceTrigger.SPAWN): Presence.SIMULATED,
    (Presence.RETIRED, PresenceTrigger.HAND_OVER): Presence.REAL,
}
"""A missing pair is refused, with a reason for the caller."""


@dataclass(frozen=True, slots=True)
class PresenceChange:
    """A change of an aMussel's presence at mission time `at_ms`, from a run's journal; `by` names the caller."""

    at_ms: MissionMs
    agent_id: int
    presence: Presence
    by: str


@dataclass(frozen=True, slots=True)
class PresenceRequest:
    """A request to change an aMussel's presence. `by` is for the journal."""

    agent_id: int
    trigger: PresenceTrigger
    by: str
    at: tuple[float, float] | None = None
    """(north, east) in local metres, to spawn an aMussel at."""
    charges: tuple[float, float] = (1.0, 1.0)
    """Primary and secondary in [0, 1], to spawn an aMussel with."""


@dataclass(frozen=True, slots=True)
class FaultRequest:
    """A request for a fault; `agent_id` is None for one of the aPad, and what else is None has the table's default."""

    agent_id: int | None
    fault: TimedFault
    value: float | None = None
    for_s: float | None = None


RosterRequest = PresenceRequest | FaultRequest


class RosterRequests(Protocol):
    """The queue of requests, and the way back for the answers."""

    def ask(self, request: RosterRequest) -> str | None:
        """Waits for the answer, in any thread but the flight's: the reason for a refusal; None when it was done."""

    def take(self) -> list[RosterRequest]: ...

    def answer(self, request: RosterRequest, refusal: str | None) -> None:
        """Answers a request with the reason for its refusal; None when it was done."""


class _Asked:
    def __init__(self, request: RosterRequest) -> None:
        self.request = request
        self.done = threading.Event()
        self.refusal: str | None = None


class AskedRequests:
    """Requests of other threads, which wait for the answers: of services, and of a person's orders."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[_Asked] = []
        self._taken: list[_Asked] = []

    def ask(self, request: RosterRequest) -> str | None:
        asked = _Asked(request)
        with self._lock:
            self._waiting.append(asked)
        if asked.done.wait(ANSWER_S):
            return asked.refusal
        with self._lock:
            if asked in self._waiting:
                self._waiting.remove(asked)
                return f"the flight made no tick for {ANSWER_S:g} s"
        if asked.done.wait(ANSWER_S):
            return asked.refusal
        return f"the flight took this up, and its tick did not end within {ANSWER_S:g} s: it may be done all the same"

    def take(self) -> list[RosterRequest]:
        with self._lock:
            self._taken, self._waiting = self._waiting, []
        return [asked.request for asked in self._taken]

    def answer(self, request: RosterRequest, refusal: str | None) -> bool:
        """Answers a request; False for one that nobody here asked."""
        for asked in self._taken:
            if asked.request is request:
                asked.refusal = refusal
                asked.done.set()
                return True
        return False


class Presences:
    """The presences of a fleet's aMussels. It belongs to the flight's thread; any thread may read `simulated`."""

    def __init__(
        self, agent_ids: Iterable[int], bottom_m: float, before: Iterable[PresenceChange] = ()
    ) -> None:
        """All are simulated, except for changes under a former supervisor of the run; the newest change comes last."""
        self._bottom_m = bottom_m
        self._now = dict.fromkeys(agent_ids, Presence.SIMULATED)
        self.before = {it.agent_id: it for it in before if it.agent_id in self._now}
        """The newest change before this supervisor, by aMussel."""
        self._now |= {it.agent_id: it.presence for it in self.before.values()}
        self.simulated = self._simulated_ids()

    def mute_as_before(self, coordinator: Coordinator) -> None:
        """Mutes twins and retired aMussels under a new supervisor. Call it before any time passes."""
        for it in self.before.values():
            if it.presence is Presence.SIMULATED:
                coordinator.unmute(it.agent_id, it.at_ms)
            else:
                coordinator.mute(it.agent_id)

    def of(self, agent_id: int) -> Presence | None:
        """The presence; None for an id that is not of this fleet."""
        return self._now.get(agent_id)

    def do(
        self,
        request: PresenceRequest,
        coordinator: Coordinator,
        beliefs: FleetBeliefs,
        now_ms: MissionMs,
        held: frozenset[int] = frozenset(),
        lent: frozenset[int] = frozenset(),
    ) -> list[Action] | str:
        """Returns the aMussels' stimuli and the note for the journal; or the reason for a refusal, without a change.

        `held` are the aMussels in the mission's docks. The reports of a simulated one count, too: a hand may have docked
        it. Those of a real one may be of long ago. `lent` are those that another aPad serves.
        """
        if (before := self._now.get(request.agent_id)) is None:
            return f"aMussel {request.agent_id} is not of this fleet"
        reports_docked = before is Presence.SIMULATED and is_docked(beliefs, request.agent_id)
        if request.agent_id in held or reports_docked:
            return f"aMussel {request.agent_id} is in a dock: undock it first"
        if request.agent_id in lent:
            return f"another aPad serves aMussel {request.agent_id} and would not know of the change"
        if (after := TABLE.get((before, request.trigger))) is None:
            return f"aMussel {request.agent_id} is {before}: it cannot {request.trigger}"
        if request.trigger is PresenceTrigger.SPAWN and (why := _no_spawn(request)) is not None:
            return why
        stimuli: list[Action] = []
        if after is Presence.SIMULATED:
            if (placed := self._placed(request, beliefs)) is None:
                return f"no report came from the real aMussel {request.agent_id}: retire it, and spawn it somewhere"
            stimuli.append((request.agent_id, placed))
            coordinator.unmute(request.agent_id, now_ms)
        else:
            coordinator.mute(request.agent_id)
        if request.trigger in (PresenceTrigger.HAND_OVER, PresenceTrigger.TAKE_BACK):
            beliefs.learn(request.agent_id, HandedOver(placed=after is Presence.SIMULATED), now_ms)
        else:
            beliefs.forget(request.agent_id)
        self._now[request.agent_id] = after
        self.simulated = self._simulated_ids()
        return [*stimuli, PresenceChanged(request.agent_id, after, request.by)]

    def _simulated_ids(self) -> frozenset[int]:
        return frozenset(it for it, presence in self._now.items() if presence is Presence.SIMULATED)

    def _placed(self, request: PresenceRequest, beliefs: FleetBeliefs) -> Placed | None:
        """On the bottom, at the requested place or at the believed place of the real one; None without a belief."""
        if request.trigger is PresenceTrigger.TAKE_BACK:
            if (belief := beliefs.get(request.agent_id)) is None or belief.is_of_another_board:
                return None
            north_m, east_m = belief.north_m, belief.east_m
            charges = belief.primary, belief.secondary
        else:
            north_m, east_m = request.at or (0.0, 0.0)
            charges = request.charges
        return Placed(
            round(north_m * 1e6),
            round(east_m * 1e6),
            round(self._bottom_m * 1e6),
            grains(charges[0]),
            grains(charges[1]),
        )


def _no_spawn(request: PresenceRequest) -> str | None:
    """The reason for refusing to spawn, or None. Charge 0 is refused: ROS 1 fills a field that is left out with 0."""
    if not all(0.0 < charge <= 1.0 for charge in request.charges):
        return "primary and secondary are charges above 0 and up to 1 (0 if left out): give both"
    if not math.hypot(*(request.at or (0.0, 0.0))) <= FARTHEST_M:
        return f"a place is metres north and east of the scenario's origin, {FARTHEST_M:.0f} m away at most"
    return None


class Roster:
    """The presences of a flight's fleet, and the requests that change them or cause faults."""

    def __init__(
        self,
        presences: Presences,
        requests: RosterRequests,
        coordinator: Coordinator,
        faults: FaultInjection | NoFaults,
    ) -> None:
        self.presences = presences
        self._faults = faults
        self._coordinator = coordinator
        self._requests = requests
        self._answers: list[tuple[RosterRequest, str | None]] = []

    def is_simulated(self, agent_id: int) -> bool:
        return agent_id in self.presences.simulated

    def is_real(self, agent_id: int) -> bool:
        return self.presences.of(agent_id) is Presence.REAL

    def is_muted(self, agent_id: int) -> bool:
        """True for one of this fleet whose simulated body nobody hears: its sound and ranges to it count for nothing."""
        return self.presences.of(agent_id) in (Presence.REAL, Presence.RETIRED)

    def advance(
        self,
        beliefs: FleetBeliefs,
        now_ms: MissionMs,
        held: frozenset[int] = frozenset(),
        lent: frozenset[int] = frozenset(),
    ) -> list[Action]:
        """Applies the requests since the last tick. No caller gets an answer before `answer`.

        `held` are the aMussels in the mission's docks, `lent` those that another aPad serves.
        """
        actions: list[Action] = []
        for request in self._requests.take():
            outcome = (
                self._cause(request, beliefs, now_ms)
                if isinstance(request, FaultRequest)
                else self.presences.do(request, self._coordinator, beliefs, now_ms, held, lent)
            )
            refusal = outcome if isinstance(outcome, str) else None
            actions += outcome if not isinstance(outcome, str) else ()
            self._answers.append((request, refusal))
        return actions

    def _cause(self, request: FaultRequest, beliefs: FleetBeliefs, now_ms: MissionMs) -> list[Action] | str:
        """Begins a fault, or returns the reason for a refusal."""
        if request.agent_id is not None:
            if (presence := self.presences.of(request.agent_id)) is None:
                return f"aMussel {request.agent_id} is not of this fleet"
            if presence is not Presence.SIMULATED:
                return f"aMussel {request.agent_id} is {presence}: faults are for simulated ones"
        try:
            asked = injection(request.fault, request.agent_id, request.value, request.for_s)
        except ValueError as error:
            return str(error)
        return self._faults.cause(asked, beliefs, now_ms)

    def ask(self, request: RosterRequest) -> str | None:
        """A request of another thread, which waits: the reason for a refusal; None when it was done."""
        return self._requests.ask(request)

    def answer(self) -> None:
        """Answers the requests. Call it when the changes are on disk, so that an accepted request outlives a crash."""
        answers, self._answers = self._answers, []
        for request, refusal in answers:
            self._requests.answer(request, refusal)


class NoRoster:
    """The roster of a flight that nobody asks for changes."""

    def ask(self, request: RosterRequest) -> str | None:
        return "no fleet is simulated in this run"

    def is_simulated(self, agent_id: int) -> bool:
        return True

    def is_real(self, agent_id: int) -> bool:
        return False

    def is_muted(self, agent_id: int) -> bool:
        return False

    def advance(
        self,
        beliefs: FleetBeliefs,
        now_ms: MissionMs,
        held: frozenset[int] = frozenset(),
        lent: frozenset[int] = frozenset(),
    ) -> list[Action]:
        return []

    def answer(self) -> None:
        pass


@dataclass(frozen=True, slots=True)
class Claim:
    """A node's claim to these aMussels, as `real` or as simulated ones."""

    node: str
    real: bool
    since_s: float
    """Wall-clock time."""
    ids: frozenset[int]
    until_s: float
    """Monotonic-clock time."""


def unclaimed_real_ids(before: Mapping[int, PresenceChange], claims: Iterable[Claim]) -> dict[int, str]:
    """The real aMussels missing from the live claim of real ones of the node that had claimed them; and its name."""
    real = {claim.node: claim.ids for claim in claims if claim.real}
    return {
        agent_id: it.by
        for agent_id, it in before.items()
        if it.presence is Presence.REAL and it.by in real and agent_id not in real[it.by]
    }


def claim_conflicts(
    presence_of: Callable[[int], Presence | None],
    before: Mapping[int, PresenceChange],
    claims: Iterable[Claim],
) -> list[str]:
    """A line for a person on each aMussel for which living claims contradict the journal."""
    claims = list(claims)
    lines = [
        f"aMussel {agent_id} was real by {node}, which claims it no more: it is taken back"
        for agent_id, node in sorted(unclaimed_real_ids(before, claims).items())
    ]
    for claim in claims:
        for agent_id in sorted(claim.ids):
            was, what = presence_of(agent_id), "real" if claim.real else "simulated"
            if (outcome := _OUTCOMES.get((was, claim.real))) is not None:
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
"""The outcome by presence and by the claim's `real`; a retired aMussel that another node simulates is no conflict."""
