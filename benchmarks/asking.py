"""The gain from asking aMussels for their status by sound: the pool on twins that receive little, paired with no asking.

The boards draw up to 30 % more or less than the twins assume. One in ten of the hourly statuses is received: either nine
of ten packets from the bottom are lost, whatever they are ("lossy"), and so are answers; or all aMussels are at the edge
of the range, at an SNR of -0.6 dB ("noisy"), where 90 % of the statuses (45 bytes) are lost, and 29 % of packets as short
as a question and its answer. "late" is "noisy" with a mission that fetches at 15 % instead of 60, from charges to match.
`asking` is `water.talk.ask_worth_answers`; `answers_charge` is the charge that all answering aMussels spent on it, in
batteries.
"""

from __future__ import annotations

import math
import random
import statistics
import tempfile
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.time_scale import MissionMs
from apad_bridge.assembly import fleet_parts, parts
from apad_bridge.assembly.acoustics import answer_charge
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.sound import PacketPassed
from apad_bridge.records.summary import uptime_figures
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.scenario.firmware_config import board_config, charge_models
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.sample_collection import SampleCollection
from apad_bridge.vehicle.link import InProcessVehicle
from benchmarks.rows import side_by_side, told
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge import Battery, fraction
from firmware_model.states import State

CONFIGURATIONS = 10
MISSION_S = 7200
SHORT_CONFIGURATIONS, SHORT_S = 2, 900
ASKING = (0.0, 1.0)
CASES = ("lossy", "noisy", "late")
SCENARIO = Path(__file__).parents[1] / "launch_scripts/scenarios/sound-12.yaml"
TWIN = {
    "drain_deviation": 0.2,
    "sensor_noise": 0.01,
    "bias_deviation": 0.01,
    "unscheduled": 0.03,
    "fix_deviation_m": 1.0,
}
OFF_BY = 0.3
LOSS, SNR_DB = 0.9, -0.6
FIGURES = ("lost", "emptied", "uptime", "least_uptime", "samples", "cost_m", "error")


def measure(configurations: int = CONFIGURATIONS, short: bool = False) -> dict[str, Any]:
    """`rows`: a mean for each case and way of asking; `gains`: the paired gain from asking, with its interval of 95 %."""
    configurations, mission_s = (SHORT_CONFIGURATIONS, SHORT_S) if short else (configurations, MISSION_S)
    flights = [
        (case, asking, seed) for seed in range(1, configurations + 1) for case in CASES for asking in ASKING
    ]
    flown = {}
    for (case, asking, seed), figures in side_by_side(partial(fly, mission_s=mission_s), flights):
        flown[case, asking, seed] = figures
        told({"case": case, "asking": asking, "seed": seed, **figures})
    rows = []
    for case in CASES:
        for asking in ASKING:
            ones = [flown[case, asking, seed] for seed in range(1, configurations + 1)]
            rows.append({"case": case, "asking": asking, **{key: _mean(ones, key) for key in ones[0]}})
    return {
        "configurations": configurations,
        "mission_s": mission_s,
        "rows": rows,
        "gains": list(_gains(flown, configurations)),
    }


def _mean(flights: list[dict[str, float]], key: str) -> float:
    return statistics.mean(it[key] for it in flights)


def _gains(
    flown: dict[tuple[str, float, int], dict[str, float]], configurations: int
) -> Iterator[dict[str, Any]]:
    for case in CASES:
        for asking in ASKING[1:]:
            gain: dict[str, Any] = {"case": case, "asking": asking}
            for key in FIGURES:
                differences = [
                    flown[case, asking, seed][key] - flown[case, 0.0, seed][key]
                    for seed in range(1, configurations + 1)
                ]
                half = 1.96 * statistics.stdev(differences) / math.sqrt(configurations)
                gain[key] = [statistics.mean(differences), half]
            yield gain


def fly(which: tuple[str, float, int], mission_s: int = MISSION_S) -> dict[str, float]:
    case, asking, seed = which
    with tempfile.TemporaryDirectory(prefix="musselbed-") as directory:
        thought = _scenario(case, asking, seed, mission_s, Path(directory))
        return _flown(thought, _as_it_is(thought, seed))


def _scenario(case: str, asking: float, seed: int, mission_s: int, directory: Path) -> Scenario:
    shipped = load(SCENARIO)
    data = resolve(shipped)
    data.update(seed=seed, duration_s=mission_s)
    data["fleet"]["start"] = {"charge": [0.2, 0.6] if case == "late" else [0.6, 1.0]}
    if case == "late":
        data["mission"]["pool_threshold"] = 0.15
    data["beliefs"] = {"estimator": "twin", "twin": TWIN}
    data["water"]["talk"]["ask_worth_answers"] = asking
    if case == "lossy":
        links = directory / "links.csv"
        links.write_text(f"from, to, loss\n*, apad, {LOSS}\n")
        data["water"]["links_file"] = str(links)
    else:
        sound = data["water"]["sound"]
        level_db = SNR_DB + sound["noise_db_per_hz"] + 10 * math.log10(sound["bandwidth_hz"])
        # The same at any distance, and whether the aPad moves or not.
        sound.update(
            source_level_db=level_db, spreading_db=0, absorption_db_per_km=0, fading_db=0, thruster_noise_db=0
        )
    return from_data(data, shipped.name)


