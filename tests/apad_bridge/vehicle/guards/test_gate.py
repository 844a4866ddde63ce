"""The gate at the end of every road: what reaches the vehicle, by an observer that shares no code with the guards."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stack_benches import FAULTS, Bench, LinkToA, is_safe, moved, place_of, real_limits, truly
from wire_observer import SIDE_M, TICK_MS

from apad_bridge.events.guard_events import (
    DangerOver,
    Drifting,
    GuardReacted,
    OrderRefused,
    OthersCommanded,
    Reaction,
    SteeringReported,
    StopChanged,
    StopKind,
    StopState,
)
from apad_bridge.scenario.area.fence import Fence
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    GoalOfOthers,
    GoTo,
    Hold,
    MoveArm,
    PilotReported,
    PoseReported,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.guards.fenced_waters import FencedWaters
from apad_bridge.vehicle.guards.gate import Gate, Safety
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.guards.guards import (
    BatteryForHome,
    InWaters,
    unlimited_guards,
)
from apad_bridge.vehicle.guards.monitor import (
    CanStopInWaters,
    EndsInTime,
    IsInWaters,
    MakesProgress,
    Monitor,
    PositionIsGood,
    SpeedIsAllowed,
    Stopping,
)
from apad_bridge.vehicle.guards.position_watch import PositionLimits, PositionWatch
from apad_bridge.vehicle.guards.stops import StopsEnded
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.apad.motion import Coast, Steer
from tests.apad_bridge.vehicle.guards.test_guards import WATERS

LIMITS = PositionLimits(age_ms=5_000, jump_m=10.0, speed_m_s=2.0)
REAL_LIMITS = replace(LIMITS, clock_step_ms=1_000, settled_ms=None)


class Wire:
    """A link that keeps what goes out, and reports acceptance, and the positions that it is told to report."""

    def __init__(self) -> None:
        self.takes = True
        """The vehicle takes what goes out."""
        self.newest_id = 0
        self.out: list[VehicleCommand] = []
        self.facts: list[LinkFact] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts, self.facts = self.facts, []
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        self.out.append(command)
        self.newest_id = command.command_id
        if isinstance(command, GoTo | Hold | Stop) and self.takes:
            self.facts.append(CommandAccepted(now_ms, command.command_id))

    def close(self) -> None:
        pass


class Guarded:
    """A vehicle in the U of the guards' tests, which is wherever it is put."""

    def __init__(
        self,
        *,
        is_real: bool = False,
        outside: Reaction = Reaction.HOLD,
        obeys_speed: bool = True,
        most_m_s: float = 2.0,
        place: tuple[float, float] | None = (5.0, 5.0),
        takes: bool = True,
    ) -> None:
        guards = [*unlimited_guards(), InWaters(WATERS, outside is Reaction.RETURN)]
        checks = [
            PositionIsGood(),
            IsInWaters(WATERS, outside),
            CanStopInWaters(WATERS, Stopping(0.5)),
            SpeedIsAllowed(most_m_s),
            EndsInTime(100.0),
            MakesProgress(),
        ]
        self.wire = Wire()
        self.wire.takes = takes
        watch = PositionWatch(REAL_LIMITS if is_real else LIMITS)
        safety = Safety(
            Gate(guards, watch, WATERS), Monitor(checks), WATERS, 0.5, is_real, lambda place, now: (0.1, 0.0)
        )
        self.vehicle, self.gate = GuardedVehicle(self.wire, safety, obeys_speed=obeys_speed), safety.gate
        self.now_ms = 0
        if place is not None:
            self.at(*place)
            self.gate.take_events()

    def at(
        self, north_m: float, east_m: float, *heard: LinkFact, ticks: int = 1, after_ms: int = 1_000
    ) -> list[LinkFact]:
        """The facts of ticks at which the vehicle is there, and was heard to tell of the others before."""
        self.wire.facts += heard
        facts: list[LinkFact] = []
        for _ in range(ticks):
            pose_ms = self.now_ms + after_ms
            self.wire.facts.append(PoseReported(pose_ms, north_m, east_m, 0.0, pose_ms))
            facts += self.silent(1, after_ms)
        return facts

    def silent(self, ticks: int, after_ms: int = 1_000) -> list[LinkFact]:
        facts: list[LinkFact] = []
        for _ in range(ticks):
            self.now_ms += after_ms
            facts += self.vehicle.advance(self.now_ms)
            self.note()
        return facts

    def note(self) -> None:
        """Nothing, after each tick and each stop: a bench that keeps a journal has more to do."""

    def command(self, command: VehicleCommand) -> list[VehicleCommand]:
        """What goes out because of it."""
        self.wire.out = []
        self.vehicle.command(command, self.now_ms)
        return self.wire.out

    def stop(self, *, off: bool = False, hands: bool = False) -> list[VehicleCommand]:
        """What goes out because a person stops the vehicle."""
        self.wire.out = []
        self.vehicle.stop("Anna", self.now_ms, off=off, hands=hands)
        self.note()
        return self.wire.out

    def continues(self, by: str = "Anna", **how: Any) -> None:
        """A person's word, after the stop that is in force now."""
        stop = self.gate.stops.in_force
        self.vehicle.allow_motion(by, None if stop is None else stop.number, self.now_ms, **how)

    def shown(self, act: Act) -> str:
        """What shows of an act: orders on the wire, primitives that failed, and the journal's lines of guards and stops."""
        self.wire.out = []
        answer = act(self)
        facts = answer if isinstance(answer, list) else []
        failed = [f"{it.command_id} failed" for it in facts if isinstance(it, CommandFailed)]
        events = [it for it in self.gate.take_events() if not isinstance(it, Drifting)]
        lines = [LINES.get(type(it), lambda it: it.kind)(it) for it in events]
        orders = [order_text(it) for it in self.wire.out]
        return "; ".join(
            [*orders, *failed, *lines, *([answer] if isinstance(answer, str) and answer else [])]
        )


