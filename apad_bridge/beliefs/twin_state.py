"""A twin's state of one aMussel, and its prediction in time, in which its uncertainty grows.

The charges stand at an anchor: the last time at which they were measured, or a dock caught or released the aMussel. The
charge spent since is kept apart (`Load`), so that time passes in closed form and frequent queries add no rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from apad_bridge.beliefs import charge_filter as charge
from apad_bridge.beliefs import charging, spent_charge
from apad_bridge.beliefs.belief import ClockBelief, Suspicion
from apad_bridge.beliefs.charge_checker import ReadingTrack, StandingReading
from apad_bridge.beliefs.charge_filter import DRAIN, PRIMARY, RATE, SECONDARY, Anchor, Array
from apad_bridge.beliefs.mixture import Gaussian, below
from apad_bridge.beliefs.modes import SUBMERGED, Mode
from apad_bridge.beliefs.place_filter import Place
from apad_bridge.beliefs.spent_charge import Load, Spent, merged
from apad_bridge.beliefs.twin_parameters import Habits, Schedule, TwinParameters
from firmware_model.packets import Reported
from firmware_model.power.charge import MS_PER_MIN

_UNLIKELY = 1e-3
"""A hypothesis of lower probability is left out."""
HEARD_WITHIN_MS = 2_000
"""The mission time within which an order is heard: the aPad acts once a second, and waits for a free channel."""
_FAR_FROM_EMPTY = 0.4
_LEAST_RATE = 0.1
"""A smaller estimate of the relative charging rate is no charger's."""
NOTHING = Spent(1.0, 0.0, 0.0)
DAY_MS = 86_400_000


@dataclass(frozen=True, slots=True)
class Pending:
    """A charge that is spent at once, at an unknown agent time between two: every one of these times is alike."""

    from_ms: int
    until_ms: int
    mean: float
    variance: float
    mode: Mode
    """The mode until then."""

    def spent_by(self, at_ms: int) -> float:
        """The probability that it is spent at `at_ms`."""
        if at_ms >= self.until_ms:
            return 1.0
        return max(0.0, (at_ms - self.from_ms) / (self.until_ms - self.from_ms))


@dataclass(slots=True, eq=False)
class TwinState:
    """Agent time, except for the place's. `situation` is None while the aMussel is submerged and chooses its own mode.

    Nothing sets a field. A class that is frozen at run time is made more slowly, and each tick makes one for each aMussel.
    """

    at_ms: int
    anchors: tuple[Anchor, ...]
    """The most probable first."""
    anchor_ms: int
    load: Load
    situation: Mode | None
    since_ms: int
    place: Place
    place_ms: int
    """Mission time."""
    clock: ClockBelief
    clock_ms: int
    packet: tuple[int, int]
    """(sequence, stated agent time) of the newest packet."""
    reported: Reported
    from_secondary: tuple[float, float] = (0.0, 0.0)
    """Mean and deviation of the charge that the secondary gave since the anchor."""
    unobeyed: tuple[Load, int] | None = None
    """The load at `at_ms` in case the newest permission was not received, and the time of that permission. It is kept
    until a packet decides, also after an aMussel that obeyed would have sunk again."""
    earlier: tuple[Load, int, float] | None = None
    """The load at a time in case the aMussel obeyed the permission before the newest one, and floats since then; and how
    probable that was at that time. The aPad repeats a permission where it hears nothing, which may be for its distance."""
    pending: Pending | None = None
    """The part that `load` does not contain yet."""
    seen: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The number of observations of each mode of `SUBMERGED`."""
    day: tuple[tuple[Mode, int] | None, ...] = ()
    """The mode observed last, and its decision's number, for each decision of a day; empty if habits are not daily."""
    stated_m: tuple[float, float] | None = None
    """The place (north, east) that the newest packet with a place stated."""
    measured_ms: int = -1
    measured_mode: Mode | None = None
    gated: int = 0
    track: ReadingTrack | None = None
    """None before the first reading that is checked, and after a dock closed or opened."""
    standing: StandingReading | None = None
    """The newest readings that agree; None as `track`, but through docks."""
    suspicion: Suspicion | None = None

    @property
    def mean(self) -> Array:
        """The mean of the most probable anchor."""
        return self.anchors[0].mean

    @property
    def cov(self) -> Array:
        return self.anchors[0].cov

    def moved_to(self, at_ms: int, load: Load, unobeyed: tuple[Load, int] | None) -> TwinState:
        """Does the work of `replace`, which takes five times as long for so many fields."""
        return TwinState(
            at_ms=at_ms,
            anchors=self.anchors,
            anchor_ms=self.anchor_ms,
            load=load,
            situation=self.situation,
            since_ms=self.since_ms,
            place=self.place,
            place_ms=self.place_ms,
            clock=self.clock,
            clock_ms=self.clock_ms,
            packet=self.packet,
            reported=self.reported,
            from_secondary=self.from_secondary,
            unobeyed=unobeyed,
            earlier=self.earlier,
            pending=self.pending,
            seen=self.seen,
            day=self.day,
            stated_m=self.stated_m,
            measured_ms=self.measured_ms,
            measured_mode=self.measured_mode,
            gated=self.gated,
            track=self.track,
            standing=self.standing,
            suspicion=self.suspicion,
        )


