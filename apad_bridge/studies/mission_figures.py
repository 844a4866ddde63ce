"""The figures of one mission of a study, counted from the truths: the same for each model, in the order of the tables."""

from __future__ import annotations

from dataclasses import dataclass, fields

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.assembly.capacity_bounds import battery_worth_min
from apad_bridge.events.mission_events import MissionState
from apad_bridge.events.run_events import EndReason
from apad_bridge.records.uptime import UptimeMeter
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.scenario.firmware_config import takes_samples
from apad_bridge.scenario.schema import Scenario
from apad_bridge.world.apad.hull_battery import Ledger
from firmware_model.power.charge import MS_PER_HOUR
from firmware_model.state_groups import AT_WORK

_LATE = 1 / 5
"""The last part of a mission, in which a fleet shows whether it is held."""


@dataclass(frozen=True, slots=True)
class Figures:
    """A mission's figures. Hours are the aMussels' own, uptimes are percent, metres are the paper's straight legs."""

    amussels_lost: int
    """AMussels that at some time could no longer surface."""
    samples_taken: int
    """A board that logs counts its samples. The paper's worst case never sleeps: each time step of equation (3) under water
    with charge is one."""
    longest_gap_h: float
    """The longest time in which one aMussel took no sample."""
    uptime_submerged_mean: float
    """Share of time at work under water, as a mean over aMussels."""
    uptime_submerged_min: float
    """The same share of the least aMussel."""
    uptime_paper_mean: float
    """The paper's uptime: not docked, and the battery above 0; as a mean over aMussels."""
    uptime_paper_min: float
    """The uptime of the least aMussel."""
    uptime_equal_charge: float
    """`uptime_paper_mean` with the charge left over or missing at the end, at the boards' own rates."""
    charge_gain_mean: float
    """Mean charge at the end minus at the begin."""
    metres: float
    """The way planned: straight legs, as the paper counts them."""
    metres_per_service: float | None
    """`metres` for each of `services`; None without a service."""
    apad_wh: float | None
    """Energy that the aPad drew. None at another theta than 1, where the aMussels charge faster than the aPad spends."""
    apad_cycles: float | None
    """`apad_wh` in whole batteries of the aPad."""
    dead_time_h: float
    """Time with an empty primary battery, over all aMussels, in their own hours."""
    final_charge_mean: float
    """Mean charge of the primary batteries at the end."""
    # Not in the tables of strategies; Table II and the comparison of models use these.
    uptime_paper_max: float
    """The uptime of the best aMussel."""
    active_mean: float
    """The mean number of active aMussels."""
    driven_m: float
    """The way that the aPad drove."""
    services: int
    """AMussels that left a dock full, or made room."""
    ended_by: str
    """The reason of the end, in words."""
    end_reason: EndReason | None
    """The kind of that reason."""
    apad_travel_wh: float | None
    """The part of `apad_wh` for the thrusters."""
    apad_hotel_wh: float | None
    """The part for computers and sensors, which are on all the time."""
    apad_handed_wh: float | None
    """The part for docks that hold an aMussel."""
    dead_late_h: float
    """`dead_time_h` in the last fifth of the mission alone: a fleet that is held for ever has none there."""


COLUMNS = tuple(field.name for field in fields(Figures))[:15]
"""The columns of every table of strategies, in this order."""


class SamplingGaps:
    """Takes every Truth, for each aMussel in order of time; gives the longest time without a sample."""

    def __init__(self, *, logs_samples: bool) -> None:
        self._is_sampling = _takes_sample if logs_samples else _works
        self._last: dict[int, Truth] = {}
        self._since_ms: dict[int, int] = {}
        """The end of each aMussel's newest sampling."""
        self._longest_ms = 0

    def take(self, truth: Truth) -> None:
        last = self._last.get(truth.agent_id)
        self._last[truth.agent_id] = truth
        since_ms = self._since_ms.setdefault(truth.agent_id, 0)
        was_sampling, is_sampling = self._is_sampling(last, truth)
        if was_sampling:
            self._since_ms[truth.agent_id] = truth.at_ms
        elif is_sampling:
            self._longest_ms = max(self._longest_ms, truth.at_ms - since_ms)
            self._since_ms[truth.agent_id] = truth.at_ms

    def longest_ms(self, now_ms: int) -> int:
        """In agent time, up to agent time `now_ms`."""
        open_ms = [
            now_ms - since_ms
            for agent_id, since_ms in self._since_ms.items()
            if not self._is_sampling(self._last[agent_id], self._last[agent_id])[0]
        ]
        return max([self._longest_ms, *open_ms])


