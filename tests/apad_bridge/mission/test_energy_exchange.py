"""The energy-exchange mission, with beliefs and port answers set by the test."""

import sys
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest
from flying import journaled
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import ExchangePhase, MissionEnd, MissionState, Phase
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.docking.docking_search import NOT_FOUND, SEARCH_S
from apad_bridge.mission.docking.docking_tries import DOCKINGS_PER_STEP, LEGS_PER_STEP
from apad_bridge.mission.end_by import KnownEnd
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.going_home import NO_HOME, HomeStays
from apad_bridge.mission.orders import Order, PermitSurfacing, SendCommand
from apad_bridge.mission.planner import PlanRules
from apad_bridge.planning import registry
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import CollectionStrategy
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Dispatch, DockedAtHome, Home, Places, Suspects, Unavailable
from apad_bridge.scenario.schema import Mission as MissionConfig
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, OpenDock, Primitive
from apad_bridge.vehicle.outcomes import (
    DockChanged,
    NothingCaught,
    PrimitiveFailed,
    PrimitiveSucceeded,
    after_report,
)
from firmware_model.packets import Kind
from firmware_model.states import State

MISSION = load(POOL_FILE).mission


class Told(dict[int, Belief]):
    """Beliefs that the test sets."""

    def all(self) -> list[Belief]:
        return [self[agent_id] for agent_id in sorted(self)]

    def say(
        self, agent_ids: int | Iterable[int], now_ms: int, state: State, charge: float, *place: float
    ) -> None:
        for agent_id in (agent_ids,) if isinstance(agent_ids, int) else agent_ids:
            before = self.get(agent_id)
            where = place or ((before.north_m, before.east_m) if before else (10.0 * agent_id, 0.0))
            self[agent_id] = Belief(agent_id, now_ms, state, charge, 1.0, where[0], where[1])


def rules(
    collection: CollectionStrategy, config: MissionConfig = MISSION, known_end: KnownEnd | None = None
) -> PlanRules:
    return PlanRules(config, collection, registry.redeployment("greedy-redeploy"), known_end=known_end)


class Bench:
    """A mission that the test drives."""

    def __init__(
        self,
        agents: int = 4,
        collection: str = "cautious",
        state: MissionState | None = None,
        place: tuple[float, float] = (0.0, 0.0),
        config: MissionConfig = MISSION,
        home: HomeStays = NO_HOME,
        known_end: KnownEnd | None = None,
    ) -> None:
        self.barred = frozenset[int]()
        self.told = Told()
        self.config = config
        self.now_ms = 0
        self.events: list[Event] = []
        """All events so far."""
        self.orders = []
        self.mission = EnergyExchange(
            rules(registry.collection(collection), config, known_end),
            self.told,
            state,
            home,
            barred=lambda: self.barred,
        )
        self.mission.moved(*place)
        for agent_id in range(1, agents + 1):
            self.told.say(agent_id, 0, State.ACTIVE, 0.5 + agent_id / 100)

    @property
    def orders(self) -> list[Order]:
        """What the mission ordered and told in the newest call."""
        return self._orders

    @orders.setter
    def orders(self, orders: list[Order]) -> None:
        self._orders = orders
        self.events += [it for it in orders if isinstance(it, Event)]

    def tick(self, seconds: int = 1) -> list[Order]:
        """One tick after so many seconds, with every aMussel heard again in its old state."""
        self.now_ms += 1000 * seconds
        for agent_id, belief in self.told.items():
            self.told[agent_id] = replace(belief, heard_ms=self.now_ms)
        self.orders = self.mission.advance(self.now_ms)
        return self.orders

    def hears(
        self, agent_ids: int | Iterable[int], state: State, charge: float, *place: float
    ) -> list[Order]:
        """A tick at which these are heard to be so."""
        self.told.say(agent_ids, self.now_ms, state, charge, *place)
        return self.tick()

    def primitive(self) -> Primitive:
        """The one just ordered, in place of a hold where the mission had waited."""
        found = [order for order in self.orders if isinstance(order, Primitive)]
        assert len(found) == 1 or (len(found) == 2 and isinstance(found[0], Hold)), self.orders
        return found[-1]

    def succeed(self) -> Primitive:
        """Lets the primitive just ordered succeed, and returns it."""
        done = self.primitive()
        if isinstance(done, GoTo):
            self.mission.moved(done.north_m, done.east_m)
        if isinstance(done, CloseDock | OpenDock):
            closed = isinstance(done, CloseDock)
            docked = after_report(self.mission.state.docked, done.dock_index, done.agent_id, closed=closed)
            changed = DockChanged(self.now_ms, done.dock_index, done.agent_id, closed, docked)
            self.mission.receive(changed, self.now_ms)
        self.orders = self.mission.receive(PrimitiveSucceeded(self.now_ms, done.command_id), self.now_ms)
        return done

    def release(self, charge: float | None = None) -> GoTo:
        """From the go-to just ordered to the released aMussel, which then sinks with a charge, if any; the go-to."""
        there = self.succeed()
        released = self.succeed()
        assert isinstance(there, GoTo) and isinstance(released, OpenDock)
        if charge is not None:
            self.told.say(released.agent_id, self.now_ms, State.ACTIVE, charge, there.north_m, there.east_m)
        return there

    def miss(self) -> None:
        """Lets the docking just ordered find nothing to catch."""
        missed = NothingCaught(self.now_ms, self.primitive().command_id)
        self.orders = self.mission.receive(missed, self.now_ms)

    def fail(self, reason: str) -> None:
        failed = PrimitiveFailed(self.now_ms, self.primitive().command_id, reason)
        self.orders = self.mission.receive(failed, self.now_ms)

    def collect(self, agent_id: int) -> None:
        """From the go-to just ordered to the docked aMussel."""
        self.succeed()
        self.told.say(agent_id, self.now_ms, State.FLOATING, self.told[agent_id].primary)
        self.tick()
        assert isinstance(self.succeed(), CloseDock)
        self.told.say(agent_id, self.now_ms, State.CHARGING, self.told[agent_id].primary)

    def notes(self, kind: str) -> list[dict[str, object]]:
        return [order.data for order in self.orders if isinstance(order, Event) and order.kind == kind]


def test_it_holds_and_waits_until_four_are_in_the_pool() -> None:
    bench = Bench(agents=5)
    bench.told.say(4, 0, State.ACTIVE, 0.81)
    bench.told.say(5, 0, State.ACTIVE, 0.9)
    assert isinstance(next(o for o in bench.tick() if not isinstance(o, Event)), Hold)
    assert [o for o in bench.tick() if isinstance(o, Primitive)] == []
    bench.hears(4, State.ACTIVE, 0.8)
    assert isinstance(bench.primitive(), GoTo)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_it_goes_to_the_lowest_first_and_permits_it_to_surface_on_the_way(bench: Bench) -> None:
    bench.tick()
    goto = next(order for order in bench.orders if isinstance(order, GoTo))
    assert (goto.north_m, goto.east_m, goto.speed_m_s) == (10.0, 0.0, 0.5)
    assert PermitSurfacing(1) in bench.orders
    assert (bench.mission.state.cost_m, bench.mission.state.planned_m) == (0.0, 10.0)
    bench.succeed()
    assert (bench.mission.state.cost_m, bench.mission.state.planned_m) == (10.0, 10.0)


