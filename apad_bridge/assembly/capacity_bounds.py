"""Upper bounds for a scenario: what no strategy can exceed, however cleverly it collects.

An aMussel i starts with the charge u_i, loses d_i an agent minute while it is active (in its duty cycle: the mean over a
whole cycle), and gains at most c_i a docked minute. In a mission of T minutes with D docks, its active time a_i and its
docked time y_i obey

    d_i a_i <= u_i + c_i y_i        (it cannot spend what it does not have)
    a_i + y_i <= T                  (it is active in the water only)
    sum of y_i <= D T               (each dock holds one)

The largest sum of a_i is a linear programme. Without docks, a_i = min(T, u_i / d_i). Each docked minute adds c_i / d_i
active ones, up to y_i = (d_i T - u_i) / (c_i + d_i), from where it costs one. So the docks' time goes to the largest
c_i / d_i first.

For ever, u_i / T vanishes: an aMussel that is never empty is active for the share c / (c + d) and docked for d / (c + d),
so one aPad sustains D (1 + c / d) aMussels. Where aMussels differ, as by the wait for their timeslots, the shares of those
that it sustains sum to D: it sustains D over the fleet's mean share. A fleet that sleeps needs kf times the charge of one
that is always awake, and the number is D (1 + (c / d) / kf). For the paper's aMussels, always awake, and four docks it is
15.2 when only the fast end of the curve is used, and 11.9 when each charge begins at empty.

Each service costs a surfacing and a sinking, e of a battery. A dock that charges from x to y in t(x, y) minutes gives the
aMussel (y - x - e) / d minutes of work. So c is max (y - x - e) / t(x, y), and because the curve is piecewise linear the
maximum lies at two of its breakpoints. Without e it is the steepest part of the curve. An aMussel that is docked at the end
of a mission has yet to sink, so the mission's u has that part of e added.

An aMussel with an empty primary comes up on its backup battery, which the dock fills at the same time. So a service from
empty pays for the sinking alone, s of a battery, and gains y - s in t(0, y) minutes. The c above is the larger one of both
maxima. Where motor runs take much, a board that is let run down gains more than one that is fetched in time.

A whole board is awake on its way up, on its way down, and while it listens on the bottom. In these t_e minutes it draws the
idle load i, and would have drawn d. So its e is that of two runs of the motors and (i - d) t_e. Its c is less what it draws
in a dock: asleep, and for `report_s` after each alarm. Its d is a mean over whole cycles. A mission may end just before an
alarm, so its u has the charge of one wake added.

A board that never sleeps samples under water alone. Each service takes it away for its time in the dock and for w minutes
more: its ways up and down, and the closing of a virtual dock, while it draws d. With the best x and y it gains at most
g = max (y - x - e - d w) / (t + w) a minute away; from empty it draws on its way down alone. So beside a <= the bound
above, its minutes of samples a obey

    d a <= u + g z  and  a + z <= T    for z minutes away, so  a <= T - (d T - u) / (g + d)

without regard to docks. One that is docked at the end has its way down before it: u and T have that way added.

Alarms find the board in the water, on its way or in a dock in proportion to time, as they do where nobody plans for them. A
service that is timed to skip a wake saves that wake. So for whole boards that sleep there is a second bound, which nothing
beats: it has the drain asleep for d, as if each wake were skipped. Travel, waiting and the rest of the time afloat are left
out, so flights stay below.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, fsum, inf, isfinite
from statistics import fmean

from apad_bridge.assembly.estimator import schedules
from apad_bridge.assembly.scenario_energy_model import drain_per_min_of
from apad_bridge.scenario.blocks.mission_options import DockingProfile
from apad_bridge.scenario.firmware_config import board_config, sinking_of, spread_of, takes_samples
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.starts_table import Start
from firmware_model.config import PATH_UNIT, BoardConfig, FullFirmware
from firmware_model.power.charge import FULL, MS_PER_MIN
from firmware_model.power.rails import Rail, rails_of
from firmware_model.sinking import Sinking
from firmware_model.states import State

_LEAST_MIN = 1 / MS_PER_MIN
"""No charge takes less than a millisecond, whatever its curve."""


@dataclass(frozen=True, slots=True)
class Rates:
    """An aMussel's charge on [0, 1]: `start`, and the rates an agent minute of its drain and of its charger."""

    start: float
    """With the charges that a mission's end may leave unspent: that of a way down, and that of a wake."""
    drain: float
    charge: float
    """The greatest gain a docked minute over whole services, less the cost of surfacing and sinking; at least 0."""
    full_charge_min: float
    """The minutes from empty to full."""
    charge_away: float
    """The greatest gain a minute away: in the dock, on the ways and in a closing dock, less what these draw; at least 0."""
    down_min: float
    """The minutes of a way down."""
    charge_held: float
    """The greatest gain a minute in which a service takes its dock: to close a virtual one, and to charge."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a mission, as means over the configurations, and of a fleet that lives for ever."""

    amussels: int
    docks: int
    uptime_percent: float
    active: float
    """aMussels that are active at a time, on average."""
    samples: float | None
    """None for boards with a low level, at which they take samples besides their schedule."""
    sustained: float
    """aMussels like this fleet's that the docks keep from ever being empty, each charge on the best part of the curve."""
    sustained_from_empty: float
    """The same if each charge goes from empty to full."""
    uptime_for_ever_percent: float
    timed_uptime_percent: float | None
    """The bound of `uptime_percent` for services that are timed to skip wakes; None for boards that do not sleep."""
    timed_uptime_for_ever_percent: float | None
    cycles_per_apad_charge: float | None
    """Number of times that one charge of the aPad fills each battery of the fleet from empty; None if it costs nothing."""

    @property
    def text(self) -> str:
        """In words. Each number is rounded up, because a bound that is rounded down may be exceeded."""
        samples = "" if self.samples is None else f", {_up(self.samples, 0)} samples"
        unless, timed = "", ""
        if self.timed_uptime_percent is not None and self.timed_uptime_for_ever_percent is not None:
            unless = " that does not time its services to skip wakes"
            timed = (
                f" One that does stays at or below {_up(self.timed_uptime_percent)} % and, in the long run, "
                f"{_up(self.timed_uptime_for_ever_percent)} %."
            )
        return (
            f"No strategy{unless} exceeds {_up(self.uptime_percent)} % uptime, {_up(self.active, 2)} active "
            f"aMussels{samples} here, or {_up(self.uptime_for_ever_percent)} % uptime in the long run.{timed} "
            f"{self.docks} docks sustain at most {_up(self.sustained)} aMussels "
            f"({_up(self.sustained_from_empty)} if each charge begins at empty); "
            f"the fleet has {self.amussels}."
        )


