"""The rows of the campaign: what is done to a vehicle under way, and what its stop owes.

A row's function does it to a flight and returns the case that `judge` judges. Even tries heal what can heal, because a
vehicle that begins to move again by itself is as bad as one that never stopped.
"""

from __future__ import annotations

import math
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from tries import NoFlight

from safety.flight import FENCE, IMC_PORT, SIDE_M, START_M, Flight, Setup
from safety.judge import LIMIT_S, Case, Kind, Told

WATCHDOG_LIMIT_S = 12.0
TETHER_LIMIT_S = 13.0
"""10 s without half a metre of progress, and 3 s."""
WITNESSES_LIMIT_S = 8.0
"""A frozen position with noise takes 5 s of ordered thrust to contradict, and 3 s."""
LOSSY_LIMIT_S = 30.0
"""30 % of the packets are lost and a way there and back takes 1 s: as soon as TCP can."""
SHOWN_S, AFTER_S = 12.0, 15.0
"""A fault that can heal does so after SHOWN_S, and the flight goes on for AFTER_S."""
SERVO_S = 27.0
MUX_LIMIT_S = 10.0
AGAIN_S = 3.0
"""An OFF goes out again so soon after a supervisor takes orders."""
TOLD_S = 15.0
IMC_GOAL_DEG = (43.9334, 15.4450)
"""Some 40 m from the start, inside the fence."""
IDLE_S = 1200.0
"""A healthy mission of four aMussels at theta 30 orders a way more often than that."""
OUTSIDE_M = (SIDE_M + 15.0, SIDE_M / 2)
BOTH = ("a", "b")
SUPERVISOR = ("runs.supervisor_process",)
NURSERY = ("nursery",)
PARENT = ("apad_bridge.commands.main run",)
GATEWAYS = ("commands.main console", "commands.main imc")
"""Words in the command lines of the laptop's processes."""
TABLE_TRIES, TRIES, LATCH_TRIES, SHORT_TRIES = 20, 5, 3, 2


@dataclass(slots=True)
class Try:
    """One try of a row: its flight, and its number from 0."""

    flight: Flight
    number: int
    minutes: float
    told: list[Told] = field(default_factory=list)

    @property
    def heals(self) -> bool:
        return self.number % 2 == 0

    def case(self, begun_s: float, **how: Any) -> Case:
        how |= {"told": tuple(self.told), "current_m_s": self.flight.setup.current_m_s}
        return Case(self.flight.generation, FENCE, begun_s, **how)

    def order(self, *words: str) -> float:
        """A person's command and its answer; returns when it was given."""
        pressed = self.flight.person(*words, "--by", "judge")
        pressed.press()
        self.told.append(pressed.answer())
        return pressed.asked_s


Act = Callable[[Try], Case | dict[str, Case]]
"""One case, or one for each of several aPads."""
Before = Callable[[Try], None]
PLAIN = Setup()


@dataclass(frozen=True, slots=True)
class Row:
    what: str
    act: Act
    setup: Setup = PLAIN
    generations: tuple[str, ...] = BOTH
    why_not: str = ""
    """The reason for a generation that is missing."""
    tries: int = TRIES
    is_short: bool = False
    """Among the rows of the short tier."""


def falsified(kind: str, *, limit_s: float = LIMIT_S, can_heal: bool = True, **how: Any) -> Act:
    """The position is falsified under way: controllers off within the limit, and nothing moves by itself afterwards."""

    def act(it: Try) -> Case:
        begun_s = time.monotonic()
        it.flight.falsify(kind, **how)
        it.flight.pause(SHOWN_S)
        if can_heal and it.heals:
            it.flight.falsify("good")
        it.flight.pause(AFTER_S)
        return it.case(begun_s, lies=True, limit_s=limit_s, must_be=Kind.OFF, is_rest_due=True)

    return act


def second_publisher(**how: Any) -> Act:
    def act(it: Try) -> Case:
        it.flight.actor("second", "mute")
        begun_s = time.monotonic()
        it.flight.falsify(who="second", **how)
        it.flight.pause(SHOWN_S + AFTER_S)
        return it.case(begun_s, lies=True, must_be=Kind.OFF)

    return act


def other_goal(it: Try) -> Case:
    """Both generations show the goals of their action servers to all."""
    begun_s = time.monotonic()
    it.flight.stranger("goal", generation=it.flight.generation, place=OUTSIDE_M)
    it.flight.pause(SHOWN_S + AFTER_S)
    return it.case(begun_s)


def other_goal_after_a_guard(it: Try) -> Case:
    """A guard has stopped the vehicle, its cause has gone, and another node drives it out: it is stopped again."""
    it.flight.falsify("nan")
    it.flight.pause(SHOWN_S)
    it.flight.falsify("good")
    it.flight.pause(AFTER_S)
    return other_goal(it)


def master_killed(it: Try) -> Case:
    pressed = it.flight.person("stop", "--by", "judge")
    it.flight.kill("master")
    it.flight.pause(2.0)
    pressed.press()
    it.told.append(pressed.answer())
    it.flight.pause(AFTER_S)
    return it.case(pressed.asked_s)


def master_and_supervisor_killed(it: Try) -> Case:
    begun_s = time.monotonic()
    it.flight.kill("master")
    it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
    it.flight.pause(WATCHDOG_LIMIT_S + AFTER_S)
    return it.case(begun_s, limit_s=WATCHDOG_LIMIT_S, deaf=(begun_s, begun_s), must_be=Kind.HOLD)


def wifi_cut(it: Try) -> Case:
    begun_s = time.monotonic()
    it.flight.link(1.0)
    it.flight.pause(25.0)
    healed_s = time.monotonic()
    it.flight.link(0.0)
    it.flight.pause(20.0)
    return it.case(begun_s, limit_s=WATCHDOG_LIMIT_S, deaf=(begun_s, healed_s), must_be=Kind.HOLD)


