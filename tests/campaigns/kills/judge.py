"""Judges the records of a run that was killed and resumed. It shares no code with what it judges.

The rules: ids are unique and in order; nothing stands twice in the journal, and nothing is lost without being told;
counts of the summary are those of the lines; energy comes from docks alone; legs are flown as they were ordered; the
run has an end, or says why not.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

from kills.records import Charge, Line, Records

NOT_IN_BAGS = {"truth", "belief", "apad", "tick", "stimulus", "capacity", "resumed"}
BAG_LOSES_MS = 10_000
"""A bag that was never closed may lack so much of its end."""
AT_ONCE = {"truth", "resumed", "restored", "died", "stands_down"}
ONCE = {"dock", "released", "leg", "plan", "given_up", "truth", "end", "run", "stop"}
"""Two equal lines of these kinds tell the same thing twice."""
FULL_GRAINS = 6e14
EXACT, TOLD = 2e-6, 2e-5
"""Rounding of a truth, of 32 bits in a bag, and of a packet's charge."""
EDGE_MS = 3000
"""Mission time between the line of a dock and the contact of the body."""
PACKET_MS = 1500
"""The greatest age of a Wi-Fi report at its tick, in mission time."""
LOSSES = {"battery_loss", "battery_ageing"}
WRONG_READINGS = {"readings_scatter", "readings_stand", "bit_flip", "link_delay", "clock_jump", "clock_skew"}
WELL = {"mission time", "the aPad's battery"}
"""Ends of a mission for which the command has exit code 0."""
TOLD_M = 0.01
REACHED_M = 0.3


Clock = Literal["own", "followed", "virtual"]
"""Mission time: it waits for a supervisor that died; it goes on meanwhile; it passes over ticks at which nothing is due."""


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of the run's last command; `code` is None if nobody waited for it, as after a crash."""

    code: int | None
    said: str
    is_over: bool = True
    """The run must have an end, or say why it has none."""
    clock: Clock = "own"


def judge(found: Records, ending: Ending) -> list[str]:
    """The failures of a run; none if its records are whole and true."""
    failures = [f"cannot be read: {it}" for it in found.unread]
    for rule in (_ids, _order, _bags, _docks, _legs, _plans, _counts, _ways, _energies):
        failures += rule(found)
    if ending.clock != "virtual":
        failures += _seconds(found, ending.clock)
    if ending.is_over:
        failures += _end(found, ending)
    return failures


def _ids(found: Records) -> Iterator[str]:
    begins = found.of_kind("run")
    if len(begins) != 1 or found.lines[0]["kind"] != "run":
        yield f"{len(begins)} lines `run`, and the first line is `{found.lines[0]['kind'] if found.lines else ''}`"
        return
    ids = [it["id"] for it in begins[0]["agents"]]
    served = {*ids, *(it["id"] for it in found.of_kind("took_on"))}
    if len(set(ids)) != len(ids):
        yield f"the fleet has an id twice: {ids}"
    for line in found.lines:
        named = line.get("agent", line.get("id"))
        if named is not None and named not in served:
            yield f"a line `{line['kind']}` is about aMussel {named}, which is not of the fleet"
    numbers = [it["snapshot"]["primitive_id"] or 0 for it in found.of_kind("mission")]
    if fallen := [(a, b) for a, b in pairwise(numbers) if b < a]:
        yield f"the number of an order falls from {fallen[0][0]} to {fallen[0][1]}"
    resumed = len(found.of_kind("resumed"))
    if found.epoch != resumed + 1:
        yield f"{found.epoch} supervisors began, and the journal has {resumed} lines `resumed`"
    stops = Counter((it["number"], it["state"]) for it in found.of_kind("stop"))
    yield from (f"stop {number} is twice `{state}`" for (number, state), count in stops.items() if count > 1)


def _order(found: Records) -> Iterator[str]:
    for before, line in pairwise(found.lines):
        if line["t"] < before["t"]:
            yield f"time falls from {before['t']} to {line['t']} ms at `{line['kind']}`"
    texts = Counter(_text(it) for it in found.lines if it["kind"] in ONCE)
    yield from (f"twice in the journal: {text[:160]}" for text, count in texts.items() if count > 1)
    numbers = Counter((it["id"], it["sequence"]) for it in found.samples)
    yield from (f"sample {it} is kept twice" for it, count in numbers.items() if count > 1)