def _up(value: float, digits: int = 1) -> str:
    """The least decimal number with so many digits that is not below the value, up to the rounding of a sum."""
    if not isfinite(value):
        return str(value)
    return f"{ceil(value * 10**digits - 1e-6) / 10**digits:.{digits}f}"


def bounds_of(
    scenarios: Sequence[Scenario], duration_s: float | None = None, failed_docks: int = 0
) -> Bounds:
    """The bounds of missions that differ in their seeds alone; `duration_s` is another mission time than the scenarios'.

    `failed_docks` of their docks served nobody.
    """
    fleets = [rates_of(scenario) for scenario in scenarios]
    scenario, amussels, docks = scenarios[0], len(fleets[0]), _docks_of(scenarios[0]) - failed_docks
    mission_s = scenario.duration_s if duration_s is None else duration_s
    minutes = scenario.time_scale.agent_time(mission_s) / 60
    if not amussels or not minutes:
        return Bounds(
            amussels=amussels,
            docks=docks,
            uptime_percent=0.0,
            active=0.0,
            samples=0.0,
            sustained=0.0,
            sustained_from_empty=0.0,
            uptime_for_ever_percent=0.0,
            timed_uptime_percent=None,
            timed_uptime_for_ever_percent=None,
            cycles_per_apad_charge=None,
        )
    active = fmean(active_minutes(fleet, minutes, docks) for fleet in fleets) / minutes
    each = [rates for fleet in fleets for rates in fleet]
    timed = timed_for_ever = None
    if scenario.board.whole is not None and scenario.board.whole.cycle is not None:
        asleep = [rates_of(it, skips_wakes=True) for it in scenarios]
        timed = 100 * fmean(active_minutes(it, minutes, docks) for it in asleep) / minutes / amussels
        timed_for_ever = _for_ever_percent(asleep[0], docks)
    return Bounds(
        amussels=amussels,
        docks=docks,
        uptime_percent=100 * active / amussels,
        active=active,
        samples=_samples(
            scenario, min(active, fmean(_sampling_minutes(it, minutes) for it in fleets) / minutes), mission_s
        ),
        sustained=docks / fmean(it.drain / (it.charge + it.drain) for it in each),
        sustained_from_empty=docks / fmean(it.drain / (1 / it.full_charge_min + it.drain) for it in each),
        uptime_for_ever_percent=_for_ever_percent(fleets[0], docks),
        timed_uptime_percent=timed,
        timed_uptime_for_ever_percent=timed_for_ever,
        cycles_per_apad_charge=_cycles_per_apad_charge(
            scenario, fmean(it.full_charge_min for it in each), amussels
        ),
    )


