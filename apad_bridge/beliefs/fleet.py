"""The beliefs of a whole fleet under one estimator. Packets are checked here, before any filter takes them."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum, auto
from typing import Any, NamedTuple, Protocol

from agents.time_scale import AgentMs, MissionMs, TimeScale
from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.beliefs.measurement import ClockSet, Measurement, Rejected
from firmware_model.packets import ShortStatus, StatusPacket

# Checks the agent times that packets state: a stamp may be corrupted, and a clock may really have been set.
#
# Between two packets a clock runs theta times as fast as mission time. A single packet that contradicts this is not
# believed, because every true packet after it would look overtaken. A second packet that agrees with it is believed.
_MAX_DELAY_MS = 60_000
"""The longest mission time that a packet may travel or wait; a wrong stamp can shut true packets out no longer."""
_MAX_DRIFT_PPM = 500
"""Far more than any board's drift: a watch crystal is within some tens of ppm."""


class StampVerdict(Enum):
    IN_TIME = auto()
    OVERTAKEN = auto()
    IMPOSSIBLE = auto()
    """The clock as believed cannot show this time; the stamp is kept for comparison, and the belief does not change."""
    CLOCK_SET = auto()
    """The stamp agrees with the doubted one before it: the clock was set."""


class Stamp(NamedTuple):
    agent_ms: int
    at_ms: int
    """Mission time at which the clock showed it."""


class StampChecker:
    """Keeps the newest stamp of each aMussel. `scale` is None if it is unknown: then any time may follow another."""

    def __init__(self, scale: TimeScale | None) -> None:
        self._scale = scale
        self.newest: dict[int, Stamp] = {}
        self._doubted: dict[int, tuple[int, Stamp]] = {}

    def judge(self, packet: StatusPacket, at_ms: int) -> StampVerdict:
        """Judges a packet received at mission time `at_ms`; the caller calls `accept` if it believes the packet."""
        newest, stamp = self.newest.get(packet.agent_id), Stamp(packet.agent_ms, at_ms)
        if newest is None:
            return StampVerdict.IN_TIME
        if not self._disagree(newest, stamp) or self._is_delayed(newest, stamp):
            self._doubted.pop(packet.agent_id, None)
            return StampVerdict.OVERTAKEN if stamp.agent_ms < newest.agent_ms else StampVerdict.IN_TIME
        before = self._doubted.get(packet.agent_id)
        if before is not None and before[0] == packet.sequence and before[1].agent_ms == stamp.agent_ms:
            return StampVerdict.IMPOSSIBLE  # a repetition of the same packet is no confirmation
        self._doubted[packet.agent_id] = packet.sequence, stamp
        if before is None or stamp.agent_ms < before[1].agent_ms or self._disagree(before[1], stamp):
            return StampVerdict.IMPOSSIBLE
        return StampVerdict.CLOCK_SET

    def accept(self, packet: StatusPacket, at_ms: int) -> None:
        """Accepts the stamp, whatever the verdict. A delayed packet in sequence carries no information about the clock."""
        newest, stamp = self.newest.get(packet.agent_id), Stamp(packet.agent_ms, at_ms)
        if self._doubted:
            self._doubted.pop(packet.agent_id, None)
        if self._scale is not None and newest is not None and self._is_delayed(newest, stamp):
            shown_ms = newest.at_ms + self._scale.mission_span(stamp.agent_ms - newest.agent_ms)
            stamp = Stamp(stamp.agent_ms, shown_ms)
        self.newest[packet.agent_id] = stamp

    def forget(self, agent_id: int) -> None:
        self.newest.pop(agent_id, None)
        self._doubted.pop(agent_id, None)

    def _ahead_ms(self, before: Stamp, after: Stamp) -> int:
        """The agent time by which the clock advanced more than mission time times theta."""
        assert self._scale is not None
        return after.agent_ms - before.agent_ms - self._scale.agent_span(after.at_ms - before.at_ms)

    def _is_delayed(self, before: Stamp, after: Stamp) -> bool:
        """True if the clock advanced, but by less than it should have: the packet waited."""
        if self._scale is None or after.agent_ms < before.agent_ms:
            return False
        return self._ahead_ms(before, after) < 0 and self._disagree(before, after)

    def _disagree(self, before: Stamp, after: Stamp) -> bool:
        if self._scale is None:
            return False
        doubt_ms = _MAX_DELAY_MS + abs(after.at_ms - before.at_ms) * _MAX_DRIFT_PPM // 1_000_000
        return abs(self._ahead_ms(before, after)) > self._scale.agent_span(doubt_ms)


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
        reason = out_of_range(
            north_m=packet.north_m,
            east_m=packet.east_m,
            depth_m=packet.depth_m,
            charge=packet.primary,
            secondary_charge=packet.secondary,
        )
        if reason is not None:
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
        if (before := self._beliefs.get(packet.agent_id)) is None:
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
