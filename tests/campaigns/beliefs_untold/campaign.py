"""Coverage in flight of twins that are told nothing of their boards: aged batteries, other drains, sensors that are off.

The twins know the catalogue's numbers. Each board of a population draws its own: an ageing of 0 to 40 % of the capacity,
a drain of 20 % more or less, and for each battery's sensor a bias of 0.05 either way and a noise of 0.005 in every
packet. The charge that a coil delivers is the catalogue's. All draws are uniform (the noise is normal) and follow from
the population's seed. Four rows are reported apart: boards that equal their twins; a population of which one aMussel's
codec takes 0.3 off its primary's charge, which is judged before and after its twin suspects it; boards whose drain swings
with the hour of the day, each with a phase of its own; and boards whose readings stand for 30 h.

The judge reads the agents' truth channel, and computes coverage and NEES itself. A round of charge ends with a release.
The bins overlap: a charging aMussel is docked too. The shares of packets received are of all packets, by sound and by
Wi-Fi, after the first one of each aMussel.
"""

from __future__ import annotations

import math
import os
import random
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from statistics import fmean, median
from typing import Any, TypeVar
from unittest.mock import patch

from beliefs.score import crps
from rich.console import Console
from rich.progress import Progress

from agents.fleet_config import FleetConfig, Spread
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.time_scale import MissionMs, TimeScale
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import FlightConfig, flight_config
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.charge_filter import RATE
from apad_bridge.beliefs.twin_parameters import CallParameters
from apad_bridge.beliefs.twin_state import TwinState
from apad_bridge.runs.flying import in_process_context
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.sample_collection import SampleCollection
from benchmarks.rows import told
from firmware_model.config import BoardConfig
from firmware_model.hardware import whole
from firmware_model.hardware.power_path import PowerPath
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.power.ageing import AS_NEW, rescaled
from firmware_model.power.charge import ChargeModel, fraction
from firmware_model.states import State

Packet = TypeVar("Packet", StatusPacket, ShortStatus)
SCENARIO = Path(__file__).parents[3] / "launch_scripts/scenarios/sound-12.yaml"
MISSION_S = 36_000
"""More than the aPad's battery lasts, which ends a flight after 4.5 to 5.1 h: three rounds of charge and more for most
aMussels."""
SHORT_S = 1800
"""The short tier flies a population that the twins were tuned on or judged by: others are kept for the judgement."""
SEEN = (3401, 3402, 3403, *range(917001, 917015))
JUDGED_ON = (917021, 917022, 917023, 917024)
"""Drawn and written down before any of them was flown."""
TUNED_ON_DAYS = (917031, 917032)
"""The twins' swing of the drain and their doubt of a reading that stands were tuned on these."""
JUDGED_ON_DAYS = (917041, 917042, 917043, 917044)
"""The same rows' judgement: written down before any of them was flown, and before any tuning."""
HEARD = (1.0, 0.3, 0.1)
SAMPLED_MS = 10_000
NOISE = 0.005
ASSUMED = (0.99, 0.997, 0.9999)
"""Shares of permissions to surface that arrive, as further twins assume where the fewest packets are received."""
MOST_AGED, MOST_DRAIN, MOST_BIAS = 0.4, 0.2, 0.05
SWING = 0.085
"""The amplitude, of its own load, by which a swinging board draws more and less within a day of agent time."""
HOUR_MS = 3_600_000
STANDS_H = 30
"""Agent time for which a reading stands; it begins between 24 and 72 h after the flight does."""
STEPS = 3
"""The noise deviations by which a reading has to have been due to move before a twin can be asked to notice."""
TWIN = {
    "drain_deviation": 0.05,
    "sensor_noise": NOISE,
    "bias_deviation": 0.0005,
    "coil_deviation": 0.005,
    "motor_deviation": 0.05,
    "unscheduled": 0.0,
    "fix_deviation_m": 0.5,
}
BINS = {
    "sleeping": {State.SLEEPING, State.SAMPLING, State.PROCESSING, State.AWAITING_SLOT, State.TRANSMITTING},
    "floating": {State.FLOATING, State.RELEASED},
    "docked": {State.CHARGING, State.REPORTING},
    "charging": {State.CHARGING, State.REPORTING},
}
LIAR, LIE = 1, -0.3
"""The aMussel whose codec takes so much off, and how much."""
ROUNDS = 3
"""The rounds of charge after which a twin should know its board."""


