"""The energy-exchange mission, with beliefs and port answers set by the test.

Its stories are transcripts: each line has what the test does, and behind the bar all that the mission orders and tells in
answer. A primitive of it is under way until a line lets it end.
"""

import ast
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from flying import journaled, play
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionChanged, MissionEnd, MissionState, Phase
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.end_by import KnownEnd
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.going_home import NO_HOME, HomeStays
from apad_bridge.mission.orders import Order, PermitSurfacing, SendCommand
from apad_bridge.mission.policy.planner import PlanRules
from apad_bridge.planning import registry
from apad_bridge.planning.dispatch_rule import Dispatch, Places
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import CollectionStrategy
from apad_bridge.scenario.blocks.mission_options import Mission as MissionConfig
from apad_bridge.scenario.blocks.mission_options import Suspects
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import DockedAtHome, Home, Unavailable
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, OpenDock, Primitive
from apad_bridge.vehicle.outcomes import (
    DockChanged,
    NothingCaught,
    PrimitiveFailed,
    PrimitiveSucceeded,
    after_report,
)
from firmware_model.states import State

MISSION = load(POOL_FILE).mission


class Told(dict[int, Belief]):
    """Beliefs that the test sets."""

    def all(self) -> list[Belief]:
        return [self[agent_id] for agent_id in sorted(self)]

    def say(self, agent_id: int, now_ms: int, state: State, charge: float, *place: float) -> None:
        before = self.get(agent_id)
        where = place or ((before.north_m, before.east_m) if before else (10.0 * agent_id, 0.0))
        self[agent_id] = Belief(agent_id, now_ms, state, charge, 1.0, where[0], where[1])


def rules(
    collection: CollectionStrategy, config: MissionConfig = MISSION, known_end: KnownEnd | None = None
) -> PlanRules:
    return PlanRules(config, collection, registry.redeployment("greedy-redeploy"), known_end=known_end)


def word(order: Order) -> str | None:
    """An order or event of a transcript; None for what it leaves out."""
    match order:
        case GoTo():
            return f"go {order.north_m:g},{order.east_m:g}"
        case Hold():
            return "hold"
        case CloseDock():
            return f"dock {order.agent_id} in {order.dock_index}"
        case OpenDock():
            return f"undock {order.agent_id}"
        case PermitSurfacing():
            return f"call {order.agent_id}"
        case SendCommand():
            return f"{order.kind.name.lower()} {order.agent_id}"
        case Event(kind="plan", data=data):
            steps = " ".join(str(it["agent"]) for it in data["steps"])
            pairs = "".join(f", {it['released']} for {it['collected']}" for it in data.get("exchanged") or ())
            return f"plan {data['what']} {steps}{pairs}"
        case Event(kind="mission" | "leg" | "dock"):
            return None
        case Event():
            return ": ".join((order.kind, *map(str, order.data.values())))
    return str(order)


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
        self.config, self.home = config, home
        self.rules = rules(registry.collection(collection), config, known_end)
        self.now_ms = 0
        self.orders: list[Order] = []
        """What the mission ordered and told in answer to the newest move."""
        self.primitive: Primitive = Hold(0, 0.0, 0.0)
        """The one ordered last."""
        self.begin(state, place)
        for agent_id in range(1, agents + 1):
            self.told.say(agent_id, 0, State.ACTIVE, 0.5 + agent_id / 100)

    def begin(self, state: MissionState | None, place: tuple[float, float]) -> None:
        self.mission = EnergyExchange(self.rules, self.told, state, self.home, barred=lambda: self.barred)
        self.mission.moved(*place)

    def take(self, orders: list[Order]) -> None:
        self.orders += orders
        for it in orders:
            self.primitive = it if isinstance(it, Primitive) else self.primitive

    # Moves.

    def tick(self, seconds: float = 1) -> None:
        """One tick after so many seconds, with every aMussel heard again in its old state."""
        self.now_ms += round(1000 * seconds)
        for agent_id, belief in self.told.items():
            self.told[agent_id] = replace(belief, heard_ms=self.now_ms)
        self.take(self.mission.advance(self.now_ms))

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    def say(self, agent_id: int, state: str, charge: float, *place: float) -> None:
        """What is heard of an aMussel, before the next tick."""
        self.told.say(agent_id, self.now_ms, State[state.upper()], charge, *place)

    def hear(self, agent_id: int, state: str, charge: float, *place: float) -> None:
        self.say(agent_id, state, charge, *place)
        self.tick()

    def ok(self) -> None:
        """The primitive under way succeeds."""
        done = self.primitive
        if isinstance(done, GoTo):
            self.mission.moved(done.north_m, done.east_m)
        if isinstance(done, CloseDock | OpenDock):
            (self.closes if isinstance(done, CloseDock) else self.opens)(done.dock_index, done.agent_id)
        self.take(self.mission.receive(PrimitiveSucceeded(self.now_ms, done.command_id), self.now_ms))

    def fail(self, reason: str) -> None:
        failed = PrimitiveFailed(self.now_ms, self.primitive.command_id, reason)
        self.take(self.mission.receive(failed, self.now_ms))

    def closes(self, dock_index: int, agent_id: int, closed: bool = True) -> None:
        """A dock closes, by an order or by hand."""
        docked = after_report(self.mission.state.docked, dock_index, agent_id, closed=closed)
        changed = DockChanged(self.now_ms, dock_index, agent_id, closed, docked)
        self.take(self.mission.receive(changed, self.now_ms))

    def opens(self, dock_index: int, agent_id: int) -> None:
        self.closes(dock_index, agent_id, closed=False)

    def collect(self, agent_id: int) -> None:
        """From the go-to under way to the docked aMussel; the answer is that to the docking."""
        self.ok()
        self.hear(agent_id, "floating", self.told[agent_id].primary)
        self.orders = []
        self.ok()
        self.say(agent_id, "charging", self.told[agent_id].primary)

    def release(self, agent_id: int, charge: float) -> None:
        """From the go-to under way to the aMussel that was let go, and then sinks with a charge."""
        self.ok()
        self.ok()
        self.say(agent_id, "active", charge, *self.mission.pose)

    def move(self, text: str) -> str:
        """One line's move, and the answer. A move that is none of the bench's own is a fact of the mission's state."""
        name, *words = text.split()
        if name == "plan":
            return ", ".join(
                f"{it.kind.value} {it.agent_id} in {it.dock_index}" for it in self.mission.state.plan
            )
        if not hasattr(self, name) and name not in MOVES:
            return str(getattr(self.mission.state, name))
        self.orders, before = [], self.mission.state.phase
        if name == "fail":
            self.fail(" ".join(words))
        else:
            given = dict(it.split("=") for it in words if "=" in it)
            (partial(MOVES[name], self) if name in MOVES else getattr(self, name))(
                *(value(it) for it in words if "=" not in it), **{k: value(v) for k, v in given.items()}
            )
        answer = [it for order in self.orders if (it := word(order)) is not None]
        after = self.mission.state.phase
        return "; ".join(answer + [f"[{after.value}]"] * (after is not before))