def supervisor_killed(it: Try) -> Case:
    begun_s = time.monotonic()
    it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
    it.flight.pause(WATCHDOG_LIMIT_S + AFTER_S)
    return it.case(begun_s, limit_s=WATCHDOG_LIMIT_S, deaf=(begun_s, begun_s), must_be=Kind.HOLD)


def frozen_for(seconds: float, *words: str) -> Act:
    """The laptop's processes, or those with these words, are stopped and go on."""

    def act(it: Try) -> Case:
        begun_s = time.monotonic()
        it.flight.signal_bench(signal.SIGSTOP, *words)
        it.flight.pause(seconds)
        awake_s = time.monotonic()
        it.flight.signal_bench(signal.SIGCONT, *words)
        it.flight.pause(20.0)
        return it.case(begun_s, limit_s=WATCHDOG_LIMIT_S, deaf=(begun_s, awake_s), must_be=Kind.HOLD)

    return act


def nursery_and_parent_killed(it: Try) -> Case:
    pressed = it.flight.person("stop", "--by", "judge")
    it.flight.signal_bench(signal.SIGKILL, *NURSERY, *PARENT)
    it.flight.pause(2.0)
    pressed.press()
    it.told.append(pressed.answer())
    it.flight.pause(AFTER_S)
    return it.case(pressed.asked_s)


def gateways_killed(it: Try) -> Case:
    pressed = it.flight.person("stop", "--by", "judge")
    it.flight.signal_bench(signal.SIGKILL, *GATEWAYS)
    it.flight.pause(3.0)
    pressed.press()
    it.told.append(pressed.answer())
    it.flight.pause(AFTER_S)
    return it.case(pressed.asked_s)


def nothing(it: Try) -> None:
    """Precedes a plain act."""


def stopped(
    *words: str,
    must_be: Kind | None = None,
    before: Before = nothing,
    after_s: float = AFTER_S,
    **how: Any,
) -> Act:
    """A person's order, after something that does not end the flight."""

    def act(it: Try) -> Case:
        before(it)
        begun_s = it.order(*words)
        it.flight.pause(after_s)
        return it.case(begun_s, must_be=must_be, **how)

    return act


def hands_then_silence(it: Try) -> Case:
    """Hands are in the docks when the Wi-Fi dies: the watchdog must not have the thrusters keep the place."""
    begun_s = it.order("hands")
    it.flight.pause(3.0)
    it.flight.link(1.0)
    it.flight.pause(20.0)
    it.flight.link(0.0)
    it.flight.pause(10.0)
    return it.case(begun_s, must_be=Kind.OFF)


def stopped_twice(it: Try) -> Case:
    it.order("stop")
    it.flight.pause(3.0)
    begun_s = it.order("stop")
    it.flight.pause(AFTER_S)
    return it.case(begun_s, must_be=Kind.OFF)


def older_stop(it: Try) -> Case:
    """`continue` with an older stop's number is refused, and with the newest one the mission goes on."""
    begun_s = it.order("stop")
    it.flight.pause(2.0)
    it.order("stop")
    it.flight.pause(2.0)
    it.order("continue", "--stop", "1")
    refused = it.told[-1].code != 0
    it.flight.pause(5.0)
    word_s = it.order("continue", "--stop", "2")
    it.flight.pause(AFTER_S)
    return it.case(
        begun_s,
        words_s=(word_s,),
        is_rest_due=False,
        must_move=True,
        other_faults=_unless(refused, "`continue --stop 1` was taken after stop 2"),
    )


def orders_at_once(it: Try) -> Case:
    flight = it.flight
    pressed = [flight.person("stop", "--by", f"judge{number}") for number in range(3)]
    pressed += [flight.order_by_console("stop"), flight.order_by_imc()]
    for one in pressed:
        one.press()
    it.told += [one.answer() for one in pressed]
    it.flight.pause(AFTER_S)
    return it.case(pressed[0].asked_s)


def piloted(times: int) -> Act:
    """A pilot takes over, while a person says stop; with `times` 1 the flag comes once, and its source falls silent."""

    def act(it: Try) -> Case:
        pressed = it.flight.person("stop", "--by", "judge")
        begun_s = time.monotonic()
        it.flight.stranger("manual", steers=True, times=times)
        it.flight.pause(6.0)
        pressed.press()
        told = pressed.answer()
        it.told.append(told)
        it.flight.pause(AFTER_S)
        fault = _unless(told.code != 0, "`stop` said done while a pilot steers")
        return it.case(begun_s, is_stop_due=False, is_rest_due=False, other_faults=fault)

    return act


def power_cycled(it: Try) -> Case:
    begun_s = time.monotonic()
    it.flight.cut_power(8.0)
    it.flight.pause(30.0)
    return it.case(begun_s, is_stop_due=False, nothing_after_s=begun_s)


def tethered(it: Try) -> Case:
    # A receiver's noise goes on at a tether; without it the position is frozen, bit for bit.
    it.flight.falsify("rough", noise_m=0.05, gap_s=0.0, waves_m=0.0)
    it.flight.pause(SHOWN_S)
    begun_s = time.monotonic()
    it.flight.spoil(hull="tied")
    it.flight.pause(TETHER_LIMIT_S + AFTER_S)
    return it.case(begun_s, limit_s=TETHER_LIMIT_S + 2.0, must_be=Kind.HOLD)


def battery_silent(it: Try) -> Case:
    it.flight.tell_battery(silent=True)
    it.flight.pause(SHOWN_S)
    begun_s = it.order("stop")
    it.flight.pause(AFTER_S)
    return it.case(begun_s)


