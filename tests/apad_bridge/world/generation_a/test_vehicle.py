"""Our simulated aPad shows the behaviour that was observed of generation A's published stack."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from flying import play
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.generation_a.messages import GO_TO, PERCH, RELEASE, GoalOrder
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_a.simulated_messages import (
    BatteryAndProgressPublished,
    GoalEnded,
    GoalOutcome,
    HeldPositionPublished,
    Published,
)
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.simulated_stack import PosePublished

POOL = load(POOL_FILE)
NORTH_M, EAST_M = POOL.apad.start_m


def vehicle(start_ms: int = 0, fault: Fault = Fault.NONE) -> GenerationAVehicle:
    made = GenerationAVehicle(SimulatedAPad(POOL.apad), 0.5, 0.5, start_ms, fault)
    made.advance(start_ms)
    return made


def go_to(key: str, north_m: float, east_m: float = EAST_M) -> GoalOrder:
    return GoalOrder(key, GO_TO, north_m, east_m, "")


def perch(name: str) -> GoalOrder:
    return GoalOrder(f"perch {name}", PERCH, 0.0, 0.0, name)


def release(name: str) -> GoalOrder:
    return GoalOrder(f"release {name}", RELEASE, 0.0, 0.0, name)


def ends(published: list[Published]) -> list[tuple[str, GoalOutcome]]:
    return [(it.key, it.outcome) for it in published if isinstance(it, GoalEnded)]


def held(published: list[Published]) -> list[HeldPositionPublished]:
    return [it for it in published if isinstance(it, HeldPositionPublished)]


class Watched:
    """A vehicle of a transcript, whose places are metres from where it began. A line's answer is all that it publishes."""

    def __init__(self, fault: Fault = Fault.NONE) -> None:
        self.apad = vehicle(fault=fault)
        self.now_ms = 0

    def answer(self, move: str) -> str:
        name, *words = move.split()
        try:
            return self.done(name, words)
        except ValueError as error:
            return str(error)

    def done(self, name: str, words: list[str]) -> str:
        apad, now_ms = self.apad, self.now_ms
        if name == "battery":
            apad.change_battery(float(words[0]), now_ms)
        if name == "advance":
            self.now_ms = round(1000 * float(words[0]))
        is_on, whom = words == ["on"], " ".join(words)
        published: dict[str, Callable[[], list[Published]]] = {
            "go": lambda: apad.receive(
                go_to(words[0], NORTH_M + float(words[1]), EAST_M + float((*words, "0")[2])), now_ms
            ),
            "perch": lambda: apad.receive(perch(whom), now_ms),
            "release": lambda: apad.receive(release(whom), now_ms),
            "unknown": lambda: apad.receive(GoalOrder("what", 7, 0.0, 0.0, ""), now_ms),
            "cancel": lambda: apad.cancel(words[0], now_ms),
            "velocity": lambda: apad.enable_velocity_control(is_on, now_ms),
            "position": lambda: apad.enable_position_control(is_on, now_ms),
            "axes": lambda: apad.configure_axes([2, 2, 0, 0, 0, 0], now_ms),
            "dock": lambda: apad.set_dock(int(words[0]), words[1] == "closes", now_ms),
            "advance": lambda: apad.advance(self.now_ms),
        }
        seen: dict[str, Callable[[], str]] = {
            "battery": lambda: f"{apad.battery_percent:g}",
            "at": lambda: f"{apad.pose.north_m - NORTH_M:.1f}, {apad.pose.east_m - EAST_M:.1f}",
            "see": lambda: str(getattr(apad, words[0])),
        }
        return seen[name]() if name in seen else shown(published[name]())


def shown(published: list[Published]) -> str:
    """Goals that ended with their times; of all else that was published, how often, and the newest."""
    found = {
        str(it): f"{it.key} {it.outcome.name.lower()} at {it.at_ms / 1000:g}"
        for it in published
        if isinstance(it, GoalEnded)
    }
    for it in published:
        if isinstance(it, HeldPositionPublished):
            place = f"{it.north_m - NORTH_M:.1f}, {it.east_m - EAST_M:.1f}"
            newest = f"{it.name} {'released' if it.released else 'held'} at {it.at_ms / 1000:g} s: {place}"
            found[it.name] = f"{sum(other.name == it.name for other in held(published))} x {newest}"
        if isinstance(it, BatteryAndProgressPublished) and it.goal_key:
            begun = found.get(it.goal_key, f"{it.goal_key} {it.covered_percent:.0f} %").partition(" to ")[0]
            found[it.goal_key] = f"{begun} to {it.covered_percent:.0f} %"
    return "; ".join(found.values())


