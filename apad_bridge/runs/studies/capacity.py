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
so one aPad sustains D (1 + c / d) aMussels. A fleet that sleeps needs kf times the charge of one that is always awake, and
the number is D (1 + (c / d) / kf). For the paper's aMussels, always awake, and four docks it is 15.2 when only the fast end
of the curve is used, and 11.9 when each charge begins at empty.

Each service costs a surfacing and a sinking, e of a battery. A dock that charges from x to y in t(x, y) minutes gives the
aMussel (y - x - e) / d minutes of work. So c is max (y - x - e) / t(x, y), and because the curve is piecewise linear the
maximum lies at two of its breakpoints. Without e it is the steepest part of the curve. An aMussel that is docked at the end
of a mission has yet to sink, so the mission's u has half of e added.

A whole board's e is its motors', and its c is less what it draws asleep in a dock. Travel, docking and waiting are left
out, and what such a board draws while it is awake for its service, so every flight stays below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from apad_bridge.assembly.energy_model import drain_per_min_of
from apad_bridge.scenario.firmware_config import board_config, spread_of, takes_samples
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from firmware_model.config import PATH_UNIT, BoardConfig
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail, rails_of
from firmware_model.states import State

_MS_PER_MIN = 60_000


@dataclass(frozen=True, slots=True)
class Rates:
    """An aMussel's charge on [0, 1]: `start`, and the rates an agent minute of its drain and of its charger."""

    start: float
    """With the charge for one run of the motors, which a mission's last service may leave unspent."""
    drain: float
    charge: float
    """The greatest gain a docked minute over whole services, less the cost of surfacing and sinking; at least 0."""
    full_charge_min: float
    """The minutes from empty to full."""


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
    """aMussels that the docks keep from ever being empty, each charge on the best part of the curve."""
    sustained_from_empty: float
    """The same if each charge goes from empty to full."""
    uptime_for_ever_percent: float
    cycles_per_apad_charge: float | None
    """Number of times that one charge of the aPad fills each battery of the fleet from empty; None if it costs nothing."""

    @property
    def text(self) -> str:
        samples = "" if self.samples is None else f", {self.samples:.0f} samples"
        return (
            f"No strategy exceeds {self.uptime_percent:.1f} % uptime, {self.active:.2f} active aMussels{samples} here, or "
            f"{self.uptime_for_ever_percent:.1f} % uptime in the long run. {self.docks} docks sustain at most "
            f"{self.sustained:.1f} aMussels ({self.sustained_from_empty:.1f} if each charge begins at empty); "
            f"the fleet has {self.amussels}."
        )


def bounds_of(scenarios: Sequence[Scenario], duration_s: float | None = None) -> Bounds:
    """The bounds of missions that differ in their seeds alone; `duration_s` is another mission time than the scenarios'."""
    fleets = [rates_of(scenario) for scenario in scenarios]
    scenario, amussels, docks = scenarios[0], len(fleets[0]), _docks_of(scenarios[0])
    mission_s = scenario.duration_s if duration_s is None else duration_s
    minutes = mission_s * scenario.theta / 60
    if not amussels or not minutes:
        return Bounds(amussels, docks, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, None)
    active = fmean(active_minutes(fleet, minutes, docks) for fleet in fleets) / minutes
    each = [rates for fleet in fleets for rates in fleet]
    drain, charge = min(it.drain for it in each), max(it.charge for it in each)
    slow = 1 / min(it.full_charge_min for it in each)
    without_start = [replace(it, start=0.0) for it in fleets[0]]
    return Bounds(
        amussels,
        docks,
        100 * active / amussels,
        active,
        _samples(scenario, active, mission_s),
        docks * (1 + charge / drain),
        docks * (1 + slow / drain),
        100 * active_minutes(without_start, 1.0, docks) / amussels,
        _cycles_per_apad_charge(scenario, fmean(it.full_charge_min for it in each), amussels),
    )


def _cycles_per_apad_charge(scenario: Scenario, full_min: float, amussels: int) -> float | None:
    """The cycles of the fleet that a full battery of one aPad affords; with several aPads each has its part of the fleet.

    A cycle fills each aMussel from empty once: its dock draws all that time, and the hotel load runs as long as the docks
    take for their aMussels one after the other. Travel is left out.
    """
    apad, share = scenario.apad, amussels / (1 + len(scenario.apads))
    hours = full_min / 60 / scenario.theta
    needed_wh = share * hours * (apad.battery.charging_w_per_dock + apad.battery.hotel_w / apad.docks)
    return apad.battery.capacity_wh / needed_wh if needed_wh else None


def active_minutes(fleet: Sequence[Rates], minutes: float, docks: int) -> float:
    """The largest sum of active time of a fleet, in agent minutes: the linear programme of this module's docstring."""
    total, left = 0.0, docks * minutes
    for it in sorted(fleet, key=lambda rates: -rates.charge / rates.drain):
        docked = min(left, max(0.0, (it.drain * minutes - it.start) / (it.charge + it.drain)))
        left -= docked
        total += min(minutes - docked, (it.start + it.charge * docked) / it.drain)
    return total


