"""Faults of a vehicle at sea, and what its guards let happen: orders outside the fence, and the time to a safe state.

Port, guards and the core of a generation fly that generation's simulated vehicle, without ROS, in ticks of a second. An
`Observer` stands at the vehicle's end of the wire. It judges each order that arrives by arithmetic of its own, and shares
no code with the guards. A stop is counted apart: a hold where the vehicle was last heard, or controllers off.

The limits of the guards are those of `real-apad.yaml`.

A vehicle is safe when it holds a place inside the fence, when its controllers are off, or when a pilot was called. The time
to that counts from the fault where the fault takes the position or the command away. Where the vehicle goes astray under a
good position, it counts from the fence; a vehicle that is safe before it gets there took 0 s.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.safety import safety_of
from apad_bridge.assembly.stacks import stack_of
from apad_bridge.scenario.guard_options import GuardOptions
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Generation, Scenario
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

ROOT = Path(__file__).parents[1]
SIDE_M = 60.0
FENCE = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
START_M = (30.0, 30.0)
TICK_MS = 1_000
JUMP_M = 10.0
AWAY_M = 8.0
"""The first go-to's least length: after 12 s at 0.5 m/s the vehicle is still under way."""
TRIES = 20
SEED = 20261122

Place = tuple[float, float]
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


@dataclass(slots=True)
class Observer:
    """Stands at the vehicle's end of the wire, and keeps what it sees there. The limits are the guards' own."""

    age_ms: int
    frozen_limit_ms: int
    heard: PoseReceived | None = None
    """The newest position that left the vehicle and is finite."""
    bad_from_ms: float = math.inf
    """From then on the positions that leave the vehicle are wrong, and the limits to notice that are over."""
    goal_m: Place | None = None
    """The last ordered goal or place to hold; None after a stop."""
    frozen_ms: int = 0
    """Time under way with a position that stayed the same to the last bit."""
    pilot_steers: bool = False
    orders: int = 0
    stops: int = 0
    outside: list[str] = field(default_factory=list)
    blind: list[str] = field(default_factory=list)
    """Orders that arrived when no good position had left the vehicle for longer than the limit."""
    against_pilot: list[str] = field(default_factory=list)

    def hear(self, pose: PoseReceived) -> None:
        if not (math.isfinite(pose.north_m) and math.isfinite(pose.east_m)):
            return
        before, here_m = self.heard, (pose.north_m, pose.east_m)
        if before is None or (before.north_m, before.east_m, before.heading_rad) != (
            *here_m,
            pose.heading_rad,
        ):
            self.frozen_ms = 0
        elif self.goal_m is not None and math.dist(self.goal_m, here_m) > 1.0:
            self.frozen_ms += pose.at_ms - before.at_ms
        if before is not None and math.dist((before.north_m, before.east_m), here_m) > JUMP_M:
            self.goal_m = (
                None  # a goal of the old frame is no place of the new one: whether it moves is not known
            )
        self.heard = pose

    def is_bad(self, now_ms: int) -> bool:
        """No good position has left the vehicle for longer than the limits."""
        is_old = self.heard is None or now_ms - self.heard.at_ms > self.age_ms
        return is_old or self.frozen_ms > self.frozen_limit_ms + TICK_MS or now_ms > self.bad_from_ms

    def take_goal(self, goal_m: Place, now_ms: int, *, is_hold: bool) -> None:
        """Judges a go-to or hold. The fence is a convex square, so that a way between two places inside lies inside."""
        self.orders += 1
        heard = self.heard
        text = f"{now_ms / 1000:g} s: to ({goal_m[0]:.1f}, {goal_m[1]:.1f})"
        if self.pilot_steers:
            self.against_pilot.append(text)
        if heard is None or self.is_bad(now_ms):
            self.blind.append(text)
            return
        self.goal_m = goal_m
        here_m = (heard.north_m, heard.east_m)
        if is_hold and math.dist(here_m, goal_m) < 0.1:
            self.stops += 1
        elif not (is_inside(goal_m, 2.0) and is_inside(here_m)):
            self.outside.append(text)

    def take_other(self, now_ms: int, what: str) -> None:
        """Judges an order to a dock."""
        self.orders += 1
        if self.pilot_steers:
            self.against_pilot.append(f"{now_ms / 1000:g} s: {what}")
        if self.heard is None or self.is_bad(now_ms):
            self.blind.append(f"{now_ms / 1000:g} s: {what}")
        elif not is_inside((self.heard.north_m, self.heard.east_m)):
            self.outside.append(f"{now_ms / 1000:g} s: {what}")

    def take_stop(self) -> None:
        self.orders += 1
        self.stops += 1
        self.goal_m = None