Act = Callable[[Guarded], Any]


LINES: dict[type, Callable[[Any], str]] = {
    StopChanged: lambda it: f"{it.number} {it.mode} {it.state}",
    OrderRefused: lambda it: f"refused: {it.guard}",
    GuardReacted: lambda it: f"{it.kind}: {it.cause}",
    DangerOver: lambda it: f"{it.kind}: {it.cause}",
    SteeringReported: lambda it: f"{it.kind}: {it.steers}",
    OthersCommanded: lambda it: f"{it.kind}: {it.client}",
}


def order_text(order: VehicleCommand) -> str:
    place = f" ({order.north_m:g}, {order.east_m:g})" if isinstance(order, GoTo | Hold) else ""
    return type(order).__name__ + "!" * (isinstance(order, Hold) and order.pre_empts) + place


# What a person, the mission or the vehicle does, step by step.


def at(north_m: float, east_m: float = 5.0, *, ticks: int = 1) -> Act:
    return lambda it: it.at(north_m, east_m, ticks=ticks)


def hears(fact: Callable[..., LinkFact], *fields: object, north_m: float = 5.0) -> Act:
    """A tick at which the vehicle tells this, too."""
    return lambda it: it.at(north_m, 5.0, fact(it.now_ms, *fields))


def answers(fact: Callable[..., LinkFact], *reason: str, place_m: tuple[float, float] = (5.0, 5.3)) -> Act:
    """A tick at which the vehicle answers the newest order."""
    return lambda it: it.at(*place_m, fact(it.now_ms, it.wire.newest_id, *reason))


def silent(ticks: int) -> Act:
    return lambda it: it.silent(ticks)


def go(command_id: int, north_m: float, east_m: float = 5.0) -> Act:
    return lambda it: it.command(GoTo(command_id, north_m, east_m, 0.5, 0.5))


def orders(command: VehicleCommand) -> Act:
    return lambda it: it.command(command)


def stop(*, off: bool = False, hands: bool = False) -> Act:
    return lambda it: it.stop(off=off, hands=hands)


def continues(**how: Any) -> Act:
    """A person's word, after the stop that is in force then."""
    return lambda it: it.continues("Anna", **how)


def why_not(number: int | None = None) -> Act:
    return lambda it: it.gate.why_not_continue(number, it.now_ms)


def between(after_ms: int, *facts: Callable[[int], LinkFact]) -> Act:
    """A look so long after the last tick, between two, at which the link tells of these."""
    return lambda it: (
        it.wire.facts.extend(fact(it.now_ms + after_ms) for fact in facts),
        it.vehicle.look_between(it.now_ms + after_ms),
    )


def goes_back_in(it: Guarded) -> None:
    it.vehicle.go_back_in("Anna", "Bo", it.now_ms)


def slowly_east(it: Guarded) -> list[LinkFact]:
    """101 s at 0.2 m/s."""
    return [fact for n in range(101) for fact in it.at(5.0, 5.0 + n / 5)]


