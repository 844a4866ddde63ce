"""Uptime, counted tick by tick as the paper does, but in closed form: exact integers, and no work at a tick.

Tick k (k = 1, 2, ...) is at mission time k * tick_ms, that is agent time theta * k * tick_ms. At a tick an aMussel is
what its newest Truth up to that time (inclusive) says. Two meanings of "active" are counted side by side:

- paper: not docked and the primary battery above 0. An aMussel counts as active until it is docked (section V);
- submerged: under water with the primary battery in use, asleep between two samples or not.

An aMussel that is LOST can no longer surface: both batteries at 0, or, of a board that reads its batteries, both read so
for long enough.

All of this is of simulated aMussels in the water. The ticks of one that goes on beside a real one, or is out of the water,
are counted apart, and whatever happens to it then counts as nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from agents.mussel.outputs import Truth
from apad_bridge.supervisor.roster import Presence
from firmware_model.power.charge import Battery, ChargeModel
from firmware_model.state_groups import AT_WORK, BEYOND_HELP


@dataclass(frozen=True, slots=True)
class AgentUptime:
    """Ticks so far of one aMussel. `charge` is its primary battery's now, in grains."""

    agent_id: int
    paper: int = 0
    submerged: int = 0
    dead: int = 0
    """Ticks with the primary battery at 0."""
    emptied: bool = False
    """The primary battery stood at 0 at some time."""
    lost: bool = False
    """It was LOST at some time."""
    charge: int = 0
    samples: int = 0
    """Which its sensors have ever taken, without those of `apart`."""
    apart: tuple[range, ...] = ()
    """Sequences of the samples that it took as a real one's twin, or out of the water."""
    beside_real: int = 0
    """Ticks as a real one's twin; the counts above have none of them."""
    retired: int = 0
    """Ticks out of the water; as before."""
    presence: Presence = Presence.SIMULATED
    """Now."""


@dataclass(slots=True)
class _Ledger:
    """The newest truth, and what was counted before `since_ms` (agent time, at or after the truth's)."""

    truth: Truth
    counted: AgentUptime
    since_ms: int
    gone_ms: int | None = None


