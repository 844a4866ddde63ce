"""The bench's look at the vehicle's own watchdog: when its loss is told, and when it is a stop."""

from __future__ import annotations

from dataclasses import replace

import pytest
from stack_benches import real_limits, scenario

from apad_bridge.assembly.safety import safety_of
from apad_bridge.events.guard_events import GuardReacted, StopChanged, WatchdogReported
from apad_bridge.scenario.blocks.guard_options import WhenUnwatched
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.commands import GoTo, Hold, PoseReported
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.guards.watchdog_watch import WatchdogWatch
from tests.apad_bridge.vehicle.guards.test_gate import Wire

SILENT = "the vehicle's watchdog is silent"
GAP: list[str | None] = [None] * 14
SAID: dict[str, tuple[bool, list[str | None], list[str]]] = {
    # Is it demanded; its states by second, None for a second without one; the fault after each.
    "one that was never seen to watch is not missed": (False, ["WAITING"] * 60, [""] * 60),
    "one that is demanded and silent is missed after 16 s": (True, [None] * 17, [*[""] * 16, SILENT]),
    "one that is demanded and waits is missed after 16 s": (
        True,
        ["WAITING"] * 17,
        [*[""] * 16, "the vehicle's watchdog says 'WAITING'"],
    ),
    **{
        f"one that was seen and then says {after} is missed 15 s after it watched last": (
            False,
            ["WAITING", "WATCHING", "WATCHING", *[after] * 16, "WATCHING"],
            [*[""] * 18, told, ""],
        )
        for after, told in {None: SILENT, "HELD": "the vehicle's watchdog says 'HELD'"}.items()
    },
    "gaps of a poor link are no loss": (False, ["WATCHING", *GAP, "WATCHING", *GAP], [""] * 30),
}


@pytest.mark.parametrize(("is_demanded", "said", "faults"), SAID.values(), ids=SAID)
def test_when_the_watchdog_is_missed(is_demanded: bool, said: list[str | None], faults: list[str]) -> None:
    watch, found = WatchdogWatch(is_demanded=is_demanded), []
    for second, it in enumerate(said):
        watch.look([] if it is None else [it], 1_000 * second)
        found.append(watch.fault)
    assert found == faults


def test_another_node_s_long_text_does_not_flood_the_terminal() -> None:
    watch = WatchdogWatch(is_demanded=True)
    for second in range(20):
        watch.look(["\x1b[31m" + "x" * 5_000], 1_000 * second)
    assert len(watch.fault) < 80 and "\x1b" not in watch.fault


class Flight:
    """A real vehicle that is on its way at 0.5 m/s, with this reaction to the loss of its watchdog."""

    def __init__(self, reaction: WhenUnwatched | None) -> None:
        limits = replace(real_limits(), watchdog=reaction)
        safety = safety_of(scenario(Generation.B, guards=limits), needs_person=True)
        self.wire = Wire()
        self.vehicle = GuardedVehicle(self.wire, safety)
        self.events: list[object] = []
        self.now_ms = 0
        self.seconds(1, "WATCHING")
        self.vehicle.command(GoTo(1, 20.0, 45.0, 0.5, 0.5), 0)

    def seconds(self, count: int, said: str | None) -> None:
        for _ in range(count):
            self.now_ms += 1_000
            pose = PoseReported(self.now_ms, 20.0, 10.0 + self.now_ms / 2_000, 0.0, self.now_ms)
            self.wire.facts.append(pose)
            self.vehicle.advance(self.now_ms)
            self.vehicle.gate.hear_watchdog([] if said is None else [said], self.now_ms)
            self.events += self.vehicle.gate.take_events()


@pytest.mark.parametrize("reaction", [None, WhenUnwatched.TELL])
def test_a_lost_watchdog_is_an_alarm_and_the_aPad_goes_on(reaction: WhenUnwatched | None) -> None:
    flight = Flight(reaction)
    flight.seconds(18, None)
    assert not flight.vehicle.gate.awaits_person
    flight.seconds(2, "WATCHING")
    alarm, relief = (it for it in flight.events if isinstance(it, WatchdogReported))
    assert (alarm.watches, relief.watches) == (False, True) and "nothing stops the aPad" in alarm.text()
    assert not any(isinstance(it, StopChanged) for it in flight.events)


def test_where_the_scenario_wants_it_the_aPad_holds_until_a_person_continues() -> None:
    flight = Flight(WhenUnwatched.HOLD)
    flight.seconds(15, None)
    held_early = any(isinstance(it, Hold) for it in flight.wire.out)
    flight.seconds(3, None)
    assert isinstance(flight.wire.out[-1], Hold) and not held_early
    (reacted,) = (it for it in flight.events if isinstance(it, GuardReacted))
    assert (reacted.cause, reacted.reaction) == ("watchdog", "hold")
    assert "guard: watchdog" in flight.vehicle.gate.awaits_person
    # A person who continues without it has decided so: it is not held again for the same loss.
    flight.vehicle.allow_motion("Anna", 1, flight.now_ms)
    flight.seconds(30, None)
    assert not flight.vehicle.gate.awaits_person


def test_a_simulated_vehicle_needs_no_watchdog() -> None:
    limits = replace(real_limits(), watchdog=WhenUnwatched.HOLD)
    gate = safety_of(scenario(Generation.B, guards=limits)).gate
    for second in range(60):
        gate.hear_watchdog([], 1_000 * second)
    assert gate.situation(60_000).watchdog_fault == ""