REAL = {"is_real": True}
SCENES: dict[str, tuple[dict[str, Any], list[tuple[Act, str]]]] = {
    "a refused order fails and does not go out": (
        {},
        [(go(1, 45.0), "refused: fence"), (at(5.0), "1 failed")],
    ),
    "a refused order holds a vehicle that is under way, once": (
        {},
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (at(5.5), ""),
            (go(2, 45.0), "Hold (5.5, 5); refused: fence"),
            (go(3, 45.0), "refused: fence"),
        ],
    ),
    "a hold that is refused ends the motion all the same, where the vehicle is": (
        {"place": (0.5, 5.0)},
        [(orders(Hold(1, -0.6, 5.0)), "Hold (0.5, 5)"), (orders(Hold(2, -3.0, 5.0)), "refused: fence")],
    ),
    "a stop goes through its states, and only then is the vehicle at rest": (
        REAL,
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (at(6.0), ""),
            (stop(), "Hold! (6, 5); 1 hold ordered; 1 hold sent"),
            (at(6.8), "1 failed; 1 hold taken"),
            (at(7.0, ticks=3), "1 hold obeyed; 1 hold at rest"),
        ],
    ),
    "a stop is off where the vehicle is outside": (
        REAL | {"place": (-3.0, 5.0)},
        [(continues(), "continued"), (stop(), "Stop; 2 off ordered; 2 off sent")],
    ),
    "a stop holds inside the fence though too near to it": (
        REAL | {"place": (0.5, 5.0)},
        [(stop(), "Hold! (0.5, 5); 1 hold ordered; 1 hold sent")],
    ),
    "a second stop is off, and nothing goes out until a person continues after it": (
        REAL,
        [
            (stop(), "Hold! (5, 5); 1 hold ordered; 1 hold sent"),
            (at(5.0), "1 hold taken; 1 hold obeyed"),
            (stop(), "Stop; 2 off ordered; 2 off sent"),
            (at(5.0), "2 off taken; 2 off obeyed"),
            (go(1, 6.0), "refused: person"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (orders(MoveArm(3, 0, False)), "refused: person"),
            (why_not(1), "stop 1 is not in force: stop 2 (off, by Anna) is in force"),
            (why_not(0), "name the stop: stop 2 (off, by Anna) is in force"),
            (why_not(2), ""),
            (why_not(), ""),
            (continues(), "continued"),
            (go(4, 6.0), "GoTo (6, 5)"),
        ],
    ),
    "hands at the docks latch off, and no other word than continue ends that": (
        REAL,
        [
            (stop(hands=True), "Stop; 1 off ordered; 1 off sent"),
            (continues(ends=StopsEnded.PERSONS_HOLD), ""),
            (at(5.0), "1 off taken; 1 off obeyed"),
            (orders(MoveArm(1, 0, True)), "refused: person"),
            (stop(), "Stop; 2 off ordered; 2 off sent"),
            (lambda it: str(it.gate.stops.in_force.stills_arms), "True"),
        ],
    ),
    "a hold that the vehicle does not take becomes off, which goes on until it is taken": (
        REAL | {"takes": False},
        [
            (stop(), "Hold! (5, 5); 1 hold ordered; 1 hold sent"),
            (at(5.0, ticks=6), "Stop; Stop; 1 hold not taken; 1 off ordered; 1 off sent; 1 off not taken"),
            (answers(CommandAccepted), "Stop; 1 off taken"),
        ],
    ),
    "an off that was lost on the way is given again until it is taken": (
        REAL | {"takes": False},
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (silent(6), "Stop; 1 failed; guard: position; 1 off ordered; 1 off sent"),
            (
                answers(CommandFailed, "its service did not answer"),
                "Stop; 1 off not taken; guard_over: position",
            ),
            (answers(CommandFailed, "its service did not answer"), "Stop"),
            (answers(CommandFailed, "its service did not answer"), "Stop"),
            (answers(CommandAccepted), "1 off taken; 1 off obeyed; 1 off at rest"),
            (at(5.0, 5.3, ticks=4), ""),
        ],
    ),
    "while a pilot steers nothing goes out, and one who lets go gives no word": (
        REAL,
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (hears(PilotReported, True), "1 failed; pilot: True"),
            (stop(), "1 hold refused"),
            (stop(off=True), "2 off refused"),
            (orders(Stop(3)), "refused: pilot"),
            (at(-3.0), "3 failed; guard: outside the fence"),
            (silent(6), "guard: position"),
            (why_not(), "the pilot has it: a pilot steers the aPad"),
            (continues(), ""),
            (
                hears(PilotReported, False),
                "pilot: False; guard_over: position; guard_over: outside the fence",
            ),
            (go(2, 6.0), "refused: person"),
        ],
    ),
    "the vehicle hears of a pilot who left by the word of a person who says so": (
        REAL,
        [(hears(PilotReported, True), "pilot: True"), (continues(pilot_left=True), "PilotLeft")],
    ),
    "where nobody can tell of a pilot nothing moves, and off still goes out": (
        REAL,
        [
            (hears(PilotReported, None), "pilot: None"),
            (hears(PilotReported, None), ""),
            (go(1, 6.0), "refused: pilot"),
            (stop(off=True), "Stop; 1 off ordered; 1 off sent"),
        ],
    ),
    "a bad position is off, and nothing moves when it is back": (
        REAL,
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (silent(6), "Stop; 1 failed; guard: position; 1 off ordered; 1 off sent"),
            (at(5.0, ticks=30), "1 off taken; guard_over: position; 1 off obeyed; 1 off at rest"),
            (orders(Hold(2, 5.0, 5.0)), ""),
            (go(3, 6.0), "refused: person"),
        ],
    ),
    "a simulated vehicle holds when its position is back": (
        {},
        [
            (go(1, 30.0), "GoTo (30, 5)"),
            (silent(6), "Stop; 1 failed; guard: position"),
            (at(5.0), "Hold (5, 5); guard_over: position"),
        ],
    ),
    "a position that goes silent is off between two ticks, within 250 ms": (
        REAL,
        [
            (go(1, 5.0, 8.0), "GoTo (5, 8)"),
            (at(5.0, 5.5), ""),
            *((between(ms), "") for ms in range(0, 5_001, 250)),
            (between(5_250), "Stop; guard: position; 1 off ordered; 1 off sent"),
        ],
    ),
    "facts from between two ticks wait for the next, and of positions the newest counts": (
        REAL,
        [
            (
                between(
                    250, lambda ms: PoseReported(ms, 5.0, 6.0, 0.0, ms), lambda ms: CommandFailed(ms, 11, "")
                ),
                "",
            ),
            (
                between(
                    500, lambda ms: PoseReported(ms, 5.0, 7.0, 0.0, ms), lambda ms: CommandFailed(ms, 12, "")
                ),
                "",
            ),
            (lambda it: str([fact.at_ms for fact in it.silent(1)]), "[1250, 1500, 1500]"),
        ],
    ),
    "a simulated vehicle is not looked at between two ticks": (
        {},
        [(between(500, lambda ms: CommandFailed(ms, 11, "")), ""), (lambda it: str(len(it.wire.facts)), "1")],
    ),
    "a jump is believed on a person's word alone": (
        REAL,
        [
            (
                at(5.0, 25.0, ticks=61),
                11 * "Stop; " + "guard: position; 1 off ordered; 1 off sent; 1 off taken",
            ),
            (
                lambda it: it.gate.situation(it.now_ms).position_fault,
                "the aPad's position is not believed: it has jumped by 20 m",
            ),
            (stop(), "Stop; 2 off ordered; 2 off sent"),
            (why_not(), ""),
            (continues(), "continued"),
            (lambda it: it.gate.situation(it.now_ms).position_fault, ""),
        ],
    ),
    "outside the fence a simulated vehicle is off and both ends are told": (
        {"place": (1.0, 5.0)},
        [
            (at(-1.0), "Stop; guard: outside the fence"),
            (go(1, 5.0), "refused: fence"),
            (at(-1.0), "1 failed"),
            (at(1.0), "guard_over: outside the fence"),
        ],
    ),
    "a real vehicle that had to be stopped waits for a person": (
        REAL | {"place": (1.0, 5.0)},
        [
            (at(-1.0), "Stop; guard: outside the fence; 1 off ordered; 1 off sent"),
            (at(1.0), "1 off taken; guard_over: outside the fence; 1 off obeyed"),
            (at(5.0), ""),
            (go(1, 6.0), "refused: person"),
            (continues(), "continued"),
            (go(2, 6.0), "GoTo (6, 5)"),
        ],
    ),
    "just outside a person with a lookout sends it back in, where the stop in force holds": (
        REAL | {"place": (1.0, 5.0)},
        [
            (at(-0.03), "Stop; guard: outside the fence; 1 off ordered; 1 off sent"),
            (
                why_not(),
                "the aPad at (-0.0 m north, 5.0 m east) lies 0.0 m outside the fence: bring it back first",
            ),
            (goes_back_in, "GoTo (1, 5); back_in"),
            (at(0.4), "1 off taken; guard_over: outside the fence"),
            (answers(Arrived, place_m=(1.0, 5.0)), "Stop"),
            (why_not(), ""),
            (go(1, 6.0), "refused: person"),
        ],
    ),
    "an aPad far outside is brought back by hand": (
        REAL | {"place": (-7.0, 5.0)},
        [
            (
                lambda it: it.gate.way_back(it.now_ms)[1],
                "the way back is 8.0 m long, the longest is 5 m: take it by hand",
            ),
            (goes_back_in, ""),
        ],
    ),
    "an aPad that obeys no speed is brought back by hand": (
        REAL | {"place": (-0.1, 5.0), "obeys_speed": False},
        [
            (
                lambda it: it.gate.way_back(it.now_ms)[1],
                "this aPad obeys no speed: bring it back by joystick",
            ),
            (goes_back_in, ""),
        ],
    ),
    "where the scenario wants it, it returns to the nearest place inside": (
        {"outside": Reaction.RETURN, "place": (1.0, 5.0)},
        [(at(-1.0), "GoTo (1, 5); guard: outside the fence")],
    ),
    "2.2 m before the fence at 1 m/s it comes to rest inside": (
        {"place": None},
        [(at(4.2), ""), (at(3.2), ""), (at(2.2), "")],
    ),
    "1.9 m before the fence at 1 m/s it would come to rest outside, and is held": (
        {"place": None},
        [(at(3.9), ""), (at(2.9), ""), (at(1.9), "Hold (1.9, 5); guard: fence ahead")],
    ),
    "a vehicle that obeys no speed is held when it is too fast": (
        {},
        [(at(5.0, 7.5), ""), (at(5.0, 10.0), "Hold (5, 10); guard: speed")],
    ),
    "a leg that lasts too long is ended": (
        {},
        [(go(1, 5.0, 30.0), "GoTo (5, 30)"), (slowly_east, "Hold (5, 25); 1 failed; guard: late")],
    ),
    "another client's goal outside the fence is ended, and its node named": (
        REAL,
        [
            (hears(CommandedByOthers, "/planner"), "others: /planner"),
            (
                hears(GoalOfOthers, "/planner", 90.0, 5.0),
                "Hold! (5, 5); guard: another client; 1 hold ordered; 1 hold sent",
            ),
            (
                lambda it: it.gate.awaits_person,
                "stop 1 (hold, by guard: another client) is in force: /planner ordered a go-to that leaves the waters: "
                "the goal (90.0 m north, 5.0 m east) lies 50.0 m outside the fence",
            ),
        ],
    ),
    "a goal that nobody heard is ended because nobody can tell where it leads": (
        REAL,
        [
            (
                hears(GoalOfOthers, "/planner", None, None),
                "Hold! (5, 5); guard: another client; 1 hold ordered; 1 hold sent",
            ),
            (
                lambda it: it.gate.awaits_person,
                "stop 1 (hold, by guard: another client) is in force: /planner sent a goal that was not heard: "
                "nobody can tell where it leads",
            ),
        ],
    ),
    "a goal to no place of any water is ended, for a simulated vehicle too": (
        {},
        [(hears(GoalOfOthers, "/planner", None, None, "no number"), "Hold (5, 5); guard: another client")],
    ),
    "a goal that nobody heard is no matter for a simulated vehicle": (
        {},
        [(hears(GoalOfOthers, "/planner", None, None), "")],
    ),
    "a client that orders again after a person's stop is stopped again and named": (
        REAL,
        [
            (stop(), "Hold! (5, 5); 1 hold ordered; 1 hold sent"),
            (
                hears(CommandedByOthers, "/planner"),
                "Hold! (5, 5); 1 hold taken; others: /planner; 1 hold ordered; 1 hold sent",
            ),
        ],
    ),
}


