"""Builds a supervisor's start state; for one that resumes a run, from the journal and the checkpoint."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from agents.coordinator import Coordinator
from agents.mussel.stimuli import AgentStimulus, ContactClosed, ContactOpened, Placed, from_json
from agents.time_scale import TICK_MS, AgentMs, MissionMs
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.capacity_bounds import battery_worth_min
from apad_bridge.assembly.flight_config import FlightConfig
from apad_bridge.events.fleet_events import (
    HandedOn,
    Presence,
    Stimulated,
    TookOn,
)
from apad_bridge.events.run_events import KnowledgeRestored, RunResumed
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.records.checkpoint import NoCheckpoint, restore
from apad_bridge.records.journal import JournalContents, read_journal
from apad_bridge.records.recorder import Recorder, Resumed
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.run_state import RunState
from apad_bridge.runs.flying import journal_start
from apad_bridge.scenario.loader import with_values
from apad_bridge.scenario.run_options import BenchPart, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.timed_faults import injection
from apad_bridge.supervisor.run_spec import ResumePoint
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.vehicle.link_errors import PeerFailed
from apad_bridge.world.fault_injection import Ongoing
from apad_bridge.world.roster import Presences

_LARGE_BYTES = 100_000_000
"""Size of bags; the repair of a gigabyte takes about ten seconds."""


def gap_ms(options: RunOptions, journal: Path, now_s: float) -> int:
    """Mission time that passed without a supervisor, to be granted to the fleet at once; `now_s` is since the Unix epoch.

    A real vehicle's time continued for as long as the journal, which every tick writes to, did not change. On a master
    of our own, /clock stopped with the supervisor.
    """
    return 0 if options.owns_master else max(0, round((now_s - journal.stat().st_mtime) * 1000))


def granted_before_ms(journal: JournalContents) -> int:
    """The part of the last grant that the journal's lines have not come to: its supervisor died before its first tick."""
    until_ms = [at_ms + (it.granted_ms or 0) for at_ms, it in journal.events(RunResumed)]
    return max(0, max(until_ms, default=0) - journal.last_ms)


