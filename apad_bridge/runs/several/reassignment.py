"""Reassigns aMussels between several aPads over ROS, in the parent: plans from the members' reports and writes orders.

An aMussel is first given and then taken: its giver reports that it has handed it on, with its belief, and only then the
taker's orders contain the aMussel. So it is never in two shares, and a lost transfer is ordered again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import assert_never

from apad_bridge.runs.parent_protocol import (
    APadView,
    Gave,
    Kept,
    MemberReport,
    Orders,
    TransferredBelief,
)
from apad_bridge.runs.several.assignment import Assignment, Move


class Reassigner:
    """`own` names the aMussels simulated beside each aPad, `folders` the runs' directories."""

    def __init__(self, own: Mapping[str, Iterable[int]], folders: Mapping[str, Path]) -> None:
        self.handed_on: set[int] = set()
        """The aMussels that were moved at least once."""
        self._own = {name: frozenset(ids) for name, ids in own.items()}
        self._folders = folders
        self._assignment = Assignment(self._own)
        self._orders = {
            name: Orders(dict.fromkeys(ids, TransferredBelief())) for name, ids in self._own.items()
        }
        self._views: dict[str, APadView] = {}
        self._ended: set[str] = set()
        self._pending_moves: dict[int, Move] = {}
        self._changed: set[str] = set()
        """The aPads whose orders are to be written."""

    @property
    def shares(self) -> Mapping[str, frozenset[int]]:
        return self._assignment.shares

    def receive(self, name: str, report: MemberReport) -> None:
        match report:
            case Gave(transfers):
                for agent_id, belief in transfers.items():
                    self._complete_move(agent_id, belief)
            case Kept(agent_ids):
                for agent_id in agent_ids:
                    if self._pending_moves.pop(agent_id, None) is not None:
                        self._order_service(name, agent_id, TransferredBelief())
            case APadView():
                self._views[name] = report
                self._plan_moves()
            case _:
                assert_never(report)
        self._write()

    def stand_down(self, name: str, reason: str) -> None:
        """Orders a member that cannot continue to stand down; it may not know the reason itself."""
        self._orders[name] = replace(self._orders[name], stands_down=reason)
        self._changed.add(name)
        self._write()

    def member_ended(self, name: str) -> None:
        """Handles the end of a member's run: its own fleet ended with it; no aPad serves the others that it served."""
        self._ended.add(name)
        for agent_id, move in list(self._pending_moves.items()):
            if move.taker == name:
                del self._pending_moves[agent_id]
                self._order_service(move.giver, agent_id, TransferredBelief())
            elif move.giver == name:
                self._complete_move(agent_id, TransferredBelief())
        if (view := self._views.get(name)) is not None:
            served_for_others = self._assignment.shares[name] - self._own[name]
            places_m = {it: at for it, at in view.places_m.items() if it in served_for_others}
            self._views[name] = APadView(name, True, view.place_m, places_m, frozenset(places_m))
        self._plan_moves()
        self._write()

    def _plan_moves(self) -> None:
        if self._pending_moves or self._views.keys() | self._ended != self._own.keys():
            return
        for move in self._assignment.plan_moves(
            [self._views[name] for name in self._own if name in self._views]
        ):
            self._pending_moves[move.agent_id] = move
            if move.giver in self._ended:
                self._complete_move(move.agent_id, TransferredBelief())
                continue
            orders = self._orders[move.giver]
            left = {it: transfer for it, transfer in orders.serves.items() if it != move.agent_id}
            self._orders[move.giver] = replace(orders, serves=left)
            self._changed.add(move.giver)

    def _complete_move(self, agent_id: int, transfer: TransferredBelief) -> None:
        if (move := self._pending_moves.pop(agent_id, None)) is None:
            return
        self._assignment.record_move(move)
        self.handed_on.add(agent_id)
        self._order_service(move.taker, agent_id, transfer)

    def _order_service(self, name: str, agent_id: int, transfer: TransferredBelief) -> None:
        orders = self._orders[name]
        self._orders[name] = replace(orders, serves={**orders.serves, agent_id: transfer})
        self._changed.add(name)

    def _write(self) -> None:
        for name in sorted(self._changed - self._ended):
            self._orders[name].save(self._folders[name])
        self._changed.clear()
