"""Schedules the aPad's acoustic packets around its aMussels' timeslots: beacons, timeslots, pings and status requests.

The scheduler gives each packet a send time at which no aMussel has its timeslot and the aPad's modem is free, so that the
time in a beacon is true when it is sent. It pings each aMussel to learn its propagation delay, and assigns it a timeslot
with an offset that makes its packets arrive within the timeslot. From time to time it sends a beacon, and all timeslots
again. It also asks single aMussels for their status, and tracks whose answer is still awaited.

An aMussel that sets its clock by a beacon is late by the beacon's propagation delay, and its own packets take as long
again: so its offset is minus twice the delay. The guard covers the clocks' drift between two beacons.

Times are agent time unless stated otherwise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from agents.modem.frames import SHORT_MS, duration_ms
from agents.packet_medium import Medium
from agents.time_scale import AgentMs, MissionMs, TimeScale
from agents.water.apad_modem import ANSWER_TIMEOUT_MS
from apad_bridge.events.sound_events import Asked, NoAnswer
from apad_bridge.mission.facts import Ping, Send, SupervisorAction
from apad_bridge.scenario.water.water_options import Water
from firmware_model.config import Timeslots, timeslots_of
from firmware_model.packets import EVERYONE, Beacon, CommandPacket, Kind, SlotAssignment
from firmware_model.packets.codec import Codec

ASK_AGAIN_MS = 600_000
"""The time before an aMussel that did not answer, or that is still too uncertain, is asked again."""


@dataclass(frozen=True, slots=True)
class ScheduleConfig:
    scale: TimeScale
    water: Water
    """The scenario's block, with the aPad's `talk`."""
    longest_delay_ms: int
    """The longest propagation delay, by which a packet may reach into somebody's timeslot."""
    answer_ms: int = 0
    """The time from the end of a status request to the end of the answer, without the propagation delays."""
    pause_ms: int = 20
    """The pause before a status request, and between packets of the mission. A moving aPad may send the second packet from
    nearer, so that it would run into the first packet, whose echoes are also still in the water."""


