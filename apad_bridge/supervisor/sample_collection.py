"""Tracks the samples of each aMussel that the supervisor has, and makes acknowledgements. Pure: the recorder has the files.

A sequence is settled when its record is kept, or when the aMussel has reported that it will never come: overwritten in
the ring, or unreadable. An acknowledgement carries the sequence below which all are settled. A record that arrives late
after all, because packets overtook each other, is kept all the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from firmware_model.packets import LogAck, LogRecords
from firmware_model.packets.sample_record import SampleRecord

_FURTHEST = 1_000_000
"""A log cannot be so far ahead of the settled sequence: a packet that claims so does not come from an aMussel."""


@dataclass(slots=True)
class _Account:
    """Every sequence below `settled` is kept or gone; beyond it, the sequences in `kept_beyond` are kept."""

    settled: int = 0
    kept_beyond: set[int] = field(default_factory=set)
    gone: set[int] = field(default_factory=set)

    def knows(self, sequence: int) -> bool:
        return sequence < self.settled or sequence in self.kept_beyond or sequence in self.gone

    def settle(self) -> None:
        while self.settled in self.kept_beyond or self.settled in self.gone:
            self.kept_beyond.discard(self.settled)
            self.settled += 1


@dataclass(frozen=True, slots=True)
class Taken:
    """The news in a packet: records that were not kept yet, and sequences that are now known never to come."""

    records: tuple[SampleRecord, ...]
    gone: tuple[int, ...]


class SampleCollection:
    """The samples of one fleet's aMussels; `kept` are the sequences that a former supervisor put on disk."""

    def __init__(self, agent_ids: Iterable[int], kept: Mapping[int, Iterable[int]] | None = None) -> None:
        self._accounts = {agent_id: _Account() for agent_id in agent_ids}
        self._received: set[int] = set()
        for agent_id, sequences in (kept or {}).items():
            account = self._accounts.setdefault(agent_id, _Account())
            account.kept_beyond.update(sequences)
            account.settle()

    @property
    def gone(self) -> dict[int, frozenset[int]]:
        """The sequences that will never come, by aMussel."""
        return {agent_id: frozenset(account.gone) for agent_id, account in self._accounts.items()}

    def take(self, packet: LogRecords) -> Taken | str:
        """Returns the news in the packet; or the reason why it is dropped, without a change."""
        account = self._accounts.get(packet.agent_id)
        if account is None:
            return "records of an unknown aMussel"
        end = packet.first + packet.covered
        if end > account.settled + _FURTHEST:
            return "records that an aMussel cannot have"
        new = [record for record in packet.records if self._is_new(account, record.sequence)]
        account.gone.difference_update(record.sequence for record in new)
        account.kept_beyond.update(record.sequence for record in new if record.sequence >= account.settled)
        sequences = {record.sequence for record in packet.records}
        lost = [*range(account.settled, packet.oldest), *range(packet.first, end)]
        gone = tuple(dict.fromkeys(n for n in lost if n not in sequences and not account.knows(n)))
        account.gone.update(gone)
        account.settle()
        self._received.add(packet.agent_id)
        return Taken(tuple(new), gone)

    def acknowledgements(self) -> list[LogAck]:
        """One for each aMussel from which records arrived since the last call, sorted by id."""
        received, self._received = sorted(self._received), set()
        return [LogAck(agent_id, self._accounts[agent_id].settled) for agent_id in received]

    @staticmethod
    def _is_new(account: _Account, sequence: int) -> bool:
        return sequence in account.gone or not account.knows(sequence)


class NoSampleCollection:
    """The collection of a supervisor whose samples another process keeps and acknowledges."""

    def __init__(self) -> None:
        self.gone: dict[int, frozenset[int]] = {}

    def take(self, packet: LogRecords) -> Taken:
        return Taken((), ())

    def acknowledgements(self) -> list[LogAck]:
        return []