class Boards(StrEnum):
    UNTOLD = "untold"
    AS_TOLD = "as told"
    LIAR = "one liar"
    SWINGING = "swinging"
    STANDING = "standing"


@dataclass(frozen=True, slots=True)
class Drawn:
    """One board, of which its twin is not told: of the catalogue's capacity and load, and of the readings."""

    ageing: float = 0.0
    drain: float = 1.0
    bias: float = 0.0
    secondary_bias: float = 0.0
    phase: float | None = None
    """The phase of the drain's swing, in days; None for a steady drain."""
    stands_ms: float = math.inf
    """The agent time from which its readings stand."""

    def drawn(self, load: int, at_ms: int) -> int:
        """The load at agent time `at_ms`."""
        if self.phase is None:
            return load
        return round(load * (1 + SWING * math.sin(math.tau * (at_ms / (24 * HOUR_MS) + self.phase))))

    def stands(self, at_ms: int) -> bool:
        return self.stands_ms <= at_ms < self.stands_ms + STANDS_H * HOUR_MS

    def board(self, nominal: BoardConfig) -> BoardConfig:
        return rescaled(nominal, round(AS_NEW * self.drain), round(AS_NEW * (1 - self.ageing)))


class Population(Spread):
    """A spread that holds each board's draw."""

    def __init__(self, boards: dict[int, Drawn]) -> None:
        super().__init__()
        object.__setattr__(self, "boards", boards)

    def applied(self, board: BoardConfig, seed: int) -> BoardConfig:
        boards: dict[int, Drawn] = self.boards  # type: ignore[attr-defined]  # a frozen class, set above
        return boards[board.agent_id].board(board)


def population(seed: int, ids: tuple[int, ...], boards: Boards = Boards.UNTOLD) -> dict[int, Drawn]:
    """The boards by id."""
    luck = random.Random(f"boards {seed}")
    if boards is Boards.AS_TOLD:
        return dict.fromkeys(ids, Drawn())
    drawn = {
        agent_id: Drawn(
            luck.uniform(0, MOST_AGED),
            luck.uniform(1 - MOST_DRAIN, 1 + MOST_DRAIN),
            luck.uniform(-MOST_BIAS, MOST_BIAS),
            luck.uniform(-MOST_BIAS, MOST_BIAS),
        )
        for agent_id in ids
    }
    if boards is Boards.LIAR:
        drawn[LIAR] = replace(drawn[LIAR], bias=LIE)
    # Draws of their own, so that the boards are those of the other rows.
    luck = random.Random(f"days {seed}")
    if boards is Boards.SWINGING:
        drawn = {agent_id: replace(it, phase=luck.random()) for agent_id, it in drawn.items()}
    if boards is Boards.STANDING:
        drawn = {
            agent_id: replace(it, stands_ms=luck.uniform(24, 72) * HOUR_MS) for agent_id, it in drawn.items()
        }
    return drawn


def swinging(boards: dict[int, Drawn]) -> type[PowerPath]:
    """The batteries of simulated boards, whose loads swing; a load that is switched on holds till the next switching."""

    class Swinging(PowerPath):
        def __init__(self, *arguments: Any, **further: Any) -> None:
            super().__init__(*arguments, **further)
            self._drawn = boards[arguments[5]]

        def set(self, charging: bool, load: int, now_ms: int) -> None:
            super().set(charging, self._drawn.drawn(load, now_ms), now_ms)

    return Swinging