class UptimeMeter:
    """Is fed every Truth, in order of time for each aMussel; answers for any mission time from the last one on."""

    def __init__(self, theta: int, charge: ChargeModel, tick_ms: int = 1000) -> None:
        self._theta = theta
        self.charge = charge
        self._tick_ms = tick_ms
        self._step_ms = theta * tick_ms
        self._ledgers: dict[int, _Ledger] = {}
        self._presences: dict[int, Presence] = {}

    @property
    def agent_ids(self) -> list[int]:
        """Those of whom a Truth was taken."""
        return sorted(self._ledgers)

    def take(self, truth: Truth) -> None:
        """The next Truth of its aMussel. ValueError, and nothing changed, when it is older than the one before."""
        ledger = self._ledgers.get(truth.agent_id)
        if ledger is None:
            self._ledgers[truth.agent_id] = _Ledger(truth, AgentUptime(truth.agent_id), truth.at_ms)
            return
        if truth.at_ms < ledger.truth.at_ms:
            raise ValueError(f"time went back: {truth.at_ms} before {ledger.truth.at_ms}")
        ledger.counted = self._count(ledger, truth.at_ms)
        ledger.since_ms = max(ledger.since_ms, truth.at_ms)
        if self._presence(truth.agent_id) is not Presence.SIMULATED:
            taken = range(ledger.truth.physical.samples, truth.physical.samples)
            ledger.counted = replace(ledger.counted, apart=_joined(ledger.counted.apart, taken))
        ledger.truth = truth
        if _is_past(ledger.gone_ms, truth.at_ms - 1):
            ledger.gone_ms = None  # it lives again: somebody started it by hand

    def gone(self, agent_id: int, at_ms: int) -> None:
        """The simulation of this aMussel ended for good at agent time `at_ms`: it is active at no later tick."""
        ledger = self._ledgers.get(agent_id)
        if ledger is not None and ledger.gone_ms is None:
            ledger.gone_ms = max(at_ms, ledger.truth.at_ms)

    def is_now(self, agent_id: int, presence: Presence, at_ms: int) -> None:
        """After the tick at agent time `at_ms`, the time of no older call, this aMussel is what `presence` says."""
        ledger = self._ledgers.get(agent_id)
        if ledger is not None:
            ledger.counted = self._count(ledger, at_ms + 1)
            ledger.since_ms = max(ledger.since_ms, at_ms + 1)
        self._presences[agent_id] = presence

    def ticks(self, now_ms: int) -> int:
        """How many ticks there were by mission time `now_ms`."""
        return now_ms // self._tick_ms

    def at(self, now_ms: int) -> list[AgentUptime]:
        """The counts at mission time `now_ms`, its own tick included, by id."""
        # One past the last tick's time, so that the open end of the span takes that tick in.
        until_ms = self.ticks(now_ms) * self._step_ms + 1
        return [self._count(self._ledgers[agent_id], until_ms) for agent_id in self.agent_ids]

    def active_now(self, now_ms: int) -> int:
        """How many are active at mission time `now_ms`, in the paper's meaning, as they stand now."""
        agent_ms = self._theta * now_ms
        active = 0
        for agent_id, ledger in self._ledgers.items():
            physical, is_there = ledger.truth.physical, self._presence(agent_id) is Presence.SIMULATED
            if is_there and not physical.docked and not _is_past(ledger.gone_ms, agent_ms):
                active += self.charge.charge_at(physical.primary, max(agent_ms, ledger.truth.at_ms)) > 0
        return active

    def _presence(self, agent_id: int) -> Presence:
        return self._presences.get(agent_id, Presence.SIMULATED)

    def _count(self, ledger: _Ledger, until_ms: int) -> AgentUptime:
        """What was counted, and the span from the ledger's time up to but not including agent time `until_ms`."""
        truth, counted = ledger.truth, ledger.counted
        start_ms = ledger.since_ms
        presence = self._presence(truth.agent_id)
        if presence is not Presence.SIMULATED:
            ticks = self._ticks_between(start_ms, max(start_ms, until_ms))
            key = "retired" if presence is Presence.RETIRED else "beside_real"
            return replace(counted, presence=presence, **{key: getattr(counted, key) + ticks})
        end_ms = max(start_ms, until_ms if ledger.gone_ms is None else min(until_ms, ledger.gone_ms))
        primary = truth.physical.primary
        empty_ms = self._span_at_zero(primary, start_ms, end_ms)
        backup_empty_ms = self._span_at_zero(truth.physical.secondary, start_ms, end_ms)
        dead = self._ticks_between(*empty_ms)
        charged = self._ticks_between(start_ms, end_ms) - dead
        both_ms = (max(empty_ms[0], backup_empty_ms[0]), min(empty_ms[1], backup_empty_ms[1]))
        return replace(
            counted,
            paper=counted.paper + (0 if truth.physical.docked else charged),
            submerged=counted.submerged + (charged if truth.state in AT_WORK else 0),
            dead=counted.dead + dead,
            emptied=counted.emptied or empty_ms[0] < empty_ms[1],
            lost=counted.lost
            or both_ms[0] < both_ms[1]
            or (truth.state in BEYOND_HELP and start_ms < end_ms),
            charge=self.charge.charge_at(primary, max(truth.at_ms, end_ms - 1)),
            samples=truth.physical.samples - sum(map(len, counted.apart)),
            presence=presence,
        )

    def _ticks_between(self, start_ms: int, end_ms: int) -> int:
        """Ticks in [start, end) of agent time."""
        return max(0, max(0, (end_ms - 1) // self._step_ms) - max(0, (start_ms - 1) // self._step_ms))

    def _span_at_zero(self, battery: Battery, start_ms: int, end_ms: int) -> tuple[int, int]:
        """The part of [start, end) in which the battery stands at 0; it is always one piece."""
        empty_at_ms = self.charge.falls_to_at_ms(battery, 0)
        if empty_at_ms is None:
            return end_ms, end_ms
        # One that falls to 0 stays there; one that begins there leaves it once more comes in than goes out.
        leaves_at_ms = self.charge.reaches_at_ms(battery, 1) if battery.charge == 0 else None
        until_ms = end_ms if leaves_at_ms is None else min(end_ms, leaves_at_ms)
        from_ms = max(start_ms, empty_at_ms)
        return (from_ms, until_ms) if from_ms < until_ms else (end_ms, end_ms)


def _is_past(gone_ms: int | None, agent_ms: int) -> bool:
    return gone_ms is not None and agent_ms >= gone_ms


def _joined(spans: tuple[range, ...], new: range) -> tuple[range, ...]:
    """With `new`, which begins no earlier than the last of them ends."""
    if not new:
        return spans
    if spans and spans[-1].stop == new.start:
        return (*spans[:-1], range(spans[-1].start, new.stop))
    return (*spans, new)
