"""The base of every mission: its state, the orders and events of this tick, and the count of its way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from agents.time_scale import MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import (
    DockSwitched,
    Leg,
    LegBegan,
    MissionChanged,
    MissionEnd,
    MissionState,
    Phase,
)
from apad_bridge.mission.orders import MissionAction, Order
from apad_bridge.planning.solution import Step
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.vehicle.commands import GoTo, Hold, Primitive
from apad_bridge.vehicle.outcomes import DockChanged, Outcome, PrimitiveFailed, PrimitiveSucceeded

CHORD_M = 0.5
"""The driven way is counted in chords of at least this, so that a standing vehicle's scattered fixes count nothing."""


class OrderBook:
    """`state` is one frozen value; `snapshot` writes it into the journal.

    A leg is the way of one go-to. It begins at its order and ends with its outcome or with the next primitive's order.
    `cost_m` counts what is driven on legs: the chords between the aPad's reported positions, each of `CHORD_M` or more,
    and the last one of a leg whole. `planned_m` counts the straight way from a leg's start to its goal, as the paper does.
    Of a leg that fails or makes way for another order it counts the part by which the aPad came nearer to the goal. A leg
    that the mission's end cuts off counts whole, because the paper adds a leg when it begins.

    So in an undisturbed flight each leg's driven way is its planned one less what remained at the arrival, at most the
    victory radius. A resumed mission ends the former one's leg where it first hears the aPad, with one straight chord
    from the last point in the journal.
    """

    def __init__(self, state: MissionState) -> None:
        self.state = state
        self.pose: tuple[float, float] | None = None
        """The aPad's place (north, east) in metres; None until it was heard."""
        self.apad_battery: float | None = None
        """The part of a full battery that the aPad has; None until it was heard."""
        self.named: dict[int, bool] = {}
        """By aMussel reported in a dock, whether the vehicle's service about its docks names it."""
        self._orders: list[MissionAction] = []

    @property
    def unheard(self) -> str:
        """The word for what is needed of the aPad before anything is done, and was not heard yet; empty for nothing."""
        return "position" if self.pose is None else ""

    def battery_heard(self, fraction: float) -> None:
        self.apad_battery = fraction

    def docks_named(self, named: Mapping[int, bool]) -> None:
        self.named = dict(named)

    def forget_home(self, agent_id: int) -> None:
        """Another board has this id from now on, or none: where the next one is first heard is its home."""
        self.set(homes=tuple(it for it in self.state.homes if it[0] != agent_id))
        self.snapshot()  # whoever resumes the run would else bring it to the home of the board before

    def moved(self, north_m: float, east_m: float) -> None:
        """Takes the aPad's position, and counts the way while a leg is under way."""
        self.pose = (north_m, east_m)
        if self.state.leg is not None and math.dist(self.state.leg.counted, self.pose) >= CHORD_M:
            self._count_chord(self.state.leg, self.pose)

    def note_outcome(self, outcome: Outcome) -> None:
        """Notes what an outcome tells of a dock or of the leg under way."""
        leg = self.state.leg
        match outcome:
            case DockChanged(_, dock_index, agent_id, closed, docked):
                self.set(docked=docked)
                self.named.pop(agent_id, None)
                self.emit(DockSwitched(dock_index, agent_id, closed))
            case PrimitiveSucceeded(_, primitive_id) if leg is not None and primitive_id == leg.primitive_id:
                self._end_leg(as_planned=True)
            case PrimitiveFailed(_, primitive_id, _) if leg is not None and primitive_id == leg.primitive_id:
                self._end_leg(as_planned=False)

    @property
    def docks(self) -> tuple[int | None, ...]:
        """The agent in each dock, None for a free one."""
        held = dict(self.state.docked)
        return tuple(held.get(dock_index) for dock_index in range(self.state.dock_count))

    @property
    def here(self) -> tuple[float, float]:
        assert self.pose is not None  # nothing is done before it is known
        return self.pose

    @property
    def step(self) -> Step:
        """The step under way."""
        return self.state.plan[0]

    def is_held(self, agent_id: int) -> bool:
        """A dock holds the aMussel."""
        return any(it == agent_id for _, it in self.state.docked)

    def emit(self, event: Event) -> None:
        """An event for the journal."""
        self._orders.append(event)

    def snapshot(self) -> None:
        self.emit(MissionChanged(self.state.phase, self.state))

    def order(self, order: Order) -> None:
        """Gives an order; a primitive ends the leg under way, and a go-to begins one (the aPad's place is known then)."""
        if isinstance(order, Primitive):
            self._end_leg(as_planned=False)
        if isinstance(order, GoTo):
            self._begin_leg(order)
        self._orders.append(order)

    def set(self, **changes: object) -> None:
        self.state = replace(self.state, **changes)  # type: ignore[arg-type]

    def next_id(self) -> int:
        """The id for a new primitive."""
        self.set(primitive_id=self.state.primitive_id + 1)
        return self.state.primitive_id

    def take_orders(self) -> list[MissionAction]:
        orders, self._orders = self._orders, []
        return orders

    def order_go_to(self, place_m: tuple[float, float], rules: Mission) -> None:
        self.order(GoTo(self.next_id(), *place_m, rules.speed_m_s, rules.victory_radius_m))

    def order_hold(self) -> None:
        """The aPad holds its position, where that is known."""
        if self.pose is not None:
            self.order(Hold(self.next_id(), *self.pose))

    def enter(self, phase: Phase, now_ms: MissionMs, **changes: object) -> None:
        self.set(phase=phase, since_ms=now_ms, **changes)
        self.snapshot()

    def close(self, end: MissionEnd, now_ms: MissionMs) -> None:
        """Gives the mission's last order, to hold, and ends its state."""
        self._end_leg(as_planned=True)
        self.order_hold()
        self.enter(Phase.ENDED, now_ms, ended_by=str(end), end_reason=end.reason)

    def _begin_leg(self, go_to: GoTo) -> None:
        assert self.pose is not None
        leg = Leg(go_to.command_id, self.pose, (go_to.north_m, go_to.east_m), self.pose)
        self.set(leg=leg, planned_m=self.state.planned_m + leg.planned_m)
        self.emit(LegBegan(round(leg.planned_m, 4)))

    def _end_leg(self, *, as_planned: bool) -> None:
        if self.state.leg is None or self.pose is None:
            return
        leg = self._count_chord(self.state.leg, self.pose)
        left_m = 0.0 if as_planned else min(leg.planned_m, math.dist(self.pose, leg.goal))
        self.set(leg=None, planned_m=self.state.planned_m - left_m)

    def _count_chord(self, leg: Leg, here: tuple[float, float]) -> Leg:
        counted = replace(leg, counted=here)
        self.set(leg=counted, cost_m=self.state.cost_m + math.dist(leg.counted, here))
        return counted