@dataclass(frozen=True, slots=True)
class Row:
    """One belief beside its truth."""

    agent_id: int
    state: State
    rounds: int
    """The rounds of charge that it had so far."""
    error: float
    deviation: float
    covered: bool
    width: float
    at_an_end: bool
    """The truth, or more than half of the belief, is exactly 0 or 1, where a deviation means nothing."""
    charging: bool
    ageing_error: float
    """The estimated minus the true ageing; NaN for a twin that estimates none."""
    ageing_deviation: float
    """The twin's own deviation of that estimate."""
    suspect: bool
    reason: str
    """The reason why it is suspect; empty for one that is not."""
    true: float
    crps: float
    at_ms: int
    """Agent time."""
    stood_ms: float
    """Agent time since its readings began to stand; negative before, and for those that never do."""


def scenario_of(seed: int, drain_swing: float) -> Scenario:
    shipped = load(SCENARIO)
    data = resolve(shipped) | {"seed": seed, "duration_s": MISSION_S}
    data["fleet"]["start"] = {"charge": [0.5, 1.0]}
    data["beliefs"] = {"estimator": "twin", "twin": TWIN | {"untold": {"drain_swing": drain_swing}}}
    return from_data(data, shipped.name)


@dataclass(frozen=True, slots=True)
class Case:
    """The boards, the share of packets received, and the share of permissions that the twins assume to arrive."""

    boards: Boards
    heard: float
    arrives: float | None = None
    """None for the twins' own assumption."""
    learns: bool = True
    """False for twins that take their boards for the catalogue's, but for the deviations that the scenario states."""
    told_swing: float = 0.0
    """The scenario's `drain_swing`."""


def flown(job: tuple[int, Case], mission_s: float = MISSION_S) -> list[Row]:
    """Flies the population of a seed, and compares each belief with its truth each 10 s of the mission."""
    seed, case = job
    scenario = replace(scenario_of(seed, case.told_swing), duration_s=mission_s)
    config = told_of_losses(flight_config(scenario), case)
    boards = population(seed, tuple(scenario.fleet.ids), case.boards)
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    drawn = replace(fleet_parts.fleet_config(config), spread=Population(boards))
    with patch.object(whole, "PowerPath", swinging(boards)):
        return _flown(seed, case, scenario, config, boards, drawn, initial_states)


def _flown(
    seed: int,
    case: Case,
    scenario: Scenario,
    config: FlightConfig,
    boards: dict[int, Drawn],
    drawn: FleetConfig,
    initial_states: dict[int, Physical],
) -> list[Row]:
    host = InProcessHost(drawn, initial_states)
    fleet = fleet_parts.fleet_of(config, host, dict.fromkeys(initial_states, 0))
    recorder = Judge(scenario, config.board, boards)
    context = in_process_context(config, fleet)
    flight = flight_parts.flight(config, context, recorder, samples=SampleCollection(config.ids))
    heard_by_sensors(flight, boards, seed, case.heard, scenario.time_scale)
    flight.run()
    return recorder.rows


def told_of_losses(config: FlightConfig, case: Case) -> FlightConfig:
    """The share of lost packets is no part of a board: a twin that weighs silence has to know it."""
    assert config.twin is not None
    parameters = config.twin.parameters
    assert parameters.calls is not None
    calls = CallParameters(parameters.calls.every_ms, max(parameters.calls.missed, 1 - case.heard))
    arrives = parameters.permission_arrives if case.arrives is None else case.arrives
    untold = parameters.untold if case.learns else None
    told = replace(parameters, calls=calls, permission_arrives=arrives, untold=untold)
    return replace(config, twin=replace(config.twin, parameters=told))