def battery_zero_once(it: Try) -> Case:
    """One reading of 0 % among good ones ends nothing."""
    begun_s = time.monotonic()
    it.flight.tell_battery(percent=0.0, once=True)
    it.flight.pause(AFTER_S)
    ended = it.flight.run_ended()
    return it.case(
        begun_s, is_stop_due=False, may_stop=False, other_faults=_unless(not ended, "the run ended")
    )


def home_on_reserve(it: Try) -> Case:
    it.flight.tell_battery(percent=20.5)
    it.flight.pause(SHOWN_S)
    begun_s = it.order("stop")
    it.flight.pause(AFTER_S)
    return it.case(begun_s)


def in_docking(it: Try) -> None:
    it.flight.wait(it.flight.is_docking, 120.0, "no docking began")
    it.flight.pause(2.0)


def blocked(it: Try) -> Case:
    """The vehicle answers nothing for 27 s while it docks: one stop waits there, and no backlog is carried out after it."""
    it.flight.wait(lambda: it.flight.ordered("commander/primitive/docking"), 120.0, "no docking began")
    it.flight.pause(3.0)
    begun_s = it.order("stop")
    it.flight.pause(SERVO_S + AFTER_S)
    return it.case(begun_s, must_take=False, is_rest_due=False)


def lossy(it: Try) -> None:
    it.flight.link(0.3, 0.5)
    it.flight.pause(5.0)


def with_dock_that_lies(it: Try) -> None:
    it.flight.stranger("docked", name="amussel3")
    it.flight.pause(8.0)


def with_full_disk(it: Try) -> None:
    it.flight.fill_disk()
    it.flight.pause(5.0)


def healthy(it: Try) -> Case:
    """Hours of rough but healthy positions over a lossy link: nobody may stop the vehicle."""
    begun_s = time.monotonic()
    it.flight.falsify("rough", noise_m=0.5, gap_s=1.5, waves_m=0.3)
    it.flight.link(0.05)
    until_s = begun_s + 60 * it.minutes
    while time.monotonic() < until_s and not it.flight.run_ended():
        it.flight.pause(5.0)
        it.flight.look()
    early = until_s - time.monotonic() > 60
    return it.case(
        begun_s,
        is_stop_due=False,
        may_stop=False,
        is_rest_due=False,
        goes_on_s=math.inf if it.flight.setup.rests else IDLE_S,
        other_faults=(*_unless(not early, "the run ended by itself"), *it.flight.guards()),
    )


# A vehicle that is late with its answers, and clients that go on ordering.


def late_link(it: Try) -> None:
    """1.2 s there and back."""
    it.flight.link(0.0, 0.6)
    it.flight.pause(5.0)


def losing_link(it: Try) -> None:
    it.flight.link(0.25)
    it.flight.pause(5.0)


def slow_answers(answer_s: float) -> Before:
    """Even tries take an order before that time, and odd ones after it. Orders wait at the services by then."""

    def before(it: Try) -> None:
        it.flight.spoil(answer_s=answer_s, takes_first=it.heals)
        it.flight.pause(3 * answer_s)

    return before


def stopped_for_good(
    *words: str, before: Before = nothing, limit_s: float = LIMIT_S, after_s: float = 2 * AFTER_S, **how: Any
) -> Act:
    """A person's stop; nothing that was ordered before or after it moves the vehicle in the end."""
    must_be = Kind.OFF if "--off" in words or words[0] == "hands" else None
    how |= {"must_be": must_be, "limit_s": limit_s, "ends_at_rest": True, "one_place": True}
    return stopped(*words, before=before, after_s=after_s, **how)


def hung_for(seconds: float, *words: str) -> Act:
    """The vehicle's node stands still when the stop comes. Its hull goes on meanwhile."""

    def act(it: Try) -> Case:
        it.flight.signal_vehicle(signal.SIGSTOP, "hull")
        it.flight.pause(0.3)
        pressed = it.flight.person(*words, "--by", "judge")
        hung_s = time.monotonic()
        pressed.press()
        it.flight.pause(max(0.0, seconds - (time.monotonic() - hung_s)))
        it.flight.signal_vehicle(signal.SIGCONT, "hull")
        it.told.append(pressed.answer())
        it.flight.pause(2 * AFTER_S)
        return it.case(
            pressed.asked_s,
            limit_s=max(LIMIT_S, seconds),
            must_take=False,
            is_rest_due=False,
            ends_at_rest=True,
        )

    return act


def stop_and_hands(before: Before = nothing, limit_s: float = LIMIT_S, **how: Any) -> Act:
    """Two people at one instant, or in odd tries with a tick between them: after the OFF no hold arrives."""

    def act(it: Try) -> Case:
        before(it)
        pressed = [it.flight.person(word, "--by", word) for word in ("stop", "hands")]
        for one in pressed:
            one.press()
            it.flight.pause(0.0 if it.heals else it.flight.rng.uniform(0.5, 1.5))
        it.told += [one.answer() for one in pressed]
        it.flight.pause(AFTER_S)
        begun_s = pressed[-1].asked_s
        return it.case(begun_s, must_be=Kind.OFF, limit_s=limit_s, arms_rest=True, ends_at_rest=True, **how)

    return act


def busy(it: Try) -> None:
    it.flight.spoil(busy_s=2.0)


# A hull that does not do what its software has taken.


def disobeyed(kind: str, *words: str) -> Act:
    """OFF and an alarm are due, and nobody is told `done`."""

    def act(it: Try) -> Case:
        pressed = it.flight.person(*words, "--by", "judge")
        it.flight.spoil(hull=kind)
        pressed.press()
        it.told.append(pressed.answer())
        it.flight.pause(AFTER_S)
        said = it.flight.said_by_bench() + it.told[-1].text
        return it.case(
            pressed.asked_s, must_take=False, is_rest_due=False, one_place=True, disobeys=True, said=said
        )

    return act