def find_resume_point(state: RunState, epoch: int, gap_ms: int) -> ResumePoint:
    """The mission's newest state, and the time with the gap granted; PeerFailed when the run has ended."""
    if state.ended_by is not None:
        raise PeerFailed("this run has ended: nothing to resume")
    return ResumePoint(
        # The journal's last line may lie between two ticks.
        now_ms=MissionMs((state.last_ms + gap_ms) // TICK_MS * TICK_MS),
        state=state.mission,
        epoch=epoch,
        apad_fraction_at_start=state.battery_at_start,
        first_failure=state.first_failure,
        stops=state.stops,
        steering=state.steering,
    )


def with_apad_as_seen(scenario: Scenario, seen: APadMoved | None) -> Scenario | None:
    """The scenario of a simulated aPad that begins where ours was seen last, with its battery; None when it was never seen.

    It has no fence, because the aPad may have been seen beyond it; the supervisor's own scenario keeps the fence.
    """
    if seen is None:
        return None
    start = scenario.apad.battery.start_fraction
    values = {
        "area.fence": None,
        "area.keep_out": (),
        "area.home_m": flight_parts.home_of(scenario),
        "apad.start_m": (seen.north_m, seen.east_m),
        "apad.battery.start_fraction": start if seen.battery is None else seen.battery,
    }
    return with_values(scenario, values, scenario.name)


def ongoing_faults(state: RunState) -> list[Ongoing]:
    """The faults that had begun and not ended, in the order in which they began."""
    return [
        Ongoing(injection(it.fault, it.id, it.value, (it.until_ms - at_ms) / 1000), it.until_ms)
        for at_ms, it in state.faults
        if it.until_ms is not None
    ]


def undelivered(journal: JournalContents, granted_ms: Mapping[int, int]) -> list[Undelivered]:
    """The journal's stimuli that had not reached their aMussels when the supervisor died, in the journal's order.

    A stimulus is journaled in the tick that queues it, and delivered in the next window of its aMussel. So an aMussel
    that has lived to `granted_ms`, in agent time, has received all with an earlier stamp.
    """
    return [
        Undelivered(it.id, it.agent_ms, from_json(it.wire))
        for _, it in journal.events(Stimulated)
        if it.agent_ms >= granted_ms.get(it.id, it.agent_ms + 1)
    ]


@dataclass(frozen=True, slots=True)
class Undelivered:
    """A journaled stimulus that its aMussel has not received; `agent_ms` is its stamp in agent time."""

    agent_id: int
    agent_ms: int
    stimulus: AgentStimulus


@dataclass(frozen=True, slots=True)
class StartState:
    """The state in which a supervisor starts: empty for the first of a run, else the state that the former one left."""

    recorder: Recorder
    presences: Presences
    learned: LearnedState
    resume_point: ResumePoint | None = None
    journal: JournalContents = field(default_factory=lambda: JournalContents([], 0))
    undelivered: Sequence[Undelivered] = ()
    """The former supervisor's stimuli that `deliver_again` has queued once more."""

    def deliver_again(self, coordinator: Coordinator) -> StartState:
        """Queues the stimuli that the fleet has not received, at their own times: the journal has their lines already."""
        waiting = undelivered(self.journal, coordinator.granted_ms)
        for it in waiting:
            coordinator.receive_at(it.agent_id, it.stimulus, AgentMs(it.agent_ms))
        return replace(self, undelivered=tuple(waiting))

    @property
    def held(self) -> tuple[int, ...]:
        """The aMussels whose bodies feel a dock.

        The bodies' state counts, not the mission's: a contact that only the mission knows of is delivered again, and one
        that a body has felt, or that waits for it, is not. The bodies of other fleets are not known here.
        """
        felt = {it.agent_id for it in self.recorder.truths_at(self.start_ms) if it.docked}
        for it in self.undelivered:
            match it.stimulus:
                case ContactClosed():
                    felt.add(it.agent_id)
                case ContactOpened() | Placed():
                    felt.discard(it.agent_id)
        docked = () if self.resume_point is None else self.resume_point.state.docked
        others = self.learned.allocation.served_for_others & {agent_id for _, agent_id in docked}
        return tuple(sorted(felt)) + tuple(sorted(others))

    @property
    def start_ms(self) -> MissionMs:
        return MissionMs(0) if self.resume_point is None else self.resume_point.now_ms


def begin_run(
    directory: RunDirectory,
    config: FlightConfig,
    options: RunOptions,
    stamp_ms: Callable[[int], int] = int,
) -> StartState:
    """Starts a new run and its journal; `stamp_ms` is the recorder's."""
    scenario, ids = config.scenario, config.ids
    recorder = Recorder(directory, scenario, ids, stamp_ms, battery_min=battery_worth_min(scenario))
    journal_start(recorder, scenario, starts_of(scenario))
    return StartState(recorder, Presences(ids, scenario.area.depth_m), _nothing_learned(config, options))


def resume_run(
    directory: RunDirectory,
    config: FlightConfig,
    options: RunOptions,
    report: Callable[[str], None],
    stamp_ms: Callable[[int], int] = int,
    others_ms: int | None = None,
) -> StartState:
    """Resumes a run whose supervisor died; `report` takes lines for a person on the state that is restored or lost.

    `others_ms` is the mission time that the other flights in the same sea have come to, if there are any. PeerFailed when
    the run has ended.
    """
    without_supervisor_ms = gap_ms(options, directory.journal, time.time())
    scenario, ids = config.scenario, config.ids
    if sum(path.stat().st_size for path in directory.bags) > _LARGE_BYTES:
        report("reading the records of a long run: this takes some seconds")

    def granted_ms(journal: JournalContents) -> int:
        if others_ms is not None:
            return max(0, others_ms - journal.last_ms)
        if options.owns_master:
            return 0
        # The clock that several aPads follow may be faster than the wall's.
        siblings_ms = newest_of_siblings_ms(directory, scenario.apad.name, options.apads)
        return max(granted_before_ms(journal) + without_supervisor_ms, siblings_ms - journal.last_ms)

    recorder, resumed = Recorder.resume(
        directory, scenario, ids, stamp_ms, granted_ms, battery_worth_min(scenario)
    )
    start = find_resume_point(recorder.state, options.epoch, resumed.granted_ms)
    presences = Presences(ids, scenario.area.depth_m, recorder.state.presences.values())
    learned = _nothing_learned(config, options)
    beliefs_line, dropped = restore_learned(directory.checkpoint, learned, start.now_ms)
    if dropped is not None:
        recorder.dropped_before = dropped
    restore_allocation(learned, recorder.state.handovers)
    stop_lines = filter(None, [start.stops.text()])
    lines = [*stop_lines, *loss_lines(resumed, dropped), *presence_lines(presences), beliefs_line]
    for line in lines:
        report(line)
    recorder.event(resumed.journal.last_ms, KnowledgeRestored(lines))
    return StartState(recorder, presences, learned, start, resumed.journal)


def newest_of_siblings_ms(directory: RunDirectory, name: str, apads: Iterable[str]) -> int:
    """The mission time to which the journals of the run's other aPads have come; 0 where there are none."""
    siblings = [RunDirectory(directory.path.with_name(it)).journal for it in apads if it != name]
    return max((read_journal(it).last_ms for it in siblings if it.exists()), default=0)


def restore_allocation(learned: LearnedState, handovers: Iterable[TookOn | HandedOn]) -> None:
    """Restores the aMussels that the former supervisor of the run served."""
    for it in handovers:
        change = learned.allocation.take if isinstance(it, TookOn) else learned.allocation.give
        change(it.id)
    for agent_id in learned.allocation.served_for_others:
        learned.beliefs.admit(agent_id, None)


def presence_lines(presences: Presences) -> list[str]:
    """Lines for a person on the restored aMussels that are real or retired."""
    lines = []
    for presence in (Presence.REAL, Presence.RETIRED):
        ids = sorted(it.agent_id for it in presences.before.values() if it.presence is presence)
        if ids:
            lines.append(f"still {presence}: aMussel {', '.join(map(str, ids))}")
    return lines


def _nothing_learned(config: FlightConfig, options: RunOptions) -> LearnedState:
    # The aPad's modem is simulated with the water, and so with the fleet. A mission alone has none.
    return flight_parts.initial_learned_state(config, has_modem=options.part is not BenchPart.MISSION)


def restore_learned(
    checkpoint: Path, learned: LearnedState, now_ms: MissionMs
) -> tuple[str, Counter[str] | None]:
    """Restores the former supervisor's learned state into `learned`.

    Returns a line for a person on the result as of `now_ms`, and the former supervisor's counts of dropped items by
    reason; None when these are not known.
    """
    try:
        restored = restore(checkpoint, learned.beliefs, learned.ranging)
    except NoCheckpoint as reason:
        return f"no beliefs until the aMussels report again: {reason}", None
    if not (believed := learned.beliefs.all()):
        return "no aMussel had reported yet", restored.counts
    oldest_s = max(it.age_s(now_ms) for it in believed)
    line = (
        f"believed as before: {len(believed)} aMussels, as of {restored.until_ms / 1000:g} s of mission time; "
        f"the longest silence is {max(0.0, oldest_s):g} s now"
    )
    if not restored.whole:
        line += f". What was learned after {restored.until_ms / 1000:g} s is lost: {checkpoint.name} is torn there"
    return line, restored.counts


def loss_lines(resumed: Resumed, dropped: Counter[str] | None) -> list[str]:
    """Lines for a person, one for each kind of data that the crash lost."""
    counts = " and the counts of dropped input" if dropped is None else ""
    lost = [f"Messages in transit{counts} were lost."]
    if resumed.journal.dropped or resumed.journal_torn_bytes:
        lost.append(f"the journal's last line was torn: {resumed.journal_torn_bytes} bytes of it are lost")
    if resumed.bag is not None:
        lost.append(f"{resumed.bag} was repaired; {resumed.bag_lost_ms / 1000:g} s of samples are lost")
    return lost