STORIES: dict[str, tuple[Fault, str]] = {
    # 5 m at 0.5 m/s, half a metre early, half a second for the mean, and the start from rest.
    "a go-to succeeds once the mean distance of a second is below the radius": (
        Fault.NONE,
        """
        go there 5 |
        advance 30 | there succeeded at 10.3; there 3 % to 92 %
        """,
    ),
    # It cannot turn on the spot.
    "feedback is the percentage covered, and negative farther away": (
        Fault.NONE,
        """
        go east 0 6 |
        advance 5   | east 3 % to 35 %
        go back 0 0 | east preempted at 5
        advance 6   | back -17 % to -17 %
        advance 30  | back succeeded at 12; back -19 % to 64 %
        """,
    ),
    "a cancelled go-to is pre-empted and keeps moving": (
        Fault.NONE,
        """
        go there 5   |
        advance 2    | there 3 % to 12 %
        cancel there | there preempted at 2
        advance 30   |
        at           | 5.0, 0.0
        """,
    ),
    # By its source, velocity control that comes on sets no axis.
    "a goal without controllers stays active, and the next go-to turns both on": (
        Fault.NONE,
        """
        go far 1000    |
        advance 10     | far 0 % to 0 %
        velocity off   |
        position off   |
        advance 100    | far 0 % to 1 %
        at             | 6.6, 0.0
        velocity on    |
        advance 130    | far 1 % to 1 %
        at             | 6.6, 0.0
        go next 12     | far preempted at 130
        advance 160    | next succeeded at 141.1; next 3 % to 94 %
        see has_thrust | True
        """,
    ),
    "controllers that come on again steer to the old reference, though its goal is cancelled": (
        Fault.NONE,
        """
        go far 1000  |
        advance 10   | far 0 % to 0 %
        cancel far   | far preempted at 10
        velocity off |
        advance 60   |
        at           | 6.6, 0.0
        axes on      |
        advance 80   |
        at           | 16.2, 0.0
        """,
    ),
    "a perch asks for no nearness and takes the first free dock": (
        Fault.NONE,
        """
        perch amussel0   | perch amussel0 succeeded at 0; 1 x amussel0 held at 0 s: -0.1, -0.1
        perch amussel1   | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, 0.1
        perch amussel2   | perch amussel2 succeeded at 0; 1 x amussel2 held at 0 s: 0.1, -0.1
        perch amussel3   | perch amussel3 succeeded at 0; 1 x amussel3 held at 0 s: 0.1, 0.1
        release amussel1 | release amussel1 succeeded at 0; 1 x amussel1 released at 0 s: -0.1, 0.1
        perch amussel9   | perch amussel9 succeeded at 0; 1 x amussel9 held at 0 s: -0.1, 0.1
        see held         | ['amussel0', 'amussel9', 'amussel2', 'amussel3']
        """,
    ),
    "the same object perched twice takes two docks": (
        Fault.NONE,
        """
        perch amussel1 | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, -0.1
        perch amussel1 | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, 0.1
        see free_docks | [2, 3]
        """,
    ),
    "what is held is told at 20 Hz and follows the vehicle": (
        Fault.NONE,
        """
        perch amussel1 | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, -0.1
        go there 5     |
        advance 0.05   | 1 x amussel1 held at 0.05 s: -0.1, -0.1
        advance 0.099  |
        advance 0.1    | 1 x amussel1 held at 0.1 s: -0.1, -0.1
        advance 30     | there succeeded at 10.3; 598 x amussel1 held at 30 s: 4.9, -0.1; there 3 % to 92 %
        """,
    ),
    "a release has a last message and a result, and one of what is not held is aborted": (
        Fault.NONE,
        """
        perch amussel1   | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, -0.1
        release          | release  aborted at 0
        release amussel2 | release amussel2 aborted at 0
        see held         | ['amussel1']
        advance 1.02     | 20 x amussel1 held at 1 s: -0.1, -0.1
        release amussel1 | release amussel1 succeeded at 1.02; 1 x amussel1 released at 1.02 s: -0.1, -0.1
        advance 3        |
        """,
    ),
    "a silent release lets go without a message": (
        Fault.RELEASE_SILENT,
        """
        perch amussel1   | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, -0.1
        release amussel1 |
        advance 3        |
        perch amussel2   | perch amussel2 succeeded at 3; 1 x amussel2 held at 3 s: -0.1, -0.1
        """,
    ),
    "a crash in release silences all that is held, and the goals": (
        Fault.RELEASE_CRASHES,
        """
        perch amussel1   | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, -0.1
        perch amussel2   | perch amussel2 succeeded at 0; 1 x amussel2 held at 0 s: -0.1, 0.1
        release amussel1 |
        advance 2        |
        go there 0       |
        see dropped      | Counter({'goal: the action server has crashed': 1})
        """,
    ),
    "a goal of an unknown kind is active until pre-empted": (
        Fault.NONE,
        """
        unknown    |
        advance 60 | what 0 % to 0 %
        go there 0 | what preempted at 60
        """,
    ),
    "a person may open a dock but not close one": (
        Fault.NONE,
        """
        perch amussel1 | perch amussel1 succeeded at 0; 1 x amussel1 held at 0 s: -0.1, -0.1
        dock 1 closes  | a dock closes by a perch, which names what it holds
        dock 1 opens   | dock 1 is open
        dock 0 opens   | 1 x amussel1 released at 0 s: -0.1, -0.1
        see free_docks | [0, 1, 2, 3]
        """,
    ),
    "its battery can be charged and drained by percent points": (
        Fault.NONE,
        """
        battery -30 | 70
        battery 10  | 80
        battery 50  | 100
        battery nan | 100
        see dropped | Counter({'charging or draining: percent_points is outside -100 to 100': 1})
        """,
    ),
}


