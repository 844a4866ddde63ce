"""What 100 aMussels do for 20 days, stepped minute by minute: the truth that no filter here may look at.

It shares no code with the filters and departs from their model: every aMussel draws up to 10 % more or less than it
should, and ages; its voltage sags and lifts by mode, by amounts of its own; docks charge a little faster or slower each
time; 3 % of the hours go otherwise than scheduled; a sensor adds noise; and for 6 to 48 hours, about every three days,
nothing is heard. Loads are those of the paper's Table I (scaled voltage a minute) as fitted in
firmware_model/table_one.py, written down again here.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

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
"""Asleep: MU and modem, hourly wakes aside. High load: the Pi besides, a third of the time. Floating: Wi-Fi, GSM and Bluetooth besides."""
ASLEEP_IN_DOCK = 0.6037
"""Of the load, what reaches a battery that is being charged."""
CURVE = ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
TWO_COILS = 1.2435
SAG = np.array([0.0, -0.010, -0.030, -0.010, -0.028, +0.030, -0.010, 0.0])
"""Mean voltage bias by what it does."""


class Event(IntEnum):
    PERMITTED = 0
    DOCKED = 1
    RELEASED = 2


@dataclass(frozen=True)
class Life:
    """Of one seed; times in minutes, hours as the second index. `slot` is the minute of the hour of each agent's packet."""

    slot: np.ndarray
    scheduled: np.ndarray
    """(agents, hours): the mode commanded for the hour, known to a filter that knows the schedule."""
    unscheduled: np.ndarray
    """(agents, hours): the hour went otherwise."""
    doing: np.ndarray
    primary: np.ndarray
    secondary: np.ndarray
    """(agents, hours): at the slot."""
    measured: np.ndarray
    """(agents, hours, 2): what a packet would say of the two charges."""
    luck: np.ndarray
    """(agents, hours) in [0, 1): a packet is lost when this is above the share that is heard."""
    dark: np.ndarray
    """(agents, hours): within a blackout."""
    events: list[list[tuple[int, Event]]]
    """By agent: (minute, event), in order."""
    drain: np.ndarray
    sag: np.ndarray
    """(agents, modes): the true voltage bias."""


def live(seed: int, agents: int = AGENTS, hours: int = HOURS) -> Life:
    rng = np.random.default_rng(seed)
    drain = rng.uniform(1 - DRAIN_SPREAD, 1 + DRAIN_SPREAD, agents)
    ageing = rng.uniform(0.0, 0.002, agents) / 1440  # of the capacity, a minute
    sag = SAG * rng.uniform(0.4, 1.6, (agents, 1)) + rng.normal(0, 0.003, (agents, len(SAG)))
    slot = 1 + np.arange(agents) % 8
    scheduled = _schedules(rng, agents, hours)
    unscheduled = rng.random((agents, hours)) < UNSCHEDULED
    other = (scheduled + rng.integers(1, 3, (agents, hours))) % 3
    by_itself = np.where(unscheduled, other, scheduled)

    primary, secondary = rng.uniform(0.3, 1.0, agents), rng.uniform(0.9, 1.0, agents)
    doing = by_itself[:, 0].copy()
    until = np.full(agents, -1)
    floats, coils = np.zeros(agents, int), np.ones(agents)
    low, wait = _service(rng, agents)
    called = np.full(agents, 1 << 40)
    events: list[list[tuple[int, Event]]] = [[] for _ in range(agents)]
    at_slot = (np.zeros((agents, hours)), np.zeros((agents, hours)), np.zeros((agents, hours), int))
    for minute in range(60 * hours):
        hour = minute // 60
        self_moved = doing <= Doing.HIGH
        if minute % 60 == 0:
            doing = np.where(self_moved, by_itself[:, hour], doing)
        for i in np.flatnonzero((called == minute) | (until == minute)):
            _turn(
                rng,
                i,
                minute,
                doing,
                until,
                floats,
                coils,
                called,
                low,
                wait,
                primary,
                drain,
                events,
                by_itself[i, hour],
            )
        here = slot == minute % 60
        if here.any():
            for kept, now in zip(at_slot, (primary, secondary, doing), strict=True):
                kept[here, hour] = now[here]
        k = drain * (1 + ageing * minute)
        doing = np.where(self_moved & (primary <= 0), Doing.EMPTY, doing)
        primary, secondary, full = _step(doing, primary, secondary, k, coils, 1 + ageing * minute)
        done = full & (until < 0)
        until[done] = minute + 1 + rng.integers(5, 90, done.sum())
        calls = (primary < low) & (called > 1 << 39) & ((doing <= Doing.HIGH) | (doing == Doing.EMPTY))
        called[calls] = minute + 1 + wait[calls]
    noise = rng.normal(0, NOISE, (agents, hours, 2))
    bias = np.take_along_axis(sag, at_slot[2], axis=1)
    lift = np.where(at_slot[2] == Doing.DOCKED, bias, 0.0)
    measured = np.stack([at_slot[0] + bias, at_slot[1] + lift], axis=2) + noise
    return Life(
        slot,
        scheduled,
        unscheduled,
        at_slot[2],
        at_slot[0],
        at_slot[1],
        np.clip(measured, 0, 1),
        rng.random((agents, hours)),
        _blackouts(rng, agents, hours),
        events,
        drain,
        sag,
    )