def heard_by_sensors(
    flight: Flight, boards: dict[int, Drawn], seed: int, heard: float, scale: TimeScale
) -> None:
    """Has the beliefs learn from the share `heard` of the packets, with what each board's sensors read."""
    beliefs = flight.supervisor.beliefs
    hear, hear_short = beliefs.hear, beliefs.hear_short
    luck, sensors = random.Random(f"losses {seed}"), random.Random(f"noise {seed}")
    first: set[int] = set()
    held: dict[int, tuple[float, float]] = {}
    """The readings that stand, by aMussel: those of the first packet since then, received or not."""

    def is_lost(agent_id: int) -> bool:
        if agent_id in first and luck.random() >= heard:
            return True
        first.add(agent_id)
        return False

    def stated(packet: Packet) -> tuple[float, float]:
        board = boards[packet.agent_id]
        charges = packet.primary + board.bias, packet.secondary + board.secondary_bias
        primary, secondary = (min(1.0, max(0.0, it + sensors.gauss(0, NOISE))) for it in charges)
        return primary, secondary

    def read(packet: Packet, at_ms: MissionMs) -> Packet | None:
        """The packet with the readings of its sensors; None for a lost one."""
        agent_id = packet.agent_id
        stands = boards[agent_id].stands(scale.agent_ms(at_ms))
        if stands and agent_id not in held:
            held[agent_id] = stated(packet)
        if is_lost(agent_id):
            return None
        primary, secondary = held[agent_id] if stands else stated(packet)
        return replace(packet, primary=primary, secondary=secondary)

    def status(packet: StatusPacket, at_ms: MissionMs) -> str | None:
        it = read(packet, at_ms)
        return "lost" if it is None else hear(it, at_ms)

    def short(packet: ShortStatus, at_ms: MissionMs) -> str | None:
        it = read(packet, at_ms)
        return "lost" if it is None else hear_short(it, at_ms)

    beliefs.hear, beliefs.hear_short = status, short  # type: ignore[method-assign]


class Judge(MemoryRecorder):
    """Compares beliefs with the truth channel."""

    def __init__(self, scenario: Scenario, nominal: BoardConfig, boards: dict[int, Drawn]) -> None:
        super().__init__(scenario)
        self.rows: list[Row] = []
        self._boards = boards
        self._models: dict[int, ChargeModel] = {
            agent_id: board.board(nominal).charge for agent_id, board in boards.items()
        }
        self._newest: dict[int, Truth] = {}
        self._docked: set[int] = set()
        self._rounds = dict.fromkeys(boards, 0)

    def truths(self, truths: list[Truth]) -> None:
        super().truths(truths)
        for truth in truths:
            self._newest[truth.agent_id] = truth
            if truth.physical.docked:
                self._docked.add(truth.agent_id)
            elif truth.agent_id in self._docked:
                self._docked.remove(truth.agent_id)
                self._rounds[truth.agent_id] += 1

    def tick(self, now_ms: MissionMs, beliefs: list[Belief], *rest: Any) -> None:
        for belief in beliefs if now_ms % SAMPLED_MS == 0 else ():
            self.rows.append(self._row(belief, now_ms))

    def _true(self, truth: Truth, at_ms: int) -> float:
        return fraction(self._models[truth.agent_id].charge_at(truth.physical.primary, at_ms))

    def _row(self, belief: Belief, now_ms: MissionMs) -> Row:
        agent_id, truth = belief.agent_id, self._newest[belief.agent_id]
        at_ms = self._scale.agent_ms(now_ms)
        true = self._true(truth, at_ms)
        low, high = belief.charge_interval()
        ageing, ageing_deviation = _ageing(belief)
        at_an_end = belief.probability_at_most(0.0) + 1 - belief.probability_at_most(1 - 1e-9) > 0.5
        return Row(
            agent_id,
            truth.state,
            self._rounds[agent_id],
            belief.primary - true,
            math.sqrt(belief.charge_cov[0]),
            low <= true <= high,
            high - low,
            not 0 < true < 1 or at_an_end,
            true < 1,
            ageing - self._boards[agent_id].ageing,
            ageing_deviation,
            belief.suspicion is not None,
            "" if belief.suspicion is None else belief.suspicion.reason,
            true,
            crps(belief.parts, true),
            at_ms,
            at_ms - self._boards[agent_id].stands_ms,
        )


