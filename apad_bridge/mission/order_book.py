"""The base of every mission: its state, and the orders and notes of this tick."""

from __future__ import annotations

from dataclasses import replace

from apad_bridge.mission.orders import Note, Order
from apad_bridge.mission.state import MissionState


class OrderBook:
    """`state` is one frozen value; `snapshot` writes it into the journal."""

    def __init__(self, state: MissionState) -> None:
        self.state = state
        self._orders: list[Order] = []

    @property
    def docks(self) -> tuple[int | None, ...]:
        """The agent in each dock, None for a free one."""
        held = dict(self.state.docked)
        return tuple(held.get(dock_index) for dock_index in range(self.state.dock_count))

    def dock_changed(self, dock_index: int, agent_id: int, closed: bool) -> None:
        """Notes that a dock closed around an aMussel, or let it go."""
        held = {at: agent for at, agent in self.state.docked if at != dock_index}
        if closed:
            held[dock_index] = agent_id
        self.set(docked=tuple(sorted(held.items())))
        self.note("dock", dock=dock_index, agent=agent_id, closed=closed)

    def note(self, kind: str, **data: object) -> None:
        """An event for the journal."""
        self._orders.append(Note(kind, data))

    def snapshot(self) -> None:
        self.note("mission", phase=self.state.phase.value, snapshot=self.state.to_json())

    def order(self, order: Order) -> None:
        self._orders.append(order)

    def set(self, **changes: object) -> None:
        self.state = replace(self.state, **changes)  # type: ignore[arg-type]

    def next_id(self) -> int:
        """The id for a new primitive."""
        self.set(primitive_id=self.state.primitive_id + 1)
        return self.state.primitive_id

    def take_orders(self) -> list[Order]:
        orders, self._orders = self._orders, []
        return orders