def _takes_sample(last: Truth | None, truth: Truth) -> tuple[bool, bool]:
    """A board with a log samples at an instant: (False, True) where its count rose."""
    before = 0 if last is None else last.physical.samples
    return False, truth.physical.samples > before


def _works(last: Truth | None, truth: Truth) -> tuple[bool, bool]:
    """The worst case samples all the time that it works: (it did up to this truth, it does from here on)."""
    return last is not None and last.state in AT_WORK, truth.state in AT_WORK


class FigureMeter:
    """Takes every Truth of a mission, and makes its figures."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._logs_samples = takes_samples(scenario.board)
        self.uptimes = UptimeMeter.for_scenario(scenario)
        self._gaps = SamplingGaps(logs_samples=self._logs_samples)
        self._late_ms = MissionMs(round(1000 * (1 - _LATE) * scenario.duration_s))
        self._dead_before: dict[int, int] = {}
        """Ticks with an empty battery before the last fifth, by aMussel, once a truth is past its begin."""

    def take(self, truth: Truth) -> None:
        agent_id, late_ms = truth.agent_id, self._late_ms
        if truth.at_ms > self._scenario.time_scale.agent_ms(late_ms) and agent_id not in self._dead_before:
            is_known = agent_id in self.uptimes.agent_ids
            self._dead_before[agent_id] = self.uptimes.of(agent_id, late_ms).dead if is_known else 0
        self.uptimes.take(truth)
        self._gaps.take(truth)

    def figures(self, now_ms: MissionMs, state: MissionState, ledger: Ledger) -> Figures:
        """The figures at mission time `now_ms`; `ledger` is what the aPad drew since the start."""
        scale, capacity_wh = self._scenario.time_scale, self._scenario.apad.battery.capacity_wh
        figures = uptime_figures(self.uptimes, now_ms, battery_min=battery_worth_min(self._scenario))
        submerged, paper = figures["uptime_submerged"], figures["uptime_paper"]
        apad_wh = ledger.used_wh if scale.is_real else None
        counts = self.uptimes.at(now_ms)
        work_ticks = sum(it.submerged for it in counts)
        dead_late = sum(it.dead - self._dead_until_late(it.agent_id, now_ms) for it in counts)
        return Figures(
            amussels_lost=figures["amussels_lost"],
            samples_taken=figures["samples_taken"] if self._logs_samples else work_ticks,
            longest_gap_h=self._gaps.longest_ms(scale.agent_ms(now_ms)) / MS_PER_HOUR,
            uptime_submerged_mean=submerged["mean"],
            uptime_submerged_min=submerged["min"],
            uptime_paper_mean=paper["mean"],
            uptime_paper_min=paper["min"],
            uptime_equal_charge=figures["uptime_equal_charge"],
            charge_gain_mean=figures["charge_gain_mean"],
            metres=state.planned_m,
            metres_per_service=state.planned_m / state.services if state.services else None,
            apad_wh=apad_wh,
            apad_cycles=None if apad_wh is None else apad_wh / capacity_wh,
            dead_time_h=scale.agent_time(figures["dead_time_s"]) / 3600,
            final_charge_mean=figures["final_charge_mean"],
            uptime_paper_max=paper["max"],
            active_mean=figures["active_mean"],
            driven_m=state.cost_m,
            services=state.services,
            ended_by=str(state.ended_by),
            end_reason=state.end_reason,
            apad_travel_wh=ledger.travel_wh if scale.is_real else None,
            apad_hotel_wh=ledger.hotel_wh if scale.is_real else None,
            apad_handed_wh=ledger.handed_wh if scale.is_real else None,
            dead_late_h=dead_late / self.uptimes.ticks_per_agent_min / 60,
        )

    def _dead_until_late(self, agent_id: int, now_ms: MissionMs) -> int:
        if agent_id in self._dead_before:
            return self._dead_before[agent_id]
        return self.uptimes.of(agent_id, min(now_ms, self._late_ms)).dead
