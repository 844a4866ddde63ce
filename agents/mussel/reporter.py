"""The packets that an aMussel sends: log and status, in full by Wi-Fi, and by sound as much as its modem carries.

`Agent` decides when it reports by Wi-Fi, by the scenario's `hearing.report_period_s`; the firmware asks for all else.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

from agents.modem.frames import ModemGeneration
from agents.mussel.body import Body
from agents.mussel.outputs import Output, SoundSent, StimulusDropped, WifiSent
from firmware_model.actions import Action, DropLog, LogSample, SendAnswer, SendBytes, SendLog, SendStatus
from firmware_model.board import Board
from firmware_model.packets import AcousticStatus, Packet, ShortStatus, StatusPacket, WifiStatus
from firmware_model.packets.codec import Codec
from firmware_model.packets.status_packets import StatusFields
from firmware_model.power.charge import fraction
from firmware_model.power.rails import Rail

if TYPE_CHECKING:
    from agents.mussel.logbook import Logbook


@dataclass(frozen=True, slots=True)
class ReportConfig:
    """The reports of every aMussel of a fleet. `period_ms` is agent time between two reports by Wi-Fi."""

    period_ms: int
    heard_always: bool
    """True for the paper's mode, in which Wi-Fi works at any depth; otherwise only at the surface."""
    modem: ModemGeneration = ModemGeneration.V3
    """The nanomodem: a packet by sound has 7 bytes with V2, and 64 with V3."""


class Reporter:
    """Sends and counts the reports of one aMussel. The paper's worst case has no log and one status for all media."""

    def __init__(
        self, board: Board, body: Body, logbook: Logbook | None, modem: ModemGeneration, codec: Codec
    ) -> None:
        self._board = board
        self._body = body
        self._logbook = logbook
        self._modem = modem
        self._codec = codec
        self._sequence = 0

    def copy(self, board: Board, body: Body) -> Reporter:
        """A reporter of this board and body that goes on with the same count."""
        other = copy(self)
        other._board, other._body = board, body
        return other

    def carry_out(self, action: Action) -> list[Output]:
        """Sends for the board, or takes into its log; nothing for other actions."""
        match action:
            case SendStatus(at_ms, by):
                return [self.status(at_ms) if by is Rail.WIFI else self._by_sound(at_ms, self._short(at_ms))]
            case SendAnswer(at_ms):
                return [self._by_sound(at_ms, self._answer(at_ms))]
            case SendBytes(at_ms, by, data):
                sent = WifiSent if by is Rail.WIFI else SoundSent
                return [sent(at_ms, self._board.config.agent_id, data)]
            case LogSample() | SendLog() | DropLog():
                return self._log(action)
        return []

    def _log(self, action: LogSample | SendLog | DropLog) -> list[Output]:
        now_ms, board = action.at_ms, self._board
        assert self._logbook is not None  # the worst case has no such actions
        packets = self._logbook.carry_out(action, board.clock_ms(now_ms))
        if packets is None:
            reason = "an acknowledgement of records that were never taken"
            return [StimulusDropped(now_ms, board.config.agent_id, reason)]
        return [self._by_wifi(now_ms, packet) for packet in packets]

    def status(self, now_ms: int) -> WifiSent:
        """The full status, by Wi-Fi."""
        return self._by_wifi(now_ms, self._full(now_ms))

    def _by_wifi(self, now_ms: int, packet: Packet) -> WifiSent:
        return WifiSent(now_ms, self._board.config.agent_id, self._codec.encode(packet))

    def _by_sound(self, now_ms: int, packet: Packet) -> SoundSent:
        return SoundSent(now_ms, self._board.config.agent_id, self._codec.encode(packet))

    def _full(self, now_ms: int) -> Packet:
        fields, board, logbook = self._fields(now_ms), self._board, self._logbook
        if logbook is None or board.reset_cause is None:
            return StatusPacket(*fields)
        log = logbook.log
        return WifiStatus(
            *fields,
            logbook.counts,
            log.next_sequence,
            log.acknowledged,
            log.oldest,
            log.overwritten,
            log.torn,
            board.reset_cause,
            board.feed,
            board.rails,
            board.clock_offset_ms,
        )

    def _short(self, now_ms: int) -> Packet:
        """The status by sound."""
        if self._modem is ModemGeneration.V2:
            return self._answer(now_ms)
        fields, logbook = self._fields(now_ms), self._logbook
        if logbook is None:
            return StatusPacket(*fields)
        log = logbook.log
        return AcousticStatus(*fields, logbook.counts, log.next_sequence, log.waiting)

    def _answer(self, now_ms: int) -> Packet:
        """The answer to a ping: as short as for a v2 modem, so that the channel is soon free again."""
        agent_id, _, state, primary, secondary, *_ = self._fields(now_ms)
        return ShortStatus(agent_id, state, primary, secondary)

    def _fields(self, now_ms: int) -> StatusFields:
        body, board = self._body, self._board
        primary, secondary = board.readings(now_ms)
        north_um, east_um = body.known_place_um(now_ms)
        self._sequence += 1
        return (
            board.config.agent_id,
            self._sequence - 1,
            board.state,
            fraction(primary),
            fraction(secondary),
            north_um / 1e6,
            east_um / 1e6,
            body.depth_at_um(now_ms) / 1e6,
            board.clock_ms(now_ms),
        )
