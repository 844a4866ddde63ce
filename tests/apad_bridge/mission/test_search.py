"""The search for an aMussel that the catch radius does not hold: by the mission, by hand, and its spiral."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest
from flying import Flying
from scenario_files import POOL_FILE, SOUND_FILE

from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.docking.docking_routine import DockingRoutine, DockingStep, Progress
from apad_bridge.mission.docking.docking_search import SEARCH_S, square_spiral
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import CloseDock, GoTo, Primitive
from apad_bridge.vehicle.outcomes import NothingCaught, PrimitiveFailed, PrimitiveSucceeded
from firmware_model.states import State

RADIUS_M = 0.5
LEG_MS = 2000
_POOL = load(POOL_FILE).mission
MISSION = replace(_POOL, docking=replace(_POOL.docking, catch_radius_m=RADIUS_M))


def test_the_spiral_visits_each_point_once_and_moves_by_one_at_a_time() -> None:
    points = list(itertools.islice(square_spiral(), 49))
    assert set(points) == set(itertools.product(range(-3, 4), repeat=2))
    assert all(math.dist(a, b) == 1 for a, b in itertools.pairwise(points))


class World:
    """An aMussel that floats somewhere, and what the aPad was last told of it."""

    def __init__(self, floats_at: tuple[float, float], believed_at: tuple[float, float] = (0.0, 0.0)) -> None:
        self.floats_at = floats_at
        self.beliefs: dict[int, Belief] = {}
        self.now_ms = 0
        self.hear(believed_at)
        self.book = OrderBook(MissionState())
        self.book.moved(*believed_at)
        self.routine = DockingRoutine(MISSION, self, self.book, 1.0)
        self.tried: list[tuple[float, float]] = []

    def get(self, agent_id: int) -> Belief | None:
        return self.beliefs.get(agent_id)

    def all(self) -> list[Belief]:
        return list(self.beliefs.values())

    def hear(self, place: tuple[float, float], state: State = State.FLOATING) -> None:
        self.beliefs[7] = Belief(7, self.now_ms, state, 0.5, 1.0, *place)

    def order(self) -> Primitive:
        (order,) = [order for order in self.book.take_orders() if isinstance(order, Primitive)]
        return order

    def begin(self) -> None:
        self.routine.dock(0, 7, self.now_ms)
        assert self.book.pose is not None
        assert self.routine.advance(self.book.pose, self.now_ms) is DockingStep.CLOSE

    def carry_out(self) -> Progress:
        """Carries the order out, as port and vehicle do."""
        order = self.order()
        if isinstance(order, GoTo):
            self.now_ms += LEG_MS
            self.book.moved(order.north_m, order.east_m)
            return self.routine.receive(PrimitiveSucceeded(self.now_ms, order.command_id), self.now_ms)
        assert isinstance(order, CloseDock) and self.book.pose is not None
        self.tried.append(self.book.pose)
        caught = math.dist(self.book.pose, self.floats_at) <= RADIUS_M
        ended = PrimitiveSucceeded if caught else NothingCaught
        return self.routine.receive(ended(self.now_ms, order.command_id), self.now_ms)

    def run(self) -> Progress:
        progress = Progress.GOES_ON
        while progress is Progress.GOES_ON:
            progress = self.carry_out()
        return progress


@pytest.mark.parametrize("bearing_deg", range(0, 360, 15))
@pytest.mark.parametrize("away_m", [0.0, 0.6, 1.2])
def test_one_that_floats_near_its_believed_place_is_found(bearing_deg: int, away_m: float) -> None:
    bearing = math.radians(bearing_deg)
    world = World((away_m * math.cos(bearing), away_m * math.sin(bearing)))
    world.begin()
    assert world.run() is Progress.ENDED
    assert len(world.tried) == 1 or away_m > 0
    assert not world.routine.is_on_search


def test_a_search_ends_after_its_time() -> None:
    world = World((50.0, 50.0))
    world.begin()
    assert world.run() is Progress.NOT_FOUND
    assert SEARCH_S * 1000 <= world.now_ms < SEARCH_S * 1000 + LEG_MS
    assert len(set(world.tried)) == len(world.tried) == SEARCH_S * 1000 / LEG_MS + 1
    # Another docking begins a search of its own.
    world.book.moved(0.0, 0.0)
    world.begin()
    assert world.carry_out() is Progress.GOES_ON


def test_a_report_from_elsewhere_moves_the_search_there_and_one_that_sinks_ends_it() -> None:
    world = World((6.0, 0.0))
    world.begin()
    world.carry_out()
    world.now_ms += 1
    world.hear((6.2, 0.0))
    world.carry_out()  # the go-to that was under way
    world.carry_out()
    assert world.run() is Progress.ENDED
    assert (world.tried[-1], len(world.tried)) == ((6.2, 0.0), 3)
    sinking = World((6.0, 0.0))
    sinking.begin()
    sinking.hear((0.0, 0.0), State.SINKING)
    assert sinking.run() is Progress.NOT_FOUND


@pytest.mark.parametrize("pre_empted", [False, True])
def test_a_search_that_cannot_go_on_ends_with_its_go_to(pre_empted: bool) -> None:
    world = World((6.0, 0.0))
    world.begin()
    world.carry_out()
    failed = PrimitiveFailed(world.now_ms, world.order().command_id, "stalled")
    if pre_empted:
        assert world.routine.pre_empt()
    else:
        assert world.routine.receive(failed, world.now_ms) is Progress.ENDED
    assert not world.routine.is_on_search
    succeeded = PrimitiveSucceeded(world.now_ms, failed.primitive_id)
    assert [world.routine.receive(it, world.now_ms) for it in (failed, succeeded)] == [Progress.NOT_OURS] * 2
    assert world.book.take_orders() == []


def test_each_leg_of_a_search_is_in_the_newest_snapshot() -> None:
    """A supervisor that dies in a search is followed by one that knows the snapshot alone."""
    flying = Flying(load(SOUND_FILE))
    flying.until(lambda: any(it["phase"] == "nothing_caught" for it in flying.events("primitive")), 6000)
    planned_m = sum(it["metres"] for it in flying.events("leg"))
    snapshot = flying.events("mission")[-1]["snapshot"]
    assert snapshot["planned_m"] == pytest.approx(planned_m, abs=0.001)
    assert snapshot["primitive_id"] == flying.flight.supervisor.mission.state.primitive_id
