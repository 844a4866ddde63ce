"""Makes the kind of MU board that a configuration asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from firmware_model.board import Board
from firmware_model.config import BoardConfig
from firmware_model.packets.codec import Codec
from firmware_model.power.charge import Battery

if TYPE_CHECKING:
    from firmware_model.settings import StoredSettings


def board_of(
    config: BoardConfig,
    codec: Codec,
    primary: Battery,
    secondary: Battery,
    now_ms: int,
    kept: StoredSettings | None = None,
) -> Board:
    """The board for `config`. `kept` holds the clock and settings of a whole board that outlived a reset."""
    if config.whole is None:
        return Board(config, codec, primary, secondary, now_ms)
    # Imported here: a fleet in the worst case does not need it, and every memory page of an agent counts.
    from firmware_model.whole_board import WholeBoard

    return WholeBoard(config, codec, primary, secondary, now_ms, kept)
