"""What an aPad says by sound of its own accord, and when: beacons, slots for its aMussels, pings, and how are you?

It plans the air: each word gets a time at which the aMussels are quiet and the aPad's modem free, so that what a beacon
says is true when it is said. It pings each aMussel, to learn how long sound takes; it gives each its slot, with an offset
that makes its words arrive in it; and from time to time it says what time it is, and everyone's slot again.

An aMussel that sets its clock by a beacon is late by the beacon's way, and its own words take as long again: so its offset
is minus twice the way. Its guard is for what clocks drift between two beacons.

Who was asked when, and whose answer is still awaited. Agent time.

When an aPad may speak: outside of the aMussels' timeslots. Agent time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from agents.modem.frames import SHORT_MS, Generation, duration_ms
from agents.packet_medium import Medium
from agents.water.apad_modem import ANSWER_TIMEOUT_MS
from apad_bridge.mission.events import Ping, Send, SupervisorAction
from apad_bridge.mission.orders import Note
from firmware_model.config import Slots
from firmware_model.packets import EVERYONE, Beacon, CommandPacket, Kind, SlotAssignment
from firmware_model.packets.codec import Codec

ASK_AGAIN_MS = 600_000
"""Before one that did not answer, or that too little is known of still, is asked again."""


class PendingPings:
    """Questions of one kind to many aMussels, one of which is asked at a time."""

    def __init__(self) -> None:
        self._asked_ms: dict[int, int] = {}
        self._awaited: dict[int, int] = {}

    def kept(self) -> list[tuple[int, int]]:
        """Who was asked when. What is awaited is left out: it dies with the water that it is on its way in."""
        return list(self._asked_ms.items())

    def restore(self, kept: list[tuple[int, int]]) -> None:
        self._asked_ms = dict(kept)

    def next(self, wanted: Sequence[int], now_ms: int) -> int | None:
        """The first of the `wanted` that may be asked now, which it so is."""
        for agent_id in wanted:
            if self._asked_ms.get(agent_id, now_ms - ASK_AGAIN_MS) + ASK_AGAIN_MS <= now_ms:
                self._asked_ms[agent_id] = now_ms
                return agent_id
        return None

    def await_answer(self, agent_id: int, until_ms: int) -> None:
        """The question goes out; its answer has come by `until_ms`, and as long again as a modem waits is allowed for."""
        self._awaited[agent_id] = until_ms + ANSWER_TIMEOUT_MS

    def answered(self, agent_id: int) -> bool:
        """It said how it is; whether that was awaited."""
        return self._awaited.pop(agent_id, None) is not None

    def given_up(self, now_ms: int) -> list[int]:
        """Whose answer did not come in time, by id."""
        late = sorted(agent_id for agent_id, until_ms in self._awaited.items() if until_ms < now_ms)
        for agent_id in late:
            del self._awaited[agent_id]
        return late


@dataclass(frozen=True, slots=True)
class TdmaWindow:
    """The first `taken_ms` of each frame are the aMussels'; a frame that is all theirs leaves no choice."""

    frame_ms: int
    taken_ms: int

    def first_ms(self, now_ms: int, lasting_ms: int) -> int:
        """The first time from now on from which it is quiet for so long.

        What lasts longer than any quiet begins with one; where there is none, it begins now.
        """
        if self.taken_ms >= self.frame_ms or self.taken_ms <= 0:
            return now_ms
        into_ms = now_ms % self.frame_ms
        if into_ms < self.taken_ms:
            return now_ms + self.taken_ms - into_ms
        if into_ms + lasting_ms <= self.frame_ms or into_ms == self.taken_ms:
            return now_ms
        return now_ms + self.frame_ms - into_ms + self.taken_ms


ALWAYS = TdmaWindow(1, 0)
"""Nobody has timeslots."""


@dataclass(frozen=True, slots=True)
class ScheduleConfig:
    """Periods are agent time but `ping_period_ms`, which is mission time; 0 for never."""

    theta: int
    sound_speed_m_s: float
    way_ms: int
    """The longest way that sound may have, by which a word may come into somebody's slot."""
    waits: bool
    assigns: bool
    guard_ms: int
    beacon_period_ms: int
    ping_period_ms: int
    modems: Generation = Generation.V3
    answer_ms: int = 0
    """From the end of the question how it is to the end of the answer, without their ways."""
    breath_ms: int = 20
    """Before such a question, and between others' words: an aPad on its way says one from nearer than the word before, into
    which it would run, and the echoes of that are in the water still."""