def shares_of(twin_state: TwinState, parameters: TwinParameters) -> tuple[float, float, float]:
    """The probabilities of the modes that this aMussel takes up, from the usual shares and its observed modes."""
    prior, habits = parameters.habits.seen_before, parameters.habits.shares
    total = prior + math.fsum(twin_state.seen)
    a, b, c = ((prior * usual + n) / total for usual, n in zip(habits, twin_state.seen, strict=True))
    return a, b, c


def choices(twin_state: TwinState, parameters: TwinParameters, schedule: Schedule) -> spent_charge.Choices:
    """The choice at each decision: by the schedule if there is one, else by usual shares and this aMussel's own modes."""
    habits = parameters.habits

    def at(decision_ms: int) -> spent_charge.ChargeChoice:
        if (scheduled := schedule.at(decision_ms)) is not None:
            return spent_charge.ChargeChoice(spent_charge.scheduled_rows(habits, scheduled), scheduled, 0.0)
        deviation = habits.plan_deviation * habits.every_ms / MS_PER_MIN
        number, shares = decision_ms // habits.every_ms, shares_of(twin_state, parameters)
        heard = twin_state.day[number % len(twin_state.day)] if twin_state.day else None
        trust = 0.0 if heard is None else _trust(habits, (number - heard[1]) * habits.every_ms)
        if heard is None or trust <= 0:
            return spent_charge.ChargeChoice(
                spent_charge.usual_rows(habits, shares, None, 0.0), None, deviation
            )
        expected = heard[0] if trust > 0.5 else None
        return spent_charge.ChargeChoice(
            spent_charge.usual_rows(habits, shares, heard[0], trust), expected, deviation
        )

    return at


def _trust(habits: Habits, age_ms: int) -> float:
    """The probability that the mode observed at this hour, `age_ms` ago, still holds: the plan may have changed since."""
    return habits.daily * max(0.0, 1 - age_ms / habits.plan_lasts_ms)


def mode_observed(twin_state: TwinState, parameters: TwinParameters, mode: Mode) -> dict[str, Any]:
    """The fields that change when `mode` was observed: its usual modes, and its mode at this hour."""
    if mode not in SUBMERGED:
        return {}
    a, b, c = (n + (one is mode) for n, one in zip(twin_state.seen, SUBMERGED, strict=True))
    changes: dict[str, Any] = {"load": Load.known(mode), "seen": (a, b, c)}
    habits = parameters.habits
    if habits.daily:
        decisions, number = DAY_MS // habits.every_ms, twin_state.at_ms // habits.every_ms
        day = list(twin_state.day or (None,) * decisions)
        day[number % decisions] = (mode, number)
        changes["day"] = tuple(day)
    return changes


