"""Which samples of which aMussel the supervisor has, and what it acknowledges. Pure: files are the recorder's.

A sequence is settled when its record is kept, or when the aMussel has said that it will never come: overwritten in its
ring, or unreadable. What is acknowledged is the sequence below which all are settled. A record that comes late after all,
because packets overtook each other, is kept all the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from firmware_model.packets import LogAck, LogRecords
from firmware_model.packets.sample_record import SampleRecord

_FURTHEST = 1_000_000
"""No log goes on so far behind what was last heard of it: such a packet is nothing that an aMussel said."""


@dataclass(slots=True)
class _Account:
    """Every sequence below `settled` is kept or gone; beyond, those of `kept_beyond` are kept."""

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
    """What a packet brought: records that nobody had yet, and sequences that now are known never to come."""

    records: tuple[SampleRecord, ...]
    gone: tuple[int, ...]


class SampleCollection:
    """For the aMussels of one fleet; `kept` are the sequences that a former supervisor put on disk."""

    def __init__(self, agent_ids: Iterable[int], kept: Mapping[int, Iterable[int]] | None = None) -> None:
        self._accounts = {agent_id: _Account() for agent_id in agent_ids}
        self._heard: set[int] = set()
        for agent_id, sequences in (kept or {}).items():
            account = self._accounts.setdefault(agent_id, _Account())
            account.kept_beyond.update(sequences)
            account.settle()

    @property
    def gone(self) -> dict[int, frozenset[int]]:
        """By aMussel, the sequences that never came."""
        return {agent_id: frozenset(account.gone) for agent_id, account in self._accounts.items()}

    def take(self, packet: LogRecords) -> Taken | str:
        """What is new of it; or why it is dropped, and nothing has changed."""
        account = self._accounts.get(packet.agent_id)
        if account is None:
            return "records of an unknown aMussel"
        until = packet.first + packet.covered
        if until > account.settled + _FURTHEST:
            return "records that an aMussel cannot have"
        new = [record for record in packet.records if self._is_new(account, record.sequence)]
        account.gone.difference_update(record.sequence for record in new)
        account.kept_beyond.update(record.sequence for record in new if record.sequence >= account.settled)
        came = {record.sequence for record in packet.records}
        never = [*range(account.settled, packet.oldest), *range(packet.first, until)]
        gone = tuple(dict.fromkeys(n for n in never if n not in came and not account.knows(n)))
        account.gone.update(gone)
        account.settle()
        self._heard.add(packet.agent_id)
        return Taken(tuple(new), gone)

    def acknowledgements(self) -> list[LogAck]:
        """One for each aMussel heard since the last call, by id."""
        heard, self._heard = sorted(self._heard), set()
        return [LogAck(agent_id, self._accounts[agent_id].settled) for agent_id in heard]

    @staticmethod
    def _is_new(account: _Account, sequence: int) -> bool:
        return sequence in account.gone or not account.knows(sequence)