def test_it_docks_only_what_floats_and_repeats_the_permission(bench: Bench) -> None:
    bench.tick()
    bench.succeed()
    for _ in range(9):
        assert PermitSurfacing(1) not in bench.tick()
    assert PermitSurfacing(1) in bench.tick()
    bench.hears(1, State.FLOATING, 0.5)
    assert bench.primitive() == CloseDock(bench.mission.state.primitive_id, 0, 1)


def test_one_that_never_answers_is_given_up_and_the_next_is_collected(bench: Bench) -> None:
    bench.tick()
    bench.succeed()
    waited = 0
    while not bench.notes("given_up"):
        bench.tick()
        waited += 1
        assert waited <= MISSION.permission_repeat_s * MISSION.surfacing_attempts
    assert bench.notes("given_up")[0]["agent"] == 1
    assert PermitSurfacing(2) in bench.orders


def ready_for_a_round() -> Bench:
    bench = Bench()
    bench.tick()
    for agent_id in (1, 2, 3, 4):
        bench.collect(agent_id)
    assert bench.mission.state.phase is Phase.CHARGE
    return bench


def test_a_whole_round_charges_all_to_99_percent_and_brings_them_home() -> None:
    bench = ready_for_a_round()
    bench.mission.moved(40.0, 0.0)
    bench.told.say((1, 2, 3), bench.now_ms, State.CHARGING, 1.0)
    bench.hears(4, State.CHARGING, 0.99)
    assert bench.mission.state.phase is Phase.CHARGE
    bench.hears(4, State.CHARGING, 0.991)
    for expected in (4, 3, 2, 1):  # nearest home first, from 40 m north
        goto = bench.succeed()
        assert isinstance(goto, GoTo) and goto.north_m == 10.0 * expected
        undock = bench.succeed()
        assert isinstance(undock, OpenDock) and undock.agent_id == expected
        assert SendCommand(Kind.RELEASE, expected) in bench.orders
        bench.told.say(expected, bench.now_ms, State.SINKING, 1.0)
    assert bench.mission.state.phase is Phase.IDLE and bench.mission.state.services == 4


def test_a_docked_one_whose_charge_does_not_rise_is_not_waited_for() -> None:
    bench = ready_for_a_round()
    bench.hears((1, 2, 3), State.CHARGING, 1.0)
    bench.tick(int(MISSION.silence_timeout_s))
    assert bench.mission.state.phase is Phase.CHARGE
    bench.tick(2)
    assert bench.notes("given_up")[0]["agent"] == 4
    assert bench.mission.state.phase is Phase.GO_DEPLOY


def test_a_failed_go_to_skips_the_step_and_says_why(bench: Bench) -> None:
    bench.tick()
    bench.fail("stalled")
    assert bench.notes("given_up")[0] == {"agent": 1, "what": "collect", "reason": "stalled"}
    assert PermitSurfacing(2) in bench.orders


def test_a_leg_that_a_resumed_mission_takes_up_is_counted_once(bench: Bench) -> None:
    bench.tick()
    bench.mission.moved(4.0, 0.0)
    after = Bench(state=journaled(bench.mission.state), place=(6.0, 0.0))
    after.tick()
    after.succeed()
    assert after.mission.state.cost_m == pytest.approx(10.0)
    assert after.mission.state.planned_m == pytest.approx(10.0)


def test_an_aPad_that_does_not_get_anywhere_is_said_and_nobody_is_left_alone_for_it(bench: Bench) -> None:
    said: list[object] = []
    for _ in range(4 * MISSION.collection_attempts):
        bench.tick(int(MISSION.silence_timeout_s) + 1)
        while any(isinstance(order, GoTo) for order in bench.orders):
            bench.fail("stalled")
            said += bench.notes("stuck")
            assert bench.notes("left_alone") == []
    assert said[0] == {"reason": "3 go-tos in a row failed: stalled"}
    assert bench.mission.state.failed_tries == ((1, 1),)


def deaf(bench: Bench, agent_id: int) -> None:
    """From the go-to just ordered: the aMussel does not answer, and is given up."""
    assert PermitSurfacing(agent_id) in bench.orders
    bench.succeed()
    while not bench.notes("given_up"):
        bench.tick()


def test_one_that_is_tried_in_vain_is_left_alone_and_the_others_are_served(bench: Bench) -> None:
    for attempt in range(1, MISSION.collection_attempts + 1):
        bench.tick(int(MISSION.silence_timeout_s) + 1)
        deaf(bench, 1)
        left_alone = bench.notes("left_alone")
        assert bool(left_alone) is (attempt == MISSION.collection_attempts)
        for agent_id in (2, 3, 4):
            bench.collect(agent_id)
        bring_home(bench, (2, 3, 4), charge=1.0)
        bench.told.say((2, 3, 4), bench.now_ms, State.ACTIVE, 0.7)
    assert left_alone == [
        {
            "agent": 1,
            "tries": MISSION.collection_attempts,
            "reason": "it does not answer the permission to surface",
        }
    ]
    # Three candidates are a whole batch from now on, and the fourth is not called any more.
    bench.tick(int(MISSION.silence_timeout_s) + 1)
    assert PermitSurfacing(2) in bench.orders
    # Another supervisor of the run leaves it alone as well; a person who gives the aPad back does not.
    assert dict(journaled(bench.mission.state).failed_tries) == {1: MISSION.collection_attempts}


def bring_home(bench: Bench, agent_ids: tuple[int, ...], charge: float) -> None:
    """From the charging wait to the last release; the docked aMussels then have `charge`."""
    bench.hears(agent_ids, State.CHARGING, charge)
    if bench.mission.state.phase is Phase.CHARGE:
        bench.tick(int(MISSION.silence_timeout_s) + 1)
    for _ in agent_ids:
        bench.succeed()
        released = bench.succeed()
        assert isinstance(released, OpenDock)
        bench.told.say(released.agent_id, bench.now_ms, State.ACTIVE, charge)
    assert bench.mission.state.phase is Phase.IDLE


def test_a_suspect_with_charge_is_fetched_for_a_look_brought_back_and_left_in_the_water() -> None:
    bench = Bench(agents=2, config=replace(MISSION, batch=1, suspects=Suspects.FETCHED))

    def suspect(was_docked: bool) -> None:
        bench.told[2] = replace(bench.told[2], suspicion=Suspicion("its charge jumps", was_docked))

    bench.told.say((1, 2), 0, State.ACTIVE, 0.95)
    assert not any(isinstance(order, GoTo) for order in bench.tick())
    suspect(was_docked=False)
    assert PermitSurfacing(2) in bench.tick()
    bench.collect(2)
    suspect(was_docked=True)  # its twin has seen the docking
    bring_home(bench, (2,), charge=1.0)
    suspect(was_docked=True)
    assert bench.mission.state.services == 1
    assert not any(isinstance(order, GoTo) for order in (*bench.tick(), *bench.tick(600)))
    bench.told.say(2, bench.now_ms, State.ACTIVE, 0.5)  # and served as any other
    suspect(was_docked=True)
    assert PermitSurfacing(2) in bench.tick()


@pytest.fixture
def alone() -> Bench:
    return Bench(agents=1)


def test_one_that_is_docked_a_second_time_is_watched_anew(alone: Bench) -> None:
    """It comes with less charge than it left with, long after it gained some; nobody else was docked meanwhile."""
    for _ in range(2):
        alone.told.say(1, alone.now_ms, State.ACTIVE, 0.5)
        alone.tick(3 * int(MISSION.silence_timeout_s))
        alone.collect(1)
        alone.tick()
        assert alone.mission.state.phase is Phase.CHARGE and not alone.notes("given_up")
        bring_home(alone, (1,), charge=0.995)


