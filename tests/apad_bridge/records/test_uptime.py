"""Tests the meter's closed forms against an independent stepper that goes through every millisecond."""

from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.time_scale import TimeScale
from apad_bridge.events.fleet_events import Presence
from apad_bridge.mission.facts import SampleSource
from apad_bridge.records.sample_file import sample_figures
from apad_bridge.records.uptime import AgentUptime, UptimeMeter
from apad_bridge.records.uptime_figures import uptime_figures
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow, grains
from firmware_model.states import State

THETA, TICK_MS = 3, 5
SCALE = TimeScale(THETA)
# So fast that a battery empties and fills within a hundred milliseconds.
MODEL = ChargeModel(FULL // 40, ((FULL // 3, FULL // 90 + 7), (FULL, FULL // 30)))
PAPER = ChargeModel.from_minutes(0.0010427134, ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)))


BatteryIs = tuple[int, Flow] | tuple[int, Flow, int]
"""Grains, flow, and the modules' load."""


def truth(at_ms: int, state: State, docked: bool, primary: BatteryIs, secondary: BatteryIs) -> Truth:
    physical = Physical(
        Battery(at_ms, *primary), Battery(at_ms, *secondary), 0, 0, 0, 0, Buoyancy.SINK, docked
    )
    return Truth(at_ms, 7, state, physical)


def literal(
    truths: list[Truth],
    ticks: int,
    presence_by_tick: dict[int, Presence] | None = None,
    in_use: bool = True,
) -> AgentUptime:
    """Equation (3)'s sum, taken literally: it steps every millisecond of agent time and counts at every tick.

    `presence_by_tick` has the presence after that tick; while the aMussel is not simulated, nothing is counted.
    """
    presence_by_tick = presence_by_tick or {}
    presence, other_ticks = Presence.SIMULATED, Counter[Presence]()
    at_last, standing, counts = None, None, Counter[str]()
    primary = secondary = 0
    emptied = lost = False
    for ms in range(ticks * TICK_MS * THETA + 1):
        if standing is not None:
            primary = _step(primary, standing.physical.primary)
            secondary = _step(secondary, standing.physical.secondary)
        for standing in (it for it in truths if it.at_ms == ms):
            # A battery that flowed on keeps what the steps gave it.
            first, second = standing.physical.primary, standing.physical.secondary
            primary = first.charge if first.anchor_ms == ms else primary
            secondary = second.charge if second.anchor_ms == ms else secondary
        if standing is None:
            continue
        tick, is_tick = ms // (TICK_MS * THETA), ms % (TICK_MS * THETA) == 0
        if presence is Presence.SIMULATED:
            emptied |= primary == 0
            lost |= (primary == 0 and secondary == 0) or standing.state is State.LOST
            if ms > 0 and is_tick:
                is_at_work = standing.state in (State.ACTIVE, State.SLEEPING)
                # The other battery counts where it feeds a board at work, and is in use.
                on_secondary = in_use and is_at_work and standing.physical.secondary.load > 0
                charged = primary > 0 or (on_secondary and secondary > 0)
                counts["paper"] += charged and not standing.physical.docked
                counts["submerged"] += charged and is_at_work
                counts["dead"] += primary == 0
            at_last = primary
        elif is_tick:
            other_ticks[presence] += 1
        if is_tick:
            presence = presence_by_tick.get(tick, presence)
    newest = max([n for n in presence_by_tick if n <= ticks], default=-1)
    return AgentUptime(
        7,
        *(counts[it] for it in ("paper", "submerged", "dead")),
        emptied,
        lost,
        at_last,
        truths[0].physical.primary.charge,
        beside_real=other_ticks[Presence.REAL],
        retired=other_ticks[Presence.RETIRED],
        presence=presence_by_tick.get(newest, Presence.SIMULATED),
    )


