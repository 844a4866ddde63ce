"""The parent's side of several aPads over ROS: plans who serves whom from what they say, and orders it.

An aMussel is first given and then taken: its giver says that it has handed it on, with what it believes, and only then is
it in its taker's orders. So it is never in two shares, and what gets lost on the way is ordered again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from apad_bridge.runs.several.assignment import Move, Seen, Sharing
from apad_bridge.runs.several.protocol import Handed, Orders, seen_from


class Reassigner:
    """`homes` are the aMussels simulated beside each aPad, `folders` the runs' directories."""

    def __init__(self, homes: Mapping[str, Iterable[int]], folders: Mapping[str, Path]) -> None:
        self.handed_on: set[int] = set()
        """Who was moved at least once."""
        self._homes = {name: frozenset(ids) for name, ids in homes.items()}
        self._folders = folders
        self._sharing = Sharing(self._homes)
        self._orders = {name: Orders(dict.fromkeys(ids, Handed())) for name, ids in self._homes.items()}
        self._seen: dict[str, Seen] = {}
        self._gone: set[str] = set()
        self._on_their_way: dict[int, Move] = {}
        self._changed: set[str] = set()
        """Those whose orders are to be written."""

    @property
    def shares(self) -> Mapping[str, frozenset[int]]:
        return self._sharing.shares

    def hear(self, name: str, told: Mapping[str, Any]) -> None:
        """What a seat said. KeyError, TypeError or ValueError for what is none of its words."""
        for agent_id, at_ms, kept in told.get("gave", ()):
            self._given(agent_id, Handed(at_ms, kept))
        for agent_id in told.get("kept", ()):
            if self._on_their_way.pop(agent_id, None) is not None:
                self._serve(name, agent_id, Handed())
        if "seen" in told:
            self._seen[name], _ = seen_from(told["seen"])
            self._look()
        self._write()

    def stand_down(self, name: str, reason: str) -> None:
        """It cannot go on, though it may not know."""
        self._orders[name] = replace(self._orders[name], stands_down=reason)
        self._changed.add(name)
        self._write()

    def gone(self, name: str) -> None:
        """Its run has ended: its own fleet with it, and whoever else it served is nobody's."""
        self._gone.add(name)
        for agent_id, move in list(self._on_their_way.items()):
            if move.taker == name:
                del self._on_their_way[agent_id]
                self._serve(move.giver, agent_id, Handed())
            elif move.giver == name:
                self._given(agent_id, Handed())
        if (seen := self._seen.get(name)) is not None:
            served_for_others = self._sharing.shares[name] - self._homes[name]
            places_m = {it: at for it, at in seen.places_m.items() if it in served_for_others}
            self._seen[name] = Seen(name, True, seen.place_m, places_m, frozenset(places_m))
        self._look()
        self._write()

    def _look(self) -> None:
        if self._on_their_way or self._seen.keys() | self._gone != self._homes.keys():
            return
        for move in self._sharing.look([self._seen[name] for name in self._homes if name in self._seen]):
            self._on_their_way[move.agent_id] = move
            if move.giver in self._gone:
                self._given(move.agent_id, Handed())
                continue
            orders = self._orders[move.giver]
            left = {it: handed for it, handed in orders.serves.items() if it != move.agent_id}
            self._orders[move.giver] = replace(orders, serves=left)
            self._changed.add(move.giver)

    def _given(self, agent_id: int, handed: Handed) -> None:
        move = self._on_their_way.pop(agent_id, None)
        if move is None:
            return
        self._sharing.moved(move)
        self.handed_on.add(agent_id)
        self._serve(move.taker, agent_id, handed)

    def _serve(self, name: str, agent_id: int, handed: Handed) -> None:
        orders = self._orders[name]
        self._orders[name] = replace(orders, serves={**orders.serves, agent_id: handed})
        self._changed.add(name)

    def _write(self) -> None:
        for name in sorted(self._changed - self._gone):
            self._orders[name].save(self._folders[name])
        self._changed.clear()
