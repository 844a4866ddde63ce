"""Doubts of the states that somebody's firmware tells: the place, the dock or the rails of its board contradict them.

Missions obey states, and energy does not follow from them, so a wrong state shows in nothing but its effects.
"""

from __future__ import annotations

from agents.mussel.body import Body
from firmware_model.board import Board
from firmware_model.power.rails import RAILS, Rail, bits, switched_in
from firmware_model.state_groups import AT_WORK, DOCKED, STRANDED, UP_AND_UNDOCKED
from firmware_model.states import State

_MODEM = bits(Rail.MODEM_LISTENING, Rail.MODEM_RECEIVING, Rail.MODEM_TRANSMITTING)
"""These follow from packets, and not from the state."""


class StateDoubts:
    """The doubts of one board. It tells each once, after a time in which no board needs to notice anything longer."""

    def __init__(self, board: Board) -> None:
        config = board.config
        self._patience_ms = config.surfacing_timeout_ms + config.pin_check_ms + config.pin_chatter_ms
        self._doubt: str | None = None
        self._since_ms = 0
        self._reported: set[str] = set()

    def due(self, board: Board, body: Body, now_ms: int) -> str | None:
        """A contradiction that has lasted up to now, if it was not told before; called after each event."""
        held = self._doubt if now_ms - self._since_ms >= self._patience_ms else None
        if (doubt := _contradiction(board, body, now_ms)) != self._doubt:
            self._doubt, self._since_ms = doubt, now_ms
        if held is None or held in self._reported:
            return None
        self._reported.add(held)
        return held


def _contradiction(board: Board, body: Body, now_ms: int) -> str | None:
    """Why the state cannot be, if it lasts; None if it can."""
    if (state := board.state) is State.BOOTING:
        return "it has told no state since its boot"
    floats = not body.docked and body.depth_at_um(now_ms) == 0
    if body.pin_high and state not in DOCKED:
        return f"it tells the state {state.name}, and a dock charges it"
    if not body.docked and state in DOCKED:
        return f"it tells the state {state.name}, and no dock holds it"
    if floats and state in AT_WORK | STRANDED | {State.SURFACING}:
        return f"it tells the state {state.name}, and floats"
    if body.rests_on_bottom and state in UP_AND_UNDOCKED | {State.SURFACING, State.SINKING}:
        return f"it tells the state {state.name}, and rests on the bottom"
    return _contradicting_rails(board)


def _contradicting_rails(board: Board) -> str | None:
    whole, state = board.config.whole, board.state
    if whole is None or not RAILS[state] or not board.rails:
        return None
    wanted = switched_in(state, whole.cycle is None) | whole.power.kept_on
    differing = (wanted ^ board.rails) & ~_MODEM & ~bits(Rail.MOTORS)
    names = ", ".join(rail.name for rail in Rail if differing >> rail & 1)
    return f"it tells the state {state.name}, and its rails {names} are those of another" if names else None
