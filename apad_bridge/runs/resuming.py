"""What a supervisor begins with, above all one that goes on with a run: what the journal and the notebook say to it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from agents.coordinator import Coordinator
from agents.mussel.stimuli import Placed, from_wire, to_wire
from apad_bridge.assembly import parts
from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.mission.state import MissionState
from apad_bridge.records.checkpoint import NoCheckpoint, restore
from apad_bridge.records.journal import JournalContents, Line
from apad_bridge.records.recorder import Recorder, Resumed
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import ResumePoint, journal_start
from apad_bridge.scenario.run_options import Part, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.context import LearnedState
from apad_bridge.supervisor.core import PRIMITIVE_NAMES
from apad_bridge.supervisor.roster import Became, Presence, Presences
from apad_bridge.vehicle.docking import PRE_EMPTED
from apad_bridge.vehicle.errors import PeerFailed
from apad_bridge.vehicle.primitives import HoldPosition, PrimitiveFailed

_PLACED = to_wire(Placed(0, 0, 0, 0, 0))[0]
_LARGE_BYTES = 100_000_000
"""Of bags; a gigabyte is repaired in about ten seconds."""


def gap_ms(options: RunOptions, journal: Path, now_s: float) -> int:
    """Mission time that went by without a supervisor, to be granted to the fleet at once; `now_s` is since the epoch.

    A real vehicle's time went on, for as long as the journal, which every tick writes to, has stood still. On a master of
    our own /clock stood still with the supervisor.
    """
    if options.owns_master:
        return 0
    return max(0, round((now_s - journal.stat().st_mtime) * 1000))


def resume_point(journal: JournalContents, epoch: int, gap_ms: int) -> ResumePoint:
    """The newest mission snapshot, and the time with the gap granted; PeerFailed when the run has ended."""
    state, fraction = MissionState(), None
    for line in journal.lines:
        if line["kind"] == "mission":
            state = MissionState.from_json(line["snapshot"])
        elif line["kind"] == "dock":
            held = {
                dock_index: agent_id for dock_index, agent_id in state.docked if dock_index != line["dock"]
            }
            if line["closed"]:
                held[line["dock"]] = line["agent"]
            state = replace(state, docked=tuple(sorted(held.items())))
        elif line["kind"] == "apad" and fraction is None:
            fraction = line["battery"]
        elif line["kind"] == "end":
            raise PeerFailed("this run has ended: there is nothing to go on with")
    # Ticks stand on whole seconds; the journal's last line may lie between two.
    now_ms = (journal.last_ms + gap_ms) // 1000 * 1000
    return ResumePoint(now_ms, state, epoch, fraction, first_failure(journal))


def first_failure(journal: JournalContents) -> PrimitiveFailed | None:
    """What a port has latched that did what the journal says. Which primitive's it was is not kept: its id is 0."""
    latched: PrimitiveFailed | None = None
    for line in journal.lines:
        if line["kind"] != "primitive":
            continue
        if line["phase"] == "succeeded" and line["name"] != PRIMITIVE_NAMES[HoldPosition]:
            latched = None
        elif line["phase"] == "failed" and line["reason"] != PRE_EMPTED and latched is None:
            latched = PrimitiveFailed(line["t"], 0, line["reason"])
    return latched


def became(journal: JournalContents) -> Iterator[Became]:
    """Who became real, retired or simulated again, in the order in which it happened."""
    for line in journal.lines:
        if line["kind"] == "presence":
            yield Became(line["t"], line["id"], Presence(line["is"]), line["by"])


def place_again(journal: JournalContents, coordinator: Coordinator, recorder: Recorder, now_ms: int) -> None:
    """Puts those where they were put whose bodies had not felt it when the supervisor died."""
    lived_ms = coordinator.granted_ms
    placed = {line["id"]: line for line in journal.lines if _is_placing(line)}
    for agent_id, line in placed.items():
        if line["agent_ms"] >= lived_ms.get(agent_id, line["agent_ms"] + 1):
            agent_ms = coordinator.receive(agent_id, from_wire(line["wire"]), now_ms)
            recorder.event(now_ms, "stimulus", id=agent_id, agent_ms=agent_ms, wire=line["wire"])


def _is_placing(line: Line) -> bool:
    return bool(line["kind"] == "stimulus" and line["wire"][0] == _PLACED)