def _schedules(rng: np.random.Generator, agents: int, hours: int) -> np.ndarray:
    """A day's plan for each, commanded anew every five days: blocks of 2 to 6 hours, mostly asleep."""
    plan = np.zeros((agents, hours), int)
    for i in range(agents):
        for first in range(0, hours, 120):
            day: list[int] = []
            while len(day) < 24:
                day += [int(rng.choice(3, p=[0.80, 0.17, 0.03]))] * int(rng.integers(2, 7))
            plan[i, first : first + 120] = np.resize(day[:24], 120)[: hours - first]
    return plan


def _service(rng: np.random.Generator, agents: int) -> tuple[np.ndarray, np.ndarray]:
    """Below which charge an aPad is called, and how many minutes later it comes."""
    return rng.uniform(0.3, 0.7, agents), rng.integers(30, 600, agents)


def _turn(
    rng, i, minute, doing, until, floats, coils, called, low, wait, primary, drain, events, by_itself
) -> None:
    """The next step of a collection: permission, up, floating, docked, released, down."""
    if doing[i] <= Doing.HIGH or doing[i] == Doing.EMPTY:
        events[i].append((minute, Event.PERMITTED))
        primary[i] = max(0.0, primary[i] - drain[i] * MOTOR_RUN)
        doing[i], until[i] = Doing.SURFACING, minute + 4
    elif doing[i] == Doing.SURFACING:
        doing[i], until[i] = Doing.FLOATING, minute + int(rng.integers(5, 40))
    elif doing[i] == Doing.FLOATING:
        events[i].append((minute, Event.DOCKED))
        doing[i], coils[i] = Doing.DOCKED, rng.normal(1.0, 0.03)
        until[i] = minute + int(rng.integers(60, 300)) if rng.random() < 0.2 else -1  # some are let go early
    elif doing[i] == Doing.DOCKED:
        events[i].append((minute, Event.RELEASED))
        primary[i] = max(0.0, primary[i] - drain[i] * MOTOR_RUN)
        doing[i], until[i] = Doing.SINKING, minute + 4
    else:
        doing[i], until[i], called[i] = by_itself, -1, 1 << 40
        low[i], wait[i] = rng.uniform(0.3, 0.7), rng.integers(30, 600)


def _step(doing, primary, secondary, k, coils, age):
    """One minute; an empty primary leaves the board asleep on the secondary."""
    docked = doing == Doing.DOCKED
    load = k * PER_MIN[doing]
    rate = np.full(len(primary), CURVE[-1][1])
    rate2 = rate.copy()
    for end, value in reversed(CURVE[:-1]):
        rate[primary <= end], rate2[secondary <= end] = value, value
    charged = np.minimum(1.0, primary + coils * age * TWO_COILS * rate - ASLEEP_IN_DOCK * load)
    charged2 = np.minimum(1.0, secondary + coils * age * rate2)
    empty = doing == Doing.EMPTY
    drained2 = np.where(empty, np.maximum(0.0, secondary - k * PER_MIN[Doing.ASLEEP]), secondary)
    new = np.where(docked, charged, np.maximum(0.0, primary - load))
    new2 = np.where(docked, charged2, drained2)
    return new, new2, docked & (new >= 1.0) & (new2 >= 1.0)


def _blackouts(rng: np.random.Generator, agents: int, hours: int) -> np.ndarray:
    dark = np.zeros((agents, hours), bool)
    for i in range(agents):
        at = rng.exponential(45.0)
        while at < hours:
            length = rng.uniform(6.0, 48.0)
            dark[i, int(at) : int(at + length)] = True
            at += length + rng.exponential(45.0)
    return dark
