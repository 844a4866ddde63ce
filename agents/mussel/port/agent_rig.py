"""The rig of the conformance kit for whole boards: an aMussel in still water, in a dock or at a depth of 3 m."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.modem.frames import ModemGeneration
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.board_parts import BoardPart
from agents.mussel.body import BodyConfig
from agents.mussel.outputs import Output, SoundSent, StimulusDropped, WifiSent
from agents.mussel.port.board_link import BENCH_TIMEOUT_S
from agents.mussel.port.others_firmware import OthersFirmware
from agents.mussel.reporter import ReportConfig
from agents.mussel.stimuli import (
    AgentStimulus,
    BuoyancyJammed,
    ChargeLost,
    ClockShifted,
    CoilSlipped,
    ContactClosed,
    ContactOpened,
    PartFailed,
    PinDisturbed,
    SoundArrived,
    WasReset,
    WifiArrived,
)
from agents.water.patches import CALM, QuantityWater
from firmware_model.actions import Buoyancy, RunBuoyancy
from firmware_model.bench.conformance import Case, Whole
from firmware_model.bench.costly_firmware import CostlyFirmware
from firmware_model.bench.rigs import Rig, RigEvent, RigHistory, charging, ends, flowed, states
from firmware_model.config import BoardConfig, Cycle, Timekeeping, Timeslots
from firmware_model.packets import Beacon
from firmware_model.packets.codec import BUILT_IN, MusselbedCodec
from firmware_model.power.charge import Battery, Flow, grains
from firmware_model.sinking import Sinking
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import CYCLES, METERING, board, power

_NORTH_UM, _EAST_UM, _DEPTH_UM = 12_340_000, -5_670_000, 3_000_000
_TRAVEL_MS = 60_000
_BEACON_WAIT_MS = 60_000
_NO_REPORTS_MS = 10**12
_TURBID = CALM | {"turbidity_ntu": QuantityWater(((0, 2000.0),))}
"""More than the sensor of turbidity can tell."""
_UNEVEN = Cycle(
    alarm_ms=2_700_000,
    sample_ms=15_000,
    processing_ms=40_000,
    slots=Timeslots(frame_ms=240_000, slot_ms=6000, guard_ms=900),
    listen_ms=50_000,
    report_ms=20_000,
)
_NUMBER = re.compile(r"(beacon|jump|loses|jam|bus|readings|uart|writes|cells|supply|flash):(-?\d+)")
_PARTS = {
    "bus": BoardPart.BUS,
    "uart": BoardPart.UARTS,
    "writes": BoardPart.WRITES,
    "cells": BoardPart.CELLS,
    "supply": BoardPart.SUPPLY,
    "flash": BoardPart.FLASH,
}
STIMULI = (
    "slips, the coils in the dock",
    "beacon:MS, the time that an aPad tells",
    "jump:MS, of the clock chip",
    "loses:PERCENT, of the primary battery",
    "jam:1, motors that do not move",
    "bus:1, sensors that do not answer",
    "readings:PERCENT, of noise in the batteries' readings",
    "uart:BYTES, which are kept of each packet",
    "writes:BYTES, which are written of each record",
    "cells:MASK, the bits that stay erased",
    "supply:BYTES, after which the next write ends with a brown-out",
    "flash:1, which does not answer",
)
"""The parts of a board fail until the same word comes with 0."""


def whole_board(whole: Whole, agent_id: int = 1) -> BoardConfig:
    """The board of a case, with Table I's loads."""
    metering = METERING if whole.metered else None
    cycle = _UNEVEN if whole.uneven else CYCLES[whole.sleep]
    config = board(
        cycle,
        power(whole.last_resort, 0, metering, grains(whole.low_level), whole.secondary_in_use),
        agent_id,
    )
    full = config.whole
    assert full is not None
    if whole.uneven:
        config = replace(
            config,
            pin_debounce_ms=80,
            pin_chatter_ms=3000,
            pin_check_ms=45_000,
            boot_ms=5000,
            release_wait_ms=75_000,
        )
        full = replace(
            full,
            transmit_ms=1500,
            call_ms=420_000,
            hover_ms=780_000,
            stay_down_ms=14_400_000,
            turnaround_ms=700,
            answer_ms=250,
        )
    if whole.doubt_ppm is not None:
        full = replace(full, timekeeping=Timekeeping(1000 * whole.doubt_ppm, _BEACON_WAIT_MS))
    return replace(
        config,
        whole=full,
        drift_ppb=1000 * whole.drift_ppm,
        surfacing_timeout_ms=3 * _TRAVEL_MS,
        float_timeout_ms=60_000 * whole.float_min,
    )


