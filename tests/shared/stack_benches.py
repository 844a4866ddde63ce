"""A guarded vehicle of either generation on its simulated stack, without ROS, with an observer on the wire.

Port, guards and the core of a generation fly that generation's simulated vehicle in ticks of a second. Faults are of its
position, of its orders and of who steers it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from wire_observer import FENCE, SIDE_M, TICK_MS, Observer, Place

from apad_bridge.assembly.safety import safety_of
from apad_bridge.assembly.stacks import stack_of
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.faults import Fault as VehicleFault
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import (
    CloseDock,
    GoalOfOthers,
    GoTo,
    Hold,
    OpenDock,
    PoseReported,
    Primitive,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import (
    GO_TO,
    DocksReceived,
    GoalCode,
    GoalOrder,
    GoalSeen,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
    OffAnswered,
)
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.messages import (
    ArmReceived,
    ManualReceived,
    PrimitiveStatus,
    ServiceAnswered,
    ServiceOrder,
    StatusReceived,
)
from apad_bridge.vehicle.guards.gate import Gate, Safety
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.outcomes import Outcome, PrimitiveFailed
from apad_bridge.vehicle.stack_messages import BatteryReceived
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.apad.motion import Coast, Steer
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_a import simulated_messages as shown_a
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.generation_b import simulated_messages as shown_b
from apad_bridge.world.generation_b.docks import BenchDocks
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle
from apad_bridge.world.simulated_stack import PosePublished

ROOT = Path(__file__).parents[2]
START_M = (30.0, 30.0)
AWAY_M = 8.0
"""The first go-to's least length: after 12 s at 0.5 m/s the vehicle is still under way."""
ARRIVED_TICKS = 100


def truly(pose: Pose, at_ms: int) -> PoseReported | None:
    return PoseReported(at_ms, pose.north_m, pose.east_m, pose.heading_rad)


GUARDS = GuardOptions(clearance_m=2.0, battery_reserve=0.1, leg_s=240.0)


@cache
def real_limits() -> GuardOptions:
    """The guards of the shipped scenario for a real aPad."""
    guards = load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml").guards
    assert guards is not None
    return replace(guards, clearance_m=2.0)  # its own is for wider waters than these 60 m


@cache
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


def cleared(command: VehicleCommand) -> Cleared[VehicleCommand]:
    """The command as a gate without guards lets it out."""
    let_out = Gate.without_guards().clear(command, 0)
    assert isinstance(let_out, Cleared)
    return let_out


def fed(core: GenerationACore | GenerationBCore, step: Any) -> int:
    """Gives the core a message, an order with its time as (ms, order), or nothing at a time in ms. Returns the time."""
    match step:
        case int(at_ms):
            pass
        case (int(at_ms), order):
            core.command(cleared(order), at_ms)
        case message:
            at_ms = message.at_ms
            core.receive(message, at_ms)
    return at_ms


class SimulatedLink:
    """A VehicleLink to a simulated vehicle, with an observer on the wire."""

    def __init__(self, flown: Scenario) -> None:
        self.observer, self.shift = Observer.of(flown), truly
        """`shift` gives the pose that the vehicle publishes at a time: the truth, another one, or none."""
        self.never_ends = False
        self.is_lost = False
        """Orders do not arrive."""
        self.is_mute = False
        """Nothing that the vehicle sends arrives: neither positions nor answers."""
        self.tells_docks = False
        """Generation A answers which aMussels it holds, as its docks' service does."""
        self._apad = SimulatedAPad(flown.apad)
        self.core: Any
        self._now_ms = 0

    @property
    def pose(self) -> Pose:
        """The truth."""
        return self._apad.pose

    def push(self, command: Coast | Steer) -> None:
        """The vehicle does this by itself."""
        self._apad.receive(command, self._now_ms)

    def close(self) -> None:
        pass

    def _tell(self, message: Any, now_ms: int) -> None:
        if not self.is_mute:
            self.core.receive(message, now_ms)

    def _tell_pose(self, pose: Pose, at_ms: int, now_ms: int) -> None:
        if (moved := self.shift(pose, at_ms)) is not None and not self.is_mute:
            self.observer.hear(moved)
            self._tell(moved, now_ms)


