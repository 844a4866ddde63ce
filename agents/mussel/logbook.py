"""Takes an aMussel's samples from the water, writes them into flash and uploads them in parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from agents.mussel.sensor_bus import SensorBus
from firmware_model.actions import DropLog, LogSample, SendLog
from firmware_model.packets.log_packets import RECORDS_AT_ONCE, LogRecords
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.sampling.flash import Flash
from firmware_model.sampling.flash_log import FlashLog
from firmware_model.sampling.sensors import NO_COUNTS

_PACKETS_AT_ONCE = 4
"""The number of packets sent before the next acknowledgement."""


class Logbook:
    """`samples` and `acknowledged` come from the registers."""

    def __init__(
        self, agent_id: int, sensors: SensorBus, flash: Flash, samples: int, acknowledged: int
    ) -> None:
        self.log = FlashLog(flash, samples, acknowledged)
        self._agent_id = agent_id
        self._sensors = sensors
        newest = self.log.newest()
        self.counts = NO_COUNTS if newest is None else newest.counts
        """The counts of the newest sample; zeros if there is none, or if it cannot be read."""
        self._sent = 0
        """The first sequence that this upload has not sent yet."""

    @property
    def registers(self) -> tuple[int, int]:
        """The number of samples ever taken, and the sequence below which all were acknowledged."""
        return self.log.next_sequence, self.log.acknowledged

    def carry_out(self, action: LogSample | SendLog | DropLog, clock_ms: int) -> Iterable[LogRecords] | None:
        """The packets to send; None for an acknowledgement of records that were never taken."""
        match action:
            case LogSample(now_ms):
                self.take_sample(now_ms, clock_ms)
                return ()
            case SendLog():
                return self.begin_upload()
            case DropLog(_, next_sequence):
                return self.acknowledge(next_sequence)

    def take_sample(self, now_ms: int, clock_ms: int) -> None:
        """Samples the water at agent time `now_ms`, when the board's clock reads `clock_ms`.

        While the sensors do not answer, it logs their last counts once more.
        """
        sequence = self.log.next_sequence
        self.counts, saturated = self._sensors.read(now_ms, sequence) or (self.counts, 0)
        self.log.append(SampleRecord(sequence, clock_ms, self.counts, saturated))

    def begin_upload(self) -> Iterator[LogRecords]:
        """The first packets of all waiting records; made one by one, so that an agent never holds them all."""
        self._sent = self.log.waiting_from
        return self._next_packets()

    def acknowledge(self, next_sequence: int) -> Iterator[LogRecords] | None:
        """The packets that follow; None for an acknowledgement of records that were never taken.

        An acknowledgement of nothing new asks for the missing records: the upload starts again from there.
        """
        log = self.log
        if next_sequence > log.next_sequence:
            return None
        if not log.acknowledge(next_sequence):
            return self.begin_upload()
        self._sent = max(self._sent, log.waiting_from)
        return self._next_packets()

    def _next_packets(self) -> Iterator[LogRecords]:
        log = self.log
        oldest = log.waiting_from
        until = min(log.next_sequence, oldest + _PACKETS_AT_ONCE * RECORDS_AT_ONCE)
        while self._sent < until:
            first = self._sent
            self._sent = min(first + RECORDS_AT_ONCE, until)
            yield LogRecords(self._agent_id, oldest, first, self._sent - first, log.raw(first, self._sent))
