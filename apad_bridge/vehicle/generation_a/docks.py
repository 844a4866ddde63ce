"""Derives a generation A aPad's dock occupancy from `position_static`, the only topic about docks.

A silence of that topic is no proof. The published server publishes for as many docks as are closed, counted from the
first, and so falls silent about a higher dock when a lower one opens. So the aPad is asked what it holds before a
silence that nobody ordered counts as a release. It is asked after each docking too, because the mission counts a docking by
more than one witness. An answer that names none of the held aMussels is none: the public docking simulator counts by
itself, and knows nothing of perches. Then a living action server holds what it held.

A perch that seemed to fail may have been done late, and the one that repeats it makes the published server hold the
aMussel twice. Its position then goes on after the release: that is no new docking, and the aPad has to release it again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from apad_bridge.scenario.choices import PAPER_DOCKS
from apad_bridge.vehicle.capabilities import DockPlaces, published_docks
from apad_bridge.vehicle.commands import DockClosed, DockOpened, DocksNamed
from apad_bridge.vehicle.generation_a.messages import OBJECT_PREFIX, DocksReceived, HeldPositionReceived
from apad_bridge.vehicle.telemetry import Readings
from apad_bridge.vehicle.vehicle_link import Carried, LetGo, LinkFact

RELEASE_SILENCE_MS = 2_000
"""From the acceptance of a release, so long a silence of `position_static` counts as the release, because the published
server crashes in it."""
UNACCEPTED_SILENCE_MS = 5_000
"""So long from a release order that was not accepted: it may be on its way, or the server crashed before it said so."""
SILENCE_MS = 10_000
"""After so long a silence without an order the aPad is asked what it holds, again and again while it lasts. It is longer,
because a gap in the Wi-Fi is no release. For the same reason silence counts only while the aPad itself is heard."""
ANSWER_MS = 5_000
"""So long an answer is awaited."""
TWICE_MS = 10_000
"""A position so soon after a release is that of an aMussel held twice, if more than one perch was ordered. Later, a person
may have docked it."""
_SERVICE = "check_docking_availability"
PAPERS_PLACES = published_docks(PAPER_DOCKS)


@dataclass(slots=True)
class _Holding:
    dock_index: int
    heard_ms: int
    place_m: tuple[float, float] | None
    is_new: bool
    """The place was not returned by `places` yet."""
    release_ms: int | None = None
    """The time of the release order; from its acceptance on, the time of that."""
    is_accepted: bool = False
    """The aPad carries the release out."""
    asked_ms: int | None = None
    """The time since which the aPad's answer is awaited."""
    confirmed_ms: int = -1
    """The time at which this aMussel, whose `position_static` is silent, was last found to be held all the same."""


@dataclass(slots=True)
class _Surplus:
    """The perches, beyond one, of an agent that was released from this dock."""

    dock_index: int
    perches: int
    until_ms: int
    """A first position up to here shows that the aPad holds it still."""
    is_held: bool = False


