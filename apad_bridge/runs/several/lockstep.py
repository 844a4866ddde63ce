"""Several aPads' flights in step: a tick of mission time is flown by one after another, then it is seen who serves whom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from apad_bridge.runs.several.assignment import Move, Sharing
from apad_bridge.squad.exchange import Exchange
from apad_bridge.squad.looking import seen_of
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.recorder_interface import Recorder

LOOK_MS = 10_000
"""So often, in mission time, it is seen who serves whom. One that stood down is so given time to hear whom it called up."""


@dataclass(frozen=True, slots=True)
class Flown:
    """One of them: where it starts, its flight over the exchange's ether, and its records."""

    start_m: tuple[float, float]
    flight: Flight
    recorder: Recorder


class Formation:
    """Without a `sharing` each serves its own to the end."""

    def __init__(self, flown: Mapping[str, Flown], exchange: Exchange, sharing: Sharing | None) -> None:
        self._flown = dict(flown)
        self._exchange = exchange
        self._sharing = sharing
        self.moves: list[tuple[int, Move]] = []
        """(mission ms, move), as they were made."""

    @property
    def moved(self) -> int:
        """How many aMussels were handed on at least once."""
        return len({move.agent_id for _, move in self.moves})

    def run(self) -> None:
        """To the end of every mission."""
        flying = dict(self._flown)
        while flying:
            now_ms = min(it.flight.now_ms for it in flying.values())
            ended = [name for name, it in flying.items() if it.flight.step()]
            for name in ended:
                del flying[name]
            if self._sharing is not None and now_ms % LOOK_MS == 0:
                self._share(self._sharing, flying, now_ms)

    def _share(self, sharing: Sharing, flying: Mapping[str, Flown], now_ms: int) -> None:
        seen = [seen_of(name, it.start_m, it.flight.supervisor) for name, it in flying.items()]
        for move in sharing.look(seen):
            giver, taker = self._flown[move.giver], self._flown[move.taker]
            belief = giver.flight.supervisor.beliefs.get(move.agent_id)
            giver.flight.supervisor.hand_on(move.agent_id)
            taker.flight.supervisor.take_on(move.agent_id, belief)
            self._exchange.server[move.agent_id] = move.taker
            sharing.moved(move)
            self.moves.append((now_ms, move))
            giver.recorder.event(now_ms, "handed_on", id=move.agent_id, to=move.taker)
            taker.recorder.event(now_ms, "took_on", id=move.agent_id, of=move.giver)