MOVES: dict[str, Callable[..., object]] = {
    "suspect": lambda bench, agent_id, was_docked: bench.told.update(
        {agent_id: replace(bench.told[agent_id], suspicion=Suspicion("its charge jumps", was_docked))}
    ),
    "miss": lambda bench: bench.take(
        bench.mission.receive(NothingCaught(bench.now_ms, bench.primitive.command_id), bench.now_ms)
    ),
    "late": lambda bench: bench.take(
        bench.mission.receive(PrimitiveSucceeded(bench.now_ms, bench.primitive.command_id - 1), bench.now_ms)
    ),
    "end": lambda bench: bench.take(bench.mission.end(MissionEnd(EndReason.OPERATOR), bench.now_ms)),
    "moved": lambda bench, *place_m: bench.mission.moved(*place_m),
    "later": lambda bench, seconds: setattr(bench, "now_ms", bench.now_ms + round(1000 * seconds)),
    "docks": lambda bench, count: bench.mission.set(dock_count=count),
    "bar": lambda bench, *agent_ids: setattr(bench, "barred", frozenset(agent_ids)),
    "bar_way": lambda bench, agent_id: setattr(bench.mission._reach, "beyond", {agent_id: "a current"}),
    "resume": lambda bench: bench.begin(journaled(bench.mission.state), bench.mission.pose),
    "plan_by": lambda bench, collection="cautious", **changes: bench.mission.change_planning(
        rules(registry.collection(collection), replace(bench.config, **changes))
    ),
    "battery": lambda bench, charge: bench.mission.battery_heard(charge),
    "forget": lambda bench: bench.told.clear(),
}
"""Moves that are one call. `miss` is a docking that catches nothing, and `late` an answer to an older primitive; `later`
lets time pass without a tick; another aPad may dock whom it bars now; after `resume` another supervisor goes on."""


def value(text: str) -> Any:
    """A word of a transcript as Python reads it, or the word itself."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


ONE_BY_ONE = replace(MISSION, dispatch=Dispatch.ASYNCHRONOUS)
BATCHES_OF_TWO = replace(MISSION, batch=2, charge_lead=0.25)
ONE = replace(MISSION, batch=1)
HOME_M = (5.0, 30.0)
CHARGED_AT_HOME = Home(charging_w=200.0, go_at=0.2, leave_at=0.9)
END = KnownEnd(end_s=1000.0, drain_per_s=0.001)
"""A whole battery lasts for 1000 s, so the charge that lasts until the end falls from 1 at the start by 0.001 a second."""


def played(story: str, bench: Bench | None = None, **setup: Any) -> Bench:
    bench = bench or Bench(**setup)
    play(story, bench.move)
    return bench


def full_docks() -> Bench:
    """All four are docked and charge."""
    return played(
        """
        tick      | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        collect 1 | go 20,0; call 2
        collect 2 | go 30,0; call 3
        collect 3 | go 40,0; call 4
        collect 4 | hold; [charging wait]
        """
    )


def half_a_round() -> Bench:
    """1 and 2 are docked, and the aPad goes to 3."""
    return played(
        """
        tick      | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        collect 1 | go 20,0; call 2
        collect 2 | go 30,0; call 3
        """
    )


def beside_one() -> Bench:
    """1 floats beside the aPad, which docks it; three others are in need."""
    return played(
        """
        tick                | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        ok                  | [await surfacing]
        hear 1 floating 0.5 | dock 1 in 0; [dock]
        """
    )


def one_docked(agents: int = 2, **changes: Any) -> Bench:
    """An aPad that collects one by one has docked 1; the others are above the pool's threshold."""
    bench = Bench(agents=agents, config=replace(ONE_BY_ONE, **changes))
    for agent_id in range(2, agents + 1):
        bench.say(agent_id, "active", 0.9)
    return played(
        """
        tick      | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1 | hold; [charging wait]
        tick      |
        """,
        bench,
    )


def four_docked(**changes: Any) -> Bench:
    """The same, with 2, 3 and 4 docked after 1, so that no dock is free."""
    bench = one_docked(agents=6, **changes)
    for agent_id in (2, 3, 4):
        bench.hear(agent_id, "active", 0.7)
        bench.collect(agent_id)
    return bench


def lets_go() -> Bench:
    """1, which was docked by hand and is believed full, is let go."""
    return played(
        """
        closes 2 1          |
        hear 1 charging 1.0 | hold; hold; [charging wait]
        tick                | plan redeploy 1; go 0,0; [go to deployment]
        ok                  | undock 1; [undock]
        """,
        agents=1,
    )


def exchanging(**changes: Any) -> Bench:
    """1 and 2 are docked and charged; 3 and 4 wait with less charge. Places are exchanged."""
    return played(
        """
        say 3 active 0.95   |
        hear 4 active 0.95  | hold; plan collect 1 2; go 10,0; call 1; [go to aMussel]
        collect 1           | go 20,0; call 2
        collect 2           | hold; [charging wait]
        say 1 charging 0.92 |
        say 2 charging 0.95 |
        say 3 active 0.5    |
        say 4 active 0.4    |
        """,
        config=replace(MISSION, batch=2, charge_to=0.9, places=Places.EXCHANGED, **changes),
    )


def half_exchanged() -> Bench:
    """No dock is free, so 2 leaves before 4 is collected, which then fails: both are at one place."""
    bench = exchanging(collection_attempts=2)
    return played(
        """
        docks 2                |
        tick                   | plan collect 4 3, 2 for 4, 1 for 3; go 40,0; [go to deployment]
        release 2 0.95         | undock 2; release 2; released: 2: True; go 40,0; call 4; [go to aMussel]
        fail the way is barred | given_up: 4: collect: the way is barred; exchange: 2: 4: half done;
                               | go 30,0; [go to deployment]
        homes                  | ((1, 30.0, 0.0), (2, 40.0, 0.0), (3, 10.0, 0.0), (4, 20.0, 0.0))
        release 1 0.95         | undock 1; release 1; released: 1: True; go 30,0; call 3; [go to aMussel]
        collect 3              | hold; [charging wait]
        """,
        bench,
    )