@pytest.mark.parametrize(("how", "steps"), SCENES.values(), ids=SCENES)
def test_what_goes_out_and_what_is_told(how: dict[str, Any], steps: list[tuple[Act, str]]) -> None:
    bench = Guarded(**how)
    assert [bench.shown(act) for act, _ in steps] == [shown for _, shown in steps]


def test_a_word_ends_no_stop_that_came_after_it() -> None:
    bench = Guarded(is_real=True)
    bench.stop()
    bench.stop(hands=True)
    bench.vehicle.allow_motion("Anna", 1, bench.now_ms)
    assert (stop := bench.gate.stops.in_force) is not None and (stop.number, stop.stills_arms) == (2, True)
    bench.vehicle.allow_motion("Anna", 2, bench.now_ms)
    assert bench.gate.stops.in_force is None


def test_a_persons_stop_in_the_place_of_a_guards_hold_needs_the_word_to_continue() -> None:
    bench = Guarded(is_real=True, most_m_s=0.5)
    for north_m in (5.0, 5.9, 6.8, 7.7, 8.6):
        bench.at(north_m, 5.0)
    assert (stop := bench.gate.stops.in_force) is not None and not stop.is_persons
    bench.stop()
    bench.continues(ends=StopsEnded.PERSONS_HOLD)
    assert bench.gate.stops.in_force is not None
    bench.continues()
    assert bench.gate.stops.in_force is None