def drain_at_load(charge: float, amussels: int, docks: int, load: float) -> float:
    """The drain of which a fleet draws `load` (in (0, 1]) of what the law allows: N = load x D (1 + charge / drain).

    Both rates are charge on [0, 1] an agent minute. ValueError for a fleet that the docks could hold for ever.
    """
    if amussels <= load * docks:
        raise ValueError(f"{docks} docks hold {amussels} aMussels for ever, whatever they draw")
    return charge / (amussels / (load * docks) - 1)


def sustained_by_balance(amussels: int, gained: float, drain: float, minutes: float) -> float:
    """The capacity that a flight measures: the fleet whose charge would have stayed the same.

    With docks that are never empty, an aMussel more costs its drain alone. So a fleet whose charges rose by `gained`
    batteries together in `minutes` could be larger by gained / (drain x minutes), or had to be smaller. That holds near the
    capacity: charges below the curve's knee lower it, docks without work too.
    """
    return amussels + gained / (drain * minutes)


def rates_of(scenario: Scenario) -> list[Rates]:
    """Each aMussel's rates, in its own duty cycle."""
    nominal, spread = board_config(scenario.board, scenario.seed), spread_of(scenario)
    found = []
    for start in starts_of(scenario):
        board = spread.applied(replace(nominal, agent_id=start.agent_id), scenario.seed)
        per_min = _curve_of(board)
        ends = [0.0, *(end for end, _ in per_min)]
        full_min = sum((end - low) / rate for (end, rate), low in zip(per_min, ends, strict=False))
        drain = drain_per_min_of(board, scenario.fleet.all_ids)
        motor_run = _motor_run_of(board)
        gain = max(0.0, _best_gain(per_min, 2 * motor_run))
        found.append(Rates(start.primary + motor_run, drain, gain, full_min))
    return found


def _draw_in_a_dock(board: BoardConfig) -> float:
    """The grains a millisecond that a sleeping whole board takes of its charger's; a board of the worst case takes none."""
    if board.whole is None:
        return 0.0
    power = board.whole.power
    asleep = power.loads.total(rails_of(State.CHARGING, power.kept_on, False, 0))
    return asleep * power.path / PATH_UNIT


def _motor_run_of(board: BoardConfig) -> float:
    """The part of a battery that a way up or down takes for the motors."""
    if board.whole is None:
        return board.motor_run / FULL
    power = board.whole.power
    return power.loads.of[Rail.MOTORS] * power.motor_run_ms / FULL


def _best_gain(per_min: Sequence[tuple[float, float]], surfacing: float) -> float:
    """The greatest (y - x - `surfacing`) / t(x, y) of the curve, whose segments are (end, rate a minute)."""
    starts = [0.0, *(end for end, _ in per_min)]
    found = []
    for first in range(len(per_min)):
        minutes = 0.0
        for index in range(first, len(per_min)):
            end, rate = per_min[index]
            minutes += (end - starts[index]) / rate
            found.append((end - starts[first] - surfacing) / minutes)
    return max(found)


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
    alarms = int(mission_s * scenario.theta // whole.cycle.alarm_s) + 1
    return float(len(scenario.fleet.ids) * alarms)


def uptime_with_services(scenario: Scenario, services: float) -> float:
    """The largest mean uptime, in percent, that so many services can give: a bound for a way that pays for no more.

    A docked minute gains most on the fastest part of the curve, so one service of t minutes gains at most g(t), the fastest
    parts first. g is concave, so S services in Y docked minutes gain at most S g(Y / S). The sum of active time is at most
    the smaller of N T - Y and sum of min(T, u_i / d_i) + S g(Y / S) / d, with the best Y up to D T, and d the least drain.
    Surfacing and travel are free. The boards are those without a spread.
    """
    fleet, minutes = rates_of(scenario), scenario.duration_s * scenario.theta / 60
    curve = _curve_of(board_config(scenario.board, scenario.seed))
    ends = [0.0, *(end for end, _ in curve)]
    fastest = sorted(((rate, end - low) for (end, rate), low in zip(curve, ends, strict=False)), reverse=True)
    drain = min(it.drain for it in fleet)
    unserved = sum(min(minutes, it.start / it.drain) for it in fleet)

    def at_work(docked: float) -> float:
        left, gain = docked / services, 0.0
        for rate, part in fastest:
            took = min(left, part / rate)
            left, gain = left - took, gain + took * rate
        return unserved + services * gain / drain

    low, high = 0.0, _docks_of(scenario) * minutes
    # The time at work rises with the docked minutes, and the time outside docks falls.
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if at_work(middle) < len(fleet) * minutes - middle else (low, middle)
    return 100 * min(at_work(high), len(fleet) * minutes - low) / (len(fleet) * minutes)


def _curve_of(board: BoardConfig) -> list[tuple[float, float]]:
    """The charging curve in a dock: (upper end, charge a minute) of each part."""
    segments = board.charge.segments_by_two or board.charge.segments
    docked = _draw_in_a_dock(board)
    return [(end / FULL, (rate - docked) * _MS_PER_MIN / FULL) for end, rate in segments]