def _seconds(found: Records, clock: Clock) -> Iterator[str]:
    """Each second of mission time has a line: an event, or a `tick`."""
    have = {math.ceil(it["t"] / 1000) for it in found.lines}
    if clock == "followed":
        for line in found.of_kind("resumed"):
            # These come at once, for the time between.
            later = [it["t"] for it in found.lines if it["kind"] not in AT_ONCE and it["t"] > line["t"]]
            have |= set(range(line["t"] // 1000, min(later, default=line["t"]) // 1000))
    missing = [it for it in range(max(have, default=0)) if it not in have]
    if missing:
        yield f"{len(missing)} seconds of mission time have no line, the first {missing[0]} s"


def _bags(found: Records) -> Iterator[str]:
    """The bags and the journal tell the same events; a bag that was not closed may lack its end.

    The last bag of a run without an end waits for its repair by a resume.
    """
    if found.unclosed and (found.unclosed > 1 or found.of_kind("end")):
        yield f"{found.unclosed} bags were not closed, and nobody repaired them"
    if not found.bags:
        return
    ours = Counter(_text(it) for it in found.lines if it["kind"] not in NOT_IN_BAGS)
    theirs = Counter(_text(it) for it in found.in_bags if it["kind"] not in NOT_IN_BAGS)
    for text in theirs - ours:
        yield f"in a bag, and not in the journal: {text[:160]}"
    cut_ms = [it["t"] for it in found.of_kind("resumed")]
    if not found.of_kind("end"):
        cut_ms.append(found.lines[-1]["t"])
    for text in ours - theirs if not found.unclosed else ():
        at_ms = json.loads(text)["t"]
        if not any(it - BAG_LOSES_MS - 1000 <= at_ms <= it for it in cut_ms):
            yield f"in the journal, and in no bag: {text[:160]}"


def _docks(found: Records) -> Iterator[str]:
    """A dock closes around one aMussel and opens before it closes again, through each resume."""
    held: dict[int, int] = {}
    for line in found.of_kind("dock", "released"):
        agent, dock = line["agent"], line.get("dock", -1)
        if line["kind"] == "released":
            if agent in held.values():
                yield f"aMussel {agent} is released at {line['t']} ms while a dock holds it"
        elif line["closed"]:
            if dock in held or agent in held.values():
                yield f"dock {dock} closes around aMussel {agent} at {line['t']} ms, and holds: {held}"
            held[dock] = agent
        elif held.pop(dock, None) != agent:
            yield f"dock {dock} lets aMussel {agent} go at {line['t']} ms, which it did not hold"


def _legs(found: Records) -> Iterator[str]:
    """Each leg begins where the aPad is, and a go-to that succeeded ends at its goal."""
    if _spans(found, {"apad_lies"}):
        return
    mission, apad = found.scenario["mission"], found.scenario["apad"]
    reach_m = mission["victory_radius_m"] + apad["max_speed_m_s"] + REACHED_M
    goal: tuple[float, float] | None = None
    leg: Line | None = None
    for line in found.of_kind("leg", "primitive", "resumed"):
        if line["kind"] != "primitive":
            leg = line if line["kind"] == "leg" else None
        elif line["name"] == "go to point":
            place = line["north_m"], line["east_m"]
            away_m = math.dist(_place_at(found, line["t"]), place)
            if line["phase"] == "started":
                if leg is not None and abs(away_m - leg["metres"]) > reach_m:
                    yield f"a leg of {leg['metres']} m at {line['t']} ms begins {away_m:.1f} m from its goal"
                goal, leg = place, None
            elif line["phase"] == "succeeded":
                if goal != place:
                    yield f"a go-to is reached at {line['t']} ms that nobody ordered"
                if away_m > reach_m:
                    yield f"a leg was never flown: at {line['t']} ms the aPad is {away_m:.1f} m from its goal"
                goal = None
    if leg is not None and found.lines[-1]["t"] > leg["t"]:
        yield f"the leg at {leg['t']} ms has no order"
    for (a_ms, *a), (b_ms, *b) in pairwise(found.places):
        if (far_m := math.dist(a, b)) > 2 * apad["max_speed_m_s"] * (b_ms - a_ms + 1000) / 1000:
            yield f"the aPad is {far_m:.1f} m further after {b_ms - a_ms} ms, at {b_ms} ms"


def _place_at(found: Records, at_ms: int) -> tuple[float, float]:
    """The aPad's place at that time, or its first one."""
    number = bisect_right(found.places, at_ms, key=lambda it: it[0]) - 1
    return found.places[max(0, number)][1:]


def _plans(found: Records) -> Iterator[str]:
    """Each step of a plan is done, given up or still planned when the next plan is made."""
    left: dict[int, Line] = {}
    for line in found.lines:
        match line["kind"]:
            case "plan":
                yield from (
                    f"aMussel {it} of the plan at {old['t']} ms was forgotten" for it, old in left.items()
                )
                left = {it["agent"]: line for it in line["steps"]}
            case "dock" if line["closed"]:
                left.pop(line["agent"], None)
            case "released" | "given_up":
                left.pop(line["agent"], None)
            case "left_alone" | "beyond_reach":
                left.pop(line["agent"], None)
            case "died" if line["gave_up"]:
                left.pop(line["id"], None)
            case "override" | "handed_on" | "stuck" | "stands_down" | "end":
                left = {}


def _counts(found: Records) -> Iterator[str]:
    summary, begin = found.summary, found.lines[0]
    if summary is None or begin["kind"] != "run":
        return
    full = Counter(it["agent"] for it in found.of_kind("released") if it["full"])
    counted = {
        "services": full.total(),
        "agents": len(begin["agents"]),
        "steps_given_up": len(found.of_kind("given_up")),
        "gave_up": sum(it["gave_up"] is not None for it in found.of_kind("died")),
    }
    if found.samples or summary["samples_uploaded"]:
        counted["samples_uploaded"] = len(found.samples)
    for name, count in counted.items():
        if summary[name] != count:
            yield f"the summary has {name} {summary[name]}, and the journal {count}"
    for number, figures in summary["amussels"].items():
        if figures["services"] != full[int(number)]:
            yield f"the summary has {figures['services']} services of aMussel {number}, and the journal {full[int(number)]}"
        if not 0 <= figures["final_charge"] <= 1:
            yield f"aMussel {number} ends with the charge {figures['final_charge']}"
        last = found.charges.get(int(number), [])[-1:]
        if (
            last
            and abs(last[0].primary - figures["final_charge"]) > TOLD
            and found.lines[-1]["kind"] == "end"
        ):
            yield f"aMussel {number} ends with {figures['final_charge']:.6f}, and {last[0].primary:.6f} in the bag"
    heard = sum(len(it["heard"]) for it in found.of_kind("packet") if it["unsent"] is None)
    if not found.of_kind("resumed") and found.bags and found.sounds != heard:
        yield f"{heard} listeners of packets in the journal, and {found.sounds} in the bags"


def _ways(found: Records) -> Iterator[str]:
    """The planned way is the sum of the legs, less the rest of those that failed; the cost is the way driven on them."""
    if found.summary is None:
        return
    legs_m = sum(it["metres"] for it in found.of_kind("leg"))
    planned_m, most_m = found.summary["planned_m"], legs_m + TOLD_M
    if not legs_m - _cut_m(found) - TOLD_M <= planned_m <= most_m:
        yield f"the summary's planned way is {planned_m:.2f} m, and the legs have {legs_m:.2f} m"
    if _spans(found, {"apad_lies"}):
        return
    low_m, high_m = _driven_m(found)
    if not low_m - 1 <= found.summary["cost_m"] <= high_m + 1:
        yield f"the summary's cost is {found.summary['cost_m']:.1f} m, and {low_m:.1f} to {high_m:.1f} m were driven"


def _cut_m(found: Records) -> float:
    """The metres of the legs that did not come to their goal."""
    cut_m = under_way_m = 0.0
    for line in found.of_kind("leg", "primitive"):
        if line["kind"] == "leg":
            cut_m, under_way_m = cut_m + under_way_m, line["metres"]
        elif line["name"] == "go to point" and line["phase"] == "succeeded":
            under_way_m = 0.0
    return cut_m + under_way_m


def _driven_m(found: Records) -> tuple[float, float]:
    """Bounds of the way on go-tos: each begins and ends somewhere between two of the aPad's places."""
    low_m = high_m = 0.0
    begin_ms: int | None = None
    for line in [*found.of_kind("primitive"), {"t": found.lines[-1]["t"], "name": "", "phase": "started"}]:
        is_start, is_go_to = line["phase"] == "started", line["name"] == "go to point"
        if begin_ms is not None and (is_start or is_go_to) and line["t"] >= begin_ms:
            first = max(0, bisect_right(found.places, begin_ms, key=lambda it: it[0]) - 1)
            last = bisect_right(found.places, line["t"], key=lambda it: it[0])
            chords = [math.dist(a[1:], b[1:]) for a, b in pairwise(found.places[first : last + 1])]
            low_m, high_m, begin_ms = low_m + sum(chords[1:-2]), high_m + sum(chords), None
        if is_start and is_go_to:
            begin_ms = line["t"]
    return low_m, high_m


@dataclass(frozen=True, slots=True)
class Rates:
    """Bounds of the change of what both batteries hold, in batteries an agent minute."""

    least_drain: float
    most_drain: float
    most_charge: float


def _rates(scenario: dict[str, Any]) -> Rates:
    board = scenario["board"]
    if board["whole"] is None:
        drain = board["discharge_per_min"]
        return Rates(drain, drain, max(it[1] for it in board["charge_segments"]))
    power = board["whole"]["power"]
    most = sum(power["loads_mw"].values()) / power["capacity_wh"] / 60_000
    return Rates(0.0, most, 2 * power["two_coils"] * max(it[1] for it in power["charge_segments"]))


def _energies(found: Records) -> Iterator[str]:
    """Each aMussel's charge: by the bags' truths, by the journal's, and by its packets as the supervisor believed them."""
    rates, theta, spread = _rates(found.scenario), found.scenario["theta"], found.scenario["fleet"]["spread"]
    if any(spread.values()) or found.scenario["board"]["motor_run_charge"]:
        return
    docked = _docked_spans(found)
    lossy, misread = _spans(found, LOSSES), _spans(found, WRONG_READINGS)
    truths, told = _journal_charges(found, theta)
    untrue = _untrue_spans(found, theta)
    for agent, charges in found.charges.items():
        charges = [it for it in charges if not _touches(untrue[agent], it.agent_ms, it.agent_ms)]
        yield from _energy(agent, "the bag", charges, rates, theta, docked[agent], lossy[agent], EXACT)
    for agent, charges in truths.items():
        yield from _energy(agent, "the journal", charges, rates, theta, docked[agent], lossy[agent], EXACT)
    if found.scenario["beliefs"]["estimator"] != "hold_last":
        return
    late = PACKET_MS * theta / 60_000 * max(rates.most_drain, rates.most_charge) + TOLD
    for agent, charges in told.items():
        kept = [
            it
            for it in charges
            if not _touches(misread[agent], it.agent_ms / theta - 60_000, it.agent_ms / theta + 60_000)
        ]
        yield from _energy(agent, "packets", kept, rates, theta, docked[agent], lossy[agent], late)


def _journal_charges(found: Records, theta: int) -> tuple[dict[int, list[Charge]], dict[int, list[Charge]]]:
    """Charges by the anchors of lines `truth`, and by the packets that lines `belief` state."""
    truths: dict[int, list[Charge]] = defaultdict(list)
    told: dict[int, list[Charge]] = defaultdict(list)
    for line in found.of_kind("truth", "belief"):
        if line["kind"] == "belief":
            at_ms, charge = line["heard"] * theta, line["charge"]
            if not told[line["id"]] or told[line["id"]][-1].agent_ms < at_ms:
                told[line["id"]].append(Charge(at_ms, charge + line["secondary"], charge, False))
        elif line["primary"][0] == line["secondary"][0] or not line["secondary"][2]:
            primary, secondary = line["primary"][1] / FULL_GRAINS, line["secondary"][1] / FULL_GRAINS
            truths[line["id"]].append(
                Charge(line["primary"][0], primary + secondary, primary, line["docked"])
            )
    return truths, told


def _energy(
    agent: int,
    source: str,
    charges: list[Charge],
    rates: Rates,
    theta: int,
    docked: list[tuple[float, float]],
    lossy: list[tuple[float, float]],
    error: float,
) -> Iterator[str]:
    for before, now in pairwise(charges):
        minutes = (now.agent_ms - before.agent_ms) / 60_000
        begin_ms, end_ms = before.agent_ms / theta - EDGE_MS, now.agent_ms / theta + EDGE_MS
        change, is_docked = (
            now.held - before.held,
            before.docked or now.docked or _touches(docked, begin_ms, end_ms),
        )
        is_empty = min(before.primary, now.primary) <= error
        most = minutes * rates.most_charge if is_docked else 0.0 if is_empty else -minutes * rates.least_drain
        least = -minutes * rates.most_drain
        where = (
            f"aMussel {agent} by {source}: {change:+.6f} in {minutes:.2f} min of its time, {now.agent_ms} ms"
        )
        if change > most + error:
            yield f"energy from nowhere: {where}, at most {most:+.6f}{'' if is_docked else ' in no dock'}"
        if change < least - error and not _touches(lossy, begin_ms, end_ms):
            yield f"energy is lost: {where}, at least {least:+.6f}"


def _untrue_spans(found: Records, theta: int) -> dict[int, list[tuple[float, float]]]:
    """Spans of agent ms from a death to the tick at which it became known: the bag shows a life that ended."""
    spans: dict[int, list[tuple[float, float]]] = defaultdict(list)
    for line in found.of_kind("died"):
        spans[line["id"]].append((line["agent_ms"], line["t"] * theta - 1))
    return spans


def _docked_spans(found: Records) -> dict[int, list[tuple[float, float]]]:
    """Spans of mission ms in which a dock holds each aMussel, by the journal's lines."""
    spans: dict[int, list[tuple[float, float]]] = defaultdict(list)
    for line in found.of_kind("dock"):
        if line["closed"]:
            spans[line["agent"]].append((line["t"], math.inf))
        elif spans[line["agent"]]:
            spans[line["agent"]][-1] = (spans[line["agent"]][-1][0], line["t"])
    return spans


def _spans(found: Records, faults: set[str]) -> dict[int | None, list[tuple[float, float]]]:
    """Spans of mission ms in which one of these faults lasts, by aMussel; None is the aPad."""
    spans: dict[int | None, list[tuple[float, float]]] = defaultdict(list)
    for line in found.faults:
        if line["fault"] in faults and "refused" not in line:
            spans[line.get("id")].append((line["t"], line["until_ms"]))
    return spans


def _touches(spans: list[tuple[float, float]], begin_ms: float, end_ms: float) -> bool:
    return any(begin <= end_ms and begin_ms <= end for begin, end in spans)


def _end(found: Records, ending: Ending) -> Iterator[str]:
    ends, summary = found.of_kind("end"), found.summary
    if len(ends) > 1 or (ends and found.lines[-1]["kind"] != "end"):
        yield f"{len(ends)} ends, and the last line is `{found.lines[-1]['kind']}`"
    if bool(ends) != (summary is not None):
        yield f"{len(ends)} ends in the journal, and {'no' if summary is None else 'a'} summary"
    if ends and summary is not None:
        if summary["end_reason"] != ends[0]["end_reason"] or 1000 * summary["mission_s"] != ends[0]["t"]:
            told = f"{summary['end_reason']} at {summary['mission_s']} s"
            yield f"the journal ends with {ends[0]}, and the summary tells {told}"
        if ending.code == 0 and ends[0]["end_reason"] not in WELL:
            yield f"exit code 0, and the mission ended by {ends[0]['end_reason']}"
    if ending.code not in (None, 0, 3, 130):
        yield f"exit code {ending.code}"
    if not ends and not ending.said.strip():
        yield "the run has no end, and nobody said why"


def _text(line: Line) -> str:
    return json.dumps(line, sort_keys=True)