def test_a_danger_that_lasts_over_a_persons_word_is_a_new_one() -> None:
    """A hull runs for the fence at 0.8 m/s, is stopped, and a person continues while it still runs."""
    bench, north_m = Guarded(is_real=True), 5.0
    while bench.gate.stops.in_force is None:
        bench.at(north_m := north_m + 0.8, 5.0)
    bench.continues()
    bench.at(north_m + 0.8, 5.0)
    assert bench.gate.stops.in_force is not None and not bench.gate.situation(bench.now_ms).outside


def test_nobody_is_sent_back_in_while_hands_are_at_the_docks() -> None:
    bench = Guarded(is_real=True)
    for n in range(28):
        bench.at(5.0, 5.0 - n / 4)
    bench.stop(hands=True)
    bench.at(5.0, -2.0, ticks=3)
    bench.wire.out = []
    bench.vehicle.go_back_in("Bo", "Cleo", bench.now_ms)
    assert bench.wire.out == [] and "hands at the docks" in bench.gate.way_back(bench.now_ms)[1]


def test_the_way_back_in_crosses_no_keep_out_zone() -> None:
    """A zone along the fence lies between the aPad and all that is inside; beside it the way is free."""
    waters = FencedWaters(
        Fence(((0, 0), (40, 0), (40, 40), (0, 40)), (((0, 10), (2, 10), (2, 20), (0, 20)),)), 1.0
    )
    assert "crosses a keep-out zone" in waters.way_back((-1.0, 15.0), 5.0)[1]
    (north_m, east_m), why_not = waters.way_back((-1.0, 5.0), 5.0)
    assert why_not == "" and north_m > 0 and math.isclose(east_m, 5.0)


