"""The bench's look at the vehicle's own watchdog: when its loss is told, and when it is a stop."""

from __future__ import annotations

from dataclasses import replace

import pytest
from stack_benches import real_limits, scenario

from apad_bridge.assembly.safety import safety_of
from apad_bridge.events.guard_events import GuardReacted, StopChanged, WatchdogTold
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.guard_options import WhenUnwatched
from apad_bridge.vehicle.commands import GoTo, Hold, PoseReported
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.guards.watchdog_watch import WatchdogWatch
from tests.apad_bridge.vehicle.guards.test_gate import Wire


def faults(watch: WatchdogWatch, *said_by_second: str | None) -> list[str]:
    """The fault after each second's state; None for a second without one."""
    found = []
    for second, said in enumerate(said_by_second):
        watch.look([] if said is None else [said], 1_000 * second)
        found.append(watch.fault)
    return found


def test_a_watchdog_that_was_never_seen_to_watch_is_missed_only_where_it_is_demanded() -> None:
    assert faults(WatchdogWatch(), *["WAITING"] * 60) == [""] * 60
    demanded = faults(WatchdogWatch(is_demanded=True), *[None] * 17)
    assert demanded == [""] * 16 + ["the vehicle's watchdog is silent"]
    waiting = faults(WatchdogWatch(is_demanded=True), *["WAITING"] * 17)
    assert waiting[15:] == ["", "the vehicle's watchdog says 'WAITING'"]


@pytest.mark.parametrize(
    ("after", "told"),
    [(None, "the vehicle's watchdog is silent"), ("HELD", "the vehicle's watchdog says 'HELD'")],
)
def test_one_that_was_seen_is_missed_15_s_after_it_watched_last(after: str | None, told: str) -> None:
    found = faults(WatchdogWatch(), "WAITING", "WATCHING", "WATCHING", *[after] * 16, "WATCHING")
    assert found == [""] * 18 + [told, ""]


def test_gaps_of_a_poor_link_and_a_new_start_are_no_loss() -> None:
    gap = [None] * 14
    states = ["WATCHING", *gap, "WATCHING", *gap, "WAITING", "WAITING", "WATCHING"]
    watch = WatchdogWatch()
    assert faults(watch, *states[:-3]) == [""] * (len(states) - 3)
    assert faults(watch, *[None]) == [""]


def test_another_node_s_long_text_does_not_flood_the_terminal() -> None:
    watch = WatchdogWatch(is_demanded=True)
    faults(watch, *["\x1b[31m" + "x" * 5_000] * 20)
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

    def told(self) -> list[bool]:
        return [it.watches for it in self.events if isinstance(it, WatchdogTold)]


@pytest.mark.parametrize("reaction", [None, WhenUnwatched.TELL])
def test_a_lost_watchdog_is_an_alarm_and_the_aPad_goes_on(reaction: WhenUnwatched | None) -> None:
    flight = Flight(reaction)
    flight.seconds(18, None)
    assert flight.told() == [False] and not flight.vehicle.gate.awaits_person
    (alarm,) = (it for it in flight.events if isinstance(it, WatchdogTold))
    assert "nothing stops the aPad" in alarm.text()
    flight.seconds(2, "WATCHING")
    assert flight.told() == [False, True]
    assert not any(isinstance(it, StopChanged) for it in flight.events)


def test_where_the_scenario_wants_it_the_aPad_holds_until_a_person_continues() -> None:
    flight = Flight(WhenUnwatched.HOLD)
    flight.seconds(15, None)
    assert not any(isinstance(it, Hold) for it in flight.wire.out)
    flight.seconds(3, None)
    assert isinstance(flight.wire.out[-1], Hold)
    (reacted,) = (it for it in flight.events if isinstance(it, GuardReacted))
    assert (reacted.cause, reacted.reaction) == ("watchdog", "hold")
    assert "guard: watchdog" in flight.vehicle.gate.awaits_person
    # A person who continues without it has decided so: it is not held again for the same loss.
    flight.vehicle.allow_motion("Anna", flight.now_ms)
    flight.seconds(30, None)
    assert not flight.vehicle.gate.awaits_person


def test_a_simulated_vehicle_needs_no_watchdog() -> None:
    limits = replace(real_limits(), watchdog=WhenUnwatched.HOLD)
    gate = safety_of(scenario(Generation.B, guards=limits)).gate
    for second in range(60):
        gate.hear_watchdog([], 1_000 * second)
    assert gate.situation(60_000).watchdog_fault == ""