def test_one_that_never_gains_charge_is_left_alone(alone: Bench) -> None:
    """An aMussel whose charge does not rise in the dock would be fetched for ever."""
    for attempt in range(1, MISSION.collection_attempts + 1):
        alone.hears(1, State.ACTIVE, 0.5)
        alone.collect(1)
        bring_home(alone, (1,), charge=0.5)
        assert dict(alone.mission.state.failed_tries) == {1: attempt}
    alone.tick(int(MISSION.silence_timeout_s) + 1)
    assert [order for order in alone.orders if isinstance(order, Primitive)] == []


def with_jammed_dock() -> tuple[Bench, list[Order]]:
    """A mission after 200 s in which the dock of aMussel 1 failed to open as often as it was tried; and its orders."""
    bench, ordered = ready_for_a_round(), list[Order]()
    bench.told.say(range(1, 5), bench.now_ms, State.CHARGING, 1.0)
    for _ in range(200):
        ordered += bench.tick()
        while bench.mission.state.phase in (Phase.GO_DEPLOY, Phase.UNDOCK):
            order = bench.primitive()
            if isinstance(order, OpenDock) and order.agent_id == 1:
                bench.fail("the dock did not open")
            else:
                bench.succeed()
            if isinstance(order, OpenDock) and order.agent_id != 1:
                bench.told.say(order.agent_id, bench.now_ms, State.ACTIVE, 0.9)
            ordered += bench.orders
    return bench, ordered


def test_a_dock_that_never_opens_is_given_up_and_the_others_go_on() -> None:
    bench, ordered = with_jammed_dock()
    tried = [it.agent_id for it in ordered if isinstance(it, OpenDock)]
    assert sorted(tried) == [1] * MISSION.collection_attempts + [2, 3, 4]
    (left,) = [it.data for it in ordered if isinstance(it, Event) and it.kind == "left_alone"]
    assert left == {
        "agent": 1,
        "tries": MISSION.collection_attempts,
        "reason": "its dock does not open: the dock did not open",
    }
    assert bench.mission.state.phase is Phase.IDLE and bench.mission.state.docked == ((0, 1),)
    # The three others are a batch: nobody else can be collected. Their docks are those that are free.
    bench.hears((2, 3, 4), State.ACTIVE, 0.5)
    assert [(it.agent_id, it.dock_index) for it in bench.mission.state.plan] == [(2, 1), (3, 2), (4, 3)]


def test_a_resumed_mission_does_not_try_a_jammed_dock_again_until_it_opens() -> None:
    bench, _ = with_jammed_dock()
    resumed = Bench(state=journaled(bench.mission.state))
    resumed.told.say(1, 0, State.CHARGING, 1.0)
    for _ in range(20):
        assert not [it for it in resumed.tick() if isinstance(it, OpenDock)]
    # A person opens it by hand.
    resumed.mission.receive(DockChanged(resumed.now_ms, 0, 1, False, ()), resumed.now_ms)
    assert resumed.mission.state.failed_undockings == ()


def test_a_try_that_helps_forgets_those_that_failed() -> None:
    bench = Bench(agents=1, state=MissionState(failed_tries=((1, 4), (7, 2))))
    bench.tick()
    bench.collect(1)
    bring_home(bench, (1,), charge=0.9)  # not full, and above the pool's threshold
    assert bench.mission.state.failed_tries == ((7, 2),)


def test_one_that_floats_away_again_and_again_is_given_up(alone: Bench) -> None:
    alone.tick()
    go_tos = 0
    while not alone.notes("given_up"):
        goto = alone.succeed()
        assert isinstance(goto, GoTo)
        go_tos += 1
        assert go_tos <= LEGS_PER_STEP
        alone.hears(1, State.FLOATING, 0.5, goto.north_m + 5.0, goto.east_m)
    assert go_tos == LEGS_PER_STEP
    assert alone.notes("given_up")[0]["reason"] == "it still floats out of reach after 3 go-tos"


def float_beside_the_apad(bench: Bench, charge: float = 0.5) -> None:
    """From the go-to just ordered: aMussel 1 floats, and its docking is ordered."""
    bench.succeed()
    bench.hears(1, State.FLOATING, charge)
    assert isinstance(bench.primitive(), CloseDock)


def test_a_docking_that_missed_is_tried_again_at_once(bench: Bench) -> None:
    bench.tick()
    float_beside_the_apad(bench)
    for _ in range(DOCKINGS_PER_STEP - 1):
        bench.fail("missed")
        assert bench.notes("given_up") == []
        bench.tick()
        assert isinstance(bench.primitive(), CloseDock)
    bench.succeed()
    assert (dict(bench.mission.state.docked), bench.mission.state.failed_tries) == ({0: 1}, ())


def test_one_that_the_catch_radius_does_not_hold_is_searched_for_and_docked(bench: Bench) -> None:
    bench.tick()
    float_beside_the_apad(bench)
    for _ in range(3):
        bench.miss()
        assert isinstance(bench.primitive(), GoTo)
        bench.tick(2)
        assert not any(isinstance(order, Primitive) for order in bench.orders)  # its go-to goes on
        bench.orders = bench.mission.receive(
            PrimitiveSucceeded(bench.now_ms, bench.mission.state.primitive_id), bench.now_ms
        )
        assert isinstance(bench.primitive(), CloseDock)
    bench.succeed()
    assert (dict(bench.mission.state.docked), bench.mission.state.plan[0].agent_id) == ({0: 1}, 2)


def test_a_search_in_vain_is_a_failed_docking(bench: Bench) -> None:
    bench.tick()
    float_beside_the_apad(bench)
    for _ in range(DOCKINGS_PER_STEP):
        bench.miss()
        bench.now_ms += round(SEARCH_S * 1000)
        bench.succeed()
        bench.miss()
        if not bench.notes("given_up"):
            bench.hears(1, State.FLOATING, 0.5, *bench.mission.pose)
    assert bench.notes("given_up")[0] == {"agent": 1, "what": "collect", "reason": NOT_FOUND}
    assert dict(bench.mission.state.failed_tries) == {1: 1}


def test_an_ended_mission_searches_no_further(bench: Bench) -> None:
    bench.tick()
    float_beside_the_apad(bench)
    bench.miss()
    go_to = bench.primitive()
    bench.mission.end(MissionEnd(EndReason.OPERATOR), bench.now_ms)
    assert bench.mission.receive(PrimitiveSucceeded(bench.now_ms, go_to.command_id), bench.now_ms) == []


def miss_all(bench: Bench) -> None:
    """From the docking just ordered: every try misses, and the aMussel is given up."""
    for _ in range(DOCKINGS_PER_STEP):
        bench.fail("missed")
        if not bench.notes("given_up"):
            bench.tick()
    assert bench.notes("given_up")[0]["agent"] == 1


def test_one_that_is_left_afloat_is_fetched_next_without_a_batch(alone: Bench) -> None:
    alone.told.say(2, 0, State.ACTIVE, 0.9)  # not in need, but it makes a batch of 2
    alone.tick()
    assert not any(isinstance(order, GoTo) for order in alone.orders)
    alone.hears(2, State.ACTIVE, 0.7)
    float_beside_the_apad(alone)
    miss_all(alone)
    alone.collect(2)
    assert alone.mission.state.phase is Phase.CHARGE
    bring_home(alone, (2,), charge=1.0)
    alone.tick()
    assert any(isinstance(order, GoTo) for order in alone.orders)
    assert alone.mission.state.plan[0].agent_id == 1