def _for_ever_percent(fleet: Sequence[Rates], docks: int) -> float:
    return 100 * active_minutes([replace(it, start=0.0) for it in fleet], 1.0, docks) / len(fleet)


def _cycles_per_apad_charge(scenario: Scenario, full_min: float, amussels: int) -> float | None:
    """The cycles of the fleet that a full battery of one aPad affords; with several aPads each has its part of the fleet.

    A cycle fills each aMussel from empty once: its dock draws all that time, and the hotel load runs as long as the docks
    take for their aMussels one after the other. Travel is left out.
    """
    apad, share = scenario.apad, amussels / (1 + len(scenario.apads))
    hours = scenario.time_scale.mission_time(full_min / 60)
    needed_wh = share * hours * (apad.battery.charging_w_per_dock + apad.battery.hotel_w / apad.docks)
    return apad.battery.capacity_wh / needed_wh if needed_wh else None


def active_minutes(
    fleet: Sequence[Rates], minutes: float, docks: int, taken: Callable[[Rates], float] = lambda _: 1.0
) -> float:
    """The largest sum of active time of a fleet, in agent minutes: the linear programme of this module's docstring.

    `taken` gives the minutes of its dock that a docked minute of an aMussel takes.
    """
    total, left = 0.0, docks * minutes
    for it in sorted(fleet, key=lambda rates: -rates.charge / (rates.drain * taken(rates))):
        docked = min(left / taken(it), max(0.0, (it.drain * minutes - it.start) / (it.charge + it.drain)))
        left -= docked * taken(it)
        total += min(minutes - docked, (it.start + it.charge * docked) / it.drain)
    return total


def _sampling_minutes(fleet: Sequence[Rates], minutes: float) -> float:
    """The largest sum of the time under water of boards that never sleep, in agent minutes, if docks are always free."""
    total = 0.0
    for it in fleet:
        away = max(0.0, (it.drain * minutes - it.start) / (it.charge_away + it.drain))
        total += min(minutes, minutes + it.down_min - away)
    return total


def battery_worth_min(scenario: Scenario) -> float:
    """The active agent minutes of one aMussel that a whole battery more at the begin is worth, on the mean over the fleet.

    It is the price of charge in the linear programme: who has it need not be docked for it, which is 1 / (c + d). A fleet
    that its docks cannot hold works off all that it gets, which is 1 / d. Without a fleet it is 0.

    With it, uptime at equal charge is U + 100 w (q_end - q_begin) / T for a mean uptime U in percent, mean charges q on
    [0, 1], and T agent minutes. By the programme it does not exceed the bound in the long run, but for a way down of those
    that are docked at the end, and a wake.
    """
    fleet = rates_of(scenario)
    docks = scenario.apad.docks if scenario.fleet.share else _docks_of(scenario)
    if not fleet:
        return 0.0
    is_held = fsum(it.drain / (it.charge + it.drain) for it in fleet) <= docks
    return fmean(1 / (it.drain + (it.charge if is_held else 0.0)) for it in fleet)