def held_by_walking_position(it: Try) -> Case:
    """Under a hold the position walks off; each hold that is ordered keeps the first one's place."""
    begun_s = it.order("stop")
    it.flight.pause(6.0)
    it.flight.falsify("walks", speed_m_s=0.4)
    it.flight.pause(2 * AFTER_S)
    return it.case(begun_s, one_place=True)


def held_by_deaf_hull(it: Try) -> Case:
    """The hull leaves a place that it had held."""
    begun_s = it.order("stop")
    it.flight.pause(4.0)
    it.flight.spoil(hull="deaf", velocity_m_s=[0.3, -0.2])
    it.flight.pause(2 * AFTER_S)
    said = it.flight.said_by_bench()
    return it.case(begun_s, is_rest_due=False, one_place=True, strays=True, said=said)


def two_places(it: Try) -> Case:
    """One node publishes two places 3 m apart, in turns."""
    begun_s = time.monotonic()
    it.flight.falsify("mux", apart_m=3.0)
    it.flight.pause(MUX_LIMIT_S + AFTER_S)
    return it.case(
        begun_s, lies=True, limit_s=MUX_LIMIT_S, must_be=Kind.OFF, longest_way_m=2.0, ends_at_rest=True
    )


# Who commands, and latches.


def taken_over(it: Try) -> Case:
    """A person who took over stops and continues: the person commands on, and the mission only after `give_back`."""
    flight = it.flight
    refused = [name for name in ("take_over", "hold_position") if not _accepted(flight, name)]
    flight.pause(4.0)
    begun_s = time.monotonic()
    refused += [] if _accepted(flight, "stop") else ["stop"]
    flight.pause(4.0)
    refused += [] if _accepted(flight, "continue", stop=1) else ["continue"]
    flight.pause(AFTER_S)
    word_s = time.monotonic()
    refused += [] if _accepted(flight, "give_back") else ["give_back"]
    flight.pause(AFTER_S)
    return it.case(
        begun_s,
        words_s=(word_s,),
        must_move=True,
        is_rest_due=False,
        other_faults=tuple(f"`{name}` was refused" for name in refused),
    )


def _accepted(flight: Flight, name: str, **request: Any) -> bool:
    request |= {"here": True} if name == "hold_position" else {}
    return bool(flight.called(name, **request)["accepted"])


def stopped_and_continued(it: Try) -> Case:
    """Without a person who has taken over, `continue` is the mission's."""
    begun_s = time.monotonic()
    refused = [] if _accepted(it.flight, "stop") else ["`stop` was refused"]
    it.flight.pause(6.0)
    word_s = time.monotonic()
    refused += [] if _accepted(it.flight, "continue", stop=1) else ["`continue` was refused"]
    it.flight.pause(AFTER_S)
    return it.case(begun_s, words_s=(word_s,), must_move=True, is_rest_due=False, other_faults=tuple(refused))


Latch = Callable[[Try], tuple[float, dict[str, Any]]]
"""Brings the vehicle under a stop; returns its beginning, and how it is judged."""
Gap = Callable[[Try], tuple[float, float]]
"""The bench is gone for a time; returns when it went and when it was back."""


def by_person(*words: str) -> Latch:
    def latch(it: Try) -> tuple[float, dict[str, Any]]:
        begun_s = it.order(*words)
        it.flight.pause(6.0)
        return begun_s, {
            "must_be": None if words == ("stop",) else Kind.OFF,
            "arms_rest": words[0] == "hands",
        }

    return latch


def off_by_guard(it: Try) -> tuple[float, dict[str, Any]]:
    begun_s = time.monotonic()
    it.flight.falsify("nan")
    it.flight.pause(6.0)
    it.flight.falsify("good")
    it.flight.pause(6.0)
    return begun_s, {"must_be": Kind.OFF}


def hold_by_guard(it: Try) -> tuple[float, dict[str, Any]]:
    it.flight.falsify("rough", noise_m=0.05, gap_s=0.0, waves_m=0.0)
    it.flight.pause(SHOWN_S)
    begun_s = time.monotonic()
    it.flight.spoil(hull="tied")
    it.flight.pause(TETHER_LIMIT_S + 6.0)
    return begun_s, {"must_be": Kind.HOLD, "limit_s": TETHER_LIMIT_S + 2.0}


def by_watchdog(kind: Kind) -> Latch:
    """The cable is cut for 20 s; for an OFF the position is no number meanwhile."""

    def latch(it: Try) -> tuple[float, dict[str, Any]]:
        begun_s = time.monotonic()
        it.flight.link(1.0)
        it.flight.pause(2.0)
        if kind is Kind.OFF:
            it.flight.falsify("nan")
        it.flight.pause(18.0)
        it.flight.falsify("good")
        it.flight.link(0.0)
        it.flight.pause(12.0)
        return begun_s, {"must_be": kind, "limit_s": WATCHDOG_LIMIT_S}

    return latch


def not_taken(it: Try) -> tuple[float, dict[str, Any]]:
    """A hold that was sent, and whose answer the supervisor does not live to see."""
    it.flight.spoil(answer_s=4.0, takes_first=it.heals)
    pressed = it.flight.person("stop", "--by", "judge")
    pressed.press()
    it.flight.wait(
        lambda: any(one["at_s"] > pressed.asked_s for one in it.flight.orders()), 10.0, "no stop went out"
    )
    return pressed.asked_s, {"one_place": True}


