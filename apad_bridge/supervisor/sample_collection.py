"""Tracks the samples of each aMussel that the supervisor has, where they were taken, and makes acknowledgements.

It is pure: the recorder has the files.

A sequence is settled when its record is kept, or when the aMussel has reported that it will never come: overwritten in
the ring, or unreadable. An acknowledgement carries the sequence below which all are settled. A record that arrives late
after all, because packets overtook each other, is kept all the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.facts import PlacedSample, SampleSource
from firmware_model.packets import LogAck, LogRecords
from firmware_model.state_groups import AT_WORK, DOCKED, STRANDED

_UNDER_WATER = AT_WORK | STRANDED
_FURTHEST = 1_000_000
"""A log cannot be so far ahead of the settled sequence: a packet that claims so does not come from an aMussel."""


_STAYS = 8
"""The number of an aMussel's latest stays that are kept: its samples are uploaded in the dock after each."""


@dataclass(slots=True)
class _Stay:
    """The time between two docks, from agent time `from_ms` on, and the believed place of the aMussel."""

    from_ms: int
    place_m: tuple[float, float]


@dataclass(slots=True)
class _Account:
    """Every sequence below `settled` is kept or gone; beyond it, the sequences in `kept_beyond` are kept."""

    is_known: bool = True
    """False until the first packet of a real one's board: what its log is rid of by then is no loss of this run."""
    settled: int = 0
    kept_beyond: set[int] = field(default_factory=set)
    gone: set[int] = field(default_factory=set)
    stays: deque[_Stay] = field(default_factory=lambda: deque(maxlen=_STAYS))
    next_stay_ms: int | None = 0
    """The agent time from which the next stay counts; None during a stay. The first one counts from the start on."""

    def knows(self, sequence: int) -> bool:
        return sequence < self.settled or sequence in self.kept_beyond or sequence in self.gone

    def settle(self) -> None:
        while self.settled in self.kept_beyond or self.settled in self.gone:
            self.kept_beyond.discard(self.settled)
            self.settled += 1


@dataclass(frozen=True, slots=True)
class Taken:
    """The news in a packet: samples that were not kept yet, and sequences that are now known never to come."""

    samples: tuple[PlacedSample, ...]
    gone: tuple[int, ...]


class SampleCollection:
    """The samples of one fleet's aMussels, whose boards are the simulated ones' but for those in `boards`.

    `kept` are the sequences that a former supervisor put on disk.
    """

    def __init__(
        self,
        agent_ids: Iterable[int],
        kept: Mapping[SampleSource, Iterable[int]] | None = None,
        boards: Iterable[SampleSource] = (),
    ) -> None:
        self._accounts: dict[SampleSource, _Account] = {}
        self._now: dict[int, _Account] = {}
        """The account of the board that has the id now."""
        self._received: set[int] = set()
        for board, sequences in (kept or {}).items():
            account = self._account(board)
            account.kept_beyond.update(sequences)
            account.settle()
        for board in (*map(SampleSource, agent_ids), *boards):
            self.change_board(board)

    def change_board(self, board: SampleSource) -> None:
        """From now on the records under this id come from this board; it is told to forget its own alone."""
        self._now[board.agent_id] = self._account(board)

    def _account(self, board: SampleSource) -> _Account:
        return self._accounts.setdefault(board, _Account(is_known=board.real_since_ms is None))

    @property
    def gone(self) -> dict[SampleSource, frozenset[int]]:
        """The sequences that will never come."""
        return {board: frozenset(account.gone) for board, account in self._accounts.items()}

    def take(self, packet: LogRecords) -> Taken | str:
        """Returns the news in the packet; or the reason why it is dropped, without a change."""
        if (account := self._now.get(packet.agent_id)) is None:
            return "records of an unknown aMussel"
        end = packet.first + packet.covered
        if end > account.settled + _FURTHEST:
            return "records that an aMussel cannot have"
        if not account.is_known:
            account.is_known, account.settled = True, max(account.settled, packet.oldest)
            account.settle()
        new = [record for record in packet.records if self._is_new(account, record.sequence)]
        account.gone.difference_update(record.sequence for record in new)
        account.kept_beyond.update(record.sequence for record in new if record.sequence >= account.settled)
        sequences = {record.sequence for record in packet.records}
        lost = [*range(account.settled, packet.oldest), *range(packet.first, end)]
        gone = tuple(dict.fromkeys(n for n in lost if n not in sequences and not account.knows(n)))
        account.gone.update(gone)
        account.settle()
        self._received.add(packet.agent_id)
        return Taken(tuple([PlacedSample(record, _place(account, record.agent_ms)) for record in new]), gone)

    def note_place(self, belief: Belief, agent_ms: int) -> None:
        """Notes the belief after a status of the aMussel, which its clock stamped with `agent_ms`.

        Samples are placed by the same clock. An aMussel samples under water: its place at the surface counts only while
        none is believed under water.
        """
        if (account := self._now.get(belief.agent_id)) is None:
            return
        if belief.state in DOCKED:
            account.next_stay_ms = agent_ms
            return
        place_m = (belief.north_m, belief.east_m)
        if account.next_stay_ms is not None:
            account.stays.append(_Stay(account.next_stay_ms, place_m))
            account.next_stay_ms = None
        elif belief.state in _UNDER_WATER:
            account.stays[-1].place_m = place_m

    def acknowledgements(self) -> list[LogAck]:
        """One for each aMussel from which records arrived since the last call, sorted by id."""
        received, self._received = sorted(self._received), set()
        return [LogAck(agent_id, self._now[agent_id].settled) for agent_id in received]

    @staticmethod
    def _is_new(account: _Account, sequence: int) -> bool:
        return sequence in account.gone or not account.knows(sequence)


class NoSampleCollection:
    """The collection of a supervisor that neither keeps nor acknowledges samples: another process does, or nobody can."""

    def __init__(self) -> None:
        self.gone: dict[SampleSource, frozenset[int]] = {}

    def change_board(self, board: SampleSource) -> None:
        pass

    def take(self, packet: LogRecords) -> Taken:
        return Taken((), ())

    def note_place(self, belief: Belief, agent_ms: int) -> None:
        pass

    def acknowledgements(self) -> list[LogAck]:
        return []


def _place(account: _Account, agent_ms: int) -> tuple[float, float] | None:
    return next((it.place_m for it in reversed(account.stays) if it.from_ms <= agent_ms), None)
