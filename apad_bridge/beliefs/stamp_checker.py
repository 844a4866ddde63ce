"""Which agent times a packet can state: a stamp may be corrupted, and a clock may really be set anew.

Between two packets a clock goes on as mission time does, theta times as fast. One packet that says otherwise is not
believed, for it would make every true one after it look overtaken; a second one that agrees with it is.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from firmware_model.packets import StatusPacket

_MAX_DELAY_MS = 60_000
"""Mission time that a packet may be under way or wait to be heard: so long a wrong stamp can make deaf, and no longer."""
_MAX_DRIFT_PPM = 500
"""Far more than any board's: a watch crystal is within some tens."""


class StampVerdict(Enum):
    IN_TIME = auto()
    OVERTAKEN = auto()
    IMPOSSIBLE = auto()
    """No clock that was believed until now shows this; it is kept in mind, and nothing has changed."""
    CLOCK_SET = auto()
    """It agrees with the one before it, which was not believed."""


class Stamp(NamedTuple):
    agent_ms: int
    at_ms: int
    """Mission time at which the clock showed it."""


class StampChecker:
    """The newest stamp of each aMussel. `theta` is None where nobody knows it: then any time may follow another."""

    def __init__(self, theta: int | None) -> None:
        self._theta = theta
        self.newest: dict[int, Stamp] = {}
        self._doubted: dict[int, tuple[int, Stamp]] = {}

    def judge(self, packet: StatusPacket, at_ms: int) -> StampVerdict:
        """What to make of a packet heard at mission time `at_ms`; `accept` it if it is believed."""
        newest, stamp = self.newest.get(packet.agent_id), Stamp(packet.agent_ms, at_ms)
        if newest is None:
            return StampVerdict.IN_TIME
        if not self._disagree(newest, stamp) or self._is_delayed(newest, stamp):
            self._doubted.pop(packet.agent_id, None)
            return StampVerdict.OVERTAKEN if stamp.agent_ms < newest.agent_ms else StampVerdict.IN_TIME
        before = self._doubted.get(packet.agent_id)
        if before is not None and before[0] == packet.sequence and before[1].agent_ms == stamp.agent_ms:
            return StampVerdict.IMPOSSIBLE  # the same once more agrees with nothing but itself
        self._doubted[packet.agent_id] = packet.sequence, stamp
        if before is None or stamp.agent_ms < before[1].agent_ms or self._disagree(before[1], stamp):
            return StampVerdict.IMPOSSIBLE
        return StampVerdict.CLOCK_SET

    def accept(self, packet: StatusPacket, at_ms: int) -> None:
        """It is believed, whatever was judged. One that comes late but in turn says nothing of how its clock goes."""
        newest, stamp = self.newest.get(packet.agent_id), Stamp(packet.agent_ms, at_ms)
        self._doubted.pop(packet.agent_id, None)
        if self._theta is not None and newest is not None and self._is_delayed(newest, stamp):
            shown_ms = newest.at_ms + (stamp.agent_ms - newest.agent_ms) // self._theta
            stamp = Stamp(stamp.agent_ms, shown_ms)
        self.newest[packet.agent_id] = stamp

    def forget(self, agent_id: int) -> None:
        self.newest.pop(agent_id, None)
        self._doubted.pop(agent_id, None)

    def _ahead_ms(self, before: Stamp, after: Stamp) -> int:
        """By how much more than mission time the clock went on, in agent time."""
        assert self._theta is not None
        return after.agent_ms - before.agent_ms - self._theta * (after.at_ms - before.at_ms)

    def _is_delayed(self, before: Stamp, after: Stamp) -> bool:
        """Its clock went on, if by less than it should have: it waited to be heard."""
        if self._theta is None or after.agent_ms < before.agent_ms:
            return False
        return self._ahead_ms(before, after) < 0 and self._disagree(before, after)

    def _disagree(self, before: Stamp, after: Stamp) -> bool:
        if self._theta is None:
            return False
        doubt_ms = _MAX_DELAY_MS + abs(after.at_ms - before.at_ms) * _MAX_DRIFT_PPM // 1_000_000
        return abs(self._ahead_ms(before, after)) > self._theta * doubt_ms