class _ObservedAgent(Agent):
    """An aMussel whose motor runs are seen."""

    def __init__(self, *arguments: Any) -> None:
        self.runs: list[RunBuoyancy] = []
        super().__init__(*arguments)

    def _run_buoyancy(self, run: RunBuoyancy, now_ms: int) -> list[Output]:
        self.runs.append(run)
        return super()._run_buoyancy(run, now_ms)

    def travels_in(self, ms: int, now_ms: int) -> None:
        """The body moves at another rate from now on."""
        self.body.settle_depth(now_ms)
        self.body._sinking = Sinking(_DEPTH_UM, ms, ms)
        self._timer = self._next_timer()

    def arrives(self, at_surface: bool, now_ms: int) -> list[Output]:
        """A hand or a net brings the body up or down."""
        body = self.body
        body.depth_um, body.depth_anchor_ms, body.hover_um = 0 if at_surface else _DEPTH_UM, now_ms, 0
        body.buoyancy = Buoyancy.FLOAT if at_surface else Buoyancy.SINK
        outputs = self._arrive(now_ms)
        self._timer = self._next_timer()
        return outputs


class AgentRig(Rig):
    """A whole board in an aMussel of its own. `command` is somebody's firmware; empty for ours."""

    def __init__(
        self,
        case: Case,
        command: tuple[str, ...] = (),
        cost_ms: int = 0,
        seed: int = 1,
        release_wait_ms: int | None = None,
    ) -> None:
        """`release_wait_ms` is another wait for a release packet than that of the case."""
        whole = case.whole or Whole()
        reports_ms = _NO_REPORTS_MS if whole.report_min is None else 60_000 * whole.report_min
        self._model = whole_board(whole, case.agent_id)
        if release_wait_ms is not None:
            self._model = replace(self._model, release_wait_ms=release_wait_ms)
        fleet = FleetConfig(
            theta=1,
            seed=1,
            codec=BUILT_IN,
            board=self._model,
            body=BodyConfig(
                Sinking(_DEPTH_UM, _TRAVEL_MS, _TRAVEL_MS), drifts_always=False, drift_amplitude_um=0
            ),
            reports=ReportConfig(
                reports_ms,
                heard_always=False,
                modem=ModemGeneration.V2 if whole.short_modem else ModemGeneration.V3,
            ),
            waters=_TURBID if whole.turbid else CALM,
        )
        config = AgentConfig(self._model, fleet.maker().config(1).water, fleet.reports, command)
        physical = resting_on_bottom(
            _NORTH_UM / 1e6, _EAST_UM / 1e6, _DEPTH_UM / 1e6, case.primary, whole.secondary
        )
        if whole.docked:
            physical = replace(
                physical,
                primary=Battery(0, grains(case.primary), Flow.CHARGING, 0, 2),
                secondary=Battery(0, grains(whole.secondary), Flow.CHARGING, 0, 1),
                depth_um=0,
                buoyancy=Buoyancy.FLOAT,
                docked=True,
            )
        self.now_ms = 0
        self.outputs: list[Output] = []
        self._charges = physical.primary.charge, physical.secondary.charge
        others = None
        if command:
            others = OthersFirmware(
                command,
                self._model,
                config.water.seed,
                config.reports.modem,
                BENCH_TIMEOUT_S,
                lambda it: CostlyFirmware(it, cost_ms, seed) if cost_ms else it,
            )
        self.agent = _ObservedAgent(config, MusselbedCodec(), physical, 0, ResetCause.POWER_ON, None, others)

    def run(self, ms: int) -> None:
        self.now_ms += ms
        self.outputs += self.agent.advance(self.now_ms)

    def pin(self, high: bool, *, noticed: bool) -> None:
        """Closes or opens a dock around it; below, where there is none, the pin alone changes, by a defect."""
        body, unseen = self.agent.body, int(not noticed)
        if body.docked or body.depth_at_um(self.now_ms) == 0:
            contact = ContactClosed(_NORTH_UM, _EAST_UM) if high else ContactOpened()
            self._stimulate(*([contact] if noticed else [PinDisturbed(0, 1), contact, PinDisturbed(0, 0)]))
        else:
            self._stimulate(PinDisturbed(int(high), unseen), PinDisturbed(int(high), 0))

    def receive(self, data: bytes, *, by_sound: bool) -> None:
        self._stimulate((SoundArrived if by_sound else WifiArrived)(data))

    def reset(self, cause: ResetCause) -> None:
        self._stimulate(WasReset(cause))

    def travels_in(self, ms: int) -> None:
        self.agent.travels_in(ms, self.now_ms)

    def arrives(self, *, at_surface: bool) -> None:
        self.outputs += self.agent.arrives(at_surface, self.now_ms)

    def play_own(self, word: str) -> bool:
        if word == "slips":
            self._stimulate(CoilSlipped())
        elif found := _NUMBER.fullmatch(word):
            self._number(found[1], int(found[2]))
        else:
            return False
        return True

    def _number(self, word: str, number: int) -> None:
        if word == "beacon":
            self._stimulate(SoundArrived(Beacon(1, number).encode()))
        elif word == "jump":
            self._stimulate(ClockShifted(number))
        elif word == "jam":
            self._stimulate(BuoyancyJammed(number))
        elif word == "loses":
            self._stimulate(ChargeLost(grains(number / 100), 0))
        elif word == "readings":
            self._stimulate(PartFailed(BoardPart.CONVERTER, grains(number / 100)))
        else:
            self._stimulate(PartFailed(_PARTS[word], number))

    def own_stimuli(self) -> Sequence[str]:
        return STIMULI

    def _stimulate(self, *stimuli: AgentStimulus) -> None:
        for stimulus in stimuli:
            self.outputs += self.agent.receive(stimulus, self.now_ms)

    def shown(self) -> RigHistory:
        agent = self.agent
        agent.close()
        truths = agent.take_truths()
        courses = [
            [(it.at_ms, battery) for it, battery in zip(truths, batteries, strict=True)]
            for batteries in zip(
                *((it.physical.primary, it.physical.secondary) for it in truths), strict=True
            )
        ]
        events = [
            *charging(courses[0]),
            *(RigEvent(it.at_ms, f"motors {it.to.name.lower()}{_depth(it)}") for it in agent.runs),
        ]
        for output in self.outputs:
            if isinstance(output, SoundSent | WifiSent):
                by = "sound" if isinstance(output, SoundSent) else "Wi-Fi"
                events.append(RigEvent(output.at_ms, f"sends by {by} {output.data.hex()}"))
        model = self._model.charge
        primary, secondary = (model.charge_at(course[-1][1], self.now_ms) for course in courses)
        over = [
            it
            for name, course in zip(("the primary", "the backup"), courses, strict=True)
            for it in ends(name, course, model, self.now_ms)
        ]
        return RigHistory(
            tuple(sorted(events, key=lambda it: it.at_ms)),
            primary,
            flowed(courses[0], primary),
            secondary=secondary,
            secondary_flowed=flowed(courses[1], secondary),
            ends=tuple(sorted(over, key=lambda it: it.at_ms)),
            refused=sum(isinstance(it, StimulusDropped) for it in self.outputs),
            states=tuple(states((it.at_ms, it.state) for it in truths)),
        )


def _depth(run: RunBuoyancy) -> str:
    return "" if run.depth_mm is None else f" at {run.depth_mm / 1000:g} m"