class AcousticScheduler:
    """Works at mission ticks: `advance` returns due packets, and `send` gives other parts' packets their send times."""

    def __init__(
        self,
        config: ScheduleConfig,
        codec: Codec,
        slots: Timeslots | None,
        agent_ids: Iterable[int],
        served: Iterable[int] | None = None,
    ) -> None:
        """`agent_ids` are the whole fleet's. This aPad serves those in `served`, or all of them if it is None."""
        self._config = config
        self._codec = codec
        self._slots = slots
        self._numbers = timeslots_of(agent_ids)
        served_ids = list(self._numbers) if served is None else sorted(served)
        self._window = ALWAYS
        talk = config.water.talk
        self._beacon_period_ms = round(talk.beacon_period_s * 1000)
        """Agent time; the next one is mission time. 0 means never."""
        self._ping_period_ms = round(talk.ping_period_s * 1000)
        self._guard_ms = 0 if slots is None else slots.guard_ms
        if talk.waits and slots is not None:
            self._window = TdmaWindow(slots.frame_ms, len(self._numbers) * slots.slot_ms, talk.turn)
        self._free_from_ms = 0
        """The time from which nothing is scheduled yet."""
        self._assigns = talk.assigns and slots is not None
        self._measure_at_ms: dict[int, int] = dict.fromkeys(served_ids if self._assigns else (), 0)
        """The times at which propagation delays are to be measured (again)."""
        self.delays_ms: dict[int, int] = {}
        """The propagation delay of each aMussel that has a timeslot made for it."""
        self._scheduled: dict[tuple[int, bytes], int] = {}
        """The send times of the mission's packets, by receiver and bytes."""
        self._beacon_due_ms = 0
        self._ping_due_ms = 0
        self._ping_order = deque(served_ids)
        self.unanswered = 0
        """The number of status requests without an answer in time."""
        self._pings = PendingPings()
        self._status_requests = PendingPings()

    def full_state(self) -> dict[str, Any]:
        """Everything learned and done so far, as plain data.

        Packets that wait to be sent are left out: they are lost with the water that would carry them.
        """
        return {
            "learn_at_ms": list(self._measure_at_ms.items()),
            "ways_ms": list(self.delays_ms.items()),
            "beacon_due_ms": self._beacon_due_ms,
            "ping_due_ms": self._ping_due_ms,
            "turns": list(self._ping_order),
            "ranged_ms": self._pings.full_state(),
            "asked_ms": self._status_requests.full_state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continues from another scheduler's `full_state`; KeyError, TypeError or ValueError for any other data."""
        self._measure_at_ms = dict(state["learn_at_ms"])
        self.delays_ms = dict(state["ways_ms"])
        self._beacon_due_ms, self._ping_due_ms = state["beacon_due_ms"], state["ping_due_ms"]
        self._ping_order = deque(state["turns"])
        self._pings.restore(state["ranged_ms"])
        self._status_requests.restore(state["asked_ms"])

    def send(self, send: Send, now_ms: MissionMs) -> Send | None:
        """Another part's packet, an acoustic one with its send time; None if the same packet already waits to be sent."""
        if send.medium is not Medium.SOUND:
            return send
        agent_ms = self._config.scale.agent_ms(now_ms)
        self._scheduled = {key: at_ms for key, at_ms in self._scheduled.items() if at_ms >= agent_ms}
        if (send.agent_id, send.data) in self._scheduled:
            return None
        timed = self._with_send_time(send, now_ms, self._config.pause_ms)
        self._scheduled[send.agent_id, send.data] = timed.not_before_ms
        return timed

    def advance(
        self,
        now_ms: MissionMs,
        away: frozenset[int],
        whereabouts: Sequence[int] = (),
        charges: Sequence[int] = (),
    ) -> list[SupervisorAction]:
        """Returns what is due at mission time `now_ms`.

        aMussels in `away` are believed unable to receive: they are afloat, or in a dock. `whereabouts` lists aMussels to
        ping for their place, `charges` aMussels to ask for their status: one of each list, the first that may be asked.
        """
        config, agent_ms = self._config, self._config.scale.agent_ms(now_ms)
        actions: list[SupervisorAction] = [
            NoAnswer(agent_id) for agent_id in self._status_requests.given_up(agent_ms)
        ]
        self.unanswered += len(actions)
        if self._free_from_ms > agent_ms + config.scale.agent_span(1000):
            return actions  # earlier packets are still to be sent
        for agent_id, due_ms in self._measure_at_ms.items():
            if due_ms <= agent_ms and agent_id not in away:
                self._measure_at_ms[agent_id] = agent_ms + ASK_AGAIN_MS
                actions.append(self._ping(agent_id, now_ms))
        if self._beacon_period_ms and self._beacon_due_ms <= agent_ms:
            self._beacon_due_ms = agent_ms + self._beacon_period_ms
            actions.append(self._beacon(now_ms))
            actions += [self._assignment(it, now_ms) for it in self.delays_ms if it not in away]
        if self._ping_period_ms and self._ping_due_ms <= now_ms:
            self._ping_due_ms = now_ms + self._ping_period_ms
            actions += self._next_ping(now_ms, away)
        if (ping_id := self._pings.next(whereabouts, agent_ms)) is not None:
            actions.append(self._ping(ping_id, now_ms))
        if (asked_id := self._status_requests.next(charges, agent_ms)) is not None:
            actions += [Asked(asked_id), self._status_request(asked_id, now_ms)]
        return actions

    def short_status_received(self, agent_id: int) -> None:
        """Called for each short status, which answers a request if one was pending."""
        self._status_requests.answered(agent_id)

    def ping_answered(self, agent_id: int, range_m: float, now_ms: MissionMs) -> list[SupervisorAction]:
        """Takes an answered ping; the first answer of an aMussel gives it its timeslot."""
        if agent_id not in self._measure_at_ms:
            return []
        del self._measure_at_ms[agent_id]
        self.delays_ms[agent_id] = round(1000 * range_m / self._config.water.sound.sound_speed_m_s)
        return [self._assignment(agent_id, now_ms)]

    def start_serving(self, agent_id: int, now_ms: MissionMs) -> None:
        """Called when this aPad takes an aMussel over from another one: its delay to this aPad is measured anew."""
        if self._assigns:
            self._measure_at_ms[agent_id] = self._config.scale.agent_ms(now_ms)
        if agent_id not in self._ping_order:
            self._ping_order.append(agent_id)

    def stop_serving(self, agent_id: int) -> None:
        self._measure_at_ms.pop(agent_id, None)
        self.delays_ms.pop(agent_id, None)
        if agent_id in self._ping_order:
            self._ping_order.remove(agent_id)

    def moved(self, agent_id: int, now_ms: MissionMs) -> None:
        """Called when an aMussel was moved or exchanged: its delay is measured again, after it has had time to sink."""
        if self.delays_ms.pop(agent_id, None) is not None:
            self._measure_at_ms[agent_id] = self._config.scale.agent_ms(now_ms) + ASK_AGAIN_MS

    def _next_ping(self, now_ms: MissionMs, away: frozenset[int]) -> list[SupervisorAction]:
        for _ in range(len(self._ping_order)):
            self._ping_order.rotate(-1)
            if self._ping_order[-1] not in away:
                return [self._ping(self._ping_order[-1], now_ms)]
        return []

    def _assignment(self, agent_id: int, now_ms: MissionMs) -> Send:
        slots, delay_ms = self._slots, self.delays_ms[agent_id]
        assert slots is not None  # delays are measured for timeslots only
        offset_ms = -2 * delay_ms if self._beacon_period_ms else -delay_ms
        number = self._numbers[agent_id]
        assignment = SlotAssignment(
            agent_id, slots.frame_ms, slots.slot_ms, slots.guard_ms, number, offset_ms
        )
        return self._with_send_time(Send(Medium.SOUND, agent_id, self._codec.encode(assignment)), now_ms)

    def _beacon(self, now_ms: MissionMs) -> Send:
        # A beacon's length does not depend on the time in it.
        lasting_ms = self._duration_ms(self._codec.encode(Beacon(EVERYONE, 0)))
        at_ms = self._reserve(now_ms, lasting_ms)
        return Send(Medium.SOUND, EVERYONE, self._codec.encode(Beacon(EVERYONE, at_ms + lasting_ms)), at_ms)

    def _ping(self, agent_id: int, now_ms: MissionMs) -> Ping:
        return Ping(agent_id, self._reserve(now_ms, SHORT_MS[self._config.water.modems] + ANSWER_TIMEOUT_MS))

    def _status_request(self, agent_id: int, now_ms: MissionMs) -> Send:
        """A request for a short status; nothing else is scheduled until the answer has arrived."""
        data = self._codec.encode(CommandPacket(Kind.PING, agent_id))
        lasting_ms = self._duration_ms(data) + self._config.answer_ms + 2 * self._config.longest_delay_ms
        at_ms = AgentMs(self._reserve(now_ms, self._config.pause_ms + lasting_ms) + self._config.pause_ms)
        self._status_requests.await_answer(agent_id, at_ms + lasting_ms)
        return Send(Medium.SOUND, agent_id, data, at_ms)

    def _with_send_time(self, send: Send, now_ms: MissionMs, after_ms: int = 0) -> Send:
        return replace(send, not_before_ms=self._reserve(now_ms, self._duration_ms(send.data), after_ms))

    def _duration_ms(self, data: bytes) -> int:
        return duration_ms(self._config.water.modems, len(data))

    def _reserve(self, now_ms: MissionMs, lasting_ms: int, after_ms: int = 0) -> AgentMs:
        """Reserves the next free time of this length, at least `after_ms` after the last packet. Returns its beginning."""
        from_ms = max(self._config.scale.agent_ms(now_ms), self._free_from_ms + after_ms)
        # It must have arrived everywhere by then, and the owner of the first timeslot may be early by its guard.
        needed_ms = lasting_ms + self._config.longest_delay_ms + self._guard_ms
        at_ms = AgentMs(self._window.first_ms(from_ms, needed_ms))
        self._free_from_ms = at_ms + lasting_ms
        return at_ms


@dataclass(frozen=True, slots=True)
class TdmaWindow:
    """The times when the aPad may send. The first `taken_ms` of each frame are the aMussels' timeslots.

    A frame without any other time does not restrict the aPad. Of several aPads each has an equal part of that time: `turn`
    is (which, of how many).
    """

    frame_ms: int
    taken_ms: int
    turn: tuple[int, int] = (1, 1)

    def first_ms(self, now_ms: int, lasting_ms: int) -> int:
        """The first time from now on at which the aPad may send for so long.

        A longer sending than the window begins with a window; without any window it begins now.
        """
        if self.taken_ms >= self.frame_ms or self.taken_ms <= 0:
            return now_ms
        which, count = self.turn
        free_ms = self.frame_ms - self.taken_ms
        opens_ms, closes_ms = (self.taken_ms + free_ms * n // count for n in (which - 1, which))
        into_ms = now_ms % self.frame_ms
        if into_ms < opens_ms:
            return now_ms + opens_ms - into_ms
        if into_ms + lasting_ms <= closes_ms or into_ms == opens_ms:
            return now_ms
        return now_ms + self.frame_ms - into_ms + opens_ms


ALWAYS = TdmaWindow(1, 0)
"""No aMussel has a timeslot."""


class PendingPings:
    """Requests of one kind to many aMussels, one aMussel at a time."""

    def __init__(self) -> None:
        self._sent_ms: dict[int, int] = {}
        self._give_up_ms: dict[int, int] = {}

    def full_state(self) -> list[tuple[int, int]]:
        """The times of the last requests, by aMussel.

        Awaited answers are left out: they are lost with the water in which they travel.
        """
        return list(self._sent_ms.items())

    def restore(self, state: list[tuple[int, int]]) -> None:
        self._sent_ms = dict(state)

    def next(self, wanted: Sequence[int], now_ms: int) -> int | None:
        """The first of the `wanted` aMussels that may be asked now; it is then marked as asked."""
        for agent_id in wanted:
            if self._sent_ms.get(agent_id, now_ms - ASK_AGAIN_MS) + ASK_AGAIN_MS <= now_ms:
                self._sent_ms[agent_id] = now_ms
                return agent_id
        return None

    def await_answer(self, agent_id: int, until_ms: int) -> None:
        """Awaits an answer that should arrive by `until_ms`; a modem's answer timeout is allowed for in addition."""
        self._give_up_ms[agent_id] = until_ms + ANSWER_TIMEOUT_MS

    def awaits(self, agent_id: int) -> bool:
        return agent_id in self._give_up_ms

    def answered(self, agent_id: int) -> bool:
        """Takes an aMussel's answer; True if it was awaited."""
        return self._give_up_ms.pop(agent_id, None) is not None

    def given_up(self, now_ms: int) -> list[int]:
        """The aMussels whose answer did not come in time, by id; they are no longer awaited."""
        late = sorted(agent_id for agent_id, until_ms in self._give_up_ms.items() if until_ms < now_ms)
        for agent_id in late:
            del self._give_up_ms[agent_id]
        return late
