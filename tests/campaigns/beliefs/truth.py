"""Simulates 100 aMussels for 20 days, minute by minute: the truth, which no filter here may read.

It shares no code with the filters and departs from their model: every aMussel draws up to 10 % more or less than the
nominal kind, and ages; its voltage sags and lifts by mode, by amounts of its own; docks charge a little faster or slower
each time; 3 % of the hours depart from the schedule; a sensor adds noise; and for 6 to 48 hours, about every three days,
no packet is received. Loads are those of the paper's Table I (scaled voltage a minute) as fitted in
firmware_model/table_one.py, written down again here.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

DAYS = 20
AGENTS = 100
HOURS = 24 * DAYS
NOISE = 0.015
UNSCHEDULED = 0.03
DRAIN_SPREAD = 0.10
MOTOR_RUN = 0.0268


class Doing(IntEnum):
    ASLEEP = 0
    IDLE = 1
    HIGH = 2
    SURFACING = 3
    FLOATING = 4
    DOCKED = 5
    SINKING = 6
    EMPTY = 7


PER_MIN = np.array(
    [0.0000674300, 0.0010427134, 0.0018000000, 0.0010427134, 0.0031823530, 0.0000674300, 0.0010427134, 0.0]
)
"""Asleep: MU and modem, hourly wakes aside. High load: the Pi besides, a third of the time. Floating: Wi-Fi, GSM and
Bluetooth besides."""
ASLEEP_IN_DOCK = 0.6037
"""The fraction of the load that reaches a battery during charging."""
CURVE = ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
TWO_COILS = 1.2435
SAG = np.array([0.0, -0.010, -0.030, -0.010, -0.028, +0.030, -0.010, 0.0])
"""Mean voltage bias by mode."""


ALONE = (Doing.ASLEEP, Doing.IDLE, Doing.HIGH)
_NOT_CALLED = 1 << 40


class Event(IntEnum):
    PERMITTED = 0
    DOCKED = 1
    RELEASED = 2


Array = npt.NDArray[Any]
Events = list[tuple[int, Event]]
"""(minute, event), in order."""


@dataclass
class Now:
    """All aMussels at one minute; `until`, `called` are minutes, `planned` the charges that an aPad assumes."""

    doing: Array
    primary: Array
    secondary: Array
    planned: Array
    planned_secondary: Array
    drain: Array
    coils: Array
    until: Array
    called: Array
    low: Array
    wait: Array


@dataclass(frozen=True)
class Life:
    """The lives of one seed; times in minutes, hours as the second index. `timeslot_minute` is the minute of the hour of
    each agent's packet."""

    timeslot_minute: Array
    scheduled: Array
    """(agents, hours): the mode commanded for the hour, known to a filter that knows the schedule."""
    unscheduled: Array
    """(agents, hours): the hour departed from the schedule."""
    doing: Array
    primary: Array
    secondary: Array
    """(agents, hours): at the timeslot."""
    measured: Array
    """(agents, hours, 2): the two charges in a packet of that hour."""
    luck: Array
    """(agents, hours) in [0, 1): a packet is lost when this is above the share of packets received."""
    dark: Array
    """(agents, hours): within a blackout."""
    events: list[Events]
    """The events of each agent."""
    drain: Array
    sag: Array
    """(agents, modes): the true voltage bias."""


def live(seed: int, agents: int = AGENTS, hours: int = HOURS) -> Life:
    rng = np.random.default_rng(seed)
    drain = rng.uniform(1 - DRAIN_SPREAD, 1 + DRAIN_SPREAD, agents)
    ageing = rng.uniform(0.0, 0.002, agents) / 1440  # of the capacity, a minute
    sag = SAG * rng.uniform(0.4, 1.6, (agents, 1)) + rng.normal(0, 0.003, (agents, len(SAG)))
    timeslot_minute = 1 + np.arange(agents) % 8
    scheduled = _schedules(rng, agents, hours)
    unscheduled = rng.random((agents, hours)) < UNSCHEDULED
    other = (scheduled + rng.integers(1, 3, (agents, hours))) % 3
    by_itself = np.where(unscheduled, other, scheduled)

    now = Now(
        doing=by_itself[:, 0].copy(),
        primary=rng.uniform(0.3, 1.0, agents),
        secondary=rng.uniform(0.9, 1.0, agents),
        planned=np.full(agents, 0.65),
        planned_secondary=np.ones(agents),
        drain=drain,
        coils=np.ones(agents),
        until=np.full(agents, -1),
        called=np.full(agents, _NOT_CALLED),
        low=rng.uniform(0.4, 0.75, agents),
        wait=rng.integers(30, 600, agents),
    )
    events: list[Events] = [[] for _ in range(agents)]
    at_timeslot = (np.zeros((agents, hours)), np.zeros((agents, hours)), np.zeros((agents, hours), int))
    for minute in range(60 * hours):
        hour = minute // 60
        if minute % 60 == 0:
            now.doing = np.where(now.doing <= Doing.HIGH, by_itself[:, hour], now.doing)
        for i in np.flatnonzero((now.called == minute) | (now.until == minute)):
            _turn(rng, i, minute, by_itself[i, hour], now, events[i])
        here = timeslot_minute == minute % 60
        if here.any():
            for target, source in zip(at_timeslot, (now.primary, now.secondary, now.doing), strict=True):
                target[here, hour] = source[here]
        _pass_a_minute(rng, minute, scheduled[:, hour], 1 + ageing * minute, now)
    noise = rng.normal(0, NOISE, (agents, hours, 2))
    bias = np.take_along_axis(sag, at_timeslot[2], axis=1)
    lift = np.where(at_timeslot[2] == Doing.DOCKED, bias, 0.0)
    measured = np.stack([at_timeslot[0] + bias, at_timeslot[1] + lift], axis=2) + noise
    return Life(
        timeslot_minute,
        scheduled,
        unscheduled,
        at_timeslot[2],
        at_timeslot[0],
        at_timeslot[1],
        np.clip(measured, 0, 1),
        rng.random((agents, hours)),
        _blackouts(rng, agents, hours),
        events,
        drain,
        sag,
    )