def test_an_empty_one_that_was_missed_is_told_to_sink_while_others_are_collected(bench: Bench) -> None:
    """At the surface its backup battery lasts for some hours, and on the bottom for days."""
    bench.tick()
    float_beside_the_apad(bench, charge=0.0)
    miss_all(bench)
    assert bench.mission.state.plan[0].agent_id == 2
    assert SendCommand(Kind.RELEASE, 1) in bench.tick()


def test_an_aPad_that_cannot_reach_one_that_floats_does_not_try_at_every_tick(alone: Bench) -> None:
    alone.hears(1, State.FLOATING, 0.5)
    alone.fail("refused")
    assert alone.notes("given_up")[0]["reason"] == "refused"
    for _ in range(int(MISSION.silence_timeout_s) - 1):
        assert not any(isinstance(order, GoTo) for order in alone.tick())


def test_an_answer_to_a_primitive_that_is_over_changes_nothing(bench: Bench) -> None:
    bench.tick()
    before = bench.mission.state
    assert (
        bench.mission.receive(PrimitiveSucceeded(bench.now_ms, before.primitive_id - 1), bench.now_ms) == []
    )
    assert bench.mission.state == before


def test_what_was_docked_by_hand_is_charged_first(bench: Bench) -> None:
    bench.mission.receive(DockChanged(0, 2, 3, True, ((2, 3),)), 0)
    bench.tick()
    assert bench.mission.state.phase is Phase.CHARGE


def test_a_stray_at_the_surface_is_told_that_it_may_sink() -> None:
    bench = Bench(agents=3)
    assert SendCommand(Kind.RELEASE, 2) in bench.hears(2, State.FLOATING, 0.9)
    assert SendCommand(Kind.RELEASE, 2) not in bench.tick()
    assert SendCommand(Kind.RELEASE, 2) in bench.tick(int(MISSION.permission_repeat_s))


def test_it_ends_once_and_holds() -> None:
    bench = ready_for_a_round()
    orders = bench.mission.end(MissionEnd(EndReason.OPERATOR), bench.now_ms)
    assert any(isinstance(order, Hold) for order in orders)
    assert bench.mission.state.end == MissionEnd(EndReason.OPERATOR, str(EndReason.OPERATOR))
    assert bench.mission.end(MissionEnd(EndReason.MISSION_TIME), bench.now_ms) == []
    assert [o for o in bench.tick() if isinstance(o, Primitive)] == []


@pytest.mark.parametrize("phase", [Phase.GO_COLLECT, Phase.AWAIT_SURFACING, Phase.DOCK])
def test_a_resumed_mission_takes_up_the_step_under_way(phase: Phase) -> None:
    state = replace(ready_state(), phase=phase)
    bench = Bench(state=journaled(state))
    bench.tick()
    assert (bench.primitive().north_m if isinstance(bench.primitive(), GoTo) else None) == 30.0
    assert PermitSurfacing(3) in bench.orders


def test_a_resumed_mission_does_not_dock_twice_what_the_dock_holds() -> None:
    state = replace(ready_state(), phase=Phase.DOCK, docked=((0, 1), (1, 2), (2, 3)))
    bench = Bench(state=state)
    bench.tick()
    assert PermitSurfacing(4) in bench.orders
    assert PermitSurfacing(3) not in bench.orders


def undocking_state() -> MissionState:
    """A journal's state with one aMussel, believed full, being let go."""
    bench = Bench(agents=1)
    bench.mission.receive(DockChanged(0, 2, 1, True, ((2, 1),)), 0)
    bench.hears(1, State.CHARGING, 1.0)
    bench.tick()
    bench.succeed()
    assert isinstance(bench.primitive(), OpenDock)
    return journaled(bench.mission.state)


def test_a_resumed_undocking_is_ordered_again() -> None:
    bench = Bench(agents=1, state=undocking_state())
    bench.hears(1, State.CHARGING, 1.0)
    bench.succeed()
    bench.succeed()
    assert SendCommand(Kind.RELEASE, 1) in bench.orders
    assert bench.notes("released") == [{"agent": 1, "full": True}]
    assert bench.mission.state.services == 1


@pytest.mark.parametrize(
    ("state", "named", "counts"),
    [
        (State.CHARGING, {}, True),
        (State.CHARGING, {1: False}, True),
        (State.ACTIVE, {}, False),
        (State.ACTIVE, {1: True}, True),
        (State.FLOATING, {}, False),
    ],
)
def test_a_service_counts_by_more_than_the_vehicle_s_report_and_the_mission_goes_on_without(
    alone: Bench, state: State, named: dict[int, bool], counts: bool
) -> None:
    alone.mission.receive(DockChanged(0, 2, 1, True, ((2, 1),)), 0)
    alone.mission.docks_named(named)
    alone.hears(1, state, 1.0)
    alone.tick()
    alone.succeed()
    assert len(alone.notes("docks_disagree")) == (not counts)
    assert isinstance(alone.primitive(), OpenDock)
    alone.succeed()
    assert alone.notes("released") == [{"agent": 1, "full": counts}]
    assert (alone.mission.state.services, alone.mission.state.phase) == (int(counts), Phase.IDLE)


def test_the_docks_service_is_no_witness_of_a_later_docking() -> None:
    bench = Bench(agents=2)
    bench.mission.docks_named({1: True, 2: False})
    bench.mission.receive(DockChanged(0, 2, 1, True, ((2, 1),)), 0)
    assert bench.mission.named == {2: False}


def test_an_undocking_that_ended_without_a_supervisor_is_a_service() -> None:
    bench = Bench(agents=1, state=replace(undocking_state(), docked=()))
    bench.hears(1, State.FLOATING, 1.0)
    assert SendCommand(Kind.RELEASE, 1) in bench.orders
    assert bench.notes("released") == [{"agent": 1, "full": True}]
    assert (bench.mission.state.services, bench.mission.state.phase) == (1, Phase.IDLE)


def test_a_resumed_charging_wait_gives_nobody_up_before_it_was_heard_for_long_enough() -> None:
    state = replace(ready_state(), phase=Phase.CHARGE, since_ms=0, plan=())
    bench = Bench(agents=0, state=state)
    bench.now_ms = 500_000
    bench.tick()
    assert bench.notes("given_up") == []
    bench.tick(int(MISSION.silence_timeout_s) + 1)
    assert [note["agent"] for note in bench.notes("given_up")] == [1, 2]


def test_one_docked_by_hand_and_never_heard_does_not_take_a_dock_for_ever(alone: Bench) -> None:
    alone.mission.receive(DockChanged(0, 2, 77, True, ((2, 77),)), 0)
    alone.tick()
    alone.tick(int(MISSION.silence_timeout_s) + 1)
    alone.succeed()
    assert isinstance(alone.succeed(), OpenDock) and alone.mission.docks == (None,) * 4


def test_a_resumed_step_waits_for_its_aMussel_to_be_heard_again() -> None:
    state = replace(ready_state(), phase=Phase.GO_COLLECT)
    bench = Bench(agents=0, state=state)
    bench.now_ms = 500_000
    assert bench.tick() == []
    bench.hears(3, State.FLOATING, 0.5)
    assert isinstance(bench.primitive(), GoTo)


def test_a_resumed_step_of_one_that_stays_silent_is_given_up() -> None:
    state = replace(ready_state(), phase=Phase.GO_COLLECT)
    bench = Bench(agents=0, state=state)
    bench.tick()
    bench.tick(int(MISSION.silence_timeout_s) + 1)
    assert bench.notes("given_up")[0]["agent"] == 3