@pytest.mark.parametrize(("at_ms", "fraction"), [(30_000, 0.9), (30_001, None)])
def test_a_charge_that_was_told_more_than_30_s_ago_is_not_known(at_ms: int, fraction: float | None) -> None:
    bench = Guarded()
    bench.at(5.0, 5.0, BatteryReported(0, 15.0, 0.9))
    assert bench.gate.situation(at_ms).battery_fraction == fraction


def test_a_sensor_that_says_nothing_is_left_once_refuses_no_leg() -> None:
    home = BatteryForHome((0.0, 0.0), 0.2, lambda begin, end, at_ms: 0.001 * math.dist(begin, end))
    gate, refused = Gate([home], PositionWatch(LIMITS)), []
    for at_ms, fraction in zip(range(1000, 8000, 1000), (0.9, 0.0, 0.89, 0.0, 0.0, 0.0, 0.0), strict=True):
        gate.observe([PoseReported(at_ms, 0.0, 0.0, 0.0), BatteryReported(at_ms, 12.0, fraction)])
        refused.append(gate.refusal(GoTo(1, 10.0, 0.0, 0.5, 1.0), at_ms) is not None)
    assert refused == [False] * 6 + [True]


def test_off_tells_at_once_and_every_ten_seconds_where_the_vehicle_drifts() -> None:
    bench = Guarded(is_real=True)
    bench.at(5.0, 5.5)
    bench.stop(off=True)
    for n in range(22):
        bench.at(5.0, 5.5 + 0.5 * n)
    _, second, _ = (it for it in bench.gate.take_events() if isinstance(it, Drifting))
    assert (second.speed_m_s, second.towards_rad) == pytest.approx((0.5, math.pi / 2), abs=1e-3)


def test_a_go_to_that_comes_no_nearer_is_held_and_not_switched_off() -> None:
    """A tether or weed: the position is good."""
    bench, noise = Guarded(is_real=True), random.Random(1)
    bench.command(GoTo(1, 30.0, 5.0, 0.5, 0.5))
    begun_ms = bench.now_ms
    while bench.gate.stops.in_force is None:
        bench.at(5.2 + noise.gauss(0.0, 0.1), 5.0 + noise.gauss(0.0, 0.1))
        assert bench.now_ms - begun_ms <= 12_000
    assert bench.now_ms - begun_ms >= 10_000 and [type(it) for it in bench.wire.out] == [GoTo, Hold]
    assert "no 0.5 m nearer" in bench.gate.awaits_person


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@pytest.mark.parametrize("fault", ["NaN position", "silent position", "jumping position", "frozen position"])
def test_by_the_real_apad_s_limits_a_bad_position_ends_in_a_safe_state_within_3_s(
    generation: Generation, fault: str
) -> None:
    for seed in range(10):
        rng = random.Random(seed)
        bench = Bench(generation, guards=real_limits())
        bench.go(rng.uniform(40.0, 55.0), rng.uniform(40.0, 55.0))
        bench.run(rng.randint(4, 12))
        begun_ms = bench.now_ms
        FAULTS[fault].inflict(bench, rng)
        while not is_safe(bench, begun_ms):
            bench.run(1)
            assert bench.now_ms <= begun_ms + 3_000
        assert bench.vehicle.gate.awaits_person


# Every road, both generations: the port's, the cores' own repeats, the monitor's.


def shift(bench: Bench, change: Callable[[Pose], Pose]) -> None:
    """The vehicle tells another pose than the true one."""
    bench.link.shift = lambda pose, at_ms: truly(change(pose), at_ms)


ACTS: dict[str, Callable[[Bench, float, float], None]] = {
    "go": lambda it, x, y: it.go(x, y),
    "hold": lambda it, x, y: it.hold(x, y),
    "dock": lambda it, x, y: it.dock(int(abs(x)) % 4, 1 + int(abs(y)) % 9),
    "undock": lambda it, x, y: it.undock(int(abs(x)) % 4, 1 + int(abs(y)) % 9),
    "wait": lambda it, x, y: it.run(1 + int(abs(x))),
    "silent": lambda it, x, y: setattr(it.link, "shift", lambda pose, at_ms: None),
    "heard": lambda it, x, y: setattr(it.link, "shift", truly),
    "frozen": lambda it, x, y: shift(it, lambda pose, last=it.link.pose: last),
    "pilot": lambda it, x, y: it.link.set_pilot(steers=True),
    "no pilot": lambda it, x, y: it.link.set_pilot(steers=False),
}


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@settings(max_examples=60, deadline=None)
@given(
    acts=st.lists(
        st.tuples(st.sampled_from(sorted(ACTS)), st.floats(-20, SIDE_M + 20), st.floats(-20, SIDE_M + 20)),
        max_size=25,
    ),
    is_real=st.booleans(),
)
def test_no_sequence_of_orders_puts_on_the_wire_what_a_guard_refuses(
    generation: Generation, acts: list[tuple[str, float, float]], is_real: bool
) -> None:
    bench = Bench(generation, is_real=is_real)
    for name, x, y in acts:
        if generation is Generation.A and "pilot" in name:
            continue  # nobody tells a bench of a pilot there
        ACTS[name](bench, x, y)
        bench.run(1)
    bench.run(5)
    observer = bench.observer
    assert (observer.outside, observer.blind, observer.against_pilot) == ([], [], [])


