"""The kinds of MU board, and which of them a configuration is of."""

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
    """The board that `config` is of. `kept` is what a reset left of a whole board's clock and settings."""
    if config.whole is None:
        return Board(config, codec, primary, secondary, now_ms)
    # Imported here: a fleet in the worst case needs none of it, and every page that an agent shares counts.
    from firmware_model.whole_board import WholeBoard

    return WholeBoard(config, codec, primary, secondary, now_ms, kept)
