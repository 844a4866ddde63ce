"""Counts uptime tick by tick as the paper does, but in closed form: exact integers, and no work at a tick.

Tick k (k = 1, 2, ...) is at mission time k * tick_ms, that is agent time theta * k * tick_ms. The newest Truth up to that
time (inclusive) gives an aMussel's state at the tick. Two meanings of "active" are counted side by side:

- paper: not docked and the primary battery above 0. An aMussel counts as active until it is docked (section V);
- submerged: under water with the primary battery in use, asleep between two samples or not.

Where a scenario lets boards work on their secondary battery, a board that does so counts in both meanings.

A LOST aMussel can no longer surface: both batteries are at 0, or a board that reads its batteries has read both as empty
for long enough.

These counts are of simulated aMussels in the water. An aMussel that runs as a real one's twin, or is out of the water, has
its ticks counted apart, and nothing that happens to it then is counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs, TimeScale
from apad_bridge.events.fleet_events import Presence
from apad_bridge.scenario.firmware_config import charge_models, works_on_secondary
from apad_bridge.scenario.schema import Scenario
from firmware_model.power.charge import Battery, ChargeModel
from firmware_model.state_groups import AT_WORK, BEYOND_HELP


@dataclass(frozen=True, slots=True)
class AgentUptime:
    """The ticks of one aMussel so far. `charge` is its primary battery's present charge, in grains."""

    agent_id: int
    paper: int = 0
    submerged: int = 0
    dead: int = 0
    """Ticks with the primary battery at 0."""
    emptied: bool = False
    """True if the primary battery was ever at 0."""
    lost: bool = False
    """True if it was ever LOST."""
    charge: int = 0
    charge_at_begin: int = 0
    """The charge of its first truth, in grains."""
    samples: int = 0
    """Samples that its sensors have taken, without those in `apart`."""
    apart: tuple[range, ...] = ()
    """Sequence numbers of the samples that it took as a real aMussel's twin, or out of the water."""
    beside_real: int = 0
    """Ticks as a real aMussel's twin; the counts above exclude them."""
    retired: int = 0
    """Ticks out of the water; the counts above exclude them."""
    presence: Presence = Presence.SIMULATED
    """Its present presence."""


@dataclass(slots=True)
class _Ledger:
    """The newest truth, and the counts before `since_ms` (agent time, at or after the truth's)."""

    truth: Truth
    counted: AgentUptime
    since_ms: int
    ended_ms: int | None = None