@pytest.mark.parametrize(("collection", "second"), [("njnp", 5), ("greedy", 2)])
def test_a_strategy_that_pre_empts_takes_a_nearer_request_that_came_on_the_way(
    collection: str, second: int
) -> None:
    bench = Bench(agents=5, collection=collection)
    bench.hears(5, State.ACTIVE, 0.9, 10.0, 1.0)
    bench.succeed()  # it has come to aMussel 1
    bench.told.say(5, 0, State.ACTIVE, 0.7)
    bench.hears(1, State.FLOATING, 0.5)
    assert isinstance(bench.succeed(), CloseDock)
    (goto,) = (order for order in bench.orders if isinstance(order, GoTo))
    assert (goto.north_m, goto.east_m) == (bench.told[second].north_m, bench.told[second].east_m)
    steps = bench.mission.state.plan
    assert len(steps) == 3 and {step.agent_id for step in steps} <= {2, 3, 4, 5}
    assert {step.dock_index for step in steps} == {1, 2, 3}


class Raises(CollectionStrategy):
    def plan(self, situation: object, batch: int) -> Solution:
        raise RuntimeError("no idea")


class Leaves(CollectionStrategy):
    def plan(self, situation: object, batch: int) -> Solution:
        sys.exit(0)


class Foreign(CollectionStrategy):
    def plan(self, situation: object, batch: int) -> Solution:
        return Solution((Step(StepKind.COLLECT, 99, 0),))


class FailsToRefuse(CollectionStrategy):
    """Has no plan, and raises when it is asked if it refuses, after so many answers."""

    def __init__(self, answered: int) -> None:
        self._answered = answered

    def plan(self, situation: object, batch: int) -> Solution:
        return Solution(())

    def refuses(self, situation: object) -> bool:
        self._answered -= 1
        if self._answered < 0:
            raise RuntimeError("cannot\ntell")
        return True


@pytest.mark.parametrize(
    ("strategy", "why"),
    [
        (Raises(), "no idea"),
        (Leaves(), "SystemExit: 0"),
        (Foreign(), "99"),
        (FailsToRefuse(0), "RuntimeError: cannot tell"),
        (FailsToRefuse(1), "RuntimeError: cannot tell"),
    ],
)
def test_a_strategy_that_fails_ends_the_mission_holding(
    bench: Bench, strategy: CollectionStrategy, why: str
) -> None:
    bench.mission.change_planning(rules(strategy))
    bench.tick()
    if bench.mission.state.phase is Phase.IDLE:
        bench.tick()  # asks again whether it still refuses
    assert bench.mission.state.phase is Phase.ENDED
    assert bench.mission.state.end_reason is EndReason.STRATEGY_FAILED
    assert str(bench.mission.state.ended_by).startswith("failure of strategy 'cautious'")
    assert why in str(bench.mission.state.ended_by)
    assert isinstance([o for o in bench.orders if isinstance(o, Primitive)][-1], Hold)
    assert len(bench.notes("mission")) == 1
    ids = [o.command_id for o in bench.orders if isinstance(o, Primitive)]
    assert ids == sorted(set(ids)), "each order is given once"


def ready_state() -> MissionState:
    """A journal's state with two docked and two more to come."""
    bench = Bench()
    bench.tick()
    bench.collect(1)
    bench.collect(2)
    assert bench.mission.state.docked == ((0, 1), (1, 2))
    return bench.mission.state


def test_nothing_is_ordered_before_the_aPad_s_place_is_known() -> None:
    told = Told()
    told.say(1, 0, State.ACTIVE, 0.1)
    assert EnergyExchange(rules(registry.collection("greedy")), told).advance(0) == []


ASYNCHRONOUS = replace(MISSION, dispatch=Dispatch.ASYNCHRONOUS)


def one_by_one(
    agents: int = 2, config: MissionConfig = ASYNCHRONOUS, known_end: KnownEnd | None = None
) -> Bench:
    """An aPad that has collected aMussel 1 alone and waits beside it; the others are above the pool's threshold."""
    bench = Bench(agents=agents, config=config, known_end=known_end)
    bench.told.say(range(2, agents + 1), 0, State.ACTIVE, 0.9)
    bench.tick()
    bench.collect(1)
    assert bench.mission.state.phase is Phase.CHARGE
    bench.tick()
    return bench


@pytest.fixture
def single() -> Bench:
    return one_by_one()


def test_an_amussel_that_was_docked_just_now_and_was_last_heard_afloat_is_not_collected_again(
    single: Bench,
) -> None:
    single.hears(1, State.FLOATING, 0.51)
    assert single.mission.state.plan == () and single.mission.state.phase is Phase.CHARGE


def test_asynchronous_dispatch_collects_one_beside_one_that_charges_and_releases_the_full_one_alone(
    single: Bench,
) -> None:
    single.hears(2, State.ACTIVE, 0.8)
    assert [step.agent_id for step in single.mission.state.plan] == [2]
    single.collect(2)
    assert single.mission.docks[:2] == (1, 2) and single.mission.state.phase is Phase.CHARGE
    single.told.say(1, single.now_ms, State.CHARGING, 0.995)
    single.hears(3, State.ACTIVE, 0.5)
    assert [(step.kind, step.agent_id) for step in single.mission.state.plan] == [(StepKind.DEPLOY, 1)]
    single.release()
    assert single.mission.state.services == 1 and single.mission.docks[:2] == (None, 2)


@pytest.mark.parametrize(("charge_to", "leaves"), [(0.85, True), (None, False)])
def test_a_charged_one_makes_room_when_another_waits(charge_to: float | None, leaves: bool) -> None:
    bench = one_by_one(agents=6, config=replace(ASYNCHRONOUS, charge_to=charge_to))
    for agent_id in (2, 3, 4):
        bench.hears(agent_id, State.ACTIVE, 0.7)
        bench.collect(agent_id)
    bench.hears(3, State.CHARGING, 0.9)
    assert bench.mission.state.phase is Phase.CHARGE
    bench.hears(5, State.ACTIVE, 0.7)
    assert [step.agent_id for step in bench.mission.state.plan] == ([3] if leaves else [])


@pytest.mark.parametrize(("waiting_charge", "leaves"), [(0.4, True), (0.5, True), (0.51, False)])
def test_one_that_leads_the_lowest_of_the_pool_makes_room_for_it(waiting_charge: float, leaves: bool) -> None:
    bench = one_by_one(agents=6, config=replace(ASYNCHRONOUS, charge_lead=0.25))
    for agent_id in (2, 3, 4):
        bench.hears(agent_id, State.ACTIVE, 0.7)
        bench.collect(agent_id)
    bench.told.say(3, bench.now_ms, State.CHARGING, 0.75)
    bench.told.say(5, bench.now_ms, State.ACTIVE, 0.7)
    bench.hears(6, State.ACTIVE, waiting_charge)
    assert [step.agent_id for step in bench.mission.state.plan] == ([3] if leaves else [])


