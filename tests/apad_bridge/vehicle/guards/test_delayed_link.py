"""The guards beyond a link that delays and loses: no alarm without a cause, and each with one."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from stack_benches import Bench, real_limits

from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.outcomes import DockChanged, PrimitiveFailed, PrimitiveSucceeded
from apad_bridge.vehicle.stack_messages import BatteryReceived
from apad_bridge.vehicle.vehicle_link import LinkFact
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.apad.motion import Steer

BOTH = (Generation.A, Generation.B)
LOSS = 0.05
DELAY_MS = (200, 2_000)
CALL_MS = 1_200
AHEAD_MS = 7_000
"""The vehicle's clock is so far ahead of the bench's."""


class DelayedCore:
    """A core at the bench's end of a link. In front of it are a topic's connections, behind it those of its orders.

    A packet takes 0.2 s; a lost one is sent again, and takes up to 2 s with all that follows on its connection. A reading
    may be lost for good, as where a publisher's queue is full. Whatever comes has the tick of its arrival as its time.
    """

    def __init__(self, core: Any, rng: random.Random) -> None:
        self._core = core
        self._rng = rng
        self._now_ms = 0
        self._on_the_way: list[tuple[int, Any]] = []
        self._orders: list[tuple[int, Any]] = []
        self._free_ms: dict[Any, int] = defaultdict(int)

    def receive(self, message: Any, now_ms: int) -> None:
        is_reading = isinstance(message, PoseReported | BatteryReceived)
        if not (is_reading and self._rng.random() < LOSS):
            self._on_the_way.append((self._arrival_ms(type(message), message.at_ms), message))

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._now_ms = now_ms
        for message in self._come(self._on_the_way):
            self._core.receive(replace(message, at_ms=now_ms), now_ms)
        return self._core.advance(now_ms)

    def command(self, command: Any, now_ms: int) -> None:
        """Orders go out at a later tick, from `take_orders` or `take_calls`."""
        if (order := self._core.command(command, now_ms)) is not None:
            self._send(order)

    def take_orders(self) -> list[Any]:
        for order in self._core.take_orders():
            self._send(order)
        return list(self._come(self._orders))

    def take_off_order(self) -> Any:
        """Services of generation A, in which nothing here is late."""
        return self._core.take_off_order()

    def take_calls(self) -> list[Any]:
        for call in self._core.take_calls():
            self._send(call)
        return list(self._come(self._orders))

    def _send(self, order: Any) -> None:
        self._orders.append((self._arrival_ms("orders", self._now_ms), order))

    def _arrival_ms(self, connection: Any, sent_ms: int) -> int:
        """A call first makes a connection."""
        is_order = connection == "orders"
        is_late = is_order or self._rng.random() < 2 * LOSS
        delay_ms = max(self._rng.randint(*DELAY_MS) if is_late else DELAY_MS[0], CALL_MS * is_order)
        self._free_ms[connection] = max(self._free_ms[connection], sent_ms + delay_ms)
        return self._free_ms[connection]

    def _come(self, items: list[tuple[int, Any]]) -> Iterator[Any]:
        come = [it for it in items if it[0] <= self._now_ms]
        items[:] = [it for it in items if it[0] > self._now_ms]
        return (item for _, item in sorted(come, key=lambda it: it[0]))


def stamped(pose: Pose, at_ms: int) -> PoseReported:
    return PoseReported(at_ms, pose.north_m, pose.east_m, pose.heading_rad, at_ms + AHEAD_MS)


def bench_of(generation: Generation, seed: int, guards: GuardOptions | None = None) -> Bench:
    """A bench beyond the link, which has heard the vehicle for a while."""
    bench = Bench(generation, guards=guards or real_limits())
    bench.link.shift = stamped
    bench.link.core = DelayedCore(bench.link.core, random.Random(seed))  # type: ignore[assignment]
    bench.run(10)
    return bench


def run_to_end(bench: Bench) -> Any:
    """The outcome of the primitive under way."""
    count, ended = len(bench.outcomes), list[Any]()
    for _ in range(120):
        if not ended:
            bench.run(1)
            ended = [
                it for it in bench.outcomes[count:] if isinstance(it, PrimitiveSucceeded | PrimitiveFailed)
            ]
    return ended[0]


@pytest.mark.parametrize("generation", BOTH)
@pytest.mark.parametrize("seed", range(8))
def test_a_service_is_flown_by_the_real_apad_s_limits(generation: Generation, seed: int) -> None:
    bench = bench_of(generation, seed)
    places_m = [(42.0, 38.0), bench.dock, (20.0, 35.0), bench.undock, (30.0, 30.0)]
    for it in places_m:
        bench.go(*it) if isinstance(it, tuple) else it(2, 7)
        assert isinstance(run_to_end(bench), PrimitiveSucceeded)
    assert [it.closed for it in bench.outcomes if isinstance(it, DockChanged)] == [True, False]
    assert bench.events == []


@pytest.mark.parametrize("generation", BOTH)
@pytest.mark.parametrize("seed", range(4))
def test_a_vehicle_at_its_greatest_speed_is_not_too_fast(generation: Generation, seed: int) -> None:
    bench = bench_of(generation, seed, replace(real_limits(), speed_limit_m_s=0.5))
    bench.go(50.0, 50.0)
    assert isinstance(run_to_end(bench), PrimitiveSucceeded) and bench.events == []


def frozen(bench: Bench) -> None:
    bench.link.shift = lambda pose, at_ms, last=bench.link.pose: stamped(last, at_ms)  # type: ignore[misc]


def too_fast(bench: Bench) -> None:
    bench.link.push(Steer(1.0, 0.7, 0.0))


@pytest.mark.parametrize("generation", BOTH)
@pytest.mark.parametrize(("inflict", "cause"), [(frozen, "position"), (too_fast, "speed")])
@pytest.mark.parametrize("seed", range(4))
def test_what_has_a_cause_is_noticed_within_3_s_and_the_link_s_delay(
    generation: Generation, inflict: Callable[[Bench], None], cause: str, seed: int
) -> None:
    bench = bench_of(generation, seed, replace(real_limits(), speed_limit_m_s=0.6))
    bench.go(50.0, 50.0)
    bench.run(12)
    assert bench.events == []
    inflict(bench)
    bench.run(3 + DELAY_MS[1] // 1_000)
    assert [data["cause"] for _, kind, data in bench.events if kind == "guard"][:1] == [cause]