class LinkToA(SimulatedLink):
    """Generation A: converts the vehicle's output to the messages of its topics and of its action server."""

    def __init__(self, flown: Scenario, core: Callable[..., GenerationACore]) -> None:
        super().__init__(flown)
        self.vehicle = GenerationAVehicle(
            self._apad, flown.mission.speed_m_s, flown.mission.victory_radius_m, 0, flown.apad.fault
        )
        self.core = core()
        self._active: list[str] = []
        self._goal: GoalOrder | None = None
        self._others = 0

    @property
    def is_at_rest(self) -> bool:
        goal = self._goal
        is_held = goal is not None and math.dist((goal.north_m, goal.east_m), place_of(self.pose)) < 3.0
        return is_held or not self.vehicle.has_thrust

    def set_pilot(self, *, steers: bool) -> None:
        self.observer.pilot_steers = steers

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._now_ms = now_ms
        self._receive(self.vehicle.advance(now_ms), now_ms)
        facts: list[LinkFact] = self.core.advance(now_ms)
        for it in self.core.take_orders():
            self._send(it.order, now_ms)
        if self.tells_docks and self.core.take_question():
            self._tell(DocksReceived(now_ms, frozenset(self.vehicle.held)), now_ms)
        self._switch_off(now_ms)
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        if (sent := self.core.command(cleared, now_ms)) is not None:
            self._send(sent.order, now_ms)
        self._switch_off(now_ms)

    def others_go(self, north_m: float, east_m: float) -> None:
        """Another client sends the vehicle there."""
        key = self.show_goal(north_m, east_m)
        self._active.append(key)
        self._receive(
            self.vehicle.receive(GoalOrder(key, GO_TO, north_m, east_m, ""), self._now_ms),
            self._now_ms,
        )

    def show_goal(self, north_m: float, east_m: float) -> str:
        """Another client's goal is on its way to the server. Returns its key."""
        self._others += 1
        key = f"/joystick-{self._others}-1.0"
        self._tell(GoalSeen(self._now_ms, key, GO_TO, north_m, east_m, "/joystick"), self._now_ms)
        return key

    def _switch_off(self, now_ms: int) -> None:
        if (off := self.core.take_off_order()) is None or self.is_lost:
            return
        self.observer.take_stop(now_ms)
        for key in list(self._active):
            self._receive(self.vehicle.cancel(key, now_ms), now_ms)
        self._receive(self.vehicle.enable_velocity_control(False, now_ms), now_ms)
        self._receive(self.vehicle.enable_position_control(False, now_ms), now_ms)
        self._tell(OffAnswered(now_ms, off.order.number, None), now_ms)

    def _send(self, order: GoalOrder, now_ms: int) -> None:
        if self.is_lost or self.vehicle.has_crashed:
            return
        if order.kind == GO_TO:
            self.observer.take_goal((order.north_m, order.east_m), now_ms, is_hold=True)
            self._goal = order
        else:
            self.observer.take_other(now_ms, order.name)
        self.take(GoalOrder(order.key, order.kind, order.north_m, order.east_m, order.name), now_ms)

    def take(self, goal: GoalOrder, now_ms: int) -> None:
        """The action server takes a goal, of whomever."""
        self._active.append(goal.key)
        self._report(GoalStatusEntry(goal.key, GoalCode.ACTIVE), now_ms)
        self._receive(self.vehicle.receive(goal, now_ms), now_ms)

    def _report(self, status: GoalStatusEntry, at_ms: int) -> None:
        self._tell(GoalStatusReceived(at_ms, (status,), whole=False), at_ms)

    def _receive(self, shown: list[shown_a.Published], now_ms: int) -> None:
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    self._tell_pose(pose, at_ms, now_ms)
                case shown_a.HeldPositionPublished(at_ms, name, north_m, east_m, released):
                    agent_id = int(name.removeprefix("amussel"))
                    self._tell(HeldPositionReceived(at_ms, agent_id, north_m, east_m, released), now_ms)
                case shown_a.BatteryAndProgressPublished(at_ms, percent) if not self.vehicle.has_crashed:
                    statuses = tuple(GoalStatusEntry(key, GoalCode.ACTIVE) for key in self._active)
                    self._tell(GoalStatusReceived(at_ms, statuses, whole=True), now_ms)
                    self._tell(BatteryReceived(at_ms, percent), now_ms)
                case shown_a.GoalEnded(at_ms, key, outcome, reason) if not self.never_ends:
                    self._active.remove(key)
                    self._report(GoalStatusEntry(key, _CODES[outcome], reason), at_ms)


_CODES = {
    shown_a.GoalOutcome.SUCCEEDED: GoalCode.SUCCEEDED,
    shown_a.GoalOutcome.PREEMPTED: GoalCode.PREEMPTED,
    shown_a.GoalOutcome.ABORTED: GoalCode.ABORTED,
}


NOT_TAKEN = "its service answered that it does not take the order"