TOLD_MS = 3_000


STOP_ACTS = ACTS | {
    "others": lambda it, x, y: it.link.others_go(x, y),
    "lost": lambda it, x, y: setattr(it.link, "is_lost", True),
    "found": lambda it, x, y: setattr(it.link, "is_lost", False),
    "mute": lambda it, x, y: setattr(it.link, "is_mute", True),
    "answers": lambda it, x, y: setattr(it.link, "is_mute", False),
    "nan": lambda it, x, y: shift(it, lambda pose: moved(pose, (math.nan, 0.0))),
    "jump": lambda it, x, y: shift(it, lambda pose: moved(pose, (x, y))),
}


Step = int | str | tuple[str, float, float]


class Watched(Bench):
    """A bench with a journal of each tick: what was on the wire, and how the newest stop stands for the operator."""

    def __init__(self, generation: Generation) -> None:
        self.ticks: list[tuple[int, int, int, StopState | None]] = []
        """(time, stops on the wire, other orders on the wire, state of the newest stop)."""
        self.wanted: list[tuple[int, int, bool]] = []
        """(time, stops on the wire before, orders are lost) of each stop that a person wants, or that another client's
        order makes due; of that one the time at which the bench hears of the order, at the next tick."""
        super().__init__(generation)

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            super().run(1)
            newest, seen = self.vehicle.gate.stops.newest, self.observer
            state = None if newest is None else newest.state
            self.ticks.append((self.now_ms, seen.stops, seen.orders - seen.stops, state))

    def act(self, name: str, x: float, y: float) -> None:
        if "pilot" in name and (isinstance(self.link, LinkToA) or self.link.is_mute):
            return  # nobody tells the bench of that pilot
        is_stopped = self.vehicle.gate.stops.in_force is not None
        if name == "others" and is_stopped and not (self.observer.pilot_steers or self.link.is_mute):
            self.wanted.append((self.now_ms + TICK_MS, self.observer.stops, self.link.is_lost))
        STOP_ACTS[name](self, x, y)
        self.run(1)

    def play(self, *steps: Step) -> StopState | None:
        """Some ticks, an act, or one with a place, step by step; the state of the newest stop after them."""
        for it in steps:
            if isinstance(it, int):
                self.run(it)
            else:
                self.act(*((it, 0.0, 0.0) if isinstance(it, str) else it))
        return self.ticks[-1][3]

    def stop(self, *, off: bool) -> None:
        """A person stops the vehicle, in place of a stop that is still on its way."""
        self.wanted = [it for it in self.wanted if it[0] + TOLD_MS <= self.now_ms]
        self.wanted.append((self.now_ms, self.observer.stops, self.link.is_lost))
        self.vehicle.stop("Anna", self.now_ms, off=off)

    def is_stopped_or_told(self, at_ms: int, stops: int, is_lost: bool) -> bool:
        """After a stop was wanted at a time at which so many had been on the wire.

        Where orders arrive it is on the wire within a tick. Where they were lost it is there after three seconds, or the
        operator is told by then.
        """
        limit_ms = at_ms + (TOLD_MS if is_lost else TICK_MS)
        if any(count > stops for now_ms, count, _, _ in self.ticks if at_ms <= now_ms <= limit_ms):
            return True
        told = (
            at_ms < told_ms <= at_ms + TOLD_MS and kind == "stop" and data["state"] == "not taken"
            for told_ms, kind, data in self.events
        )
        # Of a stop that fails on and on the operator was told before.
        (state,) = (state for now_ms, _, _, state in self.ticks if now_ms == at_ms + TOLD_MS)
        return is_lost and (any(told) or state is StopState.NOT_TAKEN)