def at_home(docked: DockedAtHome) -> Bench:
    """It is unavailable from 20 s to 500 s, with 1 docked."""
    home = HomeStays(HOME_M, replace(CHARGED_AT_HOME, docked=docked), (Unavailable(from_s=20, until_s=500),))
    bench = Bench(agents=2, config=ONE_BY_ONE, home=home)
    bench.mission.battery_heard(1.0)
    return bench


def with_battery(battery: float, **setup: Any) -> Bench:
    bench = Bench(home=HomeStays(HOME_M, CHARGED_AT_HOME, ()), **setup)
    bench.mission.battery_heard(battery)
    return bench


STORIES: dict[str, tuple[Callable[[], Bench], str]] = {
    "it holds and waits until four are in the pool": (
        lambda: Bench(agents=5),
        """
        say 4 active 0.81 |
        hear 5 active 0.9 | hold
        ticks 5           |
        hear 4 active 0.8 | plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        """,
    ),
    "it goes to the lowest first, docks only what floats, and repeats the permission": (
        Bench,
        """
        tick                | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        cost_m              | 0.0
        planned_m           | 10.0
        ok                  | [await surfacing]
        cost_m              | 10.0
        planned_m           | 10.0
        ticks 9             |
        tick                | call 1
        hear 1 floating 0.5 | dock 1 in 0; [dock]
        """,
    ),
    "one that never answers is given up after six permissions and the next is collected": (
        Bench,
        """
        tick     | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        ok       | [await surfacing]
        ticks 58 | call 1; call 1; call 1; call 1; call 1
        ticks 2  | given_up: 1: collect: it does not answer the permission to surface; go 20,0; call 2;
                 | [go to aMussel]
        """,
    ),
    "a whole round charges all to more than 99 percent and brings them home, the nearest first": (
        full_docks,
        """
        say 1 charging 1.0    |
        say 2 charging 1.0    |
        say 3 charging 1.0    |
        hear 4 charging 0.99  |
        hear 4 charging 0.991 | plan redeploy 4 3 2 1; go 40,0; [go to deployment]
        release 4 1.0         | undock 4; release 4; released: 4: True; go 30,0
        release 3 1.0         | undock 3; release 3; released: 3: True; go 20,0
        release 2 1.0         | undock 2; release 2; released: 2: True; go 10,0
        release 1 1.0         | undock 1; release 1; released: 1: True; hold; [idle wait]
        services              | 4
        """,
    ),
    "a docked one whose charge does not rise is not waited for": (
        full_docks,
        """
        say 1 charging 1.0  |
        say 2 charging 1.0  |
        hear 3 charging 1.0 |
        tick 120            |
        tick 2              | given_up: 4: charge: its believed charge does not rise; plan redeploy 4 3 2 1;
                            | go 40,0; [go to deployment]
        """,
    ),
    "a failed go-to skips the step and says why": (
        Bench,
        """
        tick         | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        fail stalled | given_up: 1: collect: stalled; go 20,0; call 2
        """,
    ),
    "a leg that a resumed mission takes up is counted once": (
        Bench,
        """
        tick      | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        moved 4 0 |
        resume    |
        moved 6 0 |
        tick      | go 10,0; call 1
        ok        | [await surfacing]
        cost_m    | 10.0
        planned_m | 10.0
        """,
    ),
    "an aPad that does not get anywhere is said and nobody is left alone for it": (
        Bench,
        """
        tick 121     | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        fail stalled | given_up: 1: collect: stalled; go 20,0; call 2
        fail stalled | given_up: 2: collect: stalled; go 30,0; call 3
        fail stalled | given_up: 3: collect: stalled; go 40,0; call 4;
                     | stuck: 3 go-tos in a row failed: stalled
        fail stalled | given_up: 4: collect: stalled; hold; [idle wait]
        tick 121     | plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        fail stalled | given_up: 1: collect: stalled; go 20,0; call 2
        fail stalled | given_up: 2: collect: stalled; go 30,0; call 3;
                     | stuck: 6 go-tos in a row failed: stalled
        fail stalled | given_up: 3: collect: stalled; go 40,0; call 4
        fail stalled | given_up: 4: collect: stalled; hold; [idle wait]
        failed_tries | ((1, 1),)
        """,
    ),
    "a suspect with charge is fetched for a look, brought back and left in the water, and served as any other": (
        lambda: Bench(agents=2, config=replace(ONE, suspects=Suspects.FETCHED)),
        """
        say 1 active 0.95   |
        hear 2 active 0.95  | hold
        suspect 2 False     |
        tick                | plan collect 2; go 20,0; call 2; [go to aMussel]
        collect 2           | hold; [charging wait]
        suspect 2 True      |
        hear 2 charging 1.0 | plan redeploy 2; go 20,0; [go to deployment]
        release 2 1.0       | undock 2; release 2; released: 2: True; hold; [idle wait]
        suspect 2 True      |
        services            | 1
        tick                |
        tick 600            |
        say 2 active 0.5    |
        suspect 2 True      |
        tick                | plan collect 2; go 20,0; call 2; [go to aMussel]
        """,
    ),
    "one that is docked a second time, with less charge than it left with, is watched anew": (
        lambda: Bench(agents=1),
        """
        say 1 active 0.5      |
        tick 360              | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1             | hold; [charging wait]
        tick                  |
        hear 1 charging 0.995 | plan redeploy 1; go 10,0; [go to deployment]
        release 1 0.995       | undock 1; release 1; released: 1: True; hold; [idle wait]
        say 1 active 0.5      |
        tick 360              | plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1             | hold; [charging wait]
        tick                  |
        """,
    ),
    "a try that helps, full or not, forgets those that failed": (
        lambda: Bench(agents=1, state=MissionState(failed_tries=((1, 4), (7, 2)))),
        """
        tick                | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1           | hold; [charging wait]
        hear 1 charging 0.9 |
        tick 121            | given_up: 1: charge: its believed charge does not rise; plan redeploy 1;
                            | go 10,0; [go to deployment]
        release 1 0.9       | undock 1; release 1; released: 1: False; hold; [idle wait]
        failed_tries        | ((7, 2),)
        """,
    ),
    "one that floats away again and again is given up": (
        lambda: Bench(agents=1),
        """
        tick                     | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        ok                       | [await surfacing]
        hear 1 floating 0.5 15 0 | go 15,0; [go to aMussel]
        ok                       | [await surfacing]
        hear 1 floating 0.5 20 0 | go 20,0; [go to aMussel]
        ok                       | [await surfacing]
        hear 1 floating 0.5 25 0 | given_up: 1: collect: it still floats out of reach after 3 go-tos; hold;
                                 | release 1; [idle wait]
        """,
    ),
    "a docking that missed is tried again at once": (
        beside_one,
        """
        fail missed  | [await surfacing]
        tick         | dock 1 in 0; [dock]
        fail missed  | [await surfacing]
        tick         | dock 1 in 0; [dock]
        ok           | go 20,0; call 2; [go to aMussel]
        docked       | ((0, 1),)
        failed_tries | ()
        """,
    ),
    "one that the catch radius does not hold is searched for and docked": (
        beside_one,
        """
        miss   | go 13,0
        tick 2 |
        ok     | dock 1 in 0
        miss   | go 13,3
        tick 2 |
        ok     | dock 1 in 0
        miss   | go 10,3
        tick 2 |
        ok     | dock 1 in 0
        ok     | go 20,0; call 2; [go to aMussel]
        docked | ((0, 1),)
        """,
    ),
    "a search in vain is a failed docking": (
        beside_one,
        """
        miss                     | go 13,0
        later 120                |
        ok                       | dock 1 in 0
        miss                     | [await surfacing]
        hear 1 floating 0.5 13 0 | dock 1 in 0; [dock]
        miss                     | go 16,0
        later 120                |
        ok                       | dock 1 in 0
        miss                     | [await surfacing]
        hear 1 floating 0.5 16 0 | dock 1 in 0; [dock]
        miss                     | go 19,0
        later 120                |
        ok                       | dock 1 in 0
        miss                     |
                                 | given_up: 1: collect: it was not found within the catch radius in a search of 120 s;
                                 | go 20,0; call 2; [go to aMussel]
        failed_tries             | ((1, 1),)
        """,
    ),
    "an answer to a primitive that is over changes nothing": (
        Bench,
        """
        tick  | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        late  |
        phase | go to aMussel
        plan  | collect 1 in 0, collect 2 in 1, collect 3 in 2, collect 4 in 3
        """,
    ),
    "an ended mission searches no further": (
        beside_one,
        """
        miss | go 13,0
        end  | hold; [ended]
        ok   |
        """,
    ),
    "one that is left afloat is fetched next without a batch": (
        lambda: Bench(agents=1),
        """
        say 2 active 0.9    |
        tick                | hold
        hear 2 active 0.7   | plan collect 1 2; go 10,0; call 1; [go to aMussel]
        ok                  | [await surfacing]
        hear 1 floating 0.5 | dock 1 in 0; [dock]
        fail missed         | [await surfacing]
        tick                | dock 1 in 0; [dock]
        fail missed         | [await surfacing]
        tick                | dock 1 in 0; [dock]
        fail missed         | given_up: 1: collect: missed; go 20,0; call 2; [go to aMussel]
        collect 2           | hold; [charging wait]
        hear 2 charging 1.0 | plan redeploy 2; go 20,0; [go to deployment]
        release 2 1.0       | undock 2; release 2; released: 2: True; hold; [idle wait]
        tick                | plan collect 1; go 10,0; call 1; [go to aMussel]
        """,
    ),
    "an empty one that was missed is told to sink while others are collected": (
        beside_one,
        """
        say 1 floating 0.0 |
        fail missed        | [await surfacing]
        tick               | dock 1 in 0; [dock]
        fail missed        | [await surfacing]
        tick               | dock 1 in 0; [dock]
        fail missed        | given_up: 1: collect: missed; go 20,0; call 2; [go to aMussel]
        tick               | release 1
        """,
    ),
    "an aPad that cannot reach one that floats does not try at every tick": (
        lambda: Bench(agents=1),
        """
        hear 1 floating 0.5 | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        fail refused        | given_up: 1: collect: refused; hold; [idle wait]
        ticks 119           | release 1; release 1; release 1; release 1; release 1; release 1; release 1;
                            | release 1; release 1; release 1; release 1; release 1
        """,
    ),
    "what was docked by hand is charged first": (
        Bench,
        """
        closes 2 3 |
        tick       | hold; hold; [charging wait]
        """,
    ),
    "a stray at the surface is told that it may sink, and again after a while": (
        lambda: Bench(agents=3),
        """
        hear 2 floating 0.9 | hold; release 2
        tick                |
        tick 10             | release 2
        """,
    ),
    "it ends once and holds": (
        full_docks,
        """
        end        | hold; [ended]
        end_reason | the operator
        end        |
        tick       |
        """,
    ),
    "a resumed mission takes up the step under way: on the way": (
        half_a_round,
        """
        resume |
        tick   | go 30,0; call 3
        """,
    ),
    "a resumed mission takes up the step under way: beside it": (
        half_a_round,
        """
        ok     | [await surfacing]
        resume |
        tick   | go 30,0; call 3; [go to aMussel]
        """,
    ),
    "a resumed mission takes up the step under way: docking": (
        half_a_round,
        """
        ok                  | [await surfacing]
        hear 3 floating 0.5 | dock 3 in 2; [dock]
        resume              |
        tick                | go 30,0; call 3; [go to aMussel]
        """,
    ),
    "a resumed mission does not dock twice what the dock holds": (
        half_a_round,
        """
        ok                  | [await surfacing]
        hear 3 floating 0.5 | dock 3 in 2; [dock]
        closes 2 3          |
        resume              |
        tick                | go 40,0; call 4; [go to aMussel]
        """,
    ),
    "a resumed undocking is ordered again": (
        lets_go,
        """
        resume              |
        hear 1 charging 1.0 | go 0,0; [go to deployment]
        release 1 1.0       | undock 1; release 1; released: 1: True; hold; [idle wait]
        services            | 1
        """,
    ),
    "an undocking that ended without a supervisor is a service": (
        lets_go,
        """
        opens 2 1           |
        resume              |
        hear 1 floating 1.0 | release 1; released: 1: True; hold; release 1; [idle wait]
        services            | 1
        """,
    ),
    "a resumed charging wait gives nobody up before it was heard for long enough": (
        half_a_round,
        """
        fail stalled | given_up: 3: collect: stalled; go 40,0; call 4
        fail stalled | given_up: 4: collect: stalled; hold; [charging wait]
        phase        | charging wait
        forget       |
        resume       |
        tick 500     | hold
        tick 121     | given_up: 1: charge: its believed charge does not rise;
                     | given_up: 2: charge: its believed charge does not rise; plan redeploy 2 1; go 20,0;
                     | [go to deployment]
        """,
    ),
    "one docked by hand and never heard does not take a dock for ever": (
        lambda: Bench(agents=1),
        """
        closes 2 77 |
        tick        | hold; hold; [charging wait]
        tick 121    | given_up: 77: charge: its believed charge does not rise; plan redeploy 77; go 0,0;
                    | [go to deployment]
        ok          | undock 77; [undock]
        ok          | release 77; released: 77: False; hold; [idle wait]
        """,
    ),
    "a resumed step waits for its aMussel to be heard again": (
        half_a_round,
        """
        forget              |
        resume              |
        tick 500            |
        hear 3 floating 0.5 | go 30,0; call 3
        """,
    ),
    "a resumed step of one that stays silent is given up": (
        half_a_round,
        """
        forget   |
        resume   |
        tick     |
        tick 121 | given_up: 3: collect: it never reported; given_up: 4: collect: it never reported; hold;
                 | [charging wait]
        """,
    ),
    "a strategy that pre-empts takes a nearer request that came on the way: njnp": (
        lambda: Bench(agents=5, collection="njnp"),
        """
        hear 5 active 0.9 10 1 | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        ok                     | [await surfacing]
        say 5 active 0.7       |
        hear 1 floating 0.5    | dock 1 in 0; [dock]
        ok                     | plan collect 5 2 3; go 10,1; call 5; [go to aMussel]
        plan                   | collect 5 in 1, collect 2 in 2, collect 3 in 3
        """,
    ),
    "a strategy that pre-empts takes a nearer request that came on the way: greedy": (
        lambda: Bench(agents=5, collection="greedy"),
        """
        hear 5 active 0.9 10 1 | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        ok                     | [await surfacing]
        say 5 active 0.7       |
        hear 1 floating 0.5    | dock 1 in 0; [dock]
        ok                     | go 20,0; call 2; [go to aMussel]
        """,
    ),
    "an aMussel that was docked just now and was last heard afloat is not collected again": (
        one_docked,
        """
        hear 1 floating 0.51 |
        """,
    ),
    "one by one, it collects one beside one that charges and releases the full one alone": (
        one_docked,
        """
        hear 2 active 0.8    | plan collect 2; go 20,0; call 2; [go to aMussel]
        collect 2            | hold; [charging wait]
        say 1 charging 0.995 |
        hear 3 active 0.5    | plan redeploy 1; go 10,0; [go to deployment]
        release 1 0.995      | undock 1; release 1; released: 1: True; hold; [charging wait]
        services             | 1
        docked               | ((1, 2),)
        """,
    ),
    "a charged one makes room when another waits": (
        lambda: four_docked(charge_to=0.85),
        """
        hear 3 charging 0.9 |
        hear 5 active 0.7   | plan redeploy 3; go 30,0; [go to deployment]
        """,
    ),
    "without charge_to it is charged further": (
        four_docked,
        """
        hear 3 charging 0.9 |
        phase               | charging wait
        hear 5 active 0.7   |
        """,
    ),
    "one that leads the lowest of the pool by charge_lead makes room for it": (
        lambda: four_docked(charge_lead=0.25),
        """
        say 3 charging 0.75 |
        say 5 active 0.7    |
        hear 6 active 0.51  |
        hear 6 active 0.5   | plan redeploy 3; go 30,0; [go to deployment]
        """,
    ),
    "a batch makes room when each of it leads each of the lowest batch": (
        lambda: Bench(agents=5, config=BATCHES_OF_TWO),
        """
        say 3 active 0.9     |
        say 4 active 0.9     |
        hear 5 active 0.9    | hold; plan collect 1 2; go 10,0; call 1; [go to aMussel]
        collect 1            | go 20,0; call 2
        collect 2            | hold; [charging wait]
        say 1 charging 0.75  |
        say 2 charging 0.95  |
        hear 3 active 0.1    |
        say 5 active 0.79    |
        hear 4 active 0.51   |
        say 4 active 0.5     |
        hear 1 charging 0.74 |
        hear 1 charging 0.75 | plan redeploy 2 1; go 20,0; [go to deployment]
        """,
    ),
    "one by one, one whose charge does not rise is given up and released": (
        one_docked,
        """
        ticks 119 |
        ticks 2   | given_up: 1: charge: its believed charge does not rise; plan redeploy 1; go 10,0;
                  | [go to deployment]
        """,
    ),
    "it goes home to be charged before it takes up a plan and goes on when it is": (
        lambda: with_battery(0.2),
        """
        tick         | hold; go 5,30; [go home]
        ok           | hold; [at home]
        battery 0.89 |
        tick         |
        battery 0.9  |
        tick         | hold; [idle wait]
        tick         | plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        """,
    ),
    "docked ones come along": (
        lambda: at_home(DockedAtHome.CHARGE),
        """
        hear 2 active 0.9 | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1         | hold; [charging wait]
        tick 20           | go 5,30; [go home]
        ok                | hold; [at home]
        tick 400          |
        tick 100          | hold; [charging wait]
        """,
    ),
    "docked ones leave first": (
        lambda: at_home(DockedAtHome.RELEASED),
        """
        hear 2 active 0.9 | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1         | hold; [charging wait]
        tick 20           | plan redeploy 1; go 10,0; [go to deployment]
        release 1 0.6     | undock 1; release 1; released: 1: False; hold; [idle wait]
        tick              | go 5,30; [go home]
        ok                | hold; [at home]
        tick 400          |
        tick 100          | hold; [idle wait]
        """,
    ),
    "a way home that fails is tried again later and not at every tick": (
        lambda: with_battery(0.1, agents=1),
        """
        hear 1 active 0.9 | hold; go 5,30; [go home]
        fail refused      | hold; [idle wait]
        tick              |
        tick 120          | go 5,30; [go home]
        """,
    ),
    "a resumed mission goes on with its way home": (
        lambda: with_battery(0.5, state=MissionState(phase=Phase.AT_HOME)),
        """
        tick | go 5,30; [go home]
        ok   | hold; [at home]
        """,
    ),
    "who lasts until a known end is not collected, until rules that change in flight forget the end": (
        lambda: Bench(config=ONE, known_end=END, agents=2),
        """
        say 1 active 0.9  |
        say 2 active 0.41 |
        tick 600          | hold
        plan_by batch=1   |
        tick              | plan collect 2; go 20,0; call 2; [go to aMussel]
        """,
    ),
    "who does not last until a known end is collected": (
        lambda: Bench(config=ONE, known_end=END, agents=2),
        """
        say 1 active 0.9  |
        say 2 active 0.39 |
        tick 600          | hold; plan collect 2; go 20,0; call 2; [go to aMussel]
        """,
    ),
    "who was charged for the time that is left is released and its service counts": (
        lambda: Bench(config=ONE, known_end=END, agents=1),
        """
        tick                 | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1            | hold; [charging wait]
        say 1 charging 0.79  |
        tick 198             |
        hear 1 charging 0.81 | plan redeploy 1; go 10,0; [go to deployment]
        release 1 0.81       | undock 1; release 1; released: 1: True; hold; [idle wait]
        services             | 1
        failed_tries         | ()
        """,
    ),
    "somebody is collected for as much charge as a service is worth": (
        lambda: Bench(config=ONE, known_end=END, agents=1),
        """
        say 1 active 0.1 |
        tick 799         | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        """,
    ),
    "nobody is collected for less charge than a service is worth": (
        lambda: Bench(config=ONE, known_end=END, agents=1),
        """
        say 1 active 0.1 |
        tick 801         | hold
        """,
    ),
    "charged ones, the fullest first, take the places of those that are collected, the lowest first": (
        exchanging,
        """
        tick           | plan collect 4 3, 2 for 4, 1 for 3; go 40,0; call 4; [go to aMussel]
        plan           | collect 4 in 2, deploy 2 in 1, collect 3 in 3, deploy 1 in 0
        collect 4      | go 40,0; [go to deployment]
        release 2 0.95 | undock 2; release 2; released: 2: True; go 30,0; call 3; [go to aMussel]
        docked         | ((0, 1), (2, 4))
        homes          | ((1, 30.0, 0.0), (2, 40.0, 0.0), (3, 10.0, 0.0), (4, 20.0, 0.0))
        """,
    ),
    # By hand: 1 has 0.60 and leads 4 (0.10) by 0.50. It leads 3, which is nearer, by 0.10 alone.
    "a partly charged one takes the place of one that it leads and not of a neighbour": (
        exchanging,
        """
        plan_by greedy dispatch=asynchronous charge_to=None charge_lead=0.45 |
        say 1 charging 0.6                                                   |
        say 2 charging 0.3                                                   |
        say 3 active 0.5                                                     |
        hear 4 active 0.1                                                    | plan collect 4, 1 for 4;
                                                                             | go 40,0; call 4;
                                                                             | [go to aMussel]
        """,
    ),
    "a partly charged one takes the place of one in a dock, where the aPad is, and not of a fuller one": (
        exchanging,
        """
        plan_by greedy dispatch=asynchronous charge_to=0.6 |
        say 1 charging 0.65                                |
        say 2 charging 0.3                                 |
        say 3 active 0.7                                   |
        hear 4 active 0.75                                 | plan redeploy 1, 1 for 2; go 20,0;
                                                           | [go to deployment]
        """,
    ),
    "a full one takes the place of a fuller one than charge_to": (
        exchanging,
        """
        plan_by greedy dispatch=asynchronous charge_to=0.6 |
        say 1 charging 1.0                                 |
        say 2 charging 0.3                                 |
        say 3 active 0.7                                   |
        hear 4 active 0.75                                 | plan collect 3, 1 for 3; go 30,0; call 3;
                                                           | [go to aMussel]
        """,
    ),
    # The aPad is at 20 m, where 2 was collected. 1 has its home at 10 m.
    "one for whom nobody waits is released at the nearest empty place": (
        exchanging,
        """
        plan_by greedy dispatch=asynchronous |
        say 1 charging 1.0                   |
        say 2 charging 0.3                   |
        say 3 active 0.99                    |
        hear 4 active 0.99                   | plan redeploy 1, 1 for 2; go 20,0; [go to deployment]
        release 1 0.95                       | undock 1; release 1; released: 1: True; hold; [charging wait]
        homes                                |
                                             | ((1, 20.0, 0.0), (2, 10.0, 0.0), (3, 30.0, 0.0), (4, 40.0, 0.0))
        """,
    ),
    "one for whom nobody waits is released at its own place where the sea bars the way to the nearest": (
        exchanging,
        """
        plan_by greedy dispatch=asynchronous |
        bar_way 2                            |
        say 1 charging 1.0                   |
        say 2 charging 0.3                   |
        say 3 active 0.99                    |
        hear 4 active 0.99                   | plan redeploy 1; go 10,0; [go to deployment]
        release 1 0.95                       | undock 1; release 1; released: 1: True; hold; [charging wait]
        homes                                |
                                             | ((1, 10.0, 0.0), (2, 20.0, 0.0), (3, 30.0, 0.0), (4, 40.0, 0.0))
        """,
    ),
    "one for whom nobody waits is released at its own place with own places": (
        exchanging,
        """
        plan_by greedy dispatch=asynchronous places=own |
        say 1 charging 1.0                              |
        say 2 charging 0.3                              |
        say 3 active 0.99                               |
        hear 4 active 0.99                              | plan redeploy 1; go 10,0; [go to deployment]
        release 1 0.95                                  | undock 1; release 1; released: 1: True; hold;
                                                        | [charging wait]
        homes                                           |
                                                        | ((1, 10.0, 0.0), (2, 20.0, 0.0), (3, 30.0, 0.0), (4, 40.0, 0.0))
        """,
    ),
    "an exchange whose partner is not collected is undone while the other one is aboard, and the next is as planned": (
        exchanging,
        """
        tick                   | plan collect 4 3, 2 for 4, 1 for 3; go 40,0; call 4; [go to aMussel]
        fail the way is barred | given_up: 4: collect: the way is barred; exchange: 2: 4: undone; go 20,0;
                               | [go to deployment]
        release 2 0.95         | undock 2; release 2; released: 2: True; go 30,0; call 3; [go to aMussel]
        collect 3              | go 30,0; [go to deployment]
        release 1 0.95         | undock 1; release 1; released: 1: True; hold; [charging wait]
        homes                  | ((1, 30.0, 0.0), (2, 20.0, 0.0), (3, 10.0, 0.0), (4, 40.0, 0.0))
        exchanged              | ()
        """,
    ),
    "an exchange that is half done is finished when the missing one is collected after all": (
        half_exchanged,
        """
        say 3 charging 1.0     |
        tick 200               | plan redeploy 3; go 10,0; [go to deployment]
        release 3 0.95         | undock 3; release 3; released: 3: True; hold; [idle wait]
        hear 1 active 0.5 30 0 | plan collect 4 1; go 40,0; call 4; [go to aMussel]
        collect 4              | exchange: 2: 4: finished; go 30,0; call 1
        homes                  | ((1, 30.0, 0.0), (2, 40.0, 0.0), (3, 10.0, 0.0), (4, 20.0, 0.0))
        exchanged              | ()
        """,
    ),
    "an exchange that is half done is undone when the other one is aboard again": (
        half_exchanged,
        """
        hear 3 charging 1.0 | plan redeploy 3; go 10,0; [go to deployment]
        release 3 0.95      | undock 3; release 3; released: 3: True; hold; [idle wait]
        say 4 active 0.95   |
        say 1 active 0.5    |
        hear 2 active 0.5   | plan collect 1 2; go 30,0; call 1; [go to aMussel]
        collect 1           | go 40,0; call 2
        collect 2           | exchange: 2: 4: undone; hold; [charging wait]
        homes               | ((1, 30.0, 0.0), (2, 20.0, 0.0), (3, 10.0, 0.0), (4, 40.0, 0.0))
        """,
    ),
    "an exchange that is half done outlives a resume and is told once": (
        half_exchanged,
        """
        exchanged | ((2, 4, <ExchangePhase.HALF_DONE: 'half done'>),)
        resume    |
        tick      | hold
        exchanged | ((2, 4, <ExchangePhase.HALF_DONE: 'half done'>),)
        """,
    ),
    "who waits alone is no batch and exchanges with nobody": (
        exchanging,
        """
        say 3 active 0.95 |
        say 1 charging 1  |
        hear 2 charging 1 | plan redeploy 2 1; go 20,0; [go to deployment]
        homes             | ((1, 10.0, 0.0), (2, 20.0, 0.0), (3, 30.0, 0.0), (4, 40.0, 0.0))
        """,
    ),
    "an aMussel that another aPad may dock is not collected": (
        lambda: Bench(agents=5),
        """
        bar 1 |
        tick  | hold; plan collect 2 3 4 5; go 20,0; call 2; [go to aMussel]
        """,
    ),
    # Of four, the first is left on the way, and the second with it; the third is left where it is waited for.
    "it leaves an aMussel that another aPad may dock now and calls up no such one": (
        Bench,
        """
        tick                | hold; plan collect 1 2 3 4; go 10,0; call 1; [go to aMussel]
        bar 1 2             |
        tick                | given_up: 1: collect: another aPad may dock it; go 30,0; call 3
        ok                  | [await surfacing]
        bar 3               |
        hear 3 floating 0.5 | given_up: 3: collect: another aPad may dock it; go 40,0; call 4; release 3;
                            | [go to aMussel]
        """,
    ),
    # A mechanism that moves is not stopped.
    "it ends a search for an aMussel that another aPad may dock": (
        beside_one,
        """
        bar 1 |
        tick  |
        miss  | go 13,0
        tick  | given_up: 1: collect: another aPad may dock it; go 20,0; call 2; release 1; [go to aMussel]
        """,
    ),
    # Three candidates are a whole batch from then on. Another supervisor of the run leaves it alone as well.
    "one that is tried in vain is left alone and the others are served": (
        lambda: Bench(
            agents=2,
            config=replace(MISSION, batch=2),
            state=MissionState(failed_tries=((1, MISSION.collection_attempts - 2),)),
        ),
        """
        tick                | hold; plan collect 1 2; go 10,0; call 1; [go to aMussel]
        ok                  | [await surfacing]
        ticks 60            | call 1; call 1; call 1; call 1; call 1;
                            | given_up: 1: collect: it does not answer the permission to surface; go 20,0;
                            | call 2; [go to aMussel]
        collect 2           | hold; [charging wait]
        hear 2 charging 1.0 | plan redeploy 2; go 20,0; [go to deployment]
        release 2 0.7       | undock 2; release 2; released: 2: True; hold; [idle wait]
        tick 121            | plan collect 1 2; go 10,0; call 1; [go to aMussel]
        ok                  | [await surfacing]
        ticks 60            | call 1; call 1; call 1; call 1; call 1;
                            | left_alone: 1: 5: it does not answer the permission to surface;
                            | given_up: 1: collect: it does not answer the permission to surface; go 20,0;
                            | call 2; [go to aMussel]
        collect 2           | hold; [charging wait]
        hear 2 charging 1.0 | plan redeploy 2; go 20,0; [go to deployment]
        release 2 0.7       | undock 2; release 2; released: 2: True; hold; [idle wait]
        resume              |
        failed_tries        | ((1, 5),)
        tick 121            | hold; plan collect 2; go 20,0; call 2; [go to aMussel]
        tick 121            | call 2
        """,
    ),
    # It would be fetched for ever.
    "one that never gains charge is left alone": (
        lambda: Bench(agents=1, state=MissionState(failed_tries=((1, MISSION.collection_attempts - 2),))),
        """
        hear 1 active 0.5 | hold; plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1         | hold; [charging wait]
        tick              |
        tick 121          | given_up: 1: charge: its believed charge does not rise; plan redeploy 1;
                          | go 10,0; [go to deployment]
        release 1 0.5     | undock 1; release 1; released: 1: False; hold; [idle wait]
        tick 121          | plan collect 1; go 10,0; call 1; [go to aMussel]
        collect 1         | hold; [charging wait]
        tick              |
        tick 121          | given_up: 1: charge: its believed charge does not rise; plan redeploy 1;
                          | go 10,0; [go to deployment]
        release 1 0.5     | undock 1; release 1; released: 1: False;
                          | left_alone: 1: 5: it left its dock with too little charge; hold; [idle wait]
        failed_tries      | ((1, 5),)
        tick 121          |
        """,
    ),
    # The three others are a batch: nobody else can be collected. Their docks are those that are free.
    "a dock that never opens is given up, and the others go on": (
        full_docks,
        """
        say 1 charging 1.0         |
        say 2 charging 1.0         |
        say 3 charging 1.0         |
        hear 4 charging 1.0        | plan redeploy 4 3 2 1; go 40,0; [go to deployment]
        release 4 0.9              | undock 4; release 4; released: 4: True; go 30,0
        release 3 0.9              | undock 3; release 3; released: 3: True; go 20,0
        release 2 0.9              | undock 2; release 2; released: 2: True; go 10,0
        ok                         | undock 1; [undock]
        fail the dock did not open | given_up: 1: deploy: the dock did not open; hold; [charging wait]
        tick                       | plan redeploy 1; go 10,0; [go to deployment]
        ok                         | undock 1; [undock]
        fail the dock did not open | given_up: 1: deploy: the dock did not open; hold; [charging wait]
        tick                       | plan redeploy 1; go 10,0; [go to deployment]
        ok                         | undock 1; [undock]
        fail the dock did not open | given_up: 1: deploy: the dock did not open; hold; [charging wait]
        tick                       | plan redeploy 1; go 10,0; [go to deployment]
        ok                         | undock 1; [undock]
        fail the dock did not open | given_up: 1: deploy: the dock did not open; hold; [charging wait]
        tick                       | plan redeploy 1; go 10,0; [go to deployment]
        ok                         | undock 1; [undock]
        fail the dock did not open | left_alone: 1: 5: its dock does not open: the dock did not open;
                                   | given_up: 1: deploy: the dock did not open; hold; [idle wait]
        failed_undockings          | ((1, 5),)
        ticks 40                   |
        resume                     |
        ticks 40                   | hold
        docked                     | ((0, 1),)
        say 2 active 0.5           |
        say 3 active 0.5           |
        hear 4 active 0.5          | plan collect 2 3 4; go 20,0; call 2; [go to aMussel]
        plan                       | collect 2 in 1, collect 3 in 2, collect 4 in 3
        opens 0 1                  |
        failed_undockings          | ()
        """,
    ),
    # The next collection was to fill it.
    "a dock does not open: without any free dock that step is given up, and is no failed try": (
        exchanging,
        """
        docks 2          |
        tick             | plan collect 4 3, 2 for 4, 1 for 3; go 40,0; [go to deployment]
        ok               | undock 2; [undock]
        fail it is stuck | given_up: 2: deploy: it is stuck; given_up: 4: collect: no dock is free;
                         | exchange: 2: 4: undone; go 30,0; [go to deployment]
        plan             | deploy 1 in 0, collect 3 in 0
        failed_tries     | ()
        """,
    ),
    "a dock does not open: it leaves its place to another dock": (
        exchanging,
        """
        docks 2          |
        tick             | plan collect 4 3, 2 for 4, 1 for 3; go 40,0; [go to deployment]
        docks 3          |
        ok               | undock 2; [undock]
        fail it is stuck | given_up: 2: deploy: it is stuck; go 40,0; call 4; [go to aMussel]
        plan             | collect 4 in 2, deploy 1 in 0, collect 3 in 0
        failed_tries     | ()
        """,
    ),
    "the rest of a tour with releases is not planned anew": (
        exchanging,
        """
        plan_by njnp |
        tick         | plan collect 3 4, 2 for 3, 1 for 4; go 30,0; call 3; [go to aMussel]
        collect 3    | go 30,0; [go to deployment]
        plan         | deploy 2 in 1, collect 4 in 3, deploy 1 in 0
        """,
    ),
}