class LinkToB(SimulatedLink):
    """Generation B: answers calls at once or never, as its services do."""

    def __init__(self, flown: Scenario, core: Callable[..., GenerationBCore]) -> None:
        super().__init__(flown)
        self.vehicle = GenerationBVehicle(self._apad, 0, flown.apad.fault)
        self.core = core()
        self._last: ServiceOrder | None = None
        self.shows_goals = True
        """Its action server shows each goal; without that nothing but the status tells of another client's go-to."""

    @property
    def is_at_rest(self) -> bool:
        return isinstance(self._last, Stop | Hold)

    def others_go(self, north_m: float, east_m: float) -> None:
        """Another client sends the vehicle there."""
        if self.shows_goals:
            self.show_goal(north_m, east_m)
        self._receive(self.vehicle.receive(GoTo(0, north_m, east_m, 0.5, 0.5), self._now_ms), self._now_ms)

    def show_goal(self, north_m: float, east_m: float) -> None:
        """Another client's goal is on its way to the server."""
        self._tell(GoalOfOthers(self._now_ms, "/commander", north_m, east_m), self._now_ms)

    def set_pilot(self, *, steers: bool) -> None:
        self.observer.pilot_steers = steers
        self._tell(ManualReceived(self._now_ms, steers), self._now_ms)
        self._receive(self.vehicle.set_manual(steers, self._now_ms), self._now_ms)

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._now_ms = now_ms
        self._receive(self.vehicle.advance(now_ms), now_ms)
        facts: list[LinkFact] = self.core.advance(now_ms)
        self._send(now_ms)
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        self.core.command(cleared, now_ms)
        self._send(now_ms)

    def _send(self, now_ms: int) -> None:
        for cleared in self.core.take_calls():
            call = cleared.order
            if self.is_lost:
                continue
            match call.order:
                case GoTo(_, north_m, east_m):
                    self.observer.take_goal((north_m, east_m), now_ms, is_hold=False)
                case Hold(_, north_m, east_m):
                    self.observer.take_goal((north_m, east_m), now_ms, is_hold=True)
                case Stop():
                    self.observer.take_stop(now_ms)
                case docking:
                    self.observer.take_other(now_ms, f"dock {docking.dock_index}")
            self._last = call.order
            self._receive(self.vehicle.receive(call.order, now_ms), now_ms)
            if self.vehicle.takes is not None:
                refusal = None if self.vehicle.takes else NOT_TAKEN
                self._tell(ServiceAnswered(now_ms, call.number, refusal), now_ms)

    def _receive(self, shown: list[shown_b.Published], now_ms: int) -> None:
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    self._tell_pose(pose, at_ms, now_ms)
                case shown_b.StatusPublished(at_ms, docking, status):
                    ended = status is not PrimitiveStatus.RUNNING
                    shown_status = (
                        PrimitiveStatus.RUNNING if self.never_ends and ended and not docking else status
                    )
                    self._tell(StatusReceived(at_ms, docking, shown_status), now_ms)
                case shown_b.BatteryPublished(at_ms, percent):
                    self._tell(BatteryReceived(at_ms, percent), now_ms)
                case shown_b.ArmPublished(at_ms, arm):
                    if True in arm.is_open:
                        self._tell(ArmReceived(at_ms, arm.is_open.index(True)), now_ms)


class Bench:
    """A port and a guarded vehicle of one generation, in ticks of a second, as a flight runs them."""

    def __init__(
        self,
        generation: Generation,
        drift_m_s: Place = (0.0, 0.0),
        *,
        guards: GuardOptions = GUARDS,
        is_real: bool = True,
        fault: VehicleFault = VehicleFault.NONE,
        safety: Safety | None = None,
    ) -> None:
        """`safety` in place of that of the guards."""
        flown = scenario(generation, drift_m_s, guards)
        flown = replace(flown, apad=replace(flown.apad, fault=fault))
        safety = safety or safety_of(flown, needs_person=is_real)
        battery_v = flown.apad.battery.range_v
        capabilities = stack_of(generation).capabilities(4)
        self.link: LinkToA | LinkToB
        if generation is Generation.A:
            self.link = LinkToA(
                flown,
                lambda: GenerationACore(
                    ReportedDocks(range(1, 10)), battery_v, "run", takes_back=not is_real, gate=safety.gate
                ),
            )
        else:
            docking, misses = flown.mission.docking, Misses(1, 0.0)
            self.link = LinkToB(
                flown,
                lambda: GenerationBCore(
                    BenchDocks(range(1, 10), misses),
                    battery_v,
                    docking,
                    takes_back=not is_real,
                    gate=safety.gate,
                ),
            )
        self.vehicle = GuardedVehicle(self.link, safety, obeys_speed=capabilities.obeys_speed)
        self.port = DockingPort(flown.mission.docking, capabilities=capabilities)
        self.now_ms = 0
        self.events: list[tuple[int, str, dict[str, Any]]] = []
        self.outcomes: list[Outcome] = []
        self.facts: list[LinkFact] = []
        self._ids = 0
        self.run(1)

    @property
    def observer(self) -> Observer:
        return self.link.observer

    def go(self, north_m: float, east_m: float, speed_m_s: float = 0.5) -> None:
        self.order(lambda it: GoTo(it, north_m, east_m, speed_m_s, 0.5))

    def hold(self, north_m: float, east_m: float) -> None:
        self.order(lambda it: Hold(it, north_m, east_m))

    def dock(self, dock_index: int, agent_id: int) -> None:
        self.order(lambda it: CloseDock(it, dock_index, agent_id))

    def undock(self, dock_index: int, agent_id: int) -> None:
        self.order(lambda it: OpenDock(it, dock_index, agent_id))

    def order(self, primitive: Callable[[int], Primitive]) -> None:
        self._ids += 1
        self.give(primitive(self._ids))

    def give(self, primitive: Primitive) -> None:
        self._pass_on(self.port.receive(primitive, self.now_ms))
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
                self.facts.append(fact)
                if not hasattr(fact, "agent_id") or hasattr(fact, "dock_index"):
                    self._pass_on(self.port.receive(fact, self.now_ms))  # type: ignore[arg-type]
        self._pass_on(self.port.advance(self.now_ms))
        self.events += [(self.now_ms, it.kind, it.data) for it in self.vehicle.gate.take_events()]

    def _pass_on(self, actions: list[VehicleCommand | Outcome]) -> None:
        for action in actions:
            if isinstance(action, Outcome):
                self.outcomes.append(action)
            else:
                self.vehicle.command(action, self.now_ms)