class ReportedDocks:
    """Docks fill in the order of perches: the vehicle takes the first free dock, whatever the command named.

    `docked` are the agents by dock index that the vehicle is known to hold at `now_ms`, as after a resume. Objects are
    called `object_prefix` and the aMussel's id.
    """

    def __init__(
        self,
        agent_ids: Iterable[int],
        docked: Mapping[int, int] = MappingProxyType({}),
        now_ms: int = 0,
        places: DockPlaces = PAPERS_PLACES,
        object_prefix: str = OBJECT_PREFIX,
    ) -> None:
        self._places = places
        self.object_prefix = object_prefix
        self.dropped: Counter[str] = Counter()
        self.disagreements: list[tuple[int, str]] = []
        """Agents with what the witnesses of their docks say, each told once and taken by the core."""
        self.unordered_releases: list[tuple[int, int]] = []
        """The dock's index and the agent, where the vehicle may hold it though its dock opened, by silence alone or once of
        twice: it should release it by name."""
        self.lost_m: dict[int, tuple[float, float]] = {}
        """The last place (north, east) of each free agent whose dock opened by silence alone."""
        self._perches: Counter[int] = Counter()
        """Perches ordered of each agent since its last release, without those that the server refused."""
        self._surpluses: dict[int, _Surplus] = {}
        """Released agents of which more than one perch was ordered."""
        self._asks = bool(docked)
        self._named_alone: frozenset[int] = frozenset()
        """Agents that the last answer named, and that no `position_static` shows."""
        self._served = frozenset(agent_ids)
        self._served_before: frozenset[int] = frozenset()
        self._held = {
            agent_id: _Holding(dock_index, now_ms, None, False)
            for dock_index, agent_id in sorted(docked.items())
        }

    def serve(self, agent_ids: Iterable[int]) -> None:
        """Serves these from now on. Messages about free aMussels that it served before do not count as dropped."""
        self._served_before |= self._served
        self._served = frozenset(agent_ids)
        self._served_before -= self._served

    def holds(self, agent_id: int) -> bool:
        return agent_id in self._held

    def dock_index_of(self, agent_id: int) -> int:
        """KeyError for an aMussel that is not held."""
        return self._held[agent_id].dock_index

    def unreported_ids(self, now_ms: int) -> list[int]:
        """Held agents without a position up to `now_ms`, except those under release and those known to be unreported."""
        return [
            agent_id
            for agent_id, holding in self._held.items()
            if holding.heard_ms < now_ms
            and holding.release_ms is None
            and holding.confirmed_ms < holding.heard_ms
        ]

    def order_perch(self, agent_id: int) -> None:
        surplus = self._surpluses.pop(agent_id, None)
        self._forget_release(agent_id)
        self._perches[agent_id] += 1 + (surplus.perches if surplus is not None and surplus.is_held else 0)

    def _forget_release(self, agent_id: int) -> None:
        self.unordered_releases = [it for it in self.unordered_releases if it[1] != agent_id]

    def perch_refused(self, agent_id: int) -> None:
        """The server did not carry the perch out."""
        self._perches[agent_id] -= 1

    def order_release(self, agent_id: int, now_ms: int) -> None:
        if (holding := self._held.get(agent_id)) is not None:
            holding.release_ms, holding.is_accepted = now_ms, False

    def release_accepted(self, agent_id: int, at_ms: int) -> None:
        if (holding := self._held.get(agent_id)) is not None:
            holding.release_ms, holding.is_accepted = at_ms, True

    def take_question(self) -> bool:
        """True, once, when the aPad should be asked what it holds."""
        asks, self._asks = self._asks, False
        return asks

    def receive(self, message: HeldPositionReceived) -> list[LinkFact]:
        """The changes at the docks. A position that only moved comes with `places`."""
        holding = self._held.get(message.agent_id)
        if message.agent_id in self._served_before and holding is None:
            return []
        if message.agent_id not in self._served | self._served_before:
            self.dropped["position_static of an aMussel that is not of this fleet"] += 1
            return []
        if holding is None and self._is_surplus(message):
            return []
        if message.released:
            if holding is None:
                self.dropped["release of an aMussel that was not held"] += 1
                return []
            return self._open(message.agent_id, message.at_ms)
        place_m = (message.north_m, message.east_m)
        if holding is not None:
            holding.heard_ms, holding.place_m, holding.is_new = message.at_ms, place_m, True
            holding.asked_ms = None
            return []
        taken = {other.dock_index for other in self._held.values()}
        free = [dock_index for dock_index in self._places.indices if dock_index not in taken]
        if not free:
            self.dropped["position_static of more aMussels than there are docks"] += 1
            return []
        self._held[message.agent_id] = _Holding(free[0], message.at_ms, place_m, False)
        self.lost_m.pop(message.agent_id, None)
        self._forget_release(message.agent_id)
        self._asks = True
        return [
            DockClosed(message.at_ms, free[0], message.agent_id),
            Carried(message.at_ms, message.agent_id, *place_m),
        ]

    def _is_surplus(self, message: HeldPositionReceived) -> bool:
        """The message is of an aMussel that was held twice and released once; the first such message orders a release."""
        agent_id = message.agent_id
        surplus = self._surpluses.get(agent_id)
        if surplus is None or not (surplus.is_held or message.at_ms <= surplus.until_ms):
            return False
        if not surplus.is_held:
            self.dropped["position_static of an aMussel that was held twice: released again"] += 1
            self.unordered_releases += [(surplus.dock_index, agent_id)] * surplus.perches
        surplus.is_held = True
        surplus.perches -= message.released
        if surplus.perches == 0:
            del self._surpluses[agent_id]
        return True

    def receive_answer(self, answer: DocksReceived, *, server_lives: bool) -> list[LinkFact]:
        """Takes the aPad's answer about aMussels whose `position_static` is silent."""
        facts: list[LinkFact] = []
        told = {it for it in self._served if f"{self.object_prefix}{it}" in (answer.held or ())}
        named, alone = told & self._held.keys(), frozenset(told - self._held.keys())
        for agent_id in sorted(alone - self._named_alone):
            self._disagree(agent_id, f"{_SERVICE} names it, and no position_static shows it: taken for free")
        self._named_alone = alone
        if named:
            facts.append(DocksNamed(answer.at_ms, frozenset(self._held), frozenset(named)))
        for agent_id, holding in list(self._held.items()):
            if holding.asked_ms is None:
                continue
            if agent_id in named or (not named and server_lives):
                if holding.confirmed_ms < holding.heard_ms:
                    none = "does not answer" if answer.held is None else "names none that is held"
                    says = "names it" if agent_id in named else f"{none}, and the action server lives"
                    self._disagree(agent_id, f"position_static is silent, {_SERVICE} {says}: taken for held")
                self._reckon(holding, answer.at_ms)
            elif named:
                self.dropped["silence on position_static, and the aPad no longer holds it"] += 1
                says = f"position_static is silent, {_SERVICE} names others"
                self._disagree(agent_id, f"{says}, and no release was ordered: taken for released")
                facts += self._open(agent_id, answer.at_ms)
            else:
                facts += self._open_by_silence(agent_id, answer.at_ms, "no release was ordered")
        return facts

    def receive_refusal(self, agent_id: int, at_ms: int) -> list[LinkFact]:
        """The vehicle refused to release this aMussel by its name: it does not hold one whose position is silent."""
        if (holding := self._held.get(agent_id)) is None:
            return []
        holding.release_ms = None
        if holding.confirmed_ms <= holding.heard_ms:
            return []
        return self._open_by_silence(agent_id, at_ms, "the aPad refuses to release it")

    def silent(self, readings: Readings, *, server_lives: bool) -> list[LinkFact]:
        """Opens the docks of silent aMussels, or asks about them. Silence counts while the aPad itself is heard."""
        facts: list[LinkFact] = []
        heard_ms = readings.position_ms
        for agent_id, holding in list(self._held.items()):
            since_ms = max(holding.heard_ms, holding.confirmed_ms, readings.heard_since_ms)
            if holding.release_ms is not None:
                silence_ms = RELEASE_SILENCE_MS if holding.is_accepted else UNACCEPTED_SILENCE_MS
                if (due_ms := max(since_ms, holding.release_ms) + silence_ms) <= heard_ms:
                    self.dropped["silence on position_static, taken for a release"] += 1
                    facts += self._open(agent_id, due_ms)
            elif since_ms + SILENCE_MS > heard_ms:
                pass
            elif holding.asked_ms is None:
                holding.asked_ms, self._asks = heard_ms, True
            elif holding.asked_ms + ANSWER_MS <= heard_ms:
                facts += self.receive_answer(DocksReceived(heard_ms, None), server_lives=server_lives)
        return facts

    def places(self, readings: Readings) -> list[Carried]:
        """The newest position of each held aMussel that has one since the last call, or that is reckoned."""
        carried, pose = [], readings.pose
        for agent_id, holding in sorted(self._held.items()):
            if holding.is_new and holding.place_m is not None:
                holding.is_new = False
                carried.append(Carried(holding.heard_ms, agent_id, *holding.place_m))
            elif holding.confirmed_ms > holding.heard_ms and pose is not None:
                holding.place_m = self._places.place_m(
                    holding.dock_index, pose.north_m, pose.east_m, pose.heading_rad
                )
                carried.append(Carried(pose.at_ms, agent_id, *holding.place_m))
        return carried

    def _reckon(self, holding: _Holding, at_ms: int) -> None:
        if holding.confirmed_ms < holding.heard_ms:
            self.dropped["silence on position_static of an aMussel that the aPad holds: dead reckoning"] += 1
        holding.asked_ms, holding.confirmed_ms = None, at_ms

    def _disagree(self, agent_id: int, reason: str) -> None:
        self.disagreements.append((agent_id, reason))

    def _open_by_silence(self, agent_id: int, at_ms: int, why: str) -> list[LinkFact]:
        self.dropped["silence on position_static, taken for a release without an order"] += 1
        self._disagree(agent_id, f"position_static is silent, and {why}: taken for released")
        self.unordered_releases.append((self._held[agent_id].dock_index, agent_id))
        if (place_m := self._held[agent_id].place_m) is not None:
            self.lost_m[agent_id] = place_m
        return self._open(agent_id, at_ms)

    def _open(self, agent_id: int, at_ms: int) -> list[LinkFact]:
        holding = self._held.pop(agent_id)
        if (perches := self._perches.pop(agent_id, 0)) > 1:
            self._surpluses[agent_id] = _Surplus(holding.dock_index, perches - 1, at_ms + TWICE_MS)
        return [DockOpened(at_ms, holding.dock_index, agent_id), LetGo(at_ms, agent_id)]