def _as_it_is(thought: Scenario, seed: int) -> Scenario:
    """The same scenario with other loads of the boards, asleep and awake; they depend on the seed alone, not on asking."""
    factor = 1 + random.Random(seed).uniform(-OFF_BY, OFF_BY)
    data = resolve(thought)
    loads = data["board"]["whole"]["power"]["loads_mw"]
    for module in ("mu_asleep", "mu_active", "modem_listening", "pi"):
        loads[module] *= factor
    return from_data(data, thought.name)


def _sown(initial_states: dict[int, Physical]) -> Iterator[StatusPacket]:
    """Reports of the aMussels that the aPad has deployed, and of their places, which it knows."""
    for agent_id, it in initial_states.items():
        charges, place = (
            (fraction(it.primary.charge), fraction(it.secondary.charge)),
            (it.north_um / 1e6, it.east_um / 1e6),
        )
        yield StatusPacket(agent_id, 0, State.SLEEPING, *charges, *place, it.depth_um / 1e6, 0)


class Scoring(MemoryRecorder):
    """Compares the believed charges of the primary batteries with the true ones, once a minute."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self._charge_of = charge_models(scenario)
        self._batteries: dict[int, Battery] = {}
        self._squares: list[float] = []

    @property
    def error(self) -> float:
        """Root mean square, on [0, 1]."""
        return math.sqrt(statistics.mean(self._squares))

    def truths(self, truths: list[Truth]) -> None:
        super().truths(truths)
        self._batteries.update({it.agent_id: it.physical.primary for it in truths})

    def tick(self, now_ms: int, beliefs: list[Belief], *rest: Any) -> None:
        if now_ms % 60_000:
            return
        for it in beliefs:
            charge = self._charge_of(it.agent_id).charge_at(
                self._batteries[it.agent_id], self._scale.agent_ms(MissionMs(now_ms))
            )
            self._squares.append((it.primary - fraction(charge)) ** 2)


def _flown(thought: Scenario, truth: Scenario) -> dict[str, float]:
    initial_states = fleet_parts.initial_states(truth, starts_of(truth))
    host = InProcessHost(fleet_parts.fleet_config(flight_config(truth)), initial_states)
    recorder = Scoring(truth)
    vehicle = InProcessVehicle(parts.simulated_apad(truth))
    fleet = fleet_parts.fleet_of(flight_config(truth), host, dict.fromkeys(initial_states, 0))
    context = FlightContext(vehicle=vehicle, pace=AsFastAsPossible(), fleet=fleet)
    samples = SampleCollection(thought.fleet.ids)
    flight = parts.flight(flight_config(thought), context, recorder, samples=samples)
    for packet in _sown(initial_states):
        flight.supervisor.beliefs.hear(packet, MissionMs(0))
    flight.run()
    figures = uptime_figures(recorder.meter, flight.now_ms)
    kinds = Counter(event.kind for _, event in recorder.journal.entries)
    answers = sum(
        isinstance(MusselbedCodec().decode(bytes.fromhex(packet.data_)), ShortStatus)
        for _, packet in recorder.journal.events(PacketPassed)
    )
    whole = board_config(truth.board, truth.seed).whole
    assert whole is not None
    return {
        "lost": figures["amussels_lost"],
        "emptied": figures["emptied"],
        "uptime": figures["uptime_paper"]["mean"],
        "least_uptime": figures["uptime_paper"]["min"],
        "samples": sum(recorder.taken.values()),
        "error": recorder.error,
        "cost_m": flight.supervisor.mission.state.planned_m,
        "asked": kinds["asked"],
        "answers_sent": answers,
        "unanswered": kinds["unanswered"],
        "answers_charge": answers * answer_charge(whole),
    }


def show(result: dict[str, Any], console: Console) -> None:
    count, hours = result["configurations"], result["mission_s"] / 3600
    table = Table(
        title=f"Asking how they are: {count} configurations of {hours:g} mission hours, 12 aMussels"
    )
    names = ("case", "asking", *FIGURES, "asked", "answers_sent", "unanswered", "answers_charge")
    for name in names:
        table.add_column(name.replace("_", " "), justify="left" if name == "case" else "right")
    for row in result["rows"]:
        table.add_row(*(it if isinstance(it := row[name], str) else f"{it:.4g}" for name in names))
    console.print(table)
    for gain in result["gains"]:
        gains = ", ".join(f"{key} {gain[key][0]:+.3g} +- {gain[key][1]:.2g}" for key in FIGURES)
        console.print(f"{gain['case']}, asking at {gain['asking']:g}: {gains}")