def _ageing(belief: Belief) -> tuple[float, float]:
    """The estimated ageing and its deviation: a battery that has lost the share a charges 1 / (1 - a) times as fast."""
    twin_state = belief.estimator_state
    assert isinstance(twin_state, TwinState)
    rate = float(twin_state.mean[RATE])
    return 1 - 1 / rate, math.sqrt(float(twin_state.cov[RATE, RATE])) / rate**2


def score(rows: list[Row]) -> dict[str, Any]:
    squares = [(row.error / row.deviation) ** 2 for row in rows if not row.at_an_end and row.deviation > 1e-9]
    if not rows:
        return {"samples": 0, "coverage": None, "nees": None, "width": None, "rmse": None, "crps": None}
    return {
        "samples": len(rows),
        "coverage": sum(row.covered for row in rows) / len(rows),
        "nees": math.fsum(squares) / len(squares) if squares else None,
        "width": math.fsum(row.width for row in rows) / len(rows),
        "rmse": math.sqrt(math.fsum(row.error**2 for row in rows) / len(rows)),
        "crps": math.fsum(row.crps for row in rows) / len(rows),
    }


def in_one_row(head: dict[str, Any], flights: list[list[Row]]) -> dict[str, Any]:
    """The scores of all samples, the range over the bins by state and rounds of charge, and the false alarms.

    A false alarm is a suspicion that begins while the board's readings neither lie nor stand.
    """
    rows = [row for its in flights for row in its]
    bins = [score(here) for _, _, here in _by_rounds(flights) if here]
    alarms, board_ms = 0, 0
    for its in flights:
        by_amussel: dict[int, list[Row]] = {}
        for row in its:
            if row.stood_ms < 0 and not (row.agent_id == LIAR and head["boards"] == Boards.LIAR):
                by_amussel.setdefault(row.agent_id, []).append(row)
        for healthy in by_amussel.values():
            alarms += healthy[0].suspect
            alarms += sum(now.suspect and not before.suspect for before, now in pairwise(healthy))
            board_ms += healthy[-1].at_ms - healthy[0].at_ms
    ranges = {
        f"{name}_{which.__name__}": which(found)
        for name in ("coverage", "nees")
        if (found := [it[name] for it in bins if it[name] is not None])
        for which in (min, max)
    }
    weeks = board_ms / (7 * 24 * HOUR_MS)
    return {
        **head,
        **score(rows),
        **ranges,
        "alarms": alarms,
        "board_weeks": weeks,
        "alarms_a_week": alarms / weeks,
    }


def binned(rows: list[Row]) -> Iterator[tuple[str, list[Row]]]:
    for name, states in BINS.items():
        yield name, [row for row in rows if row.state in states and (row.charging or name != "charging")]


Job = tuple[int, Case, int]
"""The seed, the case and the mission's duration in s."""


def measure(
    seeds: tuple[int, ...] | None = None, short: bool = False, row: Sequence[str] | None = None
) -> dict[str, Any]:
    """`summary`: a line for each row and share of packets, with false alarms. `bins`: the scores by row, share of packets,
    rounds of charge and bin. `before`: those of twins that learn nothing of their boards. `assumed`: those of twins that
    assume other shares of permissions to arrive. `ageing`: by row and share of packets, how many aMussels' ageing was
    estimated within 0.05 when their fourth round began, and the greatest error, the twins' mean deviation and their NEES
    then. `suspects`: the number by row with their reasons, and the scores of the liar. `standing`: the scores of readings
    that stand, and how soon they were suspected and believed again.

    `row` is for these rows alone; `seeds` for other populations than each row's own.
    """
    names = tuple(Boards) if row is None else [_row_named(name) for name in row]
    jobs, flown_s = [], 0
    for boards in names:
        # Days need a flight of days, also in the short tier.
        days = boards in (Boards.SWINGING, Boards.STANDING)
        mission_s = SHORT_S if short and not days else MISSION_S
        usual = (TUNED_ON_DAYS[:1] if short else JUDGED_ON_DAYS) if days else SEEN[:1] if short else JUDGED_ON
        jobs += [(seed, case, mission_s) for case in _cases(boards, short) for seed in seeds or usual]
        flown_s = max(flown_s, mission_s)
    found: dict[Case, list[list[Row]]] = {}
    for (seed, case, _), rows in _side_by_side(_fly, jobs):
        found.setdefault(case, []).append(rows)
        told({**_head(case), "seed": seed, **score(rows)})
    return judged(tuple(dict.fromkeys(seed for seed, _, _ in jobs)), flown_s, found)