def supervisor_dies(it: Try) -> tuple[float, float]:
    gone_s = time.monotonic()
    it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
    it.flight.pause(2.0)
    return gone_s, it.flight.resume()


def copied(it: Try) -> tuple[float, float]:
    """All of the laptop's programs die, and the run's directory flies on at another place."""
    gone_s = time.monotonic()
    it.flight.signal_bench(signal.SIGKILL)
    it.flight.pause(1.0)
    other = it.flight.run.with_name("carried")
    shutil.copytree(it.flight.run, other, ignore=lambda _, names: [it for it in names if ".sock" in it])
    return gone_s, it.flight.resume(other)


def asleep(it: Try) -> tuple[float, float]:
    gone_s = time.monotonic()
    it.flight.signal_bench(signal.SIGSTOP)
    it.flight.pause(30.0)
    it.flight.signal_bench(signal.SIGCONT)
    return gone_s, time.monotonic()


def latched(latch: Latch, gap: Gap = supervisor_dies, *, off_again: bool = False, holds: bool = False) -> Act:
    """A stop outlives the bench's gap: an OFF goes out again at once, a taken hold does not, and a go-to is refused."""

    def act(it: Try) -> Case:
        begun_s, how = latch(it)
        gone_s, back_s = gap(it)
        it.flight.pause(6.0)
        answer = it.flight.called("go_to_point", north_m=START_M[0], east_m=START_M[1])
        it.flight.pause(AFTER_S)
        if off_again:
            how["off_again"] = (gone_s, back_s + AGAIN_S)
        if not holds:
            how["deaf"] = (gone_s, back_s)
        return it.case(
            begun_s,
            is_rest_due=False,
            ends_at_rest=True,
            other_faults=_unless(not answer["accepted"], "a go-to was accepted after the gap"),
            **how,
        )

    return act


def fence_edited(it: Try) -> Case:
    """Somebody draws the fence closer in the run's records while no supervisor lives: the way on stays inside it."""
    begun_s = it.order("stop")
    it.flight.pause(6.0)
    it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
    here = it.flight.place()
    corners = tuple((here[0] + n, here[1] + e) for n, e in ((-14, -14), (14, -14), (14, 14), (-14, 14)))
    it.flight.draw_fence(corners)
    edited_s = time.monotonic()
    try:
        it.flight.resume()
    except NoFlight:
        it.flight.pause(AFTER_S)
        return it.case(begun_s, later_fence=(edited_s, corners))
    it.flight.pause(4.0)
    word_s = it.order("continue")
    it.flight.pause(2 * AFTER_S)
    return it.case(begun_s, words_s=(word_s,), later_fence=(edited_s, corners), is_rest_due=False)


def ordered_by_imc(it: Try) -> Case:
    """Under a guard's stop an IMC console starts a plan: it is refused."""
    pressed = it.flight.order_by_imc(*IMC_GOAL_DEG)
    begun_s = time.monotonic()
    it.flight.falsify("nan")
    it.flight.pause(4.0)
    it.flight.falsify("good")
    it.flight.pause(13.0)
    pressed.press()
    answer = pressed.answer()
    it.flight.pause(AFTER_S)
    return it.case(
        begun_s,
        lies=True,
        must_be=Kind.OFF,
        ends_at_rest=True,
        other_faults=_unless(answer.code != 0, "an IMC console's plan was accepted under a guard's stop"),
    )


def console_frozen(it: Try) -> None:
    it.flight.signal_bench(signal.SIGSTOP, "commands.main console")
    it.flight.pause(3.0)


def hands_at_arm(it: Try) -> Case:
    """`hands` comes at any time of a docking whose arm stands open, or closes: it stays as it is."""
    it.flight.wait(it.flight.arm_is_open, 120.0, "no arm was opened")
    it.flight.pause(it.flight.rng.uniform(0.5, 14.0))
    begun_s = it.order("hands")
    it.flight.pause(2 * AFTER_S)
    return it.case(begun_s, must_be=Kind.OFF, arms_rest=True, ends_at_rest=True)


# The watchdog, and a second bench.


def watchdog_dead(it: Try) -> Case:
    """Nobody is left to stop it in a silence: the bench tells that, and orders nothing after the silence."""
    begun_s = time.monotonic()
    it.flight.signal_vehicle(signal.SIGKILL, "watchdog")
    it.flight.pause(TOLD_S)
    said = it.flight.said_by_bench().lower()
    it.flight.link(1.0)
    it.flight.pause(20.0)
    healed_s = time.monotonic()
    it.flight.link(0.0)
    it.flight.pause(20.0)
    told = _unless("watchdog" in said, f"nobody was told within {TOLD_S:g} s that the watchdog is dead")
    return it.case(begun_s, is_stop_due=False, is_rest_due=False, deaf=(begun_s, healed_s), other_faults=told)


def watchdog_deaf(it: Try) -> Case:
    """The watchdog hangs, the cable is cut, and the watchdog wakes: it counts no old heartbeat, and stops the vehicle."""
    it.flight.signal_vehicle(signal.SIGSTOP, "watchdog")
    it.flight.pause(4.0)
    cut_s = time.monotonic()
    it.flight.link(1.0)
    it.flight.pause(8.0)
    it.flight.signal_vehicle(signal.SIGCONT, "watchdog")
    awake_s = time.monotonic()
    it.flight.pause(25.0)
    healed_s = time.monotonic()
    it.flight.link(0.0)
    it.flight.pause(AFTER_S)
    return it.case(
        awake_s, limit_s=WATCHDOG_LIMIT_S + 2.0, deaf=(cut_s, healed_s), must_be=None, is_rest_due=False
    )


