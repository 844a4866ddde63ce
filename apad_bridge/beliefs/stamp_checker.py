"""Checks the agent times that packets state: a stamp may be corrupted, and a clock may really have been set.

Between two packets a clock runs theta times as fast as mission time. A single packet that contradicts this is not
believed, because every true packet after it would look overtaken. A second packet that agrees with it is believed.
`fleet_beliefs.py` acts on the verdict.

A board that restarts begins at 0 again, and is believed at once where no packet can have been under way for so long: a
corrupted stamp hardly hits so small a number, and a spoofed one costs a true packet as any spoofed stamp does. A board
that restarts within `_MAX_DELAY_MS` of its former start is believed at its second packet in pace with mission time.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from agents.time_scale import TimeScale
from firmware_model.packets import StatusPacket

_MAX_DELAY_MS = 60_000
"""The longest mission time that a packet may travel or wait; a wrong stamp can shut true packets out no longer."""
_MAX_DRIFT_PPM = 500
"""Far more than any board's drift: a watch crystal is within some tens of ppm."""
_JUST_ON_MS = 60_000
"""The mission time for which a board has just been switched on: its first report comes within it."""
_PACE = 2.0
"""Packets that waited somewhere and come at once do not keep pace within this factor."""


class StampVerdict(Enum):
    IN_TIME = auto()
    OVERTAKEN = auto()
    IMPOSSIBLE = auto()
    """The clock as believed cannot show this time; the stamp is kept for comparison, and the belief does not change."""
    CLOCK_SET = auto()
    """The stamp agrees with the doubted one before it, or is that of a board that restarted: the clock was set."""


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
        if (newest := self.newest.get(packet.agent_id)) is None:
            return StampVerdict.IN_TIME
        stamp = Stamp(packet.agent_ms, at_ms)
        off, is_older = self._off(newest, stamp), stamp.agent_ms < newest.agent_ms
        if off <= 0 and not is_older:  # in sequence, with a delay at most
            self._doubted.pop(packet.agent_id, None)
            return StampVerdict.IN_TIME
        just_on = self._scale is not None and stamp.agent_ms <= self._scale.agent_span(_JUST_ON_MS)
        if off == 0 and not just_on:
            self._doubted.pop(packet.agent_id, None)
            return StampVerdict.OVERTAKEN
        if off < 0 and just_on:
            return StampVerdict.CLOCK_SET
        # A clock that was set is believed once a second packet agrees with the first; a repetition of it is none.
        before = self._doubted.get(packet.agent_id)
        if before is None or before[0] != packet.sequence or before[1].agent_ms != stamp.agent_ms:
            self._doubted[packet.agent_id] = packet.sequence, stamp
            if before is not None and self._agree(before[1], stamp, is_just_on=off == 0):
                return StampVerdict.CLOCK_SET
        return StampVerdict.OVERTAKEN if off == 0 else StampVerdict.IMPOSSIBLE

    def accept(self, packet: StatusPacket, at_ms: int) -> None:
        """Accepts the stamp, whatever the verdict. A delayed packet in sequence carries no information about the clock."""
        newest, stamp = self.newest.get(packet.agent_id), Stamp(packet.agent_ms, at_ms)
        if self._doubted:
            self._doubted.pop(packet.agent_id, None)
        if (
            self._scale is not None
            and newest is not None
            and (advanced_ms := stamp.agent_ms - newest.agent_ms) >= 0
            and self._off(newest, stamp) < 0
        ):
            stamp = Stamp(stamp.agent_ms, newest.at_ms + self._scale.mission_span(advanced_ms))
        self.newest[packet.agent_id] = stamp

    def forget(self, agent_id: int) -> None:
        self.newest.pop(agent_id, None)
        self._doubted.pop(agent_id, None)

    def _agree(self, before: Stamp, after: Stamp, *, is_just_on: bool) -> bool:
        """True if one clock may have shown both. One that has just begun keeps pace with mission time, too."""
        if after.agent_ms < before.agent_ms or self._off(before, after):
            return False
        if not is_just_on:
            return True
        assert self._scale is not None, "without a scale no clock is known to have just begun"
        due_ms = self._scale.agent_span(after.at_ms - before.at_ms)
        return due_ms / _PACE <= after.agent_ms - before.agent_ms <= due_ms * _PACE

    def _off(self, before: Stamp, after: Stamp) -> int:
        """1 or -1 if the clock advanced by too much or too little, against mission time times theta; else 0."""
        if self._scale is None:
            return 0
        passed_ms = after.at_ms - before.at_ms
        ahead_ms = after.agent_ms - before.agent_ms - self._scale.agent_span(passed_ms)
        doubt_ms = _MAX_DELAY_MS + abs(passed_ms) * _MAX_DRIFT_PPM // 1_000_000
        if abs(ahead_ms) <= self._scale.agent_span(doubt_ms):
            return 0
        return 1 if ahead_ms > 0 else -1
