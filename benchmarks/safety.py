"""Faults of a vehicle at sea, and what its guards let happen: orders outside the fence, and the time to a safe state.

Port, guards and the core of a generation fly that generation's simulated vehicle, without ROS, in ticks of a second. Faults
of what is around the vehicle take real processes on two machines, a minute for each try (`safety_study/flights.py`). Either
way an `Observer` stands at the vehicle's end of the wire. It judges each order that arrives by arithmetic of its own, and
shares no code with the guards. A stop is counted apart: a hold where the vehicle was last heard, or controllers off.

The limits of the guards are those of `real-apad.yaml`.

A vehicle is safe when it holds a place inside the fence, when its controllers are off, or when a pilot was called. The time
to that counts from the fault where the fault takes the position or the command away. Where the vehicle goes astray under a
good position, it counts from the fence; a vehicle that is safe before it gets there took 0 s. It must be safe within
`limit_s`: 3 s with the link up, and 3 s more than the watchdog's patience where nobody hears the bench.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.safety import safety_of
from apad_bridge.assembly.stacks import stack_of
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.guard_options import GuardOptions
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.docking import DockingPort
from apad_bridge.vehicle.generation_a import messages as shown_a
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.messages import (
    GO_TO,
    GoalCode,
    GoalOrder,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
)
from apad_bridge.vehicle.generation_a.simulated import GenerationAVehicle
from apad_bridge.vehicle.generation_b import messages as shown_b
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.messages import (
    ArmReceived,
    GoToOrder,
    ManualReceived,
    Order,
    PositionOrder,
    ServiceAnswered,
    StatusReceived,
    StopOrder,
)
from apad_bridge.vehicle.generation_b.simulated import GenerationBVehicle
from apad_bridge.vehicle.guards.gate import GuardedVehicle
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.primitives import (
    DockChanged,
    DockMussel,
    GoToPoint,
    HoldPosition,
    Outcome,
    Primitive,
    PrimitiveFailed,
    PrimitiveSucceeded,
    UndockMussel,
)
from apad_bridge.vehicle.simulated.apad import SimulatedAPad
from apad_bridge.vehicle.simulated.kinematics import Pose
from apad_bridge.vehicle.simulated.misses import Misses
from apad_bridge.vehicle.simulated.motion import Coast, Steer
from apad_bridge.vehicle.stack_messages import BatteryReceived, PosePublished, PoseReceived
from benchmarks.safety_study import flights
from benchmarks.safety_study.observer import FENCE, SIDE_M, TICK_MS, Observer, Place, is_inside

ROOT = Path(__file__).parents[1]
START_M = (30.0, 30.0)
AWAY_M = 8.0
"""The first go-to's least length: after 12 s at 0.5 m/s the vehicle is still under way."""
ARRIVED_TICKS = 100
TRIES = 20
TRIES_FOR_A_FLIGHT = 10
"""One of so many tries is made where real processes fly."""
SIDE_BY_SIDE = 2
"""Flights at a time: most of a flight is waiting."""
SEED = 20261122

Shift = Callable[[Pose, int], PoseReceived | None]
"""The pose that the vehicle publishes at a time: the truth, another one, or none."""


def truly(pose: Pose, at_ms: int) -> PoseReceived | None:
    return PoseReceived(at_ms, pose.north_m, pose.east_m, pose.heading_rad)


GUARDS = GuardOptions(clearance_m=2.0, battery_reserve=0.1, leg_s=240.0)


def real_limits() -> GuardOptions:
    """The guards of the shipped scenario for a real aPad."""
    guards = load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml").guards
    assert guards is not None
    return guards