class AcousticScheduler:
    """At mission ticks: `advance` gives what is due, `timed` gives others' words their times."""

    def __init__(
        self,
        config: ScheduleConfig,
        codec: Codec,
        slots: Slots | None,
        agent_ids: Iterable[int],
        now_ms: int = 0,
    ) -> None:
        self._config = config
        self._codec = codec
        self._slots = slots
        self._agent_ids = sorted(agent_ids)
        self._quiet = ALWAYS
        if config.waits and slots is not None:
            self._quiet = TdmaWindow(slots.frame_ms, len(self._agent_ids) * slots.slot_ms)
        agent_ms = config.theta * now_ms
        self._free_ms = agent_ms
        """The agent time from which the air is not yet spoken for."""
        assigns = config.assigns and slots is not None
        self._learn_at_ms = dict.fromkeys(self._agent_ids if assigns else (), agent_ms)
        """When whose way is to be learned (again)."""
        self.ways_ms: dict[int, int] = {}
        """How long sound takes, of each whose slot was made for it."""
        self._waiting: dict[tuple[int, bytes], int] = {}
        """Words of others, by whom for and what, and when they will be said."""
        self._beacon_due_ms = agent_ms
        self._ping_due_ms = now_ms
        self._turns = deque(self._agent_ids)
        self.unanswered = 0
        """How many questions how they are brought nothing in time."""
        self._ranged = PendingPings()
        self._asked = PendingPings()

    def kept(self) -> dict[str, Any]:
        """What was learned and done so far, as plain data. Words that wait are left out: they die with their water."""
        return {
            "learn_at_ms": list(self._learn_at_ms.items()),
            "ways_ms": list(self.ways_ms.items()),
            "beacon_due_ms": self._beacon_due_ms,
            "ping_due_ms": self._ping_due_ms,
            "turns": list(self._turns),
            "ranged_ms": self._ranged.kept(),
            "asked_ms": self._asked.kept(),
        }

    def restore(self, data: dict[str, Any]) -> None:
        """Goes on where another's `kept` stood; KeyError, TypeError or ValueError for anything else."""
        self._learn_at_ms = dict(data["learn_at_ms"])
        self.ways_ms = dict(data["ways_ms"])
        self._beacon_due_ms, self._ping_due_ms = data["beacon_due_ms"], data["ping_due_ms"]
        self._turns = deque(data["turns"])
        self._ranged.restore(data["ranged_ms"])
        self._asked.restore(data["asked_ms"])

    def timed(self, actions: Sequence[SupervisorAction], now_ms: int) -> list[SupervisorAction]:
        """The same actions; words by sound with the time at which they may be said.

        A word that waits already is not said twice.
        """
        agent_ms = self._config.theta * now_ms
        self._waiting = {word: at_ms for word, at_ms in self._waiting.items() if at_ms >= agent_ms}
        told: list[SupervisorAction] = []
        for it in actions:
            if not isinstance(it, Send) or it.medium is not Medium.SOUND or it.not_before_ms:
                told.append(it)
            elif (it.agent_id, it.data) not in self._waiting:
                word = self._timed(it, now_ms, self._config.breath_ms)
                self._waiting[it.agent_id, it.data] = word.not_before_ms
                told.append(word)
        return told

    def advance(
        self,
        now_ms: int,
        away: frozenset[int],
        whereabouts: Sequence[int] = (),
        charges: Sequence[int] = (),
    ) -> list[SupervisorAction]:
        """What is due at mission time `now_ms`; those who are `away` are believed not to hear: afloat, or in a dock.

        Whose `whereabouts` are wanted is pinged, and whose `charges`, asked how it is: the first of either that may be
        asked again, one after the other.
        """
        config, agent_ms = self._config, self._config.theta * now_ms
        said: list[SupervisorAction] = [
            Note("unanswered", {"id": agent_id}) for agent_id in self._asked.given_up(agent_ms)
        ]
        self.unanswered += len(said)
        if self._free_ms > agent_ms + config.theta * 1000:
            return said  # what was said before has still to be sent
        for agent_id, due_ms in self._learn_at_ms.items():
            if due_ms <= agent_ms and agent_id not in away:
                self._learn_at_ms[agent_id] = agent_ms + ASK_AGAIN_MS
                said.append(self._ping(agent_id, now_ms))
        if config.beacon_period_ms and self._beacon_due_ms <= agent_ms:
            self._beacon_due_ms = agent_ms + config.beacon_period_ms
            said.append(self._beacon(now_ms))
            said += [self._assignment(it, now_ms) for it in self.ways_ms if it not in away]
        if config.ping_period_ms and self._ping_due_ms <= now_ms:
            self._ping_due_ms = now_ms + config.ping_period_ms
            said += self._next_ping(now_ms, away)
        if (sought := self._ranged.next(whereabouts, agent_ms)) is not None:
            said.append(self._ping(sought, now_ms))
        if (asked := self._asked.next(charges, agent_ms)) is not None:
            said += [Note("asked", {"id": asked}), self._question(asked, now_ms)]
        return said

    def heard_of(self, agent_id: int) -> None:
        """It said in short how it is."""
        self._asked.answered(agent_id)

    def hear(self, agent_id: int, range_m: float, now_ms: int) -> list[SupervisorAction]:
        """A ping was answered: the first one of an aMussel gives it its slot."""
        if agent_id not in self._learn_at_ms:
            return []
        del self._learn_at_ms[agent_id]
        self.ways_ms[agent_id] = round(1000 * range_m / self._config.sound_speed_m_s)
        return [self._assignment(agent_id, now_ms)]

    def moved(self, agent_id: int, now_ms: int) -> None:
        """It is somewhere else now: its way is to be learned again, when it has had time to sink."""
        if self.ways_ms.pop(agent_id, None) is not None:
            self._learn_at_ms[agent_id] = self._config.theta * now_ms + ASK_AGAIN_MS

    def _next_ping(self, now_ms: int, away: frozenset[int]) -> list[SupervisorAction]:
        for _ in range(len(self._turns)):
            self._turns.rotate(-1)
            if self._turns[-1] not in away:
                return [self._ping(self._turns[-1], now_ms)]
        return []

    def _assignment(self, agent_id: int, now_ms: int) -> Send:
        config, slots, way_ms = self._config, self._slots, self.ways_ms[agent_id]
        assert slots is not None  # ways are learned for slots
        offset_ms = -2 * way_ms if config.beacon_period_ms else -way_ms
        index = self._agent_ids.index(agent_id)
        slot = SlotAssignment(agent_id, slots.frame_ms, slots.slot_ms, config.guard_ms, index, offset_ms)
        return self._timed(Send(Medium.SOUND, agent_id, self._codec.encode(slot)), now_ms)

    def _beacon(self, now_ms: int) -> Send:
        # Its length does not depend on what it says.
        lasting_ms = self._lasting_ms(self._codec.encode(Beacon(EVERYONE, 0)))
        at_ms = self._claim(now_ms, lasting_ms)
        data = self._codec.encode(Beacon(EVERYONE, at_ms + lasting_ms))
        return Send(Medium.SOUND, EVERYONE, data, at_ms)

    def _ping(self, agent_id: int, now_ms: int) -> Ping:
        return Ping(agent_id, self._claim(now_ms, SHORT_MS[self._config.modems] + ANSWER_TIMEOUT_MS))

    def _question(self, agent_id: int, now_ms: int) -> Send:
        """The air is kept clear until the answer has come."""
        data = self._codec.encode(CommandPacket(Kind.PING, agent_id))
        lasting_ms = self._lasting_ms(data) + self._config.answer_ms + 2 * self._config.way_ms
        at_ms = self._claim(now_ms, self._config.breath_ms + lasting_ms) + self._config.breath_ms
        self._asked.await_answer(agent_id, at_ms + lasting_ms)
        return Send(Medium.SOUND, agent_id, data, at_ms)

    def _timed(self, word: Send, now_ms: int, after_ms: int = 0) -> Send:
        return replace(word, not_before_ms=self._claim(now_ms, self._lasting_ms(word.data), after_ms))

    def _lasting_ms(self, data: bytes) -> int:
        return duration_ms(self._config.modems, len(data))

    def _claim(self, now_ms: int, lasting_ms: int, after_ms: int = 0) -> int:
        """The next time at which the air is free for so long, which from now on it is not.

        At least `after_ms` after the last word.
        """
        from_ms = max(self._config.theta * now_ms, self._free_ms + after_ms)
        # By then it must have come everywhere, and who has the first slot may be early by its guard.
        needed_ms = lasting_ms + self._config.way_ms + self._config.guard_ms
        at_ms = self._quiet.first_ms(from_ms, needed_ms)
        self._free_ms = at_ms + lasting_ms
        return at_ms