class UptimeMeter:
    """Takes every Truth, for each aMussel in order of time; gives the counts for any mission time from the last one on."""

    def __init__(
        self,
        scale: TimeScale,
        charge_of: Callable[[int], ChargeModel],
        tick_ms: int = 1000,
        *,
        secondary_in_use: bool = False,
    ) -> None:
        """`charge_of` returns the charge model of an aMussel's batteries. Work on a secondary counts if it is in use."""
        self._scale = scale
        self.charge_of = charge_of
        self._tick_ms = tick_ms
        self._secondary_in_use = secondary_in_use
        self._step_ms = scale.agent_span(tick_ms)
        self._ledgers: dict[int, _Ledger] = {}
        self._presences: dict[int, Presence] = {}

    @classmethod
    def for_scenario(cls, scenario: Scenario) -> UptimeMeter:
        """The meter of a flight of this scenario."""
        in_use = works_on_secondary(scenario.board)
        return cls(scenario.time_scale, charge_models(scenario), secondary_in_use=in_use)

    @property
    def ticks_per_agent_min(self) -> float:
        """The number of ticks in a minute of the aMussels' time."""
        return 60_000 / self._step_ms

    @property
    def agent_ids(self) -> list[int]:
        """The aMussels of which a Truth was taken."""
        return sorted(self._ledgers)

    def take(self, truth: Truth) -> None:
        """Takes the next Truth of its aMussel. ValueError, and no change, when it is older than the one before."""
        if (ledger := self._ledgers.get(truth.agent_id)) is None:
            begin = self.charge_of(truth.agent_id).charge_at(truth.physical.primary, truth.at_ms)
            counted = AgentUptime(truth.agent_id, charge_at_begin=begin)
            self._ledgers[truth.agent_id] = _Ledger(truth, counted, truth.at_ms)
            return
        if truth.at_ms < ledger.truth.at_ms:
            raise ValueError(f"time went back: {truth.at_ms} before {ledger.truth.at_ms}")
        if ledger.ended_ms is None and _counts_like(ledger.truth, truth):
            ledger.truth = truth  # its span goes on: most truths of a fleet are of a drift step
            return
        ledger.counted = self._count(ledger, truth.at_ms)
        ledger.since_ms = max(ledger.since_ms, truth.at_ms)
        if self._presence(truth.agent_id) is not Presence.SIMULATED:
            taken = range(ledger.truth.physical.samples, truth.physical.samples)
            ledger.counted = replace(ledger.counted, apart=_joined(ledger.counted.apart, taken))
        ledger.truth = truth
        if _has_ended(ledger.ended_ms, truth.at_ms - 1):
            ledger.ended_ms = None  # it runs again: somebody started it by hand

    def ended(self, agent_id: int, at_ms: int) -> None:
        """Ends this aMussel's simulation for good at agent time `at_ms`: it is active at no later tick."""
        if (ledger := self._ledgers.get(agent_id)) is not None and ledger.ended_ms is None:
            ledger.ended_ms = max(at_ms, ledger.truth.at_ms)

    def set_presence(self, agent_id: int, presence: Presence, at_ms: int) -> None:
        """Sets an aMussel's presence after the tick at agent time `at_ms`; the times of calls must not fall."""
        if (ledger := self._ledgers.get(agent_id)) is not None:
            ledger.counted = self._count(ledger, at_ms + 1)
            ledger.since_ms = max(ledger.since_ms, at_ms + 1)
        self._presences[agent_id] = presence

    def ticks(self, now_ms: int) -> int:
        """The number of ticks up to mission time `now_ms`."""
        return now_ms // self._tick_ms

    def at(self, now_ms: int) -> list[AgentUptime]:
        """The counts at mission time `now_ms`, its own tick included, by id."""
        return [self.of(agent_id, now_ms) for agent_id in self.agent_ids]

    def of(self, agent_id: int, now_ms: int) -> AgentUptime:
        """The same of one aMussel. KeyError for one of which no Truth was taken."""
        # One past the last tick's time, so that the open end of the span takes that tick in.
        until_ms = self.ticks(now_ms) * self._step_ms + 1
        return self._count(self._ledgers[agent_id], until_ms)

    def active_now(self, now_ms: MissionMs) -> int:
        """The number of active aMussels at mission time `now_ms`, in the paper's meaning, by their newest truths."""
        agent_ms = self._scale.agent_ms(now_ms)
        active = 0
        for agent_id, ledger in self._ledgers.items():
            physical, is_simulated = ledger.truth.physical, self._presence(agent_id) is Presence.SIMULATED
            if is_simulated and not physical.docked and not _has_ended(ledger.ended_ms, agent_ms):
                charge, at_ms = self.charge_of(ledger.truth.agent_id), max(agent_ms, ledger.truth.at_ms)
                used = physical.secondary if self._works_on_secondary(ledger.truth) else physical.primary
                active += charge.charge_at(used, at_ms) > 0
        return active

    def _presence(self, agent_id: int) -> Presence:
        return self._presences.get(agent_id, Presence.SIMULATED)

    def _count(self, ledger: _Ledger, until_ms: int) -> AgentUptime:
        """The counts, with the span from `ledger.since_ms` up to but not including agent time `until_ms` added."""
        truth, counted = ledger.truth, ledger.counted
        start_ms = ledger.since_ms
        if (presence := self._presence(truth.agent_id)) is not Presence.SIMULATED:
            ticks = self._ticks_between(start_ms, max(start_ms, until_ms))
            key = "retired" if presence is Presence.RETIRED else "beside_real"
            return replace(counted, presence=presence, **{key: getattr(counted, key) + ticks})
        end_ms = max(start_ms, until_ms if ledger.ended_ms is None else min(until_ms, ledger.ended_ms))
        primary, charge = truth.physical.primary, self.charge_of(truth.agent_id)
        empty_ms = _span_at_zero(charge, primary, start_ms, end_ms)
        backup_empty_ms = _span_at_zero(charge, truth.physical.secondary, start_ms, end_ms)
        dead = self._ticks_between(*empty_ms)
        charged = self._ticks_between(start_ms, end_ms) - dead
        both_ms = (max(empty_ms[0], backup_empty_ms[0]), min(empty_ms[1], backup_empty_ms[1]))
        if self._works_on_secondary(truth):
            charged += dead - self._ticks_between(*both_ms)
        return replace(
            counted,
            paper=counted.paper + (0 if truth.physical.docked else charged),
            submerged=counted.submerged + (charged if truth.state in AT_WORK else 0),
            dead=counted.dead + dead,
            emptied=counted.emptied or empty_ms[0] < empty_ms[1],
            lost=counted.lost
            or both_ms[0] < both_ms[1]
            or (truth.state in BEYOND_HELP and start_ms < end_ms),
            charge=charge.charge_at(primary, max(truth.at_ms, end_ms - 1)),
            samples=truth.physical.samples - sum(map(len, counted.apart)),
            presence=presence,
        )

    def _works_on_secondary(self, truth: Truth) -> bool:
        """True for a board at work that its secondary feeds, where that is in use."""
        return self._secondary_in_use and truth.state in AT_WORK and truth.physical.secondary.load > 0

    def _ticks_between(self, start_ms: int, end_ms: int) -> int:
        """Ticks in [start, end) of agent time."""
        return max(0, max(0, (end_ms - 1) // self._step_ms) - max(0, (start_ms - 1) // self._step_ms))


def _counts_like(before: Truth, truth: Truth) -> bool:
    """True if all that a count reads is the same, so that one span of both counts what two do."""
    was, now = before.physical, truth.physical
    return (
        before.state is truth.state
        and was.docked == now.docked
        and was.samples == now.samples
        and was.primary == now.primary
        and was.secondary == now.secondary
    )


def _span_at_zero(model: ChargeModel, battery: Battery, start_ms: int, end_ms: int) -> tuple[int, int]:
    """The part of [start, end) in which the battery is at 0; it is always one piece."""
    if (empty_at_ms := model.falls_to_at_ms(battery, 0)) is None:
        return end_ms, end_ms
    # A battery that falls to 0 stays there; a battery that begins at 0 leaves it once it gains more than it loses.
    leaves_at_ms = model.reaches_at_ms(battery, 1) if battery.charge == 0 else None
    until_ms = end_ms if leaves_at_ms is None else min(end_ms, leaves_at_ms)
    from_ms = max(start_ms, empty_at_ms)
    return (from_ms, until_ms) if from_ms < until_ms else (end_ms, end_ms)


def _has_ended(ended_ms: int | None, agent_ms: int) -> bool:
    return ended_ms is not None and agent_ms >= ended_ms


def _joined(spans: tuple[range, ...], new: range) -> tuple[range, ...]:
    """The spans with `new`, which begins no earlier than the last span ends."""
    if not new:
        return spans
    if spans and spans[-1].stop == new.start:
        return (*spans[:-1], range(spans[-1].start, new.stop))
    return (*spans, new)