def _row_named(name: str) -> Boards:
    try:
        return Boards(name)
    except ValueError:
        raise SystemExit(f"no row {name!r}: the rows are {', '.join(map(repr, map(str, Boards)))}") from None


def _cases(boards: Boards, short: bool) -> list[Case]:
    swing = SWING / math.sqrt(2) if boards is Boards.SWINGING else 0.0
    cases = [
        Case(boards, heard, told_swing=swing) for heard in (HEARD[:1] if boards is Boards.LIAR else HEARD)
    ]
    if boards is Boards.UNTOLD:
        cases += [Case(boards, heard, learns=False) for heard in HEARD]
        cases += [Case(boards, HEARD[-1], arrives) for arrives in ASSUMED]
    return cases[::2] if short and boards in (Boards.SWINGING, Boards.STANDING) else cases


def _fly(job: Job) -> list[Row]:
    return flown(job[:2], job[2])


def _side_by_side(fly: Callable[[Job], list[Row]], jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
    """Each job with its rows, in order, from as many processes as there are processors; a bar counts them."""
    with (
        Progress(console=Console(stderr=True), transient=True) as progress,
        ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool,
    ):
        task = progress.add_task("flying", total=len(jobs))
        for job, rows in zip(jobs, pool.map(fly, jobs), strict=True):
            yield job, rows
            progress.advance(task)


def _head(case: Case) -> dict[str, Any]:
    assumed = {} if case.arrives is None else {"arrives": case.arrives}
    told_swing = {"told_swing": case.told_swing} if case.told_swing else {}
    return {"boards": str(case.boards), "heard": case.heard, **told_swing, **assumed}


def judged(seeds: tuple[int, ...], mission_s: int, found: dict[Case, list[list[Row]]]) -> dict[str, Any]:
    """The figures of `measure`, from the rows of each case's flights."""
    bins: list[dict[str, Any]] = []
    before: list[dict[str, Any]] = []
    assumed: list[dict[str, Any]] = []
    ageing, suspects = [], []
    standing: list[dict[str, Any]] = []
    summary: list[dict[str, Any]] = []
    for case, flights in found.items():
        head = _head(case)
        if not case.learns:
            before += binned_scores(head, flights)
            continue
        if case.arrives is not None:
            assumed += binned_scores(head, flights)
            continue
        summary.append(in_one_row(head, flights))
        if case.boards is Boards.LIAR:
            lies = [row for rows in flights for row in rows if row.agent_id == LIAR]
            suspects += [
                {**head, "suspect": suspect, **score([row for row in lies if row.suspect is suspect])}
                for suspect in (False, True)
            ]
            continue
        if case.boards is Boards.STANDING:
            standing += _standing(head, flights)
            continue
        known: list[Row] = []
        for rows in flights:
            first: dict[int, Row] = {}
            for row in rows:
                if row.rounds >= ROUNDS:
                    first.setdefault(row.agent_id, row)
            known += first.values()
        errors = [abs(row.ageing_error) for row in known]
        deviations = [row.ageing_deviation for row in known]
        ageing.append(
            {
                **head,
                "amussels": len(known),
                "within": sum(it <= 0.05 for it in errors),
                "greatest": max(errors, default=None),
                "deviation": fmean(deviations) if known else None,
                "nees": fmean((it / sd) ** 2 for it, sd in zip(errors, deviations, strict=True))
                if known
                else None,
            }
        )
        false = _reasons(flights)
        suspects.append({**head, "suspects": len(false), "reasons": false})
        bins += binned_scores(head, flights)
    return {
        "seeds": list(seeds),
        "mission_s": mission_s,
        "summary": summary,
        "bins": bins,
        "before": before,
        "assumed": assumed,
        "ageing": ageing,
        "suspects": suspects,
        "standing": standing,
    }


def _reasons(flights: list[list[Row]]) -> list[str]:
    """The first reason against each aMussel that was suspect, flight by flight."""
    found: list[str] = []
    for rows in flights:
        first: dict[int, str] = {}
        for row in rows:
            if row.suspect:
                first.setdefault(row.agent_id, f"aMussel {row.agent_id}: {row.reason}")
        found += first.values()
    return found


def _standing(head: dict[str, Any], flights: list[list[Row]]) -> Iterator[dict[str, Any]]:
    """The scores before a reading stands, while it does (not yet suspected, and suspected) and after; and the delays.

    Those are agent time: `after_h` from when the reading began to stand, `late_h` from when the true charge had moved by
    `STEPS` deviations of the noise, and `healed_h` from when it moved again. A suspicion is `false` before it stands.
    """
    lasts_ms = STANDS_H * HOUR_MS
    parts: dict[str, list[Row]] = {"before": [], "unsuspected": [], "suspected": [], "after": []}
    after, late, healed, unhealed, false, amussels = [], [], [], 0, 0, 0
    for rows in flights:
        for agent_id in sorted({row.agent_id for row in rows}):
            its = [row for row in rows if row.agent_id == agent_id]
            stands = [row for row in its if 0 <= row.stood_ms < lasts_ms]
            again = [row for row in its if row.stood_ms >= lasts_ms]
            parts["before"] += (before := [row for row in its if row.stood_ms < 0])
            parts["after"] += again
            if not stands or not before:
                continue
            amussels += 1
            false += any(row.suspect for row in before)
            for row in stands:
                parts["suspected" if row.suspect else "unsuspected"].append(row)
            moved = [row for row in stands if abs(row.true - before[-1].true) >= STEPS * NOISE]
            suspect = [row for row in stands if row.suspect]
            if suspect:
                after.append(suspect[0].stood_ms / HOUR_MS)
            if suspect and moved:
                late.append((suspect[0].at_ms - moved[0].at_ms) / HOUR_MS)
            calm = [row for row in again if not row.suspect]
            if calm:
                healed.append((calm[0].stood_ms - lasts_ms) / HOUR_MS)
            unhealed += bool(again) and not calm
    for name, rows in parts.items():
        yield {**head, "part": name, **score(rows)}
    yield {
        **head,
        "amussels": amussels,
        "suspected": len(after),
        "false": false,
        "unhealed": unhealed,
        **{
            f"{name}_{which.__name__}": which(hours) if hours else None
            for name, hours in (("after_h", after), ("late_h", late), ("healed_h", healed))
            for which in (median, max)
        },
        "reasons": _reasons(flights),
    }


def _by_rounds(flights: list[list[Row]]) -> Iterator[tuple[int, str, list[Row]]]:
    for after in (0, ROUNDS):
        some = [row for rows in flights for row in rows if (row.rounds >= ROUNDS) is bool(after)]
        for name, here in binned(some):
            yield after, name, here


def binned_scores(head: dict[str, Any], flights: list[list[Row]]) -> Iterator[dict[str, Any]]:
    for after, name, here in _by_rounds(flights):
        yield {**head, "rounds": after, "bin": name, **score(here)}
    by_amussel = [
        [row for row in rows if row.agent_id == agent_id]
        for rows in flights
        for agent_id in {row.agent_id for row in rows}
    ]
    worst = min(by_amussel, key=lambda rows: sum(row.covered for row in rows) / len(rows))
    yield {**head, "rounds": 0, "bin": "all", **score([row for rows in flights for row in rows])}
    yield {**head, "rounds": 0, "bin": "worst aMussel", **score(worst)}
