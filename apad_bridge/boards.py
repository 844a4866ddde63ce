"""What a scenario's board becomes: the one model of its batteries, for all who ask what they hold."""

from __future__ import annotations

from apad_bridge.scenario.schema import Board
from firmware_model.charge import ChargeModel


def charge_model(board: Board) -> ChargeModel:
    """How the batteries of such a board charge and discharge."""
    return ChargeModel.from_minutes(board.discharge_per_min, board.charge_segments)
