"""The mission of a flight that takes calls: flown by the plan or by hand.

A person may take the plan's aPad over, fly it by hand, and give it back (the paper's scenario, section V-A). Both missions
share one state: the docked aMussels, homes, the distance so far. While a person flies, nobody plans. After the person gives
the aPad back, the mission begins at the start of its figure and charges the aMussels aboard first. Where no mission plans,
calls and a script fly the aPad from beginning to end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from agents.time_scale import MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionEnd, MissionState, Phase
from apad_bridge.events.person_events import Overridden, Steering
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.orders import AllowMotion, MissionAction, Order, StopVehicle
from apad_bridge.mission.script_values import Refused, Status
from apad_bridge.vehicle.commands import GoTo
from apad_bridge.vehicle.guards.stops import StopsEnded
from apad_bridge.vehicle.outcomes import Outcome

FLIES_ALREADY = "the mission flies the aPad already"
WAITS_ALREADY = "the mission waits already"


class Calls(Protocol):
    """The calls of other threads (`call_queue.py`)."""

    def serve(self, flown: FlightMission, manual: Callable[[], ManualMission | None]) -> None:
        """Runs the calls since the last tick; each may change who flies the aPad, so each asks `manual` again."""

    def show(self, manual: ManualMission | None) -> None:
        """Ends the tick."""

    def close(self, reason: str) -> None:
        """Takes no calls any more, for this reason."""


class FlightMission:
    """`planned` makes the mission that plans, `by_hand` the mission that follows calls, each from a state.

    Without `planned` no mission plans, and the aPad cannot be given back to one.
    """

    def __init__(
        self,
        planned: Callable[[MissionState | None], EnergyExchange] | None,
        by_hand: Callable[[MissionState], ManualMission],
        calls: Calls,
        state: MissionState | None = None,
        steering: Steering = Steering.PERSON,
    ) -> None:
        """`steering` says who has taken the aPad from the mission, where `state` is of a flight by hand."""
        self._planned = planned
        self._by_hand = by_hand
        self._calls = calls
        self.now_ms = MissionMs(0)
        self._pose: tuple[float, float] | None = None
        self._awaits_person = self._pilot = ""
        self._steering = steering
        """The party that flies by hand; the plan's time has none."""
        self._orders: list[MissionAction] = []
        self._flying: EnergyExchange | ManualMission
        # A resumed flight goes on as it was flown, by hand or by the plan.
        if planned is None or (state is not None and state.phase is Phase.COMMANDED):
            self._flying = by_hand(state or MissionState())
        else:
            self._flying = planned(state)

    @property
    def state(self) -> MissionState:
        return self._flying.state

    @property
    def docks(self) -> tuple[int | None, ...]:
        return self._flying.docks

    @property
    def unheard(self) -> str:
        """The word for what is needed of the aPad before anything is done, and was not heard yet; empty for nothing."""
        return self._flying.unheard

    @property
    def by_hand(self) -> ManualMission | None:
        """The mission that follows calls, while a person has taken over; else None."""
        return self._flying if isinstance(self._flying, ManualMission) else None

    def moved(self, north_m: float, east_m: float) -> None:
        self._pose = (north_m, east_m)
        self._flying.moved(north_m, east_m)

    def battery_heard(self, fraction: float) -> None:
        self._flying.battery_heard(fraction)

    def docks_named(self, named: Mapping[int, bool]) -> None:
        """Takes the word of the vehicle's service about its docks: whether it names each aMussel reported in one."""
        self._flying.docks_named(named)

    def forget_home(self, agent_id: int) -> None:
        """Another board has this id from now on, or none."""
        self._flying.forget_home(agent_id)

    def await_person(self, reason: str, pilot: str = "") -> None:
        """From now on no order moves the aPad before a person allows it, for this reason; empty: orders may.

        `pilot` is the reason why none does for a pilot's sake.
        """
        self._awaits_person, self._pilot = reason, pilot
        self._flying.await_person(reason, pilot)

    def receive(self, outcome: Outcome, now_ms: MissionMs) -> list[MissionAction]:
        return self._flying.receive(outcome, now_ms)

    def advance(self, now_ms: MissionMs) -> list[MissionAction]:
        self.now_ms = now_ms
        if self.by_hand is not None:
            self.by_hand.begin(now_ms)
        self._calls.serve(self, lambda: self.by_hand)
        orders, self._orders = self._orders, []
        orders += self._flying.advance(now_ms)
        self._calls.show(self.by_hand)
        if self.state.phase is Phase.ENDED:
            self._calls.close(str(self.state.ended_by))
        return orders

    def stand_down(self, reason: str, now_ms: MissionMs) -> list[MissionAction]:
        """One of several aPads can do no more: it plans nothing, goes nowhere and keeps its docked aMussels.

        A second call changes nothing, and neither does any call to a mission that follows somebody's orders.
        """
        return self._flying.stand_down(reason, now_ms)

    def end(self, end: MissionEnd, now_ms: MissionMs) -> list[MissionAction]:
        """Ends the mission at once; a second call changes nothing."""
        self._calls.close(str(end))
        return self._flying.end(end, now_ms)

    def finish(self, end: MissionEnd) -> None:
        """Like `end`, from within a call."""
        self._orders += self.end(end, self.now_ms)

    def emit(self, event: Event) -> None:
        """An event for the journal."""
        self._orders.append(event)

    def order(self, order: Order) -> None:
        self._orders.append(order)

    @property
    def steers(self) -> str:
        """The party that steers, for a person."""
        if self.by_hand is None:
            return "the mission steers"
        if self._planned is None:
            return "orders and the script steer: no mission plans in this flight"
        return {
            Steering.PERSON: "a person steers: only give-back returns the aPad to the mission",
            Steering.OTHERS: "another party steers: continue returns the aPad to the mission",
            Steering.STOP: "nobody steers: continue returns the aPad to the mission",
        }[self._steering]

    def take_over(self, by: Steering = Steering.PERSON) -> str:
        """The aPad holds its position and waits for orders; a commanded mechanism is not stopped half-way.

        Like `give_back`, it returns a message when nothing changes, else an empty text. A person takes it from another
        party and from a stop, too. A stop stays in force: whoever takes the aPad over has not seen that the water is clear.
        """
        if by is Steering.PERSON:
            self.order(AllowMotion(by, None, ends=StopsEnded.NONE))
        if self.by_hand is not None:
            if by is Steering.PERSON:
                self._steering = by
                self.emit(Overridden(True, by))
            if self._planned is None:
                return "no mission plans in this flight: orders are taken without it"
            return "the aPad was taken over already"
        self._leave_to(by)
        return ""

    def _leave_to(self, by: Steering) -> None:
        """The mission by hand flies from now on, where the plan did."""
        self._steering = by
        planned = self._flying
        assert isinstance(planned, EnergyExchange)
        manual = self._by_hand(self.state)
        manual.await_person(self._awaits_person, self._pilot)
        manual.go_on_with(planned.docking_routine.mechanism)
        self._change(manual, taken=True, by=by)

    def go_to_target(self, north_m: float, east_m: float, speed_m_s: float | None = None) -> GoTo:
        """Acts as `ManualMission.go_to_target`, also while the plan flies."""
        return (self.by_hand or self._by_hand(self.state)).go_to_target(north_m, east_m, speed_m_s)

    def go_to(
        self,
        north_m: float,
        east_m: float,
        speed_m_s: float | None = None,
        *,
        word: Sequence[MissionAction] = (),
    ) -> None:
        """A person's go-to. It takes the aPad over where the plan flies it, and then replaces an order that was stopped.

        Where no mission plans, a script may wait for the stopped order, which goes on first. `word` goes out before the
        order, and not if the order is refused.
        """
        self.go_to_target(north_m, east_m, speed_m_s)
        self._order_by_hand(lambda it: it.go_to(north_m, east_m, speed_m_s), word)

    def hold(self, north_m: float, east_m: float, *, word: Sequence[MissionAction] = ()) -> None:
        """A person's order to hold position at a point; it takes the aPad over as `go_to` does."""
        self.go_to_target(north_m, east_m)
        self._order_by_hand(lambda it: it.hold(north_m, east_m), word)

    @property
    def is_being_stopped(self) -> bool:
        """A person's stop was ordered in this tick, and goes out at its end."""
        return any(isinstance(it, StopVehicle) for it in self._orders)

    def give_back(self, allowed: AllowMotion | None = None) -> str:
        """Refused while a docking is under way. The mission then tries aMussels again that it had left alone.

        Without `allowed` a stop stays in force, and the mission waits for its end: the answer names it.
        """
        if allowed is not None:
            return self._give_back(allowed)
        told = self._give_back(AllowMotion(Steering.PERSON, None, ends=StopsEnded.NONE))
        return told or (self._awaits_person and f"the mission waits: {self._awaits_person}")

    def _give_back(self, allowed: AllowMotion) -> str:
        manual = self.by_hand
        if self._planned is None:
            raise Refused("this flight has no mission to which to give the aPad back")
        if manual is None:
            self.order(allowed)
            return FLIES_ALREADY
        if manual.docking is Status.RUNNING:
            raise Refused("a docking is under way: wait for its end, or order a hold")
        self.order(allowed)
        self._change(
            self._planned(
                replace(self.state, phase=Phase.IDLE, plan=(), failed_tries=(), failed_undockings=())
            ),
            taken=False,
            by=Steering.PERSON,
        )
        return ""

    def stop(self) -> str:
        """Holds the mission up, or pauses a person's order that is under way. It returns a message when nothing changes.

        It changes nobody's right to steer.
        """
        if (manual := self.by_hand) is None:
            self._leave_to(Steering.STOP)
            return ""
        if (manual.is_busy or self._planned is None) and not manual.paused:
            manual.stop()
            return ""
        return WAITS_ALREADY

    @property
    def waits(self) -> bool:
        """`go_on` would change something: a person's order was paused, or nothing but a stop holds the mission up."""
        manual = self.by_hand
        return manual is not None and (manual.paused or self._may_go_on)

    @property
    def _may_go_on(self) -> bool:
        return self._planned is not None and self._steering is not Steering.PERSON

    def go_on(self, allowed: AllowMotion) -> None:
        """Goes on with a person's order that was paused; else the mission goes on, unless a person took the aPad over."""
        manual = self.by_hand
        if manual is not None:
            manual.await_person("")  # this is the word that was awaited
            manual.resume()
        if manual is None or self._may_go_on:
            self._give_back(allowed)
        else:
            self.order(allowed)

    def _order_by_hand(self, give: Callable[[ManualMission], None], word: Sequence[MissionAction]) -> None:
        begin = len(self._orders)
        give(self._taken_over())
        self._orders[begin:begin] = word

    def _taken_over(self) -> ManualMission:
        if self.by_hand is None:
            self.take_over()
        manual = self.by_hand
        assert manual is not None
        manual.await_person("")  # a person's order is the word that was awaited, as the gate has judged
        if self._planned is not None:
            manual.forget_stopped()
        return manual

    def _change(self, mission: EnergyExchange | ManualMission, *, taken: bool, by: Steering) -> None:
        if self.state.phase is Phase.ENDED:
            raise Refused(f"the mission is over: {self.state.ended_by}")
        if (manual := self.by_hand) is not None:
            self._orders += manual.take_orders()
        mission.docks_named(self._flying.named)
        self._flying = mission
        if self._pose is not None:
            mission.moved(*self._pose)
        self.emit(Overridden(taken, by))
        # The new mission's first orders go out before those that callers give within the same tick.
        self._orders += mission.advance(self.now_ms)


MissionRole = EnergyExchange | FlightMission
"""The mission of a supervisor: the paper's alone, or one that also takes calls."""
