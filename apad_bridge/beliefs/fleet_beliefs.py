"""The beliefs of a whole fleet under one estimator. Packets are checked here, before any filter takes them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

from agents.time_scale import AgentMs, MissionMs, TimeScale
from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.beliefs.input_ranges import out_of_range, status_out_of_range
from apad_bridge.beliefs.measurement import ClockSet, HandedOver, Measurement, Rejected
from apad_bridge.beliefs.stamp_checker import Stamp, StampChecker, StampVerdict
from firmware_model.packets import ShortStatus, StatusPacket


class Estimator(Protocol):
    """Pure functions from belief to belief. They are called at events only; an estimator has no clock of its own."""

    def predict(self, belief: Belief, to_ms: MissionMs) -> Belief:
        """The belief for mission time `to_ms` without new measurements (ValueError if that is before the belief's time)."""

    def update(self, belief: Belief | None, measurement: Measurement, at_ms: MissionMs) -> Belief | None:
        """The belief with the `measurement` of `at_ms` taken in; None while nothing is known. Raises Rejected."""

    def kept(self, belief: Belief) -> dict[str, Any]:
        """The whole belief except its id, as plain data of JSON's types."""

    def restored(self, agent_id: int, data: dict[str, Any]) -> Belief:
        """The inverse of `kept`, exactly; KeyError, TypeError or ValueError for anything else."""


class BeliefLog(Protocol):
    """A log of every measurement that a fleet's beliefs come from, written as it is learned."""

    def learned(self, agent_id: int, measurement: Measurement, at_ms: MissionMs) -> None: ...

    def forgot(self, agent_id: int) -> None: ...

    def admitted(self, agent_id: int, kept: dict[str, Any]) -> None:
        """Another fleet's belief of this aMussel, as the estimator keeps it, holds from now on."""


class FleetBeliefs:
    """Beliefs by agent id, for the ids of one fleet. `advance` sets the time; `get` and `all` predict to that time."""

    def __init__(
        self,
        estimator: Estimator,
        agent_ids: Iterable[int],
        due_every_ms: int | None = None,
        scale: TimeScale | None = None,
    ) -> None:
        """`due_every_ms` is the mission time between two packets that are due; `scale` is that of the agents' clocks.

        Either is None when it is unknown.
        """
        self.estimator = estimator
        self._due_every_ms = due_every_ms
        self._known = frozenset(agent_ids)
        self._beliefs: dict[int, Belief] = {}
        self._stamp_checker = StampChecker(scale)
        self._now_ms = MissionMs(0)
        self._at_now: dict[int, Belief] = {}
        self._all_now: list[Belief] | None = None
        """All of them at this time, by id; None after a change."""
        self.belief_log: BeliefLog | None = None

    def advance(self, now_ms: MissionMs) -> None:
        """ValueError if time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        if now_ms > self._now_ms:
            self._now_ms = now_ms
            self._at_now.clear()
            self._all_now = None

    def get(self, agent_id: int) -> Belief | None:
        belief = self._at_now.get(agent_id)
        if belief is None and (newest := self._beliefs.get(agent_id)) is not None:
            belief = newest
            if newest.at_ms < self._now_ms:
                belief = self._count_silence(self.estimator.predict(newest, self._now_ms))
            self._at_now[agent_id] = belief
        return belief

    def suspicion(self, agent_id: int) -> Suspicion | None:
        """The suspicion against an aMussel; None, too, for one of which nothing is believed."""
        newest = self._beliefs.get(agent_id)
        return None if newest is None else newest.suspicion

    def all(self) -> list[Belief]:
        """All beliefs, sorted by agent id."""
        if self._all_now is None:
            found = (self.get(agent_id) for agent_id in sorted(self._beliefs))
            self._all_now = [belief for belief in found if belief is not None]
        return self._all_now.copy()

    def _count_silence(self, belief: Belief) -> Belief:
        if self._due_every_ms is None:
            return belief
        silent = (belief.at_ms - belief.heard_ms) // self._due_every_ms
        return belief if silent == belief.silent_timeslots else belief.counting_silence(silent)

    def hear(self, packet: StatusPacket, at_ms: MissionMs) -> str | None:
        """Takes in a packet received at mission time `at_ms`; or returns the reason why not, and changes nothing."""
        if packet.agent_id not in self._known:
            return "a status of an unknown aMussel"
        if (reason := status_out_of_range(packet)) is not None:
            return f"a status: {reason}"
        match self._stamp_checker.judge(packet, at_ms):
            case StampVerdict.OVERTAKEN:
                return "a status that a newer one overtook"
            case StampVerdict.IMPOSSIBLE:
                return "a status of a time that its clock cannot show, unless another agrees"
            case StampVerdict.CLOCK_SET:
                self.learn(packet.agent_id, ClockSet(AgentMs(packet.agent_ms)), at_ms)
        return self.learn(packet.agent_id, packet, at_ms)

    def hear_short(self, packet: ShortStatus, at_ms: MissionMs) -> str | None:
        """Does the work of `hear` for a status without place and time: both stay as believed."""
        if (before := self._beliefs.get(packet.agent_id)) is None or before.is_of_another_board:
            return "a short status of an aMussel whose place is not known"
        if at_ms < before.heard_ms:
            return "a status that a newer one overtook"
        if (reason := out_of_range(charge=packet.primary, secondary_charge=packet.secondary)) is not None:
            return f"a short status: {reason}"
        return self.learn(packet.agent_id, packet, at_ms)

    def admit(self, agent_id: int, belief: Belief | None) -> None:
        """Adds an aMussel of another fleet: its packets count here from now on. `belief` is the other fleet's, if any."""
        self._known |= {agent_id}
        if belief is not None:
            self.forget(agent_id)
            self._beliefs[agent_id] = belief
            if self.belief_log is not None:
                self.belief_log.admitted(agent_id, self.estimator.kept(belief))

    def dismiss(self, agent_id: int) -> None:
        """Removes an aMussel from this fleet."""
        self._known -= {agent_id}
        self.forget(agent_id)

    def forget(self, agent_id: int) -> None:
        """Drops the belief; the aMussel's next packet is accepted, whatever time it states."""
        self._beliefs.pop(agent_id, None)
        self._at_now.pop(agent_id, None)
        self._all_now = None
        self._stamp_checker.forget(agent_id)
        if self.belief_log is not None:
            self.belief_log.forgot(agent_id)

    def learn(self, agent_id: int, measurement: Measurement, at_ms: MissionMs) -> str | None:
        """Takes in a measurement of one aMussel at `at_ms`; or returns why it is rejected, and changes nothing."""
        before = self._beliefs.get(agent_id)
        try:
            belief = self.estimator.update(before, measurement, at_ms)
        except Rejected as rejected:
            return str(rejected)
        if belief is None or belief is before:
            return None
        self._beliefs[agent_id] = belief
        self._at_now.pop(agent_id, None)
        self._all_now = None
        if isinstance(measurement, StatusPacket):
            self._stamp_checker.accept(measurement, at_ms)
        elif isinstance(measurement, HandedOver):
            self._stamp_checker.forget(agent_id)
        if self.belief_log is not None:
            self.belief_log.learned(agent_id, measurement, at_ms)
        return None

    def kept(self) -> list[list[Any]]:
        """All beliefs as plain data, by id: [id, the newest stamp of its clock or None, the estimator's data].

        A stamp that waits for a second one to agree is left out: after a clock was just set, one more packet is needed.
        """
        found: list[list[Any]] = []
        for agent_id, belief in sorted(self._beliefs.items()):
            newest = self._stamp_checker.newest.get(agent_id)
            stamp = None if newest is None else list(newest)
            found.append([agent_id, stamp, self.estimator.kept(belief)])
        return found

    def restore(self, kept: list[list[Any]]) -> None:
        """Replaces all beliefs by the data that `kept` returned for the same fleet.

        Raises KeyError, TypeError or ValueError for other data, and then changes nothing.
        """
        beliefs = {agent_id: self.estimator.restored(agent_id, data) for agent_id, _, data in kept}
        newest = {agent_id: Stamp(*stamp) for agent_id, stamp, _ in kept if stamp is not None}
        self._beliefs, self._stamp_checker.newest = beliefs, newest
        self._at_now.clear()
        self._all_now = None