@dataclass(frozen=True, slots=True)
class StartState:
    """What a supervisor begins with: the first of a run with nothing, a later one with what the former one left."""

    recorder: Recorder
    presences: Presences
    known: LearnedState
    resume_point: ResumePoint | None = None
    journal: JournalContents = field(default_factory=lambda: JournalContents([], 0))

    @property
    def beliefs(self) -> FleetBeliefs:
        return self.known.beliefs

    @property
    def start_ms(self) -> int:
        return 0 if self.resume_point is None else self.resume_point.now_ms


def begin(directory: RunDirectory, scenario: Scenario, options: RunOptions) -> StartState:
    """A new run, its journal begun."""
    ids = parts.agent_ids(scenario)
    recorder = Recorder(directory, scenario, ids)
    journal_start(recorder, scenario, starts_of(scenario))
    return StartState(recorder, Presences(ids, scenario.area.depth_m), _nothing_known(scenario, options))


def resume(
    directory: RunDirectory, scenario: Scenario, options: RunOptions, tell: Callable[[str], None]
) -> StartState:
    """Takes up a run whose supervisor died; `tell` is told, in lines for a person, what is restored and what is not.

    PeerFailed when the run has ended.
    """
    gone_ms = gap_ms(options, directory.journal, time.time())
    ids = parts.agent_ids(scenario)
    if sum(path.stat().st_size for path in directory.bags) > _LARGE_BYTES:
        tell("reading the records of a long run: this takes some seconds")
    recorder, resumed = Recorder.resume(directory, scenario, ids)
    start = resume_point(resumed.journal, options.epoch, gone_ms)
    presences = Presences(ids, scenario.area.depth_m, became(resumed.journal))
    known = _nothing_known(scenario, options)
    believed, dropped = known_again(directory.checkpoint, known, start.now_ms)
    if dropped is not None:
        recorder.dropped_before = dropped
    lines = [*what_was_lost(resumed, dropped), *who_was_who(presences), believed]
    for words in lines:
        tell(words)
    recorder.event(resumed.journal.last_ms, "restored", told=lines)
    return StartState(recorder, presences, known, start, resumed.journal)


def who_was_who(presences: Presences) -> list[str]:
    """A line for a person for what is restored of who was real, and who retired."""
    lines = []
    for presence in (Presence.REAL, Presence.RETIRED):
        those = sorted(it.agent_id for it in presences.before.values() if it.presence is presence)
        if those:
            lines.append(f"still {presence}: aMussel {', '.join(map(str, those))}")
    return lines


def _nothing_known(scenario: Scenario, options: RunOptions) -> LearnedState:
    # The aPad's modem is where its water is: with the fleet, and not with a mission alone.
    return parts.nothing_known(scenario, has_modem=options.part is not Part.MISSION)


def known_again(checkpoint: Path, known: LearnedState, now_ms: int) -> tuple[str, Counter[str] | None]:
    """Lets `known` be what the former supervisor's was; a line for a person on what came of it by `now_ms`.

    And what it had counted as dropped, by reason; None when that is not known.
    """
    try:
        restored = restore(checkpoint, known.beliefs, known.ranging)
    except NoCheckpoint as reason:
        return f"nothing is believed of an aMussel until it is heard again: {reason}", None
    believed = known.beliefs.all()
    if not believed:
        return "nothing had been heard of any aMussel yet", restored.counts
    oldest_s = max(it.age_s(now_ms) for it in believed)
    line = (
        f"believed as before: {len(believed)} aMussels, as of {restored.until_ms / 1000:g} s of mission time; "
        f"the longest silence is {max(0.0, oldest_s):g} s now"
    )
    if not restored.whole:
        line += f". What was learned after {restored.until_ms / 1000:g} s is lost: {checkpoint.name} is torn there"
    return line, restored.counts


def what_was_lost(resumed: Resumed, dropped: Counter[str] | None) -> list[str]:
    """Lines for a person, one for each thing that the crash took."""
    lost = ["lost: words on their way"]
    if dropped is None:
        lost[0] += ", and the counts of what was dropped so far"
    if resumed.journal.dropped or resumed.journal_torn_bytes:
        lost.append(f"the journal's last line was torn: {resumed.journal_torn_bytes} bytes of it are lost")
    if resumed.bag is not None:
        lost.append(f"{resumed.bag} was repaired; {resumed.bag_lost_ms / 1000:g} s of samples are lost")
    return lost