# The faults. Each begins while the vehicle is under way to a place inside the fence, or in a docking.


def moved(pose: Pose, off_m: Place) -> Pose:
    return replace(pose, north_m=pose.north_m + off_m[0], east_m=pose.east_m + off_m[1])


def shift(bench: Bench, published: Any) -> None:
    """From now on it publishes this in place of the truth."""
    bench.link.shift = published


def frozen_position(bench: Bench, rng: random.Random) -> None:
    """The last position is repeated with fresh stamps, and the vehicle goes on and on."""
    last = bench.link.pose
    bench.link.shift = lambda pose, at_ms: truly(last, at_ms)
    bench.link.push(Steer(0.5, 0.0, 0.0))


def jumping_position(bench: Bench, rng: random.Random) -> None:
    off_m = (rng.uniform(12, 25) * rng.choice((-1, 1)), rng.uniform(12, 25) * rng.choice((-1, 1)))
    since_ms = bench.now_ms

    def shift(pose: Pose, at_ms: int) -> PoseReported | None:
        is_far = (at_ms - since_ms) // 4_000 % 2 == 0
        return truly(moved(pose, off_m) if is_far else pose, at_ms)

    bench.link.shift = shift
    bench.observer.bad_from_ms = bench.now_ms + 1_000


def wrong_origin(bench: Bench, rng: random.Random) -> None:
    """The vehicle starts its positioning again about another origin, some hundred metres off."""
    off_m = (rng.uniform(100, 900), rng.uniform(-900, -100))
    bench.link.shift = lambda pose, at_ms: truly(moved(pose, off_m), at_ms)


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
    "NaN position": Fault(
        lambda bench, rng: shift(bench, lambda pose, at_ms: truly(moved(pose, (math.nan, math.nan)), at_ms))
    ),
    "frozen position": Fault(frozen_position),
    "jumping position": Fault(jumping_position),
    "silent position": Fault(lambda bench, rng: shift(bench, lambda pose, at_ms: None)),
    "wrong origin": Fault(wrong_origin),
    # Its controllers are off.
    "current across the fence": Fault(lambda bench, rng: bench.link.push(Coast()), drift_m_s=(0.35, 0.2)),
    "primitive that never ends": Fault(endless_primitive),
    "pilot": Fault(pilot),
    "pilot in a docking": Fault(pilot, in_docking),
}


def is_safe(bench: Bench, since_ms: int) -> bool:
    called = any(at_ms >= since_ms and data.get("calls_pilot") for at_ms, _, data in bench.events)
    reacted = any(at_ms >= since_ms and kind == "guard" for at_ms, kind, _ in bench.events)
    held = any(isinstance(it, PrimitiveFailed) and it.at_ms >= since_ms for it in bench.outcomes)
    return called or bench.observer.pilot_steers or ((reacted or held) and bench.link.is_at_rest)


def _far_from_start(rng: random.Random) -> Place:
    while True:
        place_m = rng.uniform(4, SIDE_M - 4), rng.uniform(4, SIDE_M - 4)
        if math.dist(place_m, START_M) > AWAY_M:
            return place_m


def place_of(pose: Pose) -> Place:
    return pose.north_m, pose.east_m