@pytest.mark.parametrize(
    ("last_docked", "last_waiting", "leave"), [(0.75, 0.5, True), (0.74, 0.5, False), (0.75, 0.51, False)]
)
def test_a_batch_makes_room_when_each_of_it_leads_each_of_the_lowest_batch(
    last_docked: float, last_waiting: float, leave: bool
) -> None:
    bench = Bench(agents=5, config=replace(MISSION, batch=2, charge_lead=0.25))
    bench.hears((3, 4, 5), State.ACTIVE, 0.9)
    bench.collect(1)
    bench.collect(2)
    for agent_id, charge in ((1, last_docked), (2, 0.95)):
        bench.told.say(agent_id, bench.now_ms, State.CHARGING, charge)
    bench.hears(3, State.ACTIVE, 0.1)
    assert bench.mission.state.phase is Phase.CHARGE  # one that waits is no batch
    bench.told.say(4, bench.now_ms, State.ACTIVE, last_waiting)
    bench.hears(5, State.ACTIVE, 0.79)
    assert {step.agent_id for step in bench.mission.state.plan} == ({1, 2} if leave else set())


def test_an_asynchronous_aPad_gives_up_one_whose_charge_does_not_rise_and_releases_it(single: Bench) -> None:
    for _ in range(round(MISSION.silence_timeout_s) + 2):
        single.tick()
        if single.notes("given_up"):
            break
    assert [note["what"] for note in single.notes("given_up")] == ["charge"]
    assert [step.kind for step in single.mission.state.plan] == [StepKind.DEPLOY]


HOME_M = (5.0, 30.0)
CHARGED_AT_HOME = Home(charging_w=200.0, go_at=0.2, leave_at=0.9)


def go_to_ordered(bench: Bench) -> GoTo:
    (found,) = [order for order in bench.orders if isinstance(order, GoTo)]
    return found


def come_home(bench: Bench) -> None:
    """Drives the go-to home that was just ordered, and leaves the hold there as the primitive under way."""
    goal = go_to_ordered(bench)
    assert (goal.north_m, goal.east_m) == HOME_M and bench.mission.state.phase is Phase.GO_HOME
    bench.orders = [goal]
    bench.succeed()
    assert isinstance(bench.primitive(), Hold) and bench.mission.state.phase is Phase.AT_HOME


def test_it_goes_home_to_be_charged_before_it_takes_up_a_plan_and_goes_on_when_it_is() -> None:
    bench = Bench(home=HomeStays(HOME_M, CHARGED_AT_HOME, ()))
    bench.mission.battery_heard(0.2)
    bench.tick()
    come_home(bench)
    bench.mission.battery_heard(0.89)
    bench.tick()
    assert bench.mission.state.phase is Phase.AT_HOME and bench.mission.state.services == 0
    bench.mission.battery_heard(0.9)
    bench.tick()
    bench.tick()
    assert [step.agent_id for step in bench.mission.state.plan] == [1, 2, 3, 4]


@pytest.mark.parametrize("docked", DockedAtHome)
def test_docked_ones_come_along_or_leave_first(docked: DockedAtHome) -> None:
    home = HomeStays(HOME_M, replace(CHARGED_AT_HOME, docked=docked), (Unavailable(from_s=20, until_s=500),))
    bench = Bench(agents=2, config=ASYNCHRONOUS, home=home)
    bench.told.say(2, 0, State.ACTIVE, 0.9)
    bench.mission.battery_heard(1.0)
    bench.tick()
    bench.collect(1)
    bench.tick(seconds=20)
    if docked is DockedAtHome.RELEASED:
        assert [step.kind for step in bench.mission.state.plan] == [StepKind.DEPLOY]
        bench.release()
        bench.hears(1, State.SINKING, 0.6)
    come_home(bench)
    assert (bench.mission.docks[0] == 1) is (docked is DockedAtHome.CHARGE)
    bench.tick(seconds=400)
    assert bench.mission.state.phase is Phase.AT_HOME
    bench.tick(seconds=100)
    assert bench.mission.state.phase is (Phase.CHARGE if docked is DockedAtHome.CHARGE else Phase.IDLE)


def test_a_way_home_that_fails_is_tried_again_later_and_not_at_every_tick() -> None:
    bench = Bench(home=HomeStays(HOME_M, CHARGED_AT_HOME, ()), agents=1)
    bench.told.say(1, 0, State.ACTIVE, 0.9)
    bench.mission.battery_heard(0.1)
    bench.tick()
    bench.orders = [go_to_ordered(bench)]
    bench.fail("refused")
    bench.tick()
    assert bench.mission.state.phase is Phase.IDLE
    bench.tick(seconds=round(MISSION.silence_timeout_s))
    assert bench.mission.state.phase is Phase.GO_HOME


def test_a_resumed_mission_goes_on_with_its_way_home() -> None:
    bench = Bench(state=MissionState(phase=Phase.AT_HOME), home=HomeStays(HOME_M, CHARGED_AT_HOME, ()))
    bench.mission.battery_heard(0.5)
    bench.tick()
    come_home(bench)


END = KnownEnd(end_s=1000.0, drain_per_s=0.001)
"""A whole battery lasts for 1000 s, so the charge that lasts until the end falls from 1 at the start by 0.001 a second."""


def test_who_lasts_until_a_known_end_is_not_collected() -> None:
    for charge, is_collected in ((0.39, True), (0.41, False)):
        bench = Bench(config=replace(MISSION, batch=1), known_end=END)
        bench.told.say(tuple(bench.told), 0, State.ACTIVE, 0.9)
        bench.told.say(2, 0, State.ACTIVE, charge)
        bench.tick(600)
        assert [step.agent_id for step in bench.mission.state.plan] == ([2] if is_collected else [])