@pytest.mark.parametrize(("fault", "story"), STORIES.values(), ids=STORIES)
def test_story(fault: Fault, story: str) -> None:
    play(story, Watched(fault).answer)


def test_a_crash_in_release_does_not_silence_the_position() -> None:
    apad = vehicle(fault=Fault.RELEASE_CRASHES)
    apad.receive(perch("amussel1"), 0)
    apad.receive(release("amussel1"), 0)
    told_ms = [it.at_ms for it in apad.advance(2_000) if isinstance(it, PosePublished)]
    assert told_ms == list(range(100, 2_100, 100))


def under_way(drift_m_s: tuple[float, float] = (0.0, 0.0)) -> GenerationAVehicle:
    """Ten seconds into a long go-to to the north, at 0.5 m/s."""
    apad = GenerationAVehicle(SimulatedAPad(replace(POOL.apad, drift_m_s=drift_m_s)), 0.5, 0.5)
    apad.receive(go_to("far", NORTH_M + 1_000), 0)
    apad.advance(10_000)
    assert apad.pose.north_m_s == pytest.approx(0.5)
    return apad


@pytest.mark.parametrize("way", ["velocity", "position", "axes"])
def test_controllers_off_let_it_coast_by_its_drag_and_then_drift_with_the_water(way: str) -> None:
    """Quadratic drag from v to w takes m/k ln(v/w) metres; below 0.02 m/s the vehicle counts as at rest."""
    apad = under_way(drift_m_s=(0.03, -0.1))
    off = {
        "velocity": lambda: apad.enable_velocity_control(False, 10_000),
        "position": lambda: apad.enable_position_control(False, 10_000),
        "axes": lambda: apad.configure_axes([0, -1, 0, 0, 0, 0], 10_000),
    }
    begin = apad.pose
    assert ends(off[way]()) == [] and not apad.has_thrust
    apad.advance(310_000)
    coasted_m = POOL.apad.mass_kg / POOL.apad.drag_n_per_m2_s2 * math.log(0.5 / 0.02)
    assert apad.pose.north_m - begin.north_m == pytest.approx(coasted_m + 300 * 0.03, rel=0.05)
    assert apad.pose.east_m - begin.east_m == pytest.approx(-300 * 0.1, abs=1e-6)
    assert apad.pose.speed_m_s == 0.0


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 20_000), max_size=12))
def test_how_time_is_cut_never_shows(cuts: list[int]) -> None:
    orders = {0: perch("amussel1"), 1_730: go_to("there", NORTH_M + 3), 9_000: release("amussel1")}

    def flown(instants: set[int]) -> list[Published]:
        apad, published = vehicle(), []
        for at_ms in sorted(instants | set(orders)):
            published += apad.receive(orders[at_ms], at_ms) if at_ms in orders else apad.advance(at_ms)
        return published + apad.advance(20_000)

    assert flown(set(cuts)) == flown(set())


@pytest.mark.parametrize("docks", [1, 4, 6])
def test_it_holds_as_many_as_it_has_docks_and_one_more_perch_succeeds_and_does_nothing(docks: int) -> None:
    apad = GenerationAVehicle(SimulatedAPad(replace(POOL.apad, docks=docks)), 0.5, 0.5)
    for number in range(docks + 1):
        ended = apad.receive(GoalOrder(f"{number}", PERCH, 0.0, 0.0, f"amussel{number}"), 0)
        assert GoalEnded(0, f"{number}", GoalOutcome.SUCCEEDED) in ended
    assert apad.held == [f"amussel{number}" for number in range(docks)] and apad.free_docks == []
    assert {it.name for it in held([*ended, *apad.advance(2_000)])} == set(apad.held)
    with pytest.raises(ValueError, match=f"there is no dock {docks}"):
        apad.set_dock(docks, False, 0)
