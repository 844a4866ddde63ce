"""Rows of faults of a vehicle at sea, each with the seconds to its stop: positions, networks, programs, pilots."""

from __future__ import annotations

import math
import signal
import time
from typing import Any

from older_pythons import NEEDS

from safety.flight import IMC_PORT, SIDE_M, Setup
from safety.judge import LIMIT_S, Case, Kind
from safety.row import (
    AFTER_S,
    LOSSY_LIMIT_S,
    SHOWN_S,
    SUPERVISOR,
    TABLE_TRIES,
    TETHER_LIMIT_S,
    WATCHDOG_LIMIT_S,
    Act,
    Row,
    Try,
    stopped,
    unless,
)

WITNESSES_LIMIT_S = 8.0
"""A frozen position with noise takes 5 s of ordered thrust to contradict, and 3 s."""
SERVO_S = 27.0
IDLE_S = 1200.0
"""A healthy mission of four aMussels at theta 30 orders a way more often than that."""
OUTSIDE_M = (SIDE_M + 15.0, SIDE_M / 2)
FENCE_AHEAD_S = 90.0
"""From anywhere inside, the way to the fence takes less."""
NURSERY = ("nursery",)
PARENT = ("apad_bridge.commands.main run",)
GATEWAYS = ("commands.main console", "commands.main imc")


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
    """Both generations show the goals of their action servers to all.

    The counterpart's server does not show those of its services: it is stopped when the fence comes ahead.
    """
    begun_s = time.monotonic()
    limit_s = FENCE_AHEAD_S if it.flight.is_counterpart else LIMIT_S
    it.flight.stranger("goal", generation=it.flight.generation, place=OUTSIDE_M)
    it.flight.pause(SHOWN_S + AFTER_S - LIMIT_S + limit_s)
    return it.case(begun_s, limit_s=limit_s)


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


def wifi_cut(loss: float = 0.0, delay_s: float = 0.0) -> Act:
    """The link is away for 25 s; before and after it loses that share and is so late."""

    def act(it: Try) -> Case:
        if loss or delay_s:
            it.flight.link(loss, delay_s)
            it.flight.pause(5.0)
        begun_s = time.monotonic()
        it.flight.link(1.0)
        it.flight.pause(25.0)
        healed_s = time.monotonic()
        it.flight.link(loss, delay_s)
        it.flight.pause(20.0)
        return it.case(begun_s, limit_s=WATCHDOG_LIMIT_S, deaf=(begun_s, healed_s), must_be=Kind.HOLD)

    return act


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
        other_faults=unless(refused, "`continue --stop 1` was taken after stop 2"),
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
        fault = unless(told.code != 0, "`stop` said done while a pilot steers")
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
        begun_s, is_stop_due=False, may_stop=False, other_faults=unless(not ended, "the run ended")
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


def gap(it: Try) -> None:
    """The bench's connections end in it, and the vehicle's computer learns nothing of that."""
    it.flight.link(1.0)
    it.flight.pause(6.0)
    it.flight.link(0.0)
    it.flight.pause(5.0)


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
        other_faults=(*unless(not early, "the run ended by itself"), *it.flight.guards()),
    )


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
    "wifi cut": Row("Wi-Fi cut for 25 s", wifi_cut(), tries=_T, is_short=True),
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
            at_place_m=2.0,
        ),
    ),
    "gap": Row("`stop` 5 s after the Wi-Fi was away for 6 s", stopped("stop", before=gap)),
    "gap, off": Row(
        "`stop --off` 5 s after the Wi-Fi was away for 6 s",
        stopped("stop", "--off", before=gap, must_be=Kind.OFF),
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
for _version in NEEDS:
    for _name, _act, _off_s in (
        ("late", wifi_cut(delay_s=0.3), 0.0),
        ("losing", wifi_cut(loss=0.2), 0.0),
        ("clock off", wifi_cut(), 3.0),
    ):
        ROWS[f"wifi cut, {_name}, python {_version}"] = Row(
            f"Wi-Fi cut for 25 s, {_name}, with the watchdog under Python {_version}",
            _act,
            Setup(watchdog_python=_version, clock_off_s=_off_s),
        )