def rates_of(scenario: Scenario, *, skips_wakes: bool = False) -> list[Rates]:
    """Each aMussel's rates, in its own duty cycle; with `skips_wakes` as if it never woke."""
    nominal, spread = board_config(scenario.board, scenario.seed), spread_of(scenario)
    sinking, ids = sinking_of(scenario), scenario.fleet.all_ids
    found = []
    for start in starts_of(scenario):
        board = spread.applied(replace(nominal, agent_id=start.agent_id), scenario.seed)
        docked = _draw_in_a_dock(board, reports=not skips_wakes)
        per_min = _curve_of(board, docked)
        drain = _drain_asleep(board, ids) if skips_wakes else drain_per_min_of(board, ids)
        up, down = _ways_of(board, sinking, drain)
        sinking_cost = max(0.0, down)
        gain = max(_best_gain(per_min, max(0.0, up + down)), _gain_from_empty(board, docked, sinking_cost))
        unspent = max(0.0, down) + _wake_of(board, ids)
        away_min = (sinking.surfacing_ms + sinking.sinking_ms) / MS_PER_MIN + _closing_min(scenario, start)
        down_min, closing_min = sinking.sinking_ms / MS_PER_MIN, _closing_min(scenario, start)
        gain_held = max(
            _best_gain(per_min, max(0.0, up + down), closing_min),
            _gain_from_empty(board, docked, sinking_cost, closing_min),
        )
        gain_away = max(
            _best_gain(per_min, max(0.0, up + down) + drain * away_min, away_min),
            _gain_from_empty(board, docked, sinking_cost + drain * down_min, away_min),
        )
        found.append(
            Rates(
                start=start.primary + unspent,
                drain=drain,
                charge=gain,
                full_charge_min=_full_min(per_min),
                charge_away=gain_away,
                down_min=down_min,
                charge_held=gain_held,
            )
        )
    return found