@pytest.mark.parametrize(("begin", "story"), STORIES.values(), ids=STORIES)
def test_story(begin: Callable[[], Bench], story: str) -> None:
    play(story, begin().move)


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
    state: State, named: dict[int, bool], counts: bool
) -> None:
    bench = Bench(agents=1)
    bench.closes(2, 1)
    bench.mission.docks_named(named)
    bench.hear(1, state.name, 1.0)
    bench.tick()
    assert ("docks_disagree" not in bench.move("ok")) is counts and isinstance(bench.primitive, OpenDock)
    assert f"released: 1: {counts}" in bench.move("ok")
    assert (bench.mission.state.services, bench.mission.state.phase) == (int(counts), Phase.IDLE)


def test_the_docks_service_is_no_witness_of_a_later_docking() -> None:
    bench = Bench(agents=2)
    bench.mission.docks_named({1: True, 2: False})
    bench.closes(2, 1)
    assert bench.mission.named == {2: False}


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
def test_a_strategy_that_fails_ends_the_mission_holding(strategy: CollectionStrategy, why: str) -> None:
    bench = Bench()
    bench.mission.change_planning(rules(strategy))
    bench.tick()
    if bench.mission.state.phase is Phase.IDLE:
        bench.tick()  # asks again whether it still refuses
    assert bench.mission.state.end_reason is EndReason.STRATEGY_FAILED
    assert str(bench.mission.state.ended_by).startswith("failure of strategy 'cautious'")
    assert why in str(bench.mission.state.ended_by) and isinstance(bench.primitive, Hold)
    assert len([it for it in bench.orders if isinstance(it, MissionChanged)]) == 1
    ids = [it.command_id for it in bench.orders if isinstance(it, Primitive)]
    assert ids == sorted(set(ids)), "each order is given once"