acts_of_a_sea = st.lists(
    st.tuples(st.sampled_from(sorted(STOP_ACTS)), st.floats(-20, SIDE_M + 20), st.floats(-20, SIDE_M + 20)),
    max_size=15,
)


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
@settings(max_examples=100, deadline=None)
@given(before=acts_of_a_sea, after=acts_of_a_sea, off=st.booleans())
def test_a_persons_stop_is_on_the_wire_within_a_tick_or_the_person_is_told_within_three_seconds(
    generation: Generation,
    before: list[tuple[str, float, float]],
    after: list[tuple[str, float, float]],
    off: bool,
) -> None:
    """Whatever went before, and whatever comes after: losses of orders and of answers, bad positions, silences, others.

    Nothing that moves the vehicle follows until a person continues, another client's order has the stop go out again, and
    nobody is told that the vehicle has taken what was not on the wire.
    """
    bench = Watched(generation)
    bench.play(*before)
    since_ms, stops, moving = bench.now_ms, bench.observer.stops, bench.observer.orders - bench.observer.stops
    pilot_had_it = bench.observer.pilot_steers
    bench.stop(off=off)
    bench.play(*after, TOLD_MS // TICK_MS + 1)
    assert bench.observer.against_pilot == []
    if pilot_had_it:
        stop = next(data for _, kind, data in bench.events if kind == "stop" and data["by"] == "Anna")
        assert stop["state"] == "refused" and "the pilot has it" in stop["reason"]
        return
    for wanted in bench.wanted:
        assert bench.is_stopped_or_told(*wanted), wanted
    later = [it for it in bench.ticks if it[0] > since_ms]
    assert all(others == moving for _, _, others, _ in later)
    assert all(count > stops for _, count, _, state in later if state in (StopState.TAKEN, StopState.AT_REST))


@pytest.mark.parametrize("goes", ["inside", "outside"])
@pytest.mark.parametrize("kind", [StopKind.HOLD, StopKind.OFF])
@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_after_a_guards_stop_no_other_client_moves_the_vehicle(
    generation: Generation, kind: StopKind, goes: str
) -> None:
    bench = Watched(generation)
    bench.go(20.0, 45.0)
    beyond_m = SIDE_M + 15.0
    stopping: list[Step] = [5, "nan", 4, "heard"] if kind is StopKind.OFF else [5, ("others", beyond_m, 30.0)]
    bench.play(*stopping, 10)
    stop, here_m = bench.vehicle.gate.stops.in_force, place_of(bench.link.pose)
    assert stop is not None and not stop.is_persons and stop.kind is kind
    bench.play(("others", 10.0 if goes == "inside" else beyond_m, 30.0), 60)
    assert all(bench.is_stopped_or_told(*it) for it in bench.wanted)
    assert math.dist(place_of(bench.link.pose), here_m) < 2.0


def test_a_stop_that_was_taken_and_is_sent_again_in_vain_is_told_and_so_is_its_end() -> None:
    """The vehicle had come to rest; another client sends it away, and no order of ours arrives any more."""
    bench = Watched(Generation.B)
    bench.stop(off=False)
    assert bench.play(8) is StopState.AT_REST
    assert bench.play("lost", ("others", 50.0, 50.0), 4) is StopState.NOT_TAKEN
    assert bench.is_stopped_or_told(*bench.wanted[-1])
    assert bench.play("found", 15) is StopState.AT_REST


def test_when_a_pilot_puts_the_vehicle_down_no_hold_turns_its_thrusters_on() -> None:
    bench = Watched(Generation.B)
    bench.stop(off=False)
    bench.play(8, "pilot")
    bench.link.push(Steer(0.5, 1.0, 0.0))
    bench.play(10)
    bench.link.push(Coast())
    orders = bench.observer.orders
    bench.play("no pilot", 60)
    assert bench.observer.orders == orders
    assert "stop 1 (hold, by Anna)" in bench.vehicle.gate.awaits_person


def test_anothers_goal_that_the_vehicle_does_not_show_is_held_before_the_fence() -> None:
    bench = Bench(Generation.B)
    bench.link.shows_goals = False
    bench.hold(30.0, 30.0)
    bench.run(8)
    bench.link.others_go(SIDE_M + 15.0, SIDE_M / 2)
    bench.run(100)
    pose = bench.link.pose
    assert max(pose.north_m, pose.east_m) < SIDE_M and bench.link.is_at_rest


@pytest.mark.parametrize("north_m", [60_000.0, math.nan])
@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_anothers_goal_to_no_place_of_any_water_is_ended_by_a_hold(
    generation: Generation, north_m: float
) -> None:
    """Degrees or millimetres for metres, or no number."""
    bench = Bench(generation)
    bench.go(40.0, 40.0)
    bench.run(4)
    bench.link.show_goal(north_m, 8.0)
    bench.run(1)
    observer = bench.observer
    assert observer.held_m is not None and observer.goal_m == observer.held_m
    assert "ordered a go-to to a place that cannot be used" in bench.vehicle.gate.awaits_person


@pytest.mark.parametrize("generation", [Generation.A, Generation.B])
def test_the_observer_sees_what_the_guards_are_there_for(generation: Generation) -> None:
    """With its guards taken out, the same vehicle is sent outside, blind."""
    bench = Bench(generation)
    bench.vehicle.gate._guards = ()
    bench.go(SIDE_M + 10, 5.0)
    assert len(bench.observer.outside) == 1
    bench.link.shift = lambda pose, at_ms: None
    bench.run(7)
    bench.go(10.0, 5.0)
    assert len(bench.observer.blind) == 1