def _draw_in_a_dock(board: BoardConfig, *, reports: bool = True) -> float:
    """The mean grains a millisecond that a docked whole board takes of its charger's; the worst case takes none.

    Without `reports` no alarm rings while it is docked.
    """
    if board.whole is None:
        return 0.0
    power, cycle = board.whole.power, board.whole.cycle
    mean = float(_load_of(board.whole, State.CHARGING))
    if cycle is not None and reports:
        # The alarms that ring during a report are skipped.
        apart_ms = (cycle.report_ms // cycle.alarm_ms + 1) * cycle.alarm_ms
        mean += (_load_of(board.whole, State.REPORTING) - mean) * cycle.report_ms / apart_ms
    return mean * power.path / PATH_UNIT


def _ways_of(board: BoardConfig, sinking: Sinking, drain: float) -> tuple[float, float]:
    """The parts of a battery that the ways up and down take beyond `drain`; the way down with its time of listening."""
    if (whole := board.whole) is None:
        run = board.motor_run / FULL
        return run, run
    run = whole.power.loads.of[Rail.MOTORS] * whole.power.motor_run_ms / FULL
    listen_ms = 0 if whole.cycle is None else whole.cycle.listen_ms

    def beyond(state: State, lasting_ms: int) -> float:
        return (_load_of(whole, state) / FULL - drain / MS_PER_MIN) * lasting_ms

    return (
        run + beyond(State.SURFACING, sinking.surfacing_ms),
        run + beyond(State.SINKING, sinking.sinking_ms) + beyond(State.ACTIVE, listen_ms),
    )


def _wake_of(board: BoardConfig, all_ids: Sequence[int]) -> float:
    """The part of a battery that one wake takes beyond what sleep takes."""
    cycle = schedules(board.whole, all_ids, [board.agent_id])[board.agent_id].cycle
    return 0.0 if cycle is None else cycle.awake(0, cycle.period_ms)


def _drain_asleep(board: BoardConfig, all_ids: Sequence[int]) -> float:
    """The drain of a whole board that sleeps, between its wakes, in charge on [0, 1] an agent minute."""
    cycle = schedules(board.whole, all_ids, [board.agent_id])[board.agent_id].cycle
    assert cycle is not None
    return cycle.steps[-1][2]


def _load_of(whole: FullFirmware, state: State) -> int:
    """The grains a millisecond that the board draws in `state`."""
    return whole.power.loads.total(rails_of(state, whole.power.kept_on, whole.cycle is None, 0))


def _full_min(per_min: Sequence[tuple[float, float]]) -> float:
    """The minutes from empty to full; infinite if the load in the dock is more than the charger gives on a part."""
    if min(rate for _, rate in per_min) <= 0:
        return inf
    starts = [0.0, *(end for end, _ in per_min)]
    return fsum((end - low) / rate for (end, rate), low in zip(per_min, starts, strict=False))


def _closing_min(scenario: Scenario, start: Start) -> float:
    """The agent minutes in which a dock closes around the aMussel, which is afloat; at least 0 where a vehicle docks it."""
    docking = scenario.mission.docking
    is_virtual = docking.profile_of(start.agent_id) is DockingProfile.VIRTUAL
    return scenario.time_scale.agent_time(docking.dock_s) / 60 if is_virtual else 0.0


def _best_gain(per_min: Sequence[tuple[float, float]], surfacing: float, besides_min: float = 0.0) -> float:
    """The greatest (y - x - `surfacing`) / (t(x, y) + `besides_min`) of the curve, at least 0.

    The curve's segments are (end, rate a minute).
    """
    starts = [0.0, *(end for end, _ in per_min)]
    found = [0.0]
    for first in range(len(per_min)):
        minutes = 0.0
        for index in range(first, len(per_min)):
            end, rate = per_min[index]
            if rate <= 0:
                break
            minutes += (end - starts[index]) / rate
            found.append((end - starts[first] - surfacing) / max(_LEAST_MIN, minutes + besides_min))
    return max(found)


def _gain_from_empty(board: BoardConfig, docked: float, sinking: float, besides_min: float = 0.0) -> float:
    """The greatest (y - `sinking`) / (t(0, y) + `besides_min`), at least 0. `docked` is as of `_draw_in_a_dock`.

    The backup battery carries the board up. A whole board's carries its load in the dock until the board switches back, and
    for as long as a metered one may take to find that it can.
    """
    power = None if board.whole is None else board.whole.power
    carried = 0 if power is None else FULL if power.metering else power.switch_back
    found, minutes, low = 0.0, 0.0, 0
    for end, rate in board.charge.segments_by_two or board.charge.segments:
        for part_end in sorted({max(low, min(end, carried)), end} - {low}):
            net = rate if part_end <= carried else rate - docked
            if net <= 0:
                return found
            minutes += (part_end - low) / net / MS_PER_MIN
            low = part_end
            found = max(found, (low / FULL - sinking) / max(_LEAST_MIN, minutes + besides_min))
    return found


def _docks_of(scenario: Scenario) -> int:
    return scenario.apad.docks * (1 + len(scenario.apads))


def _samples(scenario: Scenario, active: float, mission_s: float) -> float | None:
    """Samples of the fleet: one a time step of an aMussel that never sleeps, else one an alarm, the first at 0."""
    if not takes_samples(scenario.board):
        return active * mission_s
    whole = scenario.board.whole
    assert whole is not None and whole.cycle is not None
    if whole.power.low_level > 0:
        return None
    alarms = int(scenario.time_scale.agent_time(mission_s) // whole.cycle.alarm_s) + 1
    return float(len(scenario.fleet.ids) * alarms)


def uptime_with_closing(scenario: Scenario) -> float:
    """The largest mean uptime, in percent, if a service takes its dock for the closing of a virtual dock, too.

    Nobody is charged in a dock while it closes. So with y docked minutes and z in which docks are taken, an aMussel gains
    at most the smaller of c y and h z, is active for T - y at most, and the z sum to D T. h is the greatest of
    (y - x - e) / (t + closing). Work afloat in a closing dock counts. Left out are ways, and that an aPad docks one
    aMussel at a time.
    """
    fleet, minutes = rates_of(scenario), scenario.time_scale.agent_time(scenario.duration_s) / 60

    def taken(it: Rates) -> float:
        return it.charge / it.charge_held if it.charge_held else 1.0

    return 100 * active_minutes(fleet, minutes, _docks_of(scenario), taken) / (len(fleet) * minutes)


def _curve_of(board: BoardConfig, docked: float) -> list[tuple[float, float]]:
    """The charging curve less the draw `docked`, as of `_draw_in_a_dock`: (upper end, charge a minute) of each part."""
    segments = board.charge.segments_by_two or board.charge.segments
    return [(end / FULL, (rate - docked) * MS_PER_MIN / FULL) for end, rate in segments]