def test_who_was_charged_for_the_time_that_is_left_is_released_and_its_service_counts() -> None:
    bench = one_by_one(config=replace(MISSION, batch=1), known_end=END)
    bench.told.say(1, bench.now_ms, State.CHARGING, 0.79)
    bench.tick(200 - bench.now_ms // 1000)
    assert bench.mission.state.phase is Phase.CHARGE
    bench.hears(1, State.CHARGING, 0.81)
    assert [(step.kind, step.agent_id) for step in bench.mission.state.plan] == [(StepKind.DEPLOY, 1)]
    bench.release()
    assert bench.mission.state.services == 1 and bench.mission.state.failed_tries == ()


def test_nobody_is_collected_for_less_charge_than_a_service_is_worth() -> None:
    for left_s, is_collected in ((201, True), (199, False)):
        bench = Bench(config=replace(MISSION, batch=1), known_end=END)
        bench.told.say(tuple(bench.told), 0, State.ACTIVE, 0.1)
        bench.tick(1000 - left_s)
        assert bool(bench.mission.state.plan) is is_collected


def test_a_known_end_raises_no_threshold() -> None:
    """While all of a battery's charge may be needed, the scenario's thresholds hold."""
    rules = replace(MISSION, pool_threshold=0.5, charge_to=0.7, full_threshold=0.9)
    assert END.rules(rules, 50_000) == rules
    later = END.rules(rules, 400_000)
    assert (later.pool_threshold, later.charge_to, later.full_threshold) == (0.5, 0.6, 0.6)
    assert END.rules(rules, 1_200_000).full_threshold == 0.0


def test_rules_that_change_in_flight_may_forget_the_end() -> None:
    bench = Bench(config=replace(MISSION, batch=1), known_end=END)
    bench.told.say(tuple(bench.told), 0, State.ACTIVE, 0.45)
    bench.tick(600)
    assert bench.mission.state.plan == ()
    bench.mission.change_planning(rules(registry.collection("cautious"), replace(MISSION, batch=1)))
    bench.tick()
    assert len(bench.mission.state.plan) == 1


def exchanging(**changes: Any) -> Bench:
    """A mission that has 1 and 2 in its docks; 3 and 4 wait with less charge."""
    bench = Bench(
        agents=4, config=replace(MISSION, batch=2, charge_to=0.9, places=Places.EXCHANGED, **changes)
    )
    bench.hears((3, 4), State.ACTIVE, 0.95)
    bench.collect(1)
    bench.collect(2)
    for agent_id, charge in ((3, 0.5), (4, 0.4)):
        bench.told.say(agent_id, bench.now_ms, State.ACTIVE, charge)
    for agent_id, charge in ((1, 0.92), (2, 0.95)):
        bench.told.say(agent_id, bench.now_ms, State.CHARGING, charge)
    return bench


def steps_left(bench: Bench) -> list[tuple[StepKind, int, int]]:
    return [(it.kind, it.agent_id, it.dock_index) for it in bench.mission.state.plan]


@pytest.fixture
def exchange() -> Bench:
    return exchanging()


def test_charged_ones_take_the_places_of_those_that_are_collected(exchange: Bench) -> None:
    """The fullest leaves first, and the lowest of the pool is collected first (Cautious)."""
    exchange.tick()
    assert steps_left(exchange) == [
        *((StepKind.COLLECT, 4, 2), (StepKind.DEPLOY, 2, 1)),
        *((StepKind.COLLECT, 3, 3), (StepKind.DEPLOY, 1, 0)),
    ]
    (note,) = exchange.notes("plan")
    assert note["exchanged"] == [{"released": 2, "collected": 4}, {"released": 1, "collected": 3}]
    exchange.collect(4)
    assert isinstance(exchange.primitive(), GoTo)
    there = exchange.succeed()
    assert isinstance(there, GoTo) and (there.north_m, there.east_m) == (40.0, 0.0)
    assert isinstance(exchange.succeed(), OpenDock) and SendCommand(Kind.RELEASE, 2) in exchange.orders
    assert exchange.mission.docks == (1, None, 4, None)
    assert homes_of(exchange) == {1: 30.0, 2: 40.0, 3: 10.0, 4: 20.0}


def plan_one_by_one(bench: Bench, *charges: float, **changes: Any) -> dict[str, Any]:
    """The plan, the nearest first, where 1 and 2 charge, 3 and 4 are in the water, and have these charges."""
    config = replace(bench.config, dispatch=Dispatch.ASYNCHRONOUS, **changes)
    bench.mission.change_planning(rules(registry.collection("greedy"), config))
    states = (State.CHARGING, State.CHARGING, State.ACTIVE, State.ACTIVE)
    for agent_id, (state, charge) in enumerate(zip(states, charges, strict=True), start=1):
        bench.told.say(agent_id, bench.now_ms, state, charge)
    bench.tick()
    (note,) = bench.notes("plan")
    return note


def test_a_partly_charged_one_takes_the_place_of_one_that_it_leads_and_not_of_a_neighbour() -> None:
    """By hand: 1 has 0.60 and leads 4 (0.10) by 0.50. It leads 3, which is nearer, by 0.10 alone."""
    note = plan_one_by_one(exchanging(), 0.6, 0.3, 0.5, 0.1, charge_to=None, charge_lead=0.45)
    assert note["exchanged"] == [{"released": 1, "collected": 4}]


@pytest.mark.parametrize(
    ("charge", "what", "other"), [(0.65, "redeploy", 2), (1.0, "collect", 3)], ids=["partly", "full"]
)
def test_one_that_makes_room_takes_the_place_of_a_fuller_one_only_when_it_is_full(
    charge: float, what: str, other: int
) -> None:
    """Else it takes that of 2, which is in a dock: the aPad is there."""
    note = plan_one_by_one(exchanging(), charge, 0.3, 0.7, 0.75, charge_to=0.6)
    assert note["what"] == what and note["exchanged"] == [{"released": 1, "collected": other}]


def test_one_for_whom_nobody_waits_is_released_at_the_nearest_empty_place(exchange: Bench) -> None:
    """The aPad is at 20 m, where 2 was collected. 1 has its home at 10 m."""
    assert exchange.mission.pose == (20.0, 0.0)
    note = plan_one_by_one(exchange, 1.0, 0.3, 0.99, 0.99)
    assert note["what"] == "redeploy" and note["exchanged"] == [{"released": 1, "collected": 2}]
    there = exchange.release(0.95)
    assert (there.north_m, there.east_m) == (20.0, 0.0)
    assert homes_of(exchange) == {1: 20.0, 2: 10.0, 3: 30.0, 4: 40.0}


def test_nobody_takes_a_place_to_which_the_sea_bars_the_way(exchange: Bench) -> None:
    exchange.mission._reach.beyond = {2: "a current"}
    note = plan_one_by_one(exchange, 1.0, 0.3, 0.99, 0.99)
    assert note["what"] == "redeploy" and "exchanged" not in note
    assert homes_of(exchange)[1] == 10.0


def test_with_own_places_it_goes_to_its_own() -> None:
    note = plan_one_by_one(exchanging(), 1.0, 0.3, 0.99, 0.99, places=Places.OWN)
    assert note["what"] == "redeploy" and "exchanged" not in note


def test_a_tour_that_is_resumed_after_every_step_is_flown_to_its_end() -> None:
    bench = exchanging()
    bench.tick()
    for step in bench.mission.state.plan:
        told, now_ms, place = bench.told, bench.now_ms, bench.mission.pose
        assert place is not None
        state = journaled(bench.mission.state)
        bench = Bench(agents=0, state=state, place=place, config=bench.config)
        bench.told.update(told)
        bench.now_ms = now_ms
        bench.tick()
        if step.kind is StepKind.COLLECT:
            bench.collect(step.agent_id)
        else:
            bench.release()
            bench.told.say(step.agent_id, bench.now_ms, State.ACTIVE, 0.99)
    assert bench.mission.state.phase is Phase.CHARGE
    assert {it for it in bench.mission.docks if it} == {3, 4}
    assert homes_of(bench) == {1: 30.0, 2: 40.0, 3: 10.0, 4: 20.0}


def homes_of(bench: Bench) -> dict[int, float]:
    return {agent_id: north_m for agent_id, north_m, _ in bench.mission.state.homes}


def told_exchanges(bench: Bench) -> list[tuple[int, int, str]]:
    return [
        (it["released"], it["collected"], it["phase"])
        for it in (event.data for event in bench.events if event.kind == "exchange")
    ]


def test_an_exchange_whose_partner_is_not_collected_is_undone_while_the_other_one_is_aboard(
    exchange: Bench,
) -> None:
    """A free dock takes 4 before 2 leaves. 4 is not reached, so 2 goes to its own place; 3 and 1 exchange as planned."""
    exchange.tick()
    exchange.fail("the way is barred")
    assert told_exchanges(exchange) == [(2, 4, "undone")]
    assert exchange.release(0.95).north_m == 20.0
    exchange.collect(3)
    assert exchange.release(0.95).north_m == 30.0
    assert homes_of(exchange) == {1: 30.0, 2: 20.0, 3: 10.0, 4: 40.0}
    assert exchange.mission.state.exchanged == ()


def half_done() -> Bench:
    """No dock is free, so 2 leaves before 4 is collected, which then fails: both are at one place."""
    bench = exchanging(collection_attempts=2)
    bench.mission.set(dock_count=2)
    bench.tick()
    bench.release(0.95)
    bench.fail("the way is barred")
    assert told_exchanges(bench) == [(2, 4, "half done")]
    assert homes_of(bench) == {1: 30.0, 2: 40.0, 3: 10.0, 4: 20.0}
    assert bench.release(0.95).north_m == 30.0
    bench.collect(3)
    return bench


def test_an_exchange_that_is_half_done_is_finished_when_the_missing_one_is_collected_after_all() -> None:
    bench = half_done()
    bench.told.say(3, bench.now_ms, State.CHARGING, 1.0)
    bench.tick(200)
    bench.release(0.95)
    bench.hears(1, State.ACTIVE, 0.5, 30.0, 0.0)
    bench.collect(4)
    assert told_exchanges(bench) == [(2, 4, "half done"), (2, 4, "finished")]
    assert homes_of(bench)[4] == 20.0 and bench.mission.state.exchanged == ()


def test_an_exchange_that_is_half_done_is_undone_when_the_other_one_is_aboard_again() -> None:
    bench = half_done()
    bench.hears(3, State.CHARGING, 1.0)
    bench.release(0.95)
    bench.told.say(4, bench.now_ms, State.ACTIVE, 0.95)
    bench.hears((1, 2), State.ACTIVE, 0.5)
    bench.collect(1)
    bench.collect(2)
    assert told_exchanges(bench)[-1] == (2, 4, "undone")
    assert homes_of(bench)[2] == 20.0 and homes_of(bench)[4] == 40.0


def test_an_exchange_that_is_half_done_outlives_a_resume_and_is_told_once() -> None:
    bench = half_done()
    state = journaled(bench.mission.state)
    assert state.exchanged == ((2, 4, ExchangePhase.HALF_DONE),)
    bench = Bench(agents=4, state=state, config=bench.config)
    bench.tick()
    assert told_exchanges(bench) == [] and bench.mission.state.exchanged == state.exchanged


@settings(max_examples=200, deadline=None)
@given(st.data(), st.integers(2, 4))
def test_no_two_are_left_at_one_place_without_a_word(data: st.DataObject, dock_count: int) -> None:
    """Whatever go-to, docking or undocking fails: a place that two have, and one that is empty, are of a told exchange."""
    bench = exchanging(collection_attempts=2)
    bench.mission.set(dock_count=dock_count)
    bench.tick()
    place = {3: 30.0, 4: 40.0}
    while bench.mission.state.plan:
        step = bench.mission.state.plan[0]
        if bench.mission.state.phase is not Phase.AWAIT_SURFACING and data.draw(st.integers(0, 3)) == 0:
            bench.fail("bad luck")
        elif bench.mission.state.phase is Phase.GO_COLLECT:
            bench.succeed()
            bench.hears(step.agent_id, State.FLOATING, 0.4)
        elif bench.mission.state.phase is Phase.AWAIT_SURFACING:
            bench.tick()
        else:
            done = bench.succeed()
            if isinstance(done, CloseDock):
                del place[step.agent_id]
            if isinstance(done, OpenDock):
                place[step.agent_id] = bench.mission.pose[0]
    homes, open_ones = homes_of(bench), {it[:2] for it in bench.mission.state.exchanged}
    assert sorted(homes.values()) == [10.0, 20.0, 30.0, 40.0]
    told = {it[:2] for it in told_exchanges(bench) if it[2] == "half done"}
    shared = {
        (a, b) for a in place for b in place if a != b and place[a] == place[b] and homes[a] == place[a]
    }
    assert shared == open_ones and open_ones <= told
    assert {it for it in place if place[it] != homes[it]} == {collected for _, collected in open_ones}


def test_who_waits_alone_is_no_batch_and_exchanges_with_nobody(exchange: Bench) -> None:
    for agent_id, state, charge in ((3, State.ACTIVE, 0.95), (1, State.CHARGING, 1), (2, State.CHARGING, 1)):
        exchange.told.say(agent_id, exchange.now_ms, state, charge)
    exchange.tick()
    assert [it[0] for it in steps_left(exchange)] == [StepKind.DEPLOY, StepKind.DEPLOY]
    assert homes_of(exchange)[1] == 10.0


@pytest.mark.parametrize("free_docks", [1, 0])
def test_a_dock_that_does_not_open_leaves_its_place_to_another_dock(free_docks: int) -> None:
    """The next collection was to fill it. Without any free dock that step is given up, and is no failed try."""
    bench = exchanging()
    state = replace(
        bench.mission.state,
        docked=((0, 1), (1, 2), *((index, 9 + index) for index in range(2, 4 - free_docks))),
        plan=(Step(StepKind.DEPLOY, 2, 1), Step(StepKind.COLLECT, 4, 1), Step(StepKind.DEPLOY, 1, 0)),
        phase=Phase.UNDOCK,
    )
    bench = Bench(agents=4, config=replace(MISSION, batch=2, places=Places.EXCHANGED), state=state)
    bench.tick()
    bench.succeed()
    bench.fail("it is stuck")
    if free_docks:
        assert steps_left(bench) == [(StepKind.COLLECT, 4, 3), (StepKind.DEPLOY, 1, 0)]
    else:
        assert steps_left(bench) == [(StepKind.DEPLOY, 1, 0)]
        assert [it["reason"] for it in bench.notes("given_up")] == ["it is stuck", "no dock is free"]
    assert bench.mission.state.failed_tries == ()


def test_the_rest_of_a_tour_with_releases_is_not_planned_anew() -> None:
    bench = Bench(collection="njnp", config=replace(MISSION, places=Places.EXCHANGED))
    steps = (Step(StepKind.COLLECT, 4, 3), Step(StepKind.DEPLOY, 1, 0), Step(StepKind.COLLECT, 3, 0))
    state = replace(bench.mission.state, docked=((0, 1),), plan=steps, phase=Phase.GO_COLLECT)
    bench = Bench(collection="njnp", config=replace(MISSION, places=Places.EXCHANGED), state=state)
    bench.tick()
    bench.collect(4)
    assert bench.mission.state.plan == steps[1:]


def test_an_aMussel_that_another_aPad_may_dock_is_not_collected() -> None:
    bench = Bench(agents=5)
    bench.barred = frozenset({1})
    bench.tick()
    assert [step.agent_id for step in bench.mission.state.plan] == [2, 3, 4, 5]


def test_it_leaves_an_aMussel_that_another_aPad_may_dock_now_and_calls_up_no_such_one() -> None:
    """Of four, the first is left on the way, and the second with it; the third is left where it is waited for."""
    bench = Bench()
    bench.tick()
    first, second, third, fourth = (step.agent_id for step in bench.mission.state.plan)
    bench.barred = frozenset({first, second})
    bench.tick()
    assert [it["agent"] for it in bench.notes("given_up")] == [first]
    assert [it.agent_id for it in bench.orders if isinstance(it, PermitSurfacing)] == [third]
    bench.succeed()
    bench.barred = frozenset({third})
    bench.hears(third, State.FLOATING, 0.5)
    assert not any(isinstance(it, CloseDock) for it in bench.orders)
    assert [it.agent_id for it in bench.orders if isinstance(it, PermitSurfacing)] == [fourth]


def test_it_ends_a_search_for_an_aMussel_that_another_aPad_may_dock(bench: Bench) -> None:
    bench.tick()
    float_beside_the_apad(bench)
    bench.barred = frozenset({1})
    bench.tick()
    assert bench.notes("given_up") == []  # a mechanism that moves is not stopped
    bench.orders = [
        *bench.mission.receive(NothingCaught(bench.now_ms, bench.mission.state.primitive_id), bench.now_ms)
    ]
    assert isinstance(bench.primitive(), GoTo)
    bench.tick()
    assert [it["agent"] for it in bench.notes("given_up")] == [1]
    assert bench.mission.state.plan[0].agent_id != 1
