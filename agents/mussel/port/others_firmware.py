"""Somebody's firmware on the board of an aMussel: a program behind a link for each boot, and doubts of what it tells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from agents.modem.frames import ModemGeneration
from agents.mussel.body import Body
from agents.mussel.port.board_link import TURN_TIMEOUT_S, BoardLink
from agents.mussel.port.peripherals import MeasuredWorld
from agents.mussel.port.port_firmware import PortFirmware, link_to
from agents.mussel.port.state_doubts import StateDoubts
from agents.mussel.port.whole_port_firmware import WholePortFirmware
from firmware_model.actions import Action
from firmware_model.board import Board, MakeFirmware
from firmware_model.config import BoardConfig
from firmware_model.port import FirmwareLike
from firmware_model.power.active_battery import ActiveBattery


class OthersFirmware:
    """The firmware on the board of one aMussel, when it is not ours."""

    def __init__(
        self,
        command: Sequence[str],
        board: BoardConfig,
        seed: int,
        modem: ModemGeneration = ModemGeneration.V3,
        timeout_s: float = TURN_TIMEOUT_S,
        wrapped: Callable[[FirmwareLike], FirmwareLike] = lambda program: program,
    ) -> None:
        """`command` is what `port_firmware.link_to` takes, `seed` the run's; a turn may take `timeout_s` of wall time.

        `wrapped` is what stands on the board with a program in it.
        """
        self.program: PortFirmware | None = None
        """The one of the last boot."""
        self._command = command
        self._board = board
        self._seed = seed
        self._modem = 2 if modem is ModemGeneration.V2 else 3
        self._timeout_s = timeout_s
        self._wrapped = wrapped
        self._doubts: StateDoubts | None = None

    def maker(self, world: MeasuredWorld | None) -> MakeFirmware:
        """Makes the program of a board; a whole one measures `world`, and only such a one."""
        command, timeout_s, board, seed = self._command, self._timeout_s, self._board, self._seed

        def to() -> BoardLink:
            # It does not hold `self`: a board of the fixture `mu` that nobody needs ends at once, and its program with it.
            return link_to(command, timeout_s)

        def make(hardware: Any) -> FirmwareLike:
            self.program = (
                PortFirmware(to, board, hardware, seed)
                if world is None
                else WholePortFirmware(to, board, hardware, seed, world, self._modem)
            )
            return self._wrapped(self.program)

        return make

    def close(self) -> None:
        """Ends the link to the program."""
        if self.program is not None:
            self.program.close()

    def report(self, board: Board, now_ms: int) -> list[Action] | None:
        """Asks a whole board that has power for its report; None where its host makes the report."""
        if not isinstance(self.program, WholePortFirmware) or board.feed is ActiveBattery.NEITHER:
            return None
        return self.program.report(now_ms)

    def doubt(self, board: Board, body: Body, now_ms: int) -> str | None:
        """Why the state that the program tells cannot be; each reason once."""
        if self._doubts is None:
            self._doubts = StateDoubts(board)
        return self._doubts.due(board, body, now_ms)