def advanced(twin_state: TwinState, parameters: TwinParameters, schedule: Schedule, to_ms: int) -> TwinState:
    """The twin state predicted to agent time `to_ms`, without new measurements."""
    if to_ms <= twin_state.at_ms:
        return twin_state
    if twin_state.pending is not None and to_ms >= twin_state.pending.until_ms:
        twin_state = replace(twin_state, load=load_when_spent(twin_state), pending=None)
    if twin_state.situation is Mode.CHARGING_PRIMARY:
        return replace(twin_state, at_ms=to_ms)
    if twin_state.situation is not None:
        return _afloat(twin_state, parameters, schedule, to_ms)
    later = _loads_advanced(twin_state, parameters, schedule, to_ms)
    if _is_far_from_empty(later):
        return later  # the common case is cheap
    every_ms = parameters.habits.every_ms
    while twin_state.at_ms < to_ms:
        next_ms = min(to_ms, (twin_state.at_ms // every_ms + 1) * every_ms)
        later = _loads_advanced(twin_state, parameters, schedule, next_ms)
        twin_state = _drawn_from_backup(later, parameters, next_ms - twin_state.at_ms)
    return twin_state


def _loads_advanced(
    twin_state: TwinState, parameters: TwinParameters, schedule: Schedule, to_ms: int
) -> TwinState:
    """The loads at `to_ms` of a submerged aMussel, or of one that the permission may not have reached."""
    decide = choices(twin_state, parameters, schedule)
    spending = spent_charge.spending(parameters.drain.per_min, schedule.cycle)

    def propagated(load: Load) -> Load:
        every_ms = parameters.habits.every_ms
        return spent_charge.propagated(load, twin_state.at_ms, to_ms, spending, every_ms, decide)

    load, unobeyed = twin_state.load, twin_state.unobeyed
    if unobeyed is not None:
        unobeyed = (propagated(unobeyed[0]), unobeyed[1])
    if twin_state.situation is None:
        load = propagated(load)
    return twin_state.moved_to(to_ms, load, unobeyed)


def load_when_spent(twin_state: TwinState) -> Load:
    """The load with what is pending."""
    pending = twin_state.pending
    return twin_state.load if pending is None else twin_state.load.add(pending.mean, pending.variance)


def load_of_all(twin_state: TwinState, parameters: TwinParameters) -> Load:
    """The load with what is pending, whether it obeyed a permission or not."""
    load, unobeyed = load_when_spent(twin_state), twin_state.unobeyed
    if unobeyed is None:
        return load
    return load.mixed_with(unobeyed[0], obey_probability(twin_state, parameters, twin_state.at_ms))


def shifted_to_clock(twin_state: TwinState, agent_ms: int) -> TwinState:
    """The same state on a clock that was set and shows `agent_ms` now: no time has passed for the batteries."""
    by_ms, unobeyed, pending = agent_ms - twin_state.at_ms, twin_state.unobeyed, twin_state.pending
    earlier = twin_state.earlier
    if pending is not None:
        pending = replace(pending, from_ms=pending.from_ms + by_ms, until_ms=pending.until_ms + by_ms)
    return replace(
        twin_state,
        at_ms=agent_ms,
        anchor_ms=twin_state.anchor_ms + by_ms,
        since_ms=twin_state.since_ms + by_ms,
        measured_ms=twin_state.measured_ms + by_ms,
        unobeyed=None if unobeyed is None else (unobeyed[0], unobeyed[1] + by_ms),
        earlier=None if earlier is None else (earlier[0], earlier[1] + by_ms, earlier[2]),
        pending=pending,
        packet=(-1, agent_ms),
        day=(),
        track=None,
        standing=None,
    )


def _afloat(twin_state: TwinState, parameters: TwinParameters, schedule: Schedule, to_ms: int) -> TwinState:
    """Surfacing, then floating, until a dock catches it or it sinks again by itself; or it never heard the permission."""
    if obey_probability(twin_state, parameters, to_ms) < _UNLIKELY:
        assert twin_state.unobeyed is not None
        stayed = replace(
            twin_state,
            load=twin_state.unobeyed[0],
            situation=None,
            unobeyed=None,
            earlier=None,
            pending=None,
        )
        return advanced(stayed, parameters, schedule, to_ms)
    per_min, surfaced_ms = parameters.drain.per_min, twin_state.since_ms + parameters.sinking.surfacing_ms
    sinks_ms = surfaced_ms + parameters.board.float_timeout_ms
    at_ms, spent, situation = twin_state.at_ms, twin_state.load, twin_state.situation
    if situation is Mode.SURFACING:
        end_ms = min(to_ms, max(at_ms, surfaced_ms))
        spent = spent.add(per_min[Mode.SURFACING] * (end_ms - at_ms) / MS_PER_MIN)
        at_ms = end_ms
        if to_ms >= surfaced_ms:
            situation = Mode.FLOATING
    if situation is Mode.FLOATING:
        end_ms = min(to_ms, max(at_ms, sinks_ms))
        spent = spent.add(per_min[Mode.FLOATING] * (end_ms - at_ms) / MS_PER_MIN)
        at_ms = end_ms
    later = _loads_advanced(twin_state, parameters, schedule, at_ms)
    later = replace(later, load=spent, situation=situation)
    if to_ms > at_ms:
        sunk = submerged(later, parameters, schedule, sinking(spent.total(), parameters))
        return advanced(replace(sunk, unobeyed=later.unobeyed), parameters, schedule, to_ms)
    return later


def obey_probability(twin_state: TwinState, parameters: TwinParameters, at_ms: int) -> float:
    """The probability that it received the permission to surface; 1 without one, or after a packet from the surface.

    If a surfaced aMussel should be received, each packet that is missing at agent time `at_ms` lowers the probability
    (Bayes).
    """
    if twin_state.unobeyed is None:
        return 1.0
    unheard = _obeyed_unheard(twin_state.unobeyed[1], parameters, at_ms)
    return unheard / (unheard + 1 - parameters.permission_arrives)


def _obeyed_unheard(permitted_ms: int, parameters: TwinParameters, at_ms: int) -> float:
    """The probability that it received a permission, and was not heard from the surface since."""
    calls, sinking, arrives = parameters.calls, parameters.sinking, parameters.permission_arrives
    up_ms = min(at_ms - permitted_ms - sinking.surfacing_ms, parameters.board.float_timeout_ms)
    return arrives if calls is None or up_ms < 0 else arrives * calls.missed ** (1 + up_ms // calls.every_ms)


def earlier_probability(twin_state: TwinState, parameters: TwinParameters) -> float:
    """The probability that it obeyed the permission before the newest one, and so floats for longer."""
    if twin_state.earlier is None or twin_state.unobeyed is None:
        return 0.0
    _, from_ms, probability = twin_state.earlier
    at_ms, calls = twin_state.at_ms, parameters.calls
    unheard = 1.0 if calls is None else calls.missed ** ((at_ms - from_ms) // calls.every_ms)
    floats = probability * unheard
    others = (1 - probability) * (
        _obeyed_unheard(twin_state.unobeyed[1], parameters, at_ms) + 1 - parameters.permission_arrives
    )
    return floats / (floats + others)


def spent_since_earlier(twin_state: TwinState, parameters: TwinParameters) -> Spent:
    """The charge spent if it obeyed the permission before the newest one."""
    assert twin_state.earlier is not None
    load, from_ms, _ = twin_state.earlier
    _, mean, variance = load.total()
    floated = parameters.drain.per_min[Mode.FLOATING] * (twin_state.at_ms - from_ms) / MS_PER_MIN
    return Spent(1.0, mean + floated, variance)


def surfaced_hypotheses(twin_state: TwinState, parameters: TwinParameters) -> list[Spent]:
    """The charge that an aMussel at the surface has spent: it obeyed the newest permission, or the one before.

    One that is up before the newest one can have brought it up obeyed the one before.
    """
    rows = paths(load_when_spent(twin_state))
    if not (earlier := earlier_probability(twin_state, parameters)):
        return rows
    before = spent_since_earlier(twin_state, parameters)
    if twin_state.at_ms - twin_state.since_ms < parameters.sinking.surfacing_ms:
        return [before]
    newest = (1 - earlier) * obey_probability(twin_state, parameters, twin_state.at_ms)
    share = earlier / (earlier + newest)
    return [before._replace(probability=share), *(Spent((1 - share) * p, m, v) for p, m, v in rows)]


def sinking(spent: Spent, parameters: TwinParameters) -> Spent:
    """`spent`, and one way down, awake."""
    drain = parameters.drain
    awake = drain.per_min[Mode.IDLE] * parameters.sinking.sinking_ms / MS_PER_MIN
    mean = spent[1] + drain.motor_run + awake + drain.listening
    return Spent(spent[0], mean, spent[2] + way_variance(parameters))


def way_variance(parameters: TwinParameters) -> float:
    """The variance of the charge that a way up or down takes: by its motors, and by the time at which it begins.

    Within the time in which an order is heard it draws as on the bottom or as at the surface.
    """
    drain = parameters.drain
    more_per_min = drain.per_min[Mode.FLOATING] - drain.per_min[Mode.ASLEEP]
    more = more_per_min * parameters.scale.agent_span(HEARD_WITHIN_MS) / MS_PER_MIN
    return drain.motor_deviation**2 + more**2 / 12


def released(
    twin_state: TwinState, parameters: TwinParameters, schedule: Schedule, heard_after_ms: int | None = None
) -> TwinState:
    """Released at `at_ms`, or heard so long after it, and soon to sink.

    The Wi-Fi of a board is off in a dock, so it does not hear at its release that it is clear. It waits at the surface
    until the wait runs out, or until it is heard there and told.
    """
    _, mean, variance = sinking(NOTHING, parameters)
    waits_ms, at_ms = parameters.board.release_wait_ms, twin_state.at_ms
    left_ms, heard_ms = waits_ms, waits_ms
    if heard_after_ms is not None:
        left_ms = min(max(0, waits_ms - heard_after_ms), parameters.scale.agent_span(HEARD_WITHIN_MS))
        heard_ms = left_ms // 2
    per_ms = parameters.drain.release_wait / waits_ms if waits_ms else 0.0
    mean += per_ms * heard_ms - missed_wakes(schedule, at_ms, at_ms + heard_ms + _settling_ms(parameters))
    variance += 4 * (per_ms * (left_ms - heard_ms)) ** 2 / 12
    pending = Pending(at_ms, at_ms + left_ms + parameters.motor_run_ms, mean, variance, Mode.FLOATING)
    return replace(submerged(twin_state, parameters, schedule, NOTHING), pending=pending)


def missed_wakes(schedule: Schedule, from_ms: int, to_ms: int) -> float:
    """The charge of the wakes in a span in which the board does not sleep: the alarm of one that is awake wakes nobody."""
    return 0.0 if schedule.cycle is None else schedule.cycle.awake(from_ms, to_ms)


def settled(twin_state: TwinState, parameters: TwinParameters, schedule: Schedule, spent: Spent) -> TwinState:
    """Awake on its way to sleep on the bottom, with `spent` since the anchor until then, and no wake meanwhile."""
    at_ms = twin_state.at_ms
    mean = spent[1] + parameters.drain.listening
    mean -= missed_wakes(schedule, at_ms, at_ms + _settling_ms(parameters))
    return submerged(twin_state, parameters, schedule, spent._replace(mean=mean))


def _settling_ms(parameters: TwinParameters) -> int:
    """From the release of the ballast until the board sleeps."""
    return parameters.sinking.sinking_ms + parameters.listening_ms


def listening(twin_state: TwinState, parameters: TwinParameters, schedule: Schedule) -> TwinState:
    """Awake on the bottom at `at_ms`, and asleep after a part of the time for which it listens."""
    spends, at_ms = parameters.drain.listening, twin_state.at_ms
    if not parameters.listening_ms:
        return twin_state
    until_ms = at_ms + parameters.listening_ms
    mean = spends / 2 - missed_wakes(schedule, at_ms, until_ms)
    return replace(twin_state, pending=Pending(at_ms, until_ms, mean, spends**2 / 12, Mode.IDLE))


def submerged(
    twin_state: TwinState, parameters: TwinParameters, schedule: Schedule, spent: Spent
) -> TwinState:
    """Submerged again at `at_ms` with `spent` since the anchor: it takes up the scheduled mode, or a usual one."""
    shares = shares_of(twin_state, parameters)
    if schedule.at(twin_state.at_ms) is not None:
        shares = choices(twin_state, parameters, schedule)(twin_state.at_ms).rows[0]
    unscheduled_load = Load.from_shares(shares, spent[1], spent[2])
    return replace(
        twin_state,
        load=unscheduled_load,
        situation=None,
        since_ms=twin_state.at_ms,
        unobeyed=None,
        earlier=None,
        pending=None,
    )


def _is_far_from_empty(twin_state: TwinState) -> bool:
    spent = twin_state.load.total()
    mean = twin_state.mean.item(PRIMARY) - twin_state.mean.item(DRAIN) * spent[1]
    return (
        mean > _FAR_FROM_EMPTY or mean - 4 * math.sqrt(twin_state.cov.item(PRIMARY, PRIMARY) + spent[2]) > 0
    )


def _drawn_from_backup(twin_state: TwinState, parameters: TwinParameters, elapsed_ms: int) -> TwinState:
    """Adds what an aMussel with an empty primary drew from the secondary, asleep whatever was planned, in `elapsed_ms`.

    The span lies between two decisions.
    """
    empty = below(primary_parts(twin_state, parameters), 0.0)
    if empty < _UNLIKELY:
        return twin_state
    amount = float(twin_state.mean[DRAIN]) * parameters.drain.per_min[Mode.ASLEEP] * elapsed_ms / MS_PER_MIN
    mean, sd = twin_state.from_secondary
    spread = math.sqrt(empty * (1 - empty)) * amount
    return replace(twin_state, from_secondary=(mean + empty * amount, sd + spread))


def primary_parts(twin_state: TwinState, parameters: TwinParameters) -> tuple[Gaussian, ...]:
    """The primary charge at `at_ms` as a mixture, not clamped to [0, 1]."""
    parts = []
    swing = charge.swing_over(parameters, twin_state.at_ms - twin_state.anchor_ms)
    for weight, mean, cov in twin_state.anchors:
        at, at_var = mean.item(PRIMARY), cov.item(PRIMARY, PRIMARY)
        drain, drain_var, both = charge.drain_over(mean, cov, swing)
        for probability, spent, variance in spent_hypotheses(twin_state, parameters):
            if weight * probability < _UNLIKELY:
                continue
            spread = (
                at_var - 2 * spent * both + spent * spent * drain_var + (drain * drain + drain_var) * variance
            )
            parts.append(Gaussian(weight * probability, at - drain * spent, math.sqrt(max(0.0, spread))))
    total = math.fsum(part.weight for part in parts)
    return tuple(Gaussian(weight / total, mean, sd) for weight, mean, sd in parts)


def spent_hypotheses(twin_state: TwinState, parameters: TwinParameters) -> list[Spent]:
    """The charge spent since the anchor, outside of a dock: it obeyed the permission or not; what is pending is spent or
    not."""
    rows, pending = paths(twin_state.load), twin_state.pending
    if pending is not None:
        done = pending.spent_by(twin_state.at_ms)
        rows = [Spent((1 - done) * p, mean, variance) for p, mean, variance in rows] + [
            Spent(done * p, mean + pending.mean, variance + pending.variance) for p, mean, variance in rows
        ]
    if twin_state.unobeyed is None:
        return rows
    obeyed = obey_probability(twin_state, parameters, twin_state.at_ms)
    stayed = paths(twin_state.unobeyed[0])
    earlier = earlier_probability(twin_state, parameters)
    rows = [Spent((1 - earlier) * obeyed * p, mean, variance) for p, mean, variance in rows] + [
        Spent((1 - earlier) * (1 - obeyed) * p, mean, variance) for p, mean, variance in stayed
    ]
    if earlier:
        rows.append(spent_since_earlier(twin_state, parameters)._replace(probability=earlier))
    return rows


def paths(load: Load) -> list[Spent]:
    """The hypotheses of the charge spent: the expected path, and the rest."""
    if load.expected[0] > 1 - _UNLIKELY:
        return [load.expected]
    rest = merged([load.unexpected(mode) for mode in SUBMERGED])
    return [load.expected, *load.skewed_parts(rest)]


def charge_now(twin_state: TwinState, parameters: TwinParameters, spent: Sequence[Spent]) -> list[Anchor]:
    """The state at `at_ms`, from each anchor by each hypothesis of `spent`; docked, nothing is spent. Not clamped."""
    elapsed_ms = twin_state.at_ms - twin_state.anchor_ms
    noise, swing = charge.process_noise(parameters, elapsed_ms), charge.swing_over(parameters, elapsed_ms)
    found = []
    if twin_state.situation is Mode.CHARGING_PRIMARY:
        for anchor, rows in zip(twin_state.anchors, in_dock(twin_state, parameters), strict=True):
            found.append(Anchor(anchor.weight, *charge.charged(anchor.mean, anchor.cov, rows, noise, swing)))
        return found
    from_mean, from_sd = twin_state.from_secondary
    for weight, mean, cov in twin_state.anchors:
        for one in spent:
            if weight * one[0] > _UNLIKELY**2:
                new = charge.discharged(mean, cov, one, (from_mean, from_sd**2), noise, swing)
                found.append(Anchor(weight * one[0], *new))
    return found


def in_dock(twin_state: TwinState, parameters: TwinParameters) -> list[tuple[charging.Charged, ...]]:
    """Both batteries at `at_ms`, by anchor; the primary feeds the board."""
    minutes = (twin_state.at_ms - twin_state.anchor_ms) / MS_PER_MIN
    drain, coils = parameters.drain, parameters.charger.primary
    against = drain.in_dock * drain.per_min[Mode.CHARGING_PRIMARY]
    return [
        tuple(
            charging.propagated(
                parameters.charger,
                count,
                lost,
                float(mean[row]),
                float(cov[row, row]),
                minutes,
                rate=charging.Rate(
                    max(_LEAST_RATE, float(mean[RATE])), float(cov[RATE, RATE]), float(cov[RATE, row])
                ),
            )
            for row, count, lost in ((PRIMARY, coils, against * float(mean[DRAIN])), (SECONDARY, 1.0, 0.0))
        )
        for _, mean, cov in twin_state.anchors
    ]