def _pass_a_minute(rng: np.random.Generator, minute: int, scheduled: Array, age: Array, now: Now) -> None:
    now.doing = np.where((now.doing <= Doing.HIGH) & (now.primary <= 0), Doing.EMPTY, now.doing)
    now.primary, now.secondary = _step(
        now.doing, now.primary, now.secondary, now.drain * age, now.coils * age
    )
    # An aPad cannot see the truth: it comes when a nominal aMussel on schedule would be low, and releases the aMussel
    # some hours after the nominal one would be full.
    alone = (now.doing <= Doing.HIGH) | (now.doing == Doing.EMPTY)
    nominally, nominal = np.where(alone, scheduled, now.doing), np.ones(len(alone))
    now.planned, now.planned_secondary = _step(
        nominally, now.planned, now.planned_secondary, nominal, nominal
    )
    full = (now.planned >= 1) & (now.planned_secondary >= 1)
    done = (now.doing == Doing.DOCKED) & (now.until < 0) & full
    now.until[done] = minute + 1 + rng.integers(60, 300, done.sum())
    calls = (now.planned < now.low) & (now.called == _NOT_CALLED) & alone
    now.called[calls] = minute + 1 + now.wait[calls]


def _schedules(rng: np.random.Generator, agents: int, hours: int) -> Array:
    """A day's plan for each, commanded anew every five days: blocks of 2 to 6 hours, mostly asleep."""
    plan = np.zeros((agents, hours), int)
    for i in range(agents):
        for first in range(0, hours, 120):
            day: list[int] = []
            while len(day) < 24:
                day += [int(rng.choice(3, p=[0.80, 0.17, 0.03]))] * int(rng.integers(2, 7))
            plan[i, first : first + 120] = np.resize(day[:24], 120)[: hours - first]
    return plan


def _turn(rng: np.random.Generator, i: int, minute: int, by_itself: int, now: Now, events: Events) -> None:
    """The next step of a collection: permission, up, floating, docked, released, down."""
    doing = now.doing[i]
    if doing in (*ALONE, Doing.EMPTY):
        events.append((minute, Event.PERMITTED))
        _run_motors(i, now)
        now.doing[i], now.until[i] = Doing.SURFACING, minute + 4
    elif doing == Doing.SURFACING:
        now.doing[i], now.until[i] = Doing.FLOATING, minute + int(rng.integers(5, 40))
    elif doing == Doing.FLOATING:
        events.append((minute, Event.DOCKED))
        now.doing[i], now.coils[i] = Doing.DOCKED, rng.normal(1.0, 0.03)
        # Some are released early.
        now.until[i] = minute + int(rng.integers(60, 300)) if rng.random() < 0.2 else -1
    elif doing == Doing.DOCKED:
        events.append((minute, Event.RELEASED))
        _run_motors(i, now)
        now.doing[i], now.until[i] = Doing.SINKING, minute + 4
    else:
        now.doing[i], now.until[i], now.called[i] = by_itself, -1, _NOT_CALLED
        now.low[i], now.wait[i] = rng.uniform(0.4, 0.75), rng.integers(30, 600)


def _run_motors(i: int, now: Now) -> None:
    now.primary[i] = max(0.0, now.primary[i] - now.drain[i] * MOTOR_RUN)
    now.planned[i] = max(0.0, now.planned[i] - MOTOR_RUN)


def _step(
    doing: Array,
    primary: Array,
    secondary: Array,
    drain: Array,
    coils: Array,
) -> tuple[Array, Array]:
    """Both charges a minute later; an empty primary leaves the board asleep on the secondary."""
    docked = doing == Doing.DOCKED
    load = drain * PER_MIN[doing]
    rates = []
    for battery in (primary, secondary):
        rate = np.full(len(battery), CURVE[-1][1])
        for end, value in reversed(CURVE[:-1]):
            rate[battery <= end] = value
        rates.append(rate)
    charged = np.minimum(1.0, primary + coils * TWO_COILS * rates[0] - ASLEEP_IN_DOCK * load)
    backup = np.where(doing == Doing.EMPTY, drain * PER_MIN[Doing.ASLEEP], 0.0)
    return (
        np.where(docked, charged, np.maximum(0.0, primary - load)),
        np.where(docked, np.minimum(1.0, secondary + coils * rates[1]), np.maximum(0.0, secondary - backup)),
    )


def _blackouts(rng: np.random.Generator, agents: int, hours: int) -> Array:
    dark = np.zeros((agents, hours), bool)
    for i in range(agents):
        at = rng.exponential(45.0)
        while at < hours:
            length = rng.uniform(6.0, 48.0)
            dark[i, int(at) : int(at + length)] = True
            at += length + rng.exponential(45.0)
    return dark