def test_nothing_is_ordered_before_the_aPad_s_place_is_known() -> None:
    told = Told()
    told.say(1, 0, State.ACTIVE, 0.1)
    assert EnergyExchange(rules(registry.collection("greedy")), told).advance(0) == []


def test_a_known_end_raises_no_threshold() -> None:
    """While all of a battery's charge may be needed, the scenario's thresholds hold."""
    rules = replace(MISSION, pool_threshold=0.5, charge_to=0.7, full_threshold=0.9)
    assert END.rules(rules, 50_000) == rules
    later = END.rules(rules, 400_000)
    assert (later.pool_threshold, later.charge_to, later.full_threshold) == (0.5, 0.6, 0.6)
    assert END.rules(rules, 1_200_000).full_threshold == 0.0


def test_a_tour_that_is_resumed_after_every_step_is_flown_to_its_end() -> None:
    bench = exchanging()
    bench.tick()
    for step in bench.mission.state.plan:
        MOVES["resume"](bench)
        bench.tick()
        if step.kind is StepKind.COLLECT:
            bench.collect(step.agent_id)
        else:
            bench.release(step.agent_id, 0.99)
    assert bench.mission.state.phase is Phase.CHARGE
    assert {it for it in bench.mission.docks if it} == {3, 4}
    assert homes_of(bench) == {1: 30.0, 2: 40.0, 3: 10.0, 4: 20.0}


def homes_of(bench: Bench) -> dict[int, float]:
    return {agent_id: north_m for agent_id, north_m, _ in bench.mission.state.homes}


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
            bench.ok()
            bench.hear(step.agent_id, "floating", 0.4)
        elif bench.mission.state.phase is Phase.AWAIT_SURFACING:
            bench.tick()
        else:
            done = bench.primitive
            bench.ok()
            if isinstance(done, CloseDock):
                del place[step.agent_id]
            if isinstance(done, OpenDock):
                place[step.agent_id] = bench.mission.pose[0]
    homes, open_ones = homes_of(bench), {it[:2] for it in bench.mission.state.exchanged}
    assert sorted(homes.values()) == [10.0, 20.0, 30.0, 40.0]
    shared = {
        (a, b) for a in place for b in place if a != b and place[a] == place[b] and homes[a] == place[a]
    }
    told = [it.data for it in bench.orders if isinstance(it, Event) and it.kind == "exchange"]
    assert shared == open_ones and open_ones <= {(it["released"], it["collected"]) for it in told}
    assert {it for it in place if place[it] != homes[it]} == {collected for _, collected in open_ones}