def watchdog_restarted(*words: str) -> Act:
    """Under a latch the watchdog starts anew, and the cable is cut: neither it nor the bench moves the vehicle."""

    def act(it: Try) -> Case:
        begun_s = it.order(*words)
        it.flight.pause(4.0)
        it.flight.kill("watchdog")
        it.flight.start_watchdog()
        it.flight.pause(8.0)
        cut_s = time.monotonic()
        it.flight.link(1.0)
        it.flight.pause(20.0)
        healed_s = time.monotonic()
        it.flight.link(0.0)
        it.flight.pause(AFTER_S)
        must_be = None if words == ("stop",) else Kind.OFF
        return it.case(begun_s, must_be=must_be, deaf=(cut_s, healed_s), ends_at_rest=True)

    return act


def second_bench(it: Try) -> Case:
    """A second command that flies is refused, and orders nothing."""
    begun_s = time.monotonic()
    other = it.flight.start_bench(it.flight.run.with_name("second"))
    with suppress(TimeoutError):
        it.flight.wait(lambda: other.poll() is not None, 60.0, "")
    fault = _unless(other.poll() not in (None, 0), "the second bench was not refused")
    it.flight.pause(AFTER_S)
    return it.case(
        begun_s, is_stop_due=False, is_rest_due=False, may_stop=False, newcomers_s=begun_s, other_faults=fault
    )


# Several aPads, and a bench that restarts its supervisor.


def stop_all(*words: str, one: str = "", hangs: str = "") -> Act:
    """`stop RUN` stops each aPad and tells of each; that of `one` stops it alone; the node of `hangs` hangs meanwhile."""

    def act(it: Try) -> dict[str, Case]:
        flight = it.flight
        pressed = flight.person(*words, "--by", "judge", one=one)
        if hangs:
            flight.signal_vehicle(signal.SIGSTOP, hangs)
        flight.pause(0.3)
        pressed.press()
        told = pressed.answer()
        flight.pause(AFTER_S)
        if hangs:
            flight.signal_vehicle(signal.SIGCONT, hangs)
            flight.pause(AFTER_S)
        untold = [] if one else [name for name in flight.names if f"{name}:" not in told.text]
        cases = {}
        for name in flight.names:
            is_asked = name == (one or name)
            is_heard = is_asked and name != hangs
            cases[name] = Case(
                flight.generation,
                FENCE,
                pressed.asked_s,
                is_stop_due=is_heard,
                is_rest_due=is_heard,
                ends_at_rest=is_asked,
                may_stop=is_asked,
                goes_on_s=math.inf if is_asked else 2 * AFTER_S,
                must_take=is_heard and not hangs,
                told=(told,) if is_heard else (),
                other_faults=_unless(name not in untold, "the answer does not tell of it"),
            )
        return cases

    return act


def restarted_by_parent(*words: str) -> Act:
    """The run's own parent starts another supervisor under the stop, and nothing moves before `continue`."""

    def act(it: Try) -> Case:
        begun_s = it.order(*words)
        it.flight.pause(6.0)
        gone_s = time.monotonic()
        it.flight.signal_bench(signal.SIGKILL, *SUPERVISOR)
        it.flight.wait(lambda: not it.flight.takes_orders(), 10.0, "the supervisor lives")
        it.flight.wait(it.flight.takes_orders, 60.0, "the parent starts no other supervisor")
        back_s = time.monotonic()
        it.flight.pause(2 * AFTER_S)
        off = "--off" in words or words[0] == "hands"
        return it.case(
            begun_s,
            must_be=Kind.OFF if off else None,
            off_again=(gone_s, back_s + AGAIN_S) if off else None,
            deaf=(gone_s, back_s),
            ends_at_rest=True,
        )

    return act


def _unless(good: bool, fault: str) -> tuple[str, ...]:
    return () if good else (fault,)