def _step(charge: int, battery: Battery) -> int:
    charger = FULL // 90 + 7 if charge <= FULL // 3 else FULL // 30
    flows = {Flow.DISCHARGING: -FULL // 40 - battery.load, Flow.CHARGING: charger - battery.load}
    return min(FULL, max(0, charge + flows.get(battery.flow, 0)))


charges = st.one_of(st.just(0), st.just(FULL), st.integers(0, FULL))
# Either less than every charger's rate or more: between the two a charge would rest at a segment's end.
loads = st.sampled_from([0, FULL // 100, FULL // 20])
batteries = st.tuples(charges, st.sampled_from(Flow), loads)
events = st.lists(
    st.tuples(
        st.integers(1, 60),
        st.sampled_from([State.ACTIVE, State.SLEEPING, State.CALLING, State.REPORTING, State.LOST]),
        st.booleans(),
        batteries,
        batteries,
        st.sampled_from(("all anew", "batteries flow on", "primary anew", "secondary anew", "drift step")),
    ),
    max_size=8,
)


def truths_of(events, first_ms=0):
    """The truths, and the time after the last one. What is not anew stays as it was; a drift step changes the place."""
    truths, at_ms = [], first_ms
    for gap_ms, state, docked, primary, secondary, kind in events:
        now = truth(at_ms, state, docked, primary, secondary)
        if truths and kind != "all anew":
            before, part = truths[-1], kind.removesuffix(" anew")
            told = {"batteries flow on": {"docked": docked}, "drift step": {"north_um": at_ms}}
            changed = told[kind] if kind in told else {part: getattr(now.physical, part)}
            kept = state if kind == "batteries flow on" else before.state
            now = replace(now, state=kept, physical=replace(before.physical, **changed))
        truths.append(now)
        at_ms += gap_ms
    return truths, at_ms


EMPTY, FED = (0, Flow.DISCHARGING, 0), (FULL, Flow.RESTING, FULL // 100)
"""A battery that is empty, and a full one that feeds the board."""


@given(first_ms=st.integers(0, 20), events=events, ticks=st.integers(0, 20), in_use=st.booleans())
@example(
    first_ms=0,
    events=[
        (20, State.ACTIVE, False, EMPTY, FED, "all anew"),
        (20, State.ACTIVE, False, EMPTY, EMPTY, "secondary anew"),
    ],
    ticks=2,
    in_use=True,
)
def test_the_meter_counts_what_a_literal_stepper_counts(first_ms, events, ticks, in_use):
    truths, _ = truths_of(events, first_ms)
    until_ms = ticks * TICK_MS * THETA
    truths = [it for it in truths if it.at_ms <= until_ms]
    meter = UptimeMeter(SCALE, lambda _: MODEL, TICK_MS, secondary_in_use=in_use)
    for it in truths:
        meter.take(it)
    assert meter.at(ticks * TICK_MS) == ([literal(truths, ticks, in_use=in_use)] if truths else [])


presences = st.dictionaries(st.integers(0, 20), st.sampled_from(Presence), max_size=4)


@given(events=events, ticks=st.integers(0, 20), presence_by_tick=presences)
def test_only_a_simulated_one_in_the_water_is_counted(events, ticks, presence_by_tick):
    """The counts without `charge`, which is that of the last time when it was simulated."""
    truths, _ = truths_of(events)
    until_ms = ticks * TICK_MS * THETA
    truths = [it for it in truths if it.at_ms <= until_ms]
    stimuli = [(it.at_ms, 0, it) for it in truths]
    stimuli += [(n * TICK_MS * THETA, 1, presence) for n, presence in presence_by_tick.items() if n <= ticks]
    meter = UptimeMeter(SCALE, lambda _: MODEL, TICK_MS, secondary_in_use=True)
    for at_ms, _, it in sorted(stimuli, key=lambda it: it[:2]):
        if isinstance(it, Truth):
            meter.take(it)
        else:
            meter.set_presence(7, it, at_ms)
    counted = [replace(it, charge=0) for it in meter.at(ticks * TICK_MS)]
    assert counted == ([replace(literal(truths, ticks, presence_by_tick), charge=0)] if truths else [])


@pytest.fixture
def meter() -> UptimeMeter:
    return UptimeMeter(SCALE, lambda _: MODEL, TICK_MS, secondary_in_use=True)


def test_what_a_twin_does_is_told_apart(meter):
    """Ten ticks: three in the water, four as a real aMussel's twin that ends empty, three back in the water."""
    tick_ms = TICK_MS * THETA

    def at(tick: int, charge: int, samples: int) -> Truth:
        newest = truth(tick * tick_ms, State.ACTIVE, False, (charge, Flow.RESTING), (FULL, Flow.RESTING))
        return replace(newest, physical=replace(newest.physical, samples=samples))

    meter.take(
        replace(truth(0, State.CHARGING, True, (FULL, Flow.RESTING), (FULL, Flow.RESTING)), agent_id=8)
    )
    meter.take(at(0, FULL, 0))
    meter.take(at(2, FULL, 5))
    meter.set_presence(7, Presence.REAL, 3 * tick_ms)
    meter.take(at(5, 0, 9))
    active = [meter.active_now(5 * TICK_MS)]
    meter.take(at(7, FULL // 2, 9))
    meter.set_presence(7, Presence.SIMULATED, 7 * tick_ms)
    meter.take(at(8, FULL // 2, 11))
    assert [*active, meter.active_now(9 * TICK_MS)] == [0, 1]
    figures = uptime_figures(meter, 10 * TICK_MS, TICK_MS)
    # aMussel 7 was active at all of its 6 ticks, aMussel 8 docked at all of its 10.
    told = {"uptime_paper": {"mean": 100 * 6 / 16, "max": 100.0, "min": 0.0}, "active_mean": 6 / 10}
    told |= {"counted_s": 16 * TICK_MS / 1000, "counted_at_end": 2, "samples_taken": 7}
    told |= dict.fromkeys(("amussels_lost", "emptied", "dead_time_s"), 0)
    beside = {"amussels": 1, "beside_real_s": 4 * TICK_MS / 1000, "retired_s": 0, "samples_taken": 4}
    assert {key: figures[key] for key in (*told, "excluded")} == {**told, "excluded": beside}
    # Sequences 5 to 8 are the twin's. Of the others 0, 1, 2 and 10 were uploaded; 3 and 4 are a real aMussel's.
    apart = {it.agent_id: it.apart for it in meter.at(10 * TICK_MS)}
    kept = {SampleSource(7): {0, 1, 2, 6, 10}, SampleSource(7, 3000): {1, 3, 4}}
    assert sample_figures({7: 11, 8: 0}, kept, {SampleSource(7): {3, 7}}, apart) == {
        "samples_taken": 7,
        "samples_uploaded": 4,
        "samples_lost": 1,
        "samples_waiting": 2,
    }


def test_where_everybody_is_elsewhere_there_are_no_figures(meter):
    meter.take(truth(0, State.ACTIVE, False, (FULL, Flow.RESTING), (FULL, Flow.RESTING)))
    meter.set_presence(7, Presence.RETIRED, 0)
    figures = uptime_figures(meter, 4 * TICK_MS, TICK_MS)
    told = figures["uptime_paper"], figures["uptime_missing"], figures["excluded"]["retired_s"]
    assert told == (None, "no aMussel was simulated in the water", 4 * TICK_MS / 1000)


@given(events=events, ticks=st.integers(1, 20))
def test_asking_early_changes_nothing(events, ticks):
    asked, silent = (UptimeMeter(SCALE, lambda _: MODEL, TICK_MS, secondary_in_use=True) for _ in range(2))
    truths, at_ms = truths_of(events)
    for it in truths:
        for meter in (asked, silent):
            meter.take(it)
        asked.at(it.at_ms // THETA)
    end_ms = max(ticks * TICK_MS, at_ms)
    assert asked.at(end_ms) == silent.at(end_ms)


# Table II, "no charging": 40 minutes at theta = 30 take 1.25126 batteries; the mean initial charge is 0.8428, the least
# 0.7087, the largest 0.9955; the uptimes 67.36, 56.64 and 79.56 percent.
@pytest.mark.parametrize(("charge", "percent"), [(0.8428, 67.36), (0.7087, 56.64), (0.9955, 79.56)])
def test_the_papers_row_without_charging(charge, percent):
    meter = UptimeMeter(TimeScale(30), lambda _: PAPER)
    meter.take(truth(0, State.ACTIVE, False, (grains(charge), Flow.DISCHARGING), (FULL, Flow.RESTING)))
    (uptime,) = meter.at(2_400_000)
    assert 100 * uptime.paper / 2400 == pytest.approx(percent, abs=0.05)
    found = uptime.emptied, uptime.lost, uptime.charge, uptime.dead
    assert found == (True, False, 0, 2400 - uptime.paper)


def test_uptime_at_equal_charge_by_hand():
    """One spends charge and pays for it, one comes back fuller, and what a real one's twin gained is unknown."""
    meter = UptimeMeter(TimeScale(30), lambda _: PAPER)
    spends = truth(0, State.ACTIVE, False, (grains(0.8), Flow.DISCHARGING), (FULL, Flow.RESTING))
    fills = truth(0, State.CHARGING, True, (grains(0.6), Flow.CHARGING), (FULL, Flow.RESTING))
    for it in (spends, replace(fills, agent_id=8), replace(spends, agent_id=9)):
        meter.take(it)
    meter.set_presence(9, Presence.REAL, 30_000)
    # 1000 s of the mission are 500 minutes of theirs: 0.0010427134 a minute down, and the fast 0.002911 up to full.
    figures = uptime_figures(meter, 1_000_000, battery_min=250.0)
    assert figures["charge_gain_mean"] == pytest.approx((-500 * 0.0010427134 + 0.4) / 2, abs=1e-6)
    # In the water: 1000 ticks each for two, one tick for the third. Two ticks a minute of theirs.
    paid_ticks = 250 * 2 * (-500 * 0.0010427134 + 0.4)
    assert figures["uptime_equal_charge"] == pytest.approx(100 * (1000 + 1 + paid_ticks) / 2001, abs=1e-3)
    assert uptime_figures(meter, 1_000_000)["uptime_equal_charge"] is None
    for agent_id in (7, 8):
        meter.set_presence(agent_id, Presence.REAL, 30_000_000)
    # Nobody is left whose charge has a value.
    assert uptime_figures(meter, 1_001_000, battery_min=250.0)["uptime_equal_charge"] is None


UP, DOWN = (FULL, Flow.RESTING), (FULL, Flow.DISCHARGING)
CHARGES = truth(45, State.CHARGING, True, (FULL // 2, Flow.CHARGING), UP)
IDLE = truth(0, State.ACTIVE, False, UP, UP)


def test_active_now_follows_the_dock_and_the_battery_and_one_that_is_gone(meter):
    """After 39 ms of agent time 1/40 of a battery is left. One that is gone may be started again."""
    meter.take(truth(0, State.ACTIVE, False, DOWN, UP))
    found = [meter.active_now(13), meter.active_now(14)]
    meter.take(CHARGES)
    found.append(meter.active_now(15))
    meter.take(replace(IDLE, agent_id=8))
    meter.ended(8, 4 * TICK_MS * THETA)
    counts = [meter.at(10 * TICK_MS)[-1].paper]
    found += meter.active_now(3 * TICK_MS), meter.active_now(4 * TICK_MS)
    meter.take(replace(IDLE, agent_id=8, at_ms=8 * TICK_MS * THETA))
    counts.append(meter.at(10 * TICK_MS)[-1].paper)
    assert (found, counts) == ([1, 0, 0, 1, 0], [3, 6])


def test_an_older_truth_is_refused_and_changes_nothing(meter):
    meter.take(truth(30, State.ACTIVE, False, (FULL, Flow.RESTING), (FULL, Flow.RESTING)))
    with pytest.raises(ValueError, match="time went back: 29 before 30"):
        meter.take(truth(29, State.ACTIVE, True, (0, Flow.RESTING), (0, Flow.RESTING)))
    assert meter.at(100) == [AgentUptime(7, 19, 19, 0, False, False, FULL, FULL)]