def scenario(
    generation: Generation, drift_m_s: Place = (0.0, 0.0), guards: GuardOptions = GUARDS
) -> Scenario:
    """The pool's scenario in a square of 60 m with a fence."""
    pool = load(ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml")
    return replace(
        pool,
        area=replace(pool.area, polygon_m=FENCE, fence=FENCE, home_m=START_M),
        apad=replace(pool.apad, start_m=START_M, generation=generation, drift_m_s=drift_m_s),
        guards=guards,
    )


class StackLink(Protocol):
    """A VehicleLink to a simulated vehicle, with an observer on the wire."""

    observer: Observer
    shift: Shift

    @property
    def pose(self) -> Pose:
        """The truth."""
        ...

    @property
    def is_at_rest(self) -> bool:
        """It holds a place, or its controllers are off."""
        ...

    def push(self, command: Coast | Steer) -> None:
        """The vehicle does this by itself."""
        ...

    def set_pilot(self, *, steers: bool) -> None: ...

    def advance(self, now_ms: int) -> list[LinkFact]: ...

    def command(self, command: VehicleCommand, now_ms: int) -> None: ...

    def close(self) -> None: ...


class LinkToA:
    """Generation A: converts the vehicle's output to the messages of its topics and of its action server."""

    def __init__(self, flown: Scenario, core: Callable[..., GenerationACore]) -> None:
        self.observer, self.shift = Observer.of(flown), truly
        self._apad = SimulatedAPad(flown.apad)
        self._vehicle = GenerationAVehicle(
            self._apad, flown.mission.speed_m_s, flown.mission.victory_radius_m
        )
        self._core = core()
        self._active: list[str] = []
        self._goal: GoalOrder | None = None
        self.never_ends = False
        self._now_ms = 0

    @property
    def pose(self) -> Pose:
        return self._apad.pose

    @property
    def is_at_rest(self) -> bool:
        goal = self._goal
        return goal is not None and math.dist((goal.north_m, goal.east_m), _place(self.pose)) < 3.0

    def push(self, command: Coast | Steer) -> None:
        self._apad.receive(command, self._now_ms)

    def set_pilot(self, *, steers: bool) -> None:
        self.observer.pilot_steers = steers

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._now_ms = now_ms
        self._receive(self._vehicle.advance(now_ms), now_ms)
        facts = self._core.advance(now_ms)
        for order in self._core.take_orders():
            self._send(order, now_ms)
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        if (order := self._core.command(command, now_ms)) is not None:  # type: ignore[arg-type]
            self._send(order, now_ms)

    def close(self) -> None:
        pass

    def _send(self, order: GoalOrder, now_ms: int) -> None:
        if order.kind == GO_TO:
            self.observer.take_goal((order.north_m, order.east_m), now_ms, is_hold=True)
            self._goal = order
        else:
            self.observer.take_other(now_ms, order.name)
        goal = shown_a.Goal(order.key, order.kind, order.north_m, order.east_m, order.name)
        self._active.append(order.key)
        self._report(GoalStatusEntry(order.key, GoalCode.ACTIVE), now_ms)
        self._receive(self._vehicle.receive(goal, now_ms), now_ms)

    def _report(self, status: GoalStatusEntry, at_ms: int) -> None:
        self._core.receive(GoalStatusReceived(at_ms, (status,), whole=False), at_ms)

    def _receive(self, shown: list[shown_a.Published], now_ms: int) -> None:
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    if (moved := self.shift(pose, at_ms)) is not None:
                        self.observer.hear(moved)
                        self._core.receive(moved, now_ms)
                case shown_a.HeldPositionPublished(at_ms, name, north_m, east_m, released):
                    agent_id = int(name.removeprefix("amussel"))
                    self._core.receive(
                        HeldPositionReceived(at_ms, agent_id, north_m, east_m, released), now_ms
                    )
                case shown_a.BatteryAndProgressPublished(at_ms, percent):
                    statuses = tuple(GoalStatusEntry(key, GoalCode.ACTIVE) for key in self._active)
                    self._core.receive(GoalStatusReceived(at_ms, statuses, whole=True), now_ms)
                    self._core.receive(BatteryReceived(at_ms, percent), now_ms)
                case shown_a.GoalEnded(at_ms, key, outcome, reason) if not self.never_ends:
                    self._active.remove(key)
                    self._report(GoalStatusEntry(key, _CODES[outcome], reason), at_ms)


_CODES = {
    shown_a.Outcome.SUCCEEDED: GoalCode.SUCCEEDED,
    shown_a.Outcome.PREEMPTED: GoalCode.PREEMPTED,
    shown_a.Outcome.ABORTED: GoalCode.ABORTED,
}


class LinkToB:
    """Generation B: answers calls at once, as its services do."""

    def __init__(self, flown: Scenario, core: Callable[..., GenerationBCore]) -> None:
        self.observer, self.shift = Observer.of(flown), truly
        self._apad = SimulatedAPad(flown.apad)
        self._vehicle = GenerationBVehicle(self._apad)
        self._core = core()
        self._last: Order | None = None
        self.never_ends = False
        self._now_ms = 0

    @property
    def pose(self) -> Pose:
        return self._apad.pose

    @property
    def is_at_rest(self) -> bool:
        return isinstance(self._last, StopOrder | PositionOrder)

    def push(self, command: Coast | Steer) -> None:
        self._apad.receive(command, self._now_ms)

    def set_pilot(self, *, steers: bool) -> None:
        self.observer.pilot_steers = steers
        self._core.receive(ManualReceived(self._now_ms, steers), self._now_ms)
        self._receive(self._vehicle.set_manual(steers, self._now_ms), self._now_ms)

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._now_ms = now_ms
        self._receive(self._vehicle.advance(now_ms), now_ms)
        facts = self._core.advance(now_ms)
        self._send(now_ms)
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self._core.command(command, now_ms)
        self._send(now_ms)

    def close(self) -> None:
        pass

    def _send(self, now_ms: int) -> None:
        for call in self._core.take_calls():
            match call.order:
                case GoToOrder(north_m, east_m):
                    self.observer.take_goal((north_m, east_m), now_ms, is_hold=False)
                case PositionOrder(north_m, east_m):
                    self.observer.take_goal((north_m, east_m), now_ms, is_hold=True)
                case StopOrder():
                    self.observer.take_stop()
                case docking:
                    self.observer.take_other(now_ms, f"dock {docking.dock_index}")
            self._last = call.order
            self._receive(self._vehicle.receive(call.order, now_ms), now_ms)
            self._core.receive(ServiceAnswered(now_ms, call.number, None), now_ms)

    def _receive(self, shown: list[shown_b.Published], now_ms: int) -> None:
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    if (moved := self.shift(pose, at_ms)) is not None:
                        self.observer.hear(moved)
                        self._core.receive(moved, now_ms)
                case shown_b.StatusPublished(at_ms, docking, status):
                    ended = status is not shown_b.Status.RUNNING
                    shown_status = (
                        shown_b.Status.RUNNING if self.never_ends and ended and not docking else status
                    )
                    self._core.receive(StatusReceived(at_ms, docking, shown_status), now_ms)
                case shown_b.BatteryPublished(at_ms, percent):
                    self._core.receive(BatteryReceived(at_ms, percent), now_ms)
                case shown_b.ArmPublished(at_ms, arm):
                    dock_index = arm.is_open.index(True) if True in arm.is_open else None
                    self._core.receive(ArmReceived(at_ms, dock_index), now_ms)


class Bench:
    """A port and a guarded vehicle of one generation, in ticks of a second, as a flight runs them."""

    def __init__(
        self,
        generation: Generation,
        drift_m_s: Place = (0.0, 0.0),
        *,
        guards: GuardOptions = GUARDS,
        is_real: bool = True,
    ) -> None:
        flown = scenario(generation, drift_m_s, guards)
        safety = safety_of(flown, needs_person=is_real)
        battery = flown.apad.battery
        battery_v = (battery.empty_v, battery.full_v)
        capabilities = stack_of(generation).capabilities(4)
        self.link: LinkToA | LinkToB
        if generation is Generation.A:
            self.link = LinkToA(
                flown, lambda: GenerationACore(range(1, 10), battery_v, "run", gate=safety.gate)
            )
        else:
            docking, misses = flown.mission.docking, Misses(1, 0.0)
            self.link = LinkToB(
                flown,
                lambda: GenerationBCore(
                    range(1, 10), battery_v, docking, misses, takes_back=not is_real, gate=safety.gate
                ),
            )
        self.vehicle = GuardedVehicle(self.link, safety, can_stop=capabilities.can_stop)
        self.port = DockingPort(flown.mission.docking, capabilities=capabilities)
        self.now_ms = 0
        self.events: list[tuple[int, str, dict[str, Any]]] = []
        self.outcomes: list[Outcome] = []
        self._ids = 0
        self.run(1)

    @property
    def observer(self) -> Observer:
        return self.link.observer

    def go(self, north_m: float, east_m: float, speed_m_s: float = 0.5) -> None:
        self.order(lambda it: GoToPoint(it, north_m, east_m, speed_m_s, 0.5))

    def hold(self, north_m: float, east_m: float) -> None:
        self.order(lambda it: HoldPosition(it, north_m, east_m))

    def dock(self, dock_index: int, agent_id: int) -> None:
        self.order(lambda it: DockMussel(it, dock_index, agent_id))

    def undock(self, dock_index: int, agent_id: int) -> None:
        self.order(lambda it: UndockMussel(it, dock_index, agent_id))

    def order(self, primitive: Callable[[int], Primitive]) -> None:
        self._ids += 1
        self._pass_on(self.port.receive(primitive(self._ids), self.now_ms))
        self._settle()

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.now_ms += TICK_MS
            self._settle()

    def refusals(self) -> list[str]:
        return [data["reason"] for _, kind, data in self.events if kind == "refused"]

    def _settle(self) -> None:
        for _ in range(3):
            for fact in self.vehicle.advance(self.now_ms):
                if not hasattr(fact, "agent_id") or hasattr(fact, "dock_index"):
                    self._pass_on(self.port.receive(fact, self.now_ms))  # type: ignore[arg-type]
        self._pass_on(self.port.advance(self.now_ms))
        self.events += [(self.now_ms, *event) for event in self.vehicle.gate.take_events()]

    def _pass_on(self, actions: list[VehicleCommand | Outcome]) -> None:
        for action in actions:
            if isinstance(action, PrimitiveSucceeded | PrimitiveFailed | DockChanged):
                self.outcomes.append(action)
            else:
                self.vehicle.command(action, self.now_ms)


# The faults. Each begins while the vehicle is under way to a place inside the fence, or in a docking.


def nan_position(bench: Bench, rng: random.Random) -> None:
    bench.link.shift = lambda pose, at_ms: PoseReceived(at_ms, math.nan, math.nan, pose.heading_rad)


def frozen_position(bench: Bench, rng: random.Random) -> None:
    """The last position is repeated with fresh stamps, and the vehicle goes on and on."""
    last = bench.link.pose
    bench.link.shift = lambda pose, at_ms: PoseReceived(at_ms, last.north_m, last.east_m, last.heading_rad)
    bench.link.push(Steer(0.5, 0.0, 0.0))


def jumping_position(bench: Bench, rng: random.Random) -> None:
    off_m = (rng.uniform(12, 25) * rng.choice((-1, 1)), rng.uniform(12, 25) * rng.choice((-1, 1)))
    since_ms = bench.now_ms

    def shift(pose: Pose, at_ms: int) -> PoseReceived:
        far = (at_ms - since_ms) // 4_000 % 2 == 0
        return PoseReceived(
            at_ms, pose.north_m + off_m[0] * far, pose.east_m + off_m[1] * far, pose.heading_rad
        )

    bench.link.shift = shift
    bench.observer.bad_from_ms = bench.now_ms + 1_000


def silent_position(bench: Bench, rng: random.Random) -> None:
    bench.link.shift = lambda pose, at_ms: None


def wrong_origin(bench: Bench, rng: random.Random) -> None:
    """The vehicle starts its positioning again about another origin, some hundred metres off."""
    off_m = (rng.uniform(100, 900), rng.uniform(-900, -100))
    bench.link.shift = lambda pose, at_ms: PoseReceived(
        at_ms, pose.north_m + off_m[0], pose.east_m + off_m[1], pose.heading_rad
    )


def current(bench: Bench, rng: random.Random) -> None:
    """Its controllers are off, and a current takes it across the fence."""
    bench.link.push(Coast())


def endless_primitive(bench: Bench, rng: random.Random) -> None:
    """Nothing reports the go-to's end, and the vehicle goes on."""
    bench.link.never_ends = True
    bench.link.push(Steer(0.4, rng.uniform(-math.pi, math.pi), 0.0))


def pilot(bench: Bench, rng: random.Random) -> None:
    """A pilot steers, and takes it anywhere."""
    bench.link.set_pilot(steers=True)
    bench.link.push(Steer(0.5, rng.uniform(-math.pi, math.pi), 0.0))


def under_way(bench: Bench, rng: random.Random) -> None:
    bench.go(*_far_from_start(rng))
    bench.run(rng.randint(4, 12))


def in_docking(bench: Bench, rng: random.Random) -> None:
    bench.go(*_far_from_start(rng))
    bench.run(ARRIVED_TICKS)
    bench.dock(rng.randrange(4), rng.randrange(1, 10))
    bench.run(rng.randint(2, 12))


Act = Callable[[Bench, random.Random], None]


@dataclass(frozen=True, slots=True)
class Fault:
    inflict: Act
    begin: Act = under_way
    """The vehicle's act when the fault comes."""
    drift_m_s: Place = (0.0, 0.0)


FAULTS = {
    "NaN position": Fault(nan_position),
    "frozen position": Fault(frozen_position),
    "jumping position": Fault(jumping_position),
    "silent position": Fault(silent_position),
    "wrong origin": Fault(wrong_origin),
    "current across the fence": Fault(current, drift_m_s=(0.35, 0.2)),
    "primitive that never ends": Fault(endless_primitive),
    "pilot": Fault(pilot),
    "pilot in a docking": Fault(pilot, in_docking),
}
ASTRAY = ("current across the fence", "primitive that never ends")
"""The vehicle leaves its way under a good position: it is unsafe from the fence on."""
PILOTED = ("pilot", "pilot in a docking")
_WATCHED_TICKS = 240


def try_once(fault: str, generation: Generation, guards: GuardOptions, rng: random.Random) -> dict[str, Any]:
    """Flies one try: the fault under way, and orders that go on being given as if nothing had happened."""
    acts = FAULTS[fault]
    bench = Bench(generation, acts.drift_m_s, guards=guards)
    acts.begin(bench, rng)
    begun_ms = bench.now_ms
    acts.inflict(bench, rng)
    safe_ms = None
    unsafe_ms = None if fault in ASTRAY else begun_ms
    for _ in range(_WATCHED_TICKS):
        bench.run(1)
        if unsafe_ms is None and not is_inside(_place(bench.link.pose)):
            unsafe_ms = bench.now_ms
        if safe_ms is None and _is_safe(bench, begun_ms):
            safe_ms = bench.now_ms
        if rng.random() < 0.1:
            rng.choice(
                (
                    lambda: bench.go(rng.uniform(-20, SIDE_M + 20), rng.uniform(-20, SIDE_M + 20)),
                    lambda: bench.hold(rng.uniform(-20, SIDE_M + 20), rng.uniform(-20, SIDE_M + 20)),
                    lambda: bench.dock(rng.randrange(4), rng.randrange(1, 10)),
                    lambda: bench.undock(rng.randrange(4), rng.randrange(1, 10)),
                )
            )()
    observer = bench.observer
    return {
        "outside": len(observer.outside) + len(observer.blind),
        "against_pilot": len(observer.against_pilot),
        "stops": observer.stops,
        "orders": observer.orders,
        "safe_s": _waited_s(unsafe_ms, safe_ms),
    }


def _waited_s(unsafe_ms: int | None, safe_ms: int | None) -> float | None:
    """None where the vehicle did not come to a safe state."""
    if safe_ms is None:
        return None
    return 0.0 if unsafe_ms is None else max(0, safe_ms - unsafe_ms) / 1000


def _is_safe(bench: Bench, since_ms: int) -> bool:
    called = any(at_ms >= since_ms and data.get("calls_pilot") for at_ms, _, data in bench.events)
    reacted = any(at_ms >= since_ms and kind == "guard" for at_ms, kind, _ in bench.events)
    held = any(isinstance(it, PrimitiveFailed) and it.at_ms >= since_ms for it in bench.outcomes)
    return called or bench.observer.pilot_steers or ((reacted or held) and bench.link.is_at_rest)


def _far_from_start(rng: random.Random) -> Place:
    while True:
        place_m = rng.uniform(4, SIDE_M - 4), rng.uniform(4, SIDE_M - 4)
        if math.dist(place_m, START_M) > AWAY_M:
            return place_m


def _place(pose: Pose) -> Place:
    return pose.north_m, pose.east_m


def measure(tries: int = TRIES) -> dict[str, Any]:
    """Each fault for each generation: counts are sums, and `safe_after_s` is the longest time.

    A fault is tried `tries` times, or a tenth as often where real processes fly. `not_tried` says what was not, and why.
    """
    guards = real_limits()
    rows = [_tried(fault, generation, guards, tries) for fault, generation in _pairs()]
    not_tried = {f"{it}, generation a": "that stack tells nobody of a pilot" for it in PILOTED}
    if why := flights.why_no_flight():
        not_tried |= dict.fromkeys(flights.FAULTS, why)
    else:
        for fault in flights.FAULTS:
            for generation in Generation.A, Generation.B:
                rows.append(_flown(fault, generation, guards, max(1, tries // TRIES_FOR_A_FLIGHT)))
    return {"rows": rows, "not_tried": not_tried}


def _pairs() -> Iterator[tuple[str, Generation]]:
    for fault in FAULTS:
        for generation in (Generation.A, Generation.B):
            if fault not in PILOTED or generation is Generation.B:
                yield fault, generation


def _tried(fault: str, generation: Generation, guards: GuardOptions, tries: int) -> dict[str, Any]:
    rng = random.Random(f"{SEED} {fault} {generation}")
    results = [try_once(fault, generation, guards, rng) for _ in range(tries)]
    return _row(fault, generation, flights.REACTION_S, results)


def _flown(name: str, generation: Generation, guards: GuardOptions, tries: int) -> dict[str, Any]:
    fault, flown = flights.FAULTS[name], scenario(generation, guards=guards)
    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        results = list(
            pool.map(
                lambda it: flights.try_once(
                    fault, flown, it, random.Random(f"{SEED} {name} {generation} {it}")
                ),
                range(tries),
            )
        )
    return _row(name, generation, fault.limit_s, results)


def _row(fault: str, generation: Generation, limit_s: float, results: list[dict[str, Any]]) -> dict[str, Any]:
    times_s = [it["safe_s"] for it in results]
    return {
        "fault": fault,
        "generation": generation.value,
        "tries": len(results),
        "orders": sum(it["orders"] for it in results),
        "stops": sum(it["stops"] for it in results),
        "orders_outside_fence": sum(it["outside"] for it in results),
        "orders_against_pilot": sum(it["against_pilot"] for it in results),
        "safe_after_s": None if None in times_s else max(times_s),
        "limit_s": limit_s,
    }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(*(name.replace("_", " ") for name in result["rows"][0]))
    for row in result["rows"]:
        table.add_row(*("-" if value is None else str(value) for value in row.values()))
    console.print(table)
    for fault, why in result["not_tried"].items():
        console.print(f"not tried: {fault}: {why}")