def is_inside(place_m: Place, clearance_m: float = 0.0) -> bool:
    return all(clearance_m - 1e-6 <= it <= SIDE_M - clearance_m + 1e-6 for it in place_m)


def _observer_of(flown: Scenario) -> Observer:
    assert flown.guards is not None
    return Observer(round(1000 * flown.guards.position_age_s), round(1000 * flown.guards.frozen_s))


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
        self.observer, self.shift = _observer_of(flown), truly
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
        self.observer, self.shift = _observer_of(flown), truly
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


# The faults. Each begins while the vehicle is under way to a place inside the fence.


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


Inflict = Callable[[Bench, random.Random], None]
FAULTS: dict[str, tuple[Inflict, Place]] = {
    "NaN position": (nan_position, (0.0, 0.0)),
    "frozen position": (frozen_position, (0.0, 0.0)),
    "jumping position": (jumping_position, (0.0, 0.0)),
    "silent position": (silent_position, (0.0, 0.0)),
    "wrong origin": (wrong_origin, (0.0, 0.0)),
    "current across the fence": (current, (0.35, 0.2)),
    "primitive that never ends": (endless_primitive, (0.0, 0.0)),
    "pilot": (pilot, (0.0, 0.0)),
}
ASTRAY = ("current across the fence", "primitive that never ends")
"""The vehicle leaves its way under a good position: it is unsafe from the fence on."""
_WATCHED_TICKS = 240


def try_once(fault: str, generation: Generation, guards: GuardOptions, rng: random.Random) -> dict[str, Any]:
    """Flies one try: a go-to, the fault under way, and orders that go on being given as if nothing had happened."""
    inflict, drift_m_s = FAULTS[fault]
    bench = Bench(generation, drift_m_s, guards=guards)
    bench.go(*_far_from_start(rng))
    bench.run(rng.randint(4, 12))
    begun_ms = bench.now_ms
    inflict(bench, rng)
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
    """Each fault `tries` times for each generation; counts are sums, and `safe_after_s` is the longest time."""
    guards = real_limits()
    return {"rows": [_measured(fault, generation, guards, tries) for fault, generation in _pairs()]}


def _pairs() -> Iterator[tuple[str, Generation]]:
    for fault in FAULTS:
        for generation in (Generation.A, Generation.B):
            if fault != "pilot" or generation is Generation.B:  # the stack of A tells nobody of a pilot
                yield fault, generation


def _measured(fault: str, generation: Generation, guards: GuardOptions, tries: int) -> dict[str, Any]:
    rng = random.Random(f"{SEED} {fault} {generation}")
    results = [try_once(fault, generation, guards, rng) for _ in range(tries)]
    times_s = [it["safe_s"] for it in results]
    return {
        "fault": fault,
        "generation": generation.value,
        "tries": tries,
        "orders": sum(it["orders"] for it in results),
        "stops": sum(it["stops"] for it in results),
        "orders_outside_fence": sum(it["outside"] for it in results),
        "orders_against_pilot": sum(it["against_pilot"] for it in results),
        "safe_after_s": None if None in times_s else max(times_s),
    }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(*(name.replace("_", " ") for name in result["rows"][0]))
    for row in result["rows"]:
        table.add_row(*("-" if value is None else str(value) for value in row.values()))
    console.print(table)