_T = TABLE_TRIES
ROWS: dict[str, Row] = {
    "nan": Row("position NaN", falsified("nan"), tries=_T, is_short=True),
    "infinite": Row("position infinite", falsified("infinite"), tries=_T),
    "yaw nan": Row("yaw NaN", falsified("yaw_nan"), tries=_T),
    "silent": Row("position silent", falsified("silent"), tries=_T, is_short=True),
    "frozen": Row("position frozen, bit for bit", falsified("frozen"), tries=_T, is_short=True),
    "frozen noise": Row(
        "position frozen, with 3 mm of noise",
        falsified("frozen", limit_s=WITNESSES_LIMIT_S, noise_m=0.003),
        tries=_T,
    ),
    "jump": Row(
        "jump of 50 m", falsified("offset", can_heal=False, north_m=50.0, east_m=0.0), tries=_T, is_short=True
    ),
    "origin": Row(
        "origin 1 km off", falsified("offset", can_heal=False, north_m=800.0, east_m=-600.0), tries=_T
    ),
    "north sign": Row("wrong sign of north", falsified("north_sign", can_heal=False), tries=_T),
    "late": Row("positions late by up to 8 s", falsified("late_more"), tries=_T),
    "stamps old": Row("stamps 60 s old", falsified("stamps", by_s=-60.0), tries=_T),
    "time back": Row("time going backwards", falsified("backwards"), tries=_T),
    "two publishers": Row(
        "a second publisher, 20 m off", second_publisher(kind="offset", north_m=20.0, east_m=0.0), tries=_T
    ),
    "two clocks": Row(
        "one position by two clocks 30 s apart", second_publisher(kind="stamps", by_s=30.0), tries=_T
    ),
    "slow": Row("position at 0.2 Hz", falsified("slow", every_s=5.0), tries=_T),
    "other goal": Row("another node's goal outside the fence", other_goal, tries=_T, is_short=True),
    "other goal, stopped": Row("another node's goal outside the fence, after NaN", other_goal_after_a_guard),
    "master killed": Row("master killed, then `stop`", master_killed, tries=_T, is_short=True),
    "master and supervisor": Row("master and supervisor killed", master_and_supervisor_killed, tries=_T),
    "wifi cut": Row("Wi-Fi cut for 25 s", wifi_cut, tries=_T, is_short=True),
    "supervisor killed": Row("supervisor killed", supervisor_killed, tries=_T),
    "supervisor stopped": Row("supervisor stopped for 25 s", frozen_for(25.0, *SUPERVISOR), tries=_T),
    "laptop asleep": Row("the laptop asleep for 60 s", frozen_for(60.0), tries=_T),
    "pilot": Row(
        "a pilot takes over, then `stop`",
        piloted(0),
        generations=("b",),
        tries=_T,
        is_short=True,
        why_not="generation A has no manual channel in its published stack",
    ),
    "pilot once": Row(
        "a pilot who publishes once, then `stop`",
        piloted(1),
        generations=("b",),
        why_not="generation A has no manual channel in its published stack",
    ),
    "stop": Row("`stop` under way", stopped("stop"), is_short=True),
    "stop off": Row("`stop --off` under way", stopped("stop", "--off", must_be=Kind.OFF), is_short=True),
    "stop twice": Row("`stop`, and `stop` again", stopped_twice),
    "hands": Row("`hands` under way", stopped("hands", must_be=Kind.OFF)),
    "hands, silence": Row("`hands`, and then the Wi-Fi is cut", hands_then_silence, is_short=True),
    "older stop": Row("`continue` of an older stop, then of the newest", older_stop),
    "in docking": Row(
        "`stop` in a docking", stopped("stop", before=in_docking), Setup(near_m=8.0, ahead_m=2.0)
    ),
    "blocked": Row(
        "`stop` while the vehicle blocks its services for a docking",
        blocked,
        Setup(near_m=8.0, ahead_m=2.0, fault="blocks", docks_by_eye=True),
        generations=("b",),
        why_not="generation A perches at once",
    ),
    "lossy": Row(
        "`stop` over 30 % loss and 1 s round trip",
        stopped(
            "stop",
            before=lossy,
            after_s=LOSSY_LIMIT_S + AFTER_S,
            limit_s=LOSSY_LIMIT_S,
            must_take=False,
            may_stand=True,  # positions come too late there, so that a guard's OFF is often in force before
        ),
    ),
    "current": Row("`stop` in a steady current of 0.25 m/s", stopped("stop"), Setup(current_m_s=(0.2, 0.15))),
    "clock off": Row("`stop` with the vehicle's clock 30 s off", stopped("stop"), Setup(clock_off_s=30.0)),
    "docks lie": Row(
        "`stop` while a dock says that it holds an aMussel",
        stopped("stop", before=with_dock_that_lies),
        generations=("a",),
        why_not="generation B says nothing of its docks",
    ),
    "disk full": Row(
        "`stop` with the laptop's disk full",
        stopped("stop", before=with_full_disk, must_take=False, may_stand=True),
        Setup(full=True),
    ),
    "nursery and parent": Row("nursery and parent killed, then `stop`", nursery_and_parent_killed),
    "gateways": Row(
        "console and IMC gateway killed, then `stop`",
        gateways_killed,
        Setup(run_words=("--console", "--imc")),
    ),
    "at once": Row(
        "`stop` by the page, an IMC console and three shells at once",
        orders_at_once,
        Setup(run_words=("--console", "--imc", "--neptus", f"0x4001@127.0.0.1:{IMC_PORT}")),
    ),
    "power cycle": Row("power cycle of the vehicle", power_cycled, is_short=True),
    "tether": Row("a tether holds the vehicle", tethered),
    "battery silent": Row("battery silent in flight, then `stop`", battery_silent),
    "battery zero": Row("one reading of 0 %", battery_zero_once),
    "reserve": Row("`stop` on the way home on reserve", home_on_reserve),
    "nuisance": Row("a healthy mission for --minutes", healthy, tries=1),
    "nuisance hold": Row("a healthy hold for --minutes", healthy, Setup(rests=True), tries=1),
}
SCRIPT, CALLS = Setup(flies="script"), Setup(flies="calls")
CONSOLES = Setup(run_words=("--console", "--imc", "--neptus", f"0x4001@127.0.0.1:{IMC_PORT}"))
_LATE = "generation A answers by its topics, and has no services that could answer late"
for _answer_s in (1.5, 3.0):
    for _flies in (SCRIPT, CALLS):
        for _words in (("stop",), ("stop", "--off")):
            ROWS[f"answers {_answer_s:g} s, {_flies.flies}, {' '.join(_words)}"] = Row(
                f"`{' '.join(_words)}` where services answer after {_answer_s:g} s, and {_flies.flies} go on",
                stopped_for_good(
                    *_words,
                    before=slow_answers(_answer_s),
                    limit_s=LIMIT_S,
                    must_take=False,
                    is_rest_due=False,
                ),
                _flies,
                generations=("b",),
                why_not=_LATE,
            )
ROWS |= {
    "late link": Row(
        "`stop` over a round trip of 1.2 s, while a script goes on",
        stopped_for_good("stop", before=late_link, limit_s=LIMIT_S + 1.2, at_place_m=2.0),
        SCRIPT,
    ),
    "losing link": Row(
        "`stop` over 25 % loss, while a script goes on",
        stopped_for_good("stop", before=losing_link, limit_s=LOSSY_LIMIT_S, must_take=False, may_stand=True),
        SCRIPT,
    ),
    "hung 2 s": Row("`stop` while the vehicle's node hangs for 2 s", hung_for(2.0, "stop"), SCRIPT),
    "hung 20 s": Row("`stop` while the vehicle's node hangs for 20 s", hung_for(20.0, "stop"), SCRIPT),
    "hung 20 s, off": Row(
        "`stop --off` while the vehicle's node hangs for 20 s", hung_for(20.0, "stop", "--off"), CALLS
    ),
    "script goes on": Row("`stop` of a script that goes on", stopped_for_good("stop"), SCRIPT),
    "calls go on": Row("`stop`, and calls by hand go on", stopped_for_good("stop"), CALLS),
    "calls go on, off": Row(
        "`stop --off`, and calls by hand go on", stopped_for_good("stop", "--off"), CALLS
    ),
    "stop and hands": Row("`stop` and `hands` at once", stop_and_hands()),
    "stop and hands, busy": Row(
        "`stop` and `hands` at once, while the vehicle takes nothing for 2 s",
        stop_and_hands(busy, must_take=False),
        generations=("b",),
        why_not=_LATE,
    ),
    "stop and hands, late": Row(
        "`stop` and `hands` at once, over a round trip of 1.2 s",
        stop_and_hands(late_link, LIMIT_S + 1.2, must_take=False),
    ),
    "stop and hands, losing": Row(
        "`stop` and `hands` at once, over 25 % loss",
        stop_and_hands(losing_link, LOSSY_LIMIT_S, must_take=False, is_rest_due=False, may_stand=True),
    ),
    "deaf": Row("`stop` of a hull that goes on", disobeyed("deaf", "stop")),
    "deaf, off": Row("`stop --off` of a hull that goes on", disobeyed("deaf", "stop", "--off")),
    "reversed": Row("`stop` of a hull whose thrusters push the other way", disobeyed("reversed", "stop")),
    "hold, walking": Row(
        "the position walks off at 0.4 m/s under a hold",
        held_by_walking_position,
        generations=("b",),
        why_not="generation A has no hold but a go-to",
    ),
    "hold, deaf": Row(
        "a hull goes on under a hold",
        held_by_deaf_hull,
        generations=("b",),
        why_not="generation A has no hold but a go-to",
    ),
    "mux": Row("one node with two places 3 m apart", two_places),
    "taken over": Row("`take_over`, `hold_position`, `stop`, `continue`, `give_back`", taken_over),
    "continue": Row("`stop` and `continue` by ROS", stopped_and_continued),
    "arm": Row(
        "`hands` while an arm is open or closes",
        hands_at_arm,
        Setup(near_m=8.0, ahead_m=2.0, arm_moves=True),
        generations=("b",),
        why_not="generation A moves its docks itself",
    ),
    "imc under a latch": Row("an IMC console's plan under a guard's OFF", ordered_by_imc, CONSOLES),
    "console frozen": Row("`stop` with a frozen console", stopped("stop", before=console_frozen), CONSOLES),
    "fence edited": Row("the fence is drawn closer between death and resume", fence_edited),
    "watchdog dead": Row("watchdog killed, then the cable is cut", watchdog_dead),
    "watchdog deaf": Row("watchdog hangs while the cable is cut", watchdog_deaf),
    "watchdog anew, hold": Row("watchdog starts anew under a hold", watchdog_restarted("stop")),
    "watchdog anew, off": Row("watchdog starts anew under an OFF", watchdog_restarted("stop", "--off")),
    "second bench": Row("a second bench on the same vehicle", second_bench),
}
LATCHES: dict[str, tuple[Latch, bool]] = {
    "hold": (by_person("stop"), False),
    "off": (by_person("stop", "--off"), True),
    "hands": (by_person("hands"), True),
    "guard's hold": (hold_by_guard, False),
    "guard's off": (off_by_guard, True),
    "watchdog's hold": (by_watchdog(Kind.HOLD), False),
    "watchdog's off": (by_watchdog(Kind.OFF), False),
}
"""Each with whether an OFF of the bench is in force, which goes out again."""
for _name, (_latch, _off_again) in LATCHES.items():
    ROWS[f"resumed, {_name}"] = Row(
        f"supervisor killed and resumed under a {_name}",
        latched(_latch, off_again=_off_again),
        tries=LATCH_TRIES,
    )
for _name in ("hold", "off", "hands"):
    _latch, _off_again = LATCHES[_name]
    ROWS[f"asleep, {_name}"] = Row(
        f"the laptop asleep for 30 s under a {_name}", latched(_latch, asleep), tries=LATCH_TRIES
    )
    ROWS[f"carried, {_name}"] = Row(
        f"the run's directory carried elsewhere and resumed under a {_name}",
        latched(_latch, copied, off_again=_off_again),
        tries=LATCH_TRIES,
    )
ROWS["resumed, not taken"] = Row(
    "supervisor killed and resumed after a hold whose answer it did not live to see",
    latched(not_taken, holds=True),
    generations=("b",),
    why_not=_LATE,
    tries=LATCH_TRIES,
)
FIVE = Setup(apads=5, watchdog=False)
ROWS |= {
    "five": Row("`stop RUN` of five aPads", stop_all("stop"), FIVE),
    "five, off": Row("`stop RUN --off` of five aPads", stop_all("stop", "--off"), FIVE),
    "five, one": Row("`stop RUN/apad3` of five aPads", stop_all("stop", one="apad3"), FIVE),
    "five, one hangs": Row(
        "`stop RUN` of five aPads, one of whose nodes hangs", stop_all("stop", hangs="apad2"), FIVE
    ),
}
OWN = Setup(is_our_own=True)
for _name, _order in (("hold", "stop"), ("off", "stop --off"), ("hands", "hands")):
    ROWS[f"parent, {_name}"] = Row(
        f"the run's parent restarts a killed supervisor under a {_name}",
        restarted_by_parent(*_order.split()),
        OWN,
        tries=LATCH_TRIES,
    )
