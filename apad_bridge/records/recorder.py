"""Writes all records of a flight: journal, bag, checkpoint, uploaded samples, ends and summary."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from contextlib import closing
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar, cast

from agents.mussel.outputs import Truth
from agents.time_scale import AgentMs, MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.event import Event
from apad_bridge.events.run_events import EndReason, RunResumed, TickPassed
from apad_bridge.events.sound_events import PacketPassed
from apad_bridge.mission.facts import PlacedSample, SampleSource
from apad_bridge.records.bag import BagWriter, repair_bag
from apad_bridge.records.changes import (
    Changes,
    differs_in_kind,
    has_moved,
)
from apad_bridge.records.checkpoint import Checkpoint
from apad_bridge.records.digest import RunDigest
from apad_bridge.records.journal import Journal, JournalContents, JournalDamaged, read_journal
from apad_bridge.records.line_file import FileGone
from apad_bridge.records.packet_lines import sound_rows
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.run_state import RunState
from apad_bridge.records.sample_file import SAMPLE_KEYS, SampleFile, sample_figures
from apad_bridge.records.samples import TruthExtrapolator, TruthSample, apad_sample, belief_sample
from apad_bridge.records.summary import Ending, RunAtEnd, apad_energy, summary_of
from apad_bridge.records.truth_lines import truth_event
from apad_bridge.records.uptime_figures import amussel_figures, uptime_figures
from apad_bridge.scenario.firmware_config import takes_samples
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import save_starts
from apad_bridge.scenario.starts_table import Start
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from apad_bridge.vehicle.link_errors import PeerFailed

DAY_MS = 86_400_000


class RecordsFailed(PeerFailed):
    """The records can take no more: the disk refuses, or their directory is gone. `reason` is the mission's end."""

    def __init__(self, text: str, reason: EndReason) -> None:
        super().__init__(text)
        self.reason = reason


_Write = TypeVar("_Write", bound=Callable[..., None])


def _on_disk(write: _Write) -> _Write:
    """Makes an OSError of a recorder's method a RecordsFailed. After the first one such methods do nothing."""

    @wraps(write)
    def written(recorder: Recorder, *arguments: Any, **named: Any) -> None:
        if recorder.has_failed:
            return
        try:
            write(recorder, *arguments, **named)
        except OSError as error:
            raise recorder.fail(error) from error

    return cast(_Write, written)


@dataclass(frozen=True, slots=True)
class Resumed:
    """The records of the run that is resumed, and the losses in them."""

    journal: JournalContents
    journal_torn_bytes: int
    bag: str | None
    """The name of the bag that was never closed, if there was one."""
    bag_lost_ms: int
    """The time from that bag's last saved sample to the journal's last line."""
    granted_ms: int
    """The time from that line to the moment at which the run continues."""


class Recorder:
    """The one object that writes a flight's records.

    Without any call of `truths` there are no uptimes, and summary.json gives the reason. Lines and samples reach the files
    at the end of each `tick`. `finish` writes the ends and the summary and closes the files; `close` alone leaves a valid
    bag and a journal without an end. RecordsFailed, once, when the disk takes no more.
    """

    def __init__(
        self,
        directory: RunDirectory,
        scenario: Scenario,
        agent_ids: Iterable[int],
        stamp_ms: Callable[[int], int] = int,
        resumed_ms: int = 0,
        battery_min: float | None = None,
    ) -> None:
        """`stamp_ms` returns the stamp of a bag's message about a mission time; by default the same.

        `resumed_ms` is the newest mission time of the records that it continues; 0 for a new run. `battery_min` is that of
        `uptime_figures`.
        """
        self.dropped: Counter[str] = Counter()
        self.dropped_before: Counter[str] = Counter()
        """The counts of this run's former supervisors, as far as they are known."""
        self._dropped_in_flight: Callable[[], Counter[str]] = Counter
        self._directory = directory
        self.has_failed = False
        self._scenario, self._scale = scenario, scenario.time_scale
        self._battery_min = battery_min
        self._agent_ids = frozenset(agent_ids)
        self._water = TruthExtrapolator(scenario)
        self.state = RunState(scenario)
        """The state by the events in the journal."""
        self._newest: dict[int, Truth] = {}
        self._beliefs: Sequence[Belief] = ()
        self._digest = RunDigest()
        self._changes = Changes()
        self._sampled_ms: int | None = None
        self._record_period_ms = round(scenario.records.record_period_s * 1000)
        self._checkpoint: Checkpoint | None = None
        self._journal = Journal(directory.journal, resumed_ms)
        self._bag = BagWriter(directory.next_bag, self._scale, stamp_ms)
        self._samples = SampleFile(directory.samples, self._scale)

    @classmethod
    def resume(
        cls,
        directory: RunDirectory,
        scenario: Scenario,
        agent_ids: Iterable[int],
        stamp_ms: Callable[[int], int] = int,
        granted_ms: Callable[[JournalContents], int] = lambda journal: 0,
        battery_min: float | None = None,
    ) -> tuple[Recorder, Resumed]:
        """Continues the records of a run whose supervisor died: repairs its bag, begins another, and rebuilds the uptimes.

        `granted_ms` returns the time from the journal's last line to the moment at which the run continues. It and the
        losses are in the result and in the journal's line `resumed`. JournalDamaged when the journal cannot be read.
        """
        contents = read_journal(directory.journal)
        granted = granted_ms(contents)
        bags = directory.bags
        repair = repair_bag(bags[-1]) if bags else None
        # A bag whose supervisor died at once has no sample: it lacks those since that supervisor began.
        begun_ms = max((at_ms for at_ms, _ in contents.events(RunResumed)), default=0)
        lost_ms = 0 if repair is None else max(0, contents.last_ms - max(repair["last_ms"], begun_ms))
        # The line comes before the next bag, so that each bag after the first has one.
        with closing(Journal(directory.journal, contents.last_ms)) as journal:
            event = RunResumed(contents.dropped, journal.torn_bytes, repair, lost_ms, granted or None)
            journal.append(contents.last_ms, event)
        recorder = cls(directory, scenario, agent_ids, stamp_ms, contents.last_ms, battery_min)
        try:
            recorder._replay(contents)
        except ValueError as error:
            recorder.close()
            raise JournalDamaged(
                f"{directory.journal}: two of its lines contradict each other: {error}"
            ) from error
        recorder._note(contents.last_ms, event)
        name = None if repair is None else repair["name"]
        return recorder, Resumed(contents, event.journal_torn_bytes, name, lost_ms, granted)

    @_on_disk
    def event(self, at_ms: MissionMs, event: Event) -> None:
        """Records an event at mission time `at_ms`."""
        self._journal.append(at_ms, event)
        self._note(at_ms, event)

    def _note(self, at_ms: MissionMs, event: Event) -> None:
        """Counts a journaled event, and writes it into the bag."""
        self._count(at_ms, event)
        if isinstance(event, PacketPassed):
            for row in sound_rows(event):
                self._bag.sound(at_ms, row)
        if not event.is_for_journal_alone:
            self._bag.event(at_ms, event.kind, json.dumps(event.data, separators=(",", ":")))

    def truths(self, truths: Sequence[Truth]) -> None:
        """Takes truths, for each aMussel in order of time; a truth out of order is dropped and counted.

        A truth that becomes known after the tick that it belongs to, that of an aMussel that died in its sleep, has the
        time of the newest tick in the journal, and its own in `agent_ms`.
        """
        for truth in truths:
            agent_id = truth.agent_id
            if agent_id not in self._agent_ids:
                self.dropped["a truth of an unknown aMussel"] += 1
                continue
            newest, journaled = self._newest.get(agent_id), self.state.truths.get(agent_id)
            if newest is not None and truth.at_ms < newest.at_ms:
                self.dropped["a truth that a newer one overtook"] += 1
                continue
            self._newest[agent_id] = truth
            if (
                journaled is not None
                and not differs_in_kind(truth, journaled)
                and not has_moved(truth, journaled)
            ):
                continue
            # The state has only truths that are journaled, so that a resumed run counts the same.
            self.state.take_truth(truth)
            at_ms = max(self._scale.mission_ms(AgentMs(truth.at_ms)), self._journal.flushed_ms)
            event = truth_event(truth)
            self._journal.append(at_ms, event)
            self._digest.take(at_ms, event)

    @_on_disk
    def flush(self) -> None:
        """Writes the journal's lines before the tick ends: they outlive a kill of this process."""
        self._journal.flush()

    @_on_disk
    def begin_checkpoint(self, learned: LearnedState, now_ms: MissionMs) -> None:
        """Writes the checkpoint from mission time `now_ms` on, so that another supervisor can resume the run."""
        self._checkpoint = Checkpoint(
            self._directory.checkpoint, learned.beliefs, now_ms, learned.ranging, self._dropped_so_far
        )

    @property
    def samples_kept(self) -> Mapping[SampleSource, Set[int]]:
        """The sequence numbers of the samples on disk."""
        return self._samples.kept

    @_on_disk
    def samples(self, agent_id: int, samples: Sequence[PlacedSample]) -> None:
        """Writes samples that an aMussel uploaded; they are on disk when it returns, so that they can be acknowledged."""
        self._samples.append(self.state.boards.get(agent_id, SampleSource(agent_id)), samples)

    @_on_disk
    def tick(
        self,
        now_ms: MissionMs,
        beliefs: Sequence[Belief],
        pose: PoseReported | None,
        battery: BatteryReported | None,
        primitive: str,
        docks: tuple[int | None, ...],
        dropped: Callable[[], Counter[str]] = Counter,
    ) -> None:
        """Ends a mission tick: samples it, journals the changes, and writes the tick's lines to disk.

        `dropped` returns the counts of the recorded flight so far.
        """
        self._dropped_in_flight = dropped
        self._journal.refuse_gone()
        apad = None if pose is None else apad_sample(pose, battery, primitive, docks)
        self._beliefs = beliefs
        for changed in self._changes.events(now_ms, apad, beliefs):
            self._journal.append(now_ms, changed)
        if self._is_sampled(now_ms):
            belief_samples = [belief_sample(belief, now_ms) for belief in beliefs]
            self._bag.sample(now_ms, self.truths_at(now_ms), belief_samples, apad)
        if self._journal.last_ms < now_ms:
            # A quiet tick leaves its time, because a resumed run must know up to which time the fleet was granted.
            self._journal.append(now_ms, TickPassed())
        # The checkpoint is written first: learning an update twice does no harm, and the mission may have acted on it.
        if self._checkpoint is not None:
            self._checkpoint.flush(now_ms)
        self._journal.flush()

    def truths_at(self, now_ms: MissionMs) -> list[TruthSample]:
        """Every aMussel's newest truth, extrapolated to mission time `now_ms`, by id."""
        agent_ms = self._scale.agent_ms(now_ms)
        return [
            self._water.sample(truth, max(agent_ms, truth.at_ms)) for _, truth in sorted(self._newest.items())
        ]

    def finish(self, at_ms: MissionMs, ending: Ending) -> dict[str, Any]:
        """Ends the run at mission time `at_ms`: writes ends.csv and summary.json, closes all files, returns the summary."""
        self._write_ends(at_ms)
        end = RunAtEnd(self._scenario, self._agent_ids, at_ms, self.state, ending)
        together = {
            **self.state.failures.figures(),
            **uptime_figures(self.state.meter, at_ms, battery_min=self._battery_min),
            **apad_energy(ending, self._scale),
            **self._sample_figures(ending, at_ms),
            "amussels": amussel_figures(
                self.state.meter,
                self.state.services,
                self._agent_ids,
                at_ms,
                takes_samples=takes_samples(self._scenario.board),
            ),
            "dropped": dict(sorted(self._all_dropped(ending).items())),
            "digest": str(self._digest),
        }
        summary = summary_of(end, together)
        self._write_ending(summary)
        return summary

    def close(self) -> None:
        """Closes all files, whatever becomes of one of them; a second call does nothing."""
        failures = []
        for file in (self._journal, self._bag, self._samples, self._checkpoint):
            try:
                if file is not None:
                    file.close()
            except OSError as error:
                failures.append(error)
        if failures and not self.has_failed:
            raise self.fail(failures[0])

    def fail(self, error: OSError) -> RecordsFailed:
        """Nothing more is written after this; the result is to be raised."""
        self.has_failed = True
        if isinstance(error, FileGone):
            return RecordsFailed(
                f"{error} while the run flew: the run ends, and its records end there, without a summary",
                EndReason.RECORDS_GONE,
            )
        return RecordsFailed(
            f"the disk of {self._directory.path} takes no more data ({error.strerror}): the run ends, and "
            "its records are complete up to there",
            EndReason.DISK_FULL,
        )

    @_on_disk
    def _write_ends(self, at_ms: MissionMs) -> None:
        """Writes ends.csv. Without it the run has its summary all the same, which counts the loss with its reason."""
        if not (ends := self._ends(at_ms)):
            return
        try:
            save_starts(self._directory.ends, ends, self._scenario.area.origin)
        except ValueError as error:
            self.dropped[f"{self._directory.ends.name}: {error}"] += 1

    @_on_disk
    def _write_ending(self, summary: dict[str, Any]) -> None:
        self._directory.write_json(self._directory.summary, summary)
        self.close()
        self._directory.checkpoint.unlink(missing_ok=True)  # an ended run cannot be resumed

    def _dropped_so_far(self) -> Counter[str]:
        """The counts that the next supervisor would not count again."""
        return self.dropped_before + self._dropped_in_flight() + self.dropped

    def _all_dropped(self, ending: Ending) -> Counter[str]:
        unreadable = Counter({"a line of samples.jsonl that cannot be read": self._samples.unreadable})
        return self.dropped_before + Counter(ending.dropped) + self.dropped + unreadable

    def _sample_figures(self, ending: Ending, at_ms: MissionMs) -> dict[str, Any]:
        if not takes_samples(self._scenario.board):
            return dict.fromkeys(SAMPLE_KEYS)
        taken = {agent_id: truth.physical.samples for agent_id, truth in self._newest.items()}
        apart = {uptime.agent_id: uptime.apart for uptime in self.state.meter.at(at_ms)}
        return sample_figures(taken, self._samples.kept, ending.samples_gone, apart)

    def _is_sampled(self, now_ms: MissionMs) -> bool:
        """True at every tick of the first day of mission time, then at the scenario's period."""
        last_ms = self._sampled_ms
        if now_ms > DAY_MS and last_ms is not None and now_ms < last_ms + self._record_period_ms:
            return False
        self._sampled_ms = now_ms
        return True

    def _count(self, at_ms: MissionMs, event: Event) -> None:
        self._digest.take(at_ms, event)
        self.state.apply(at_ms, event)

    def _replay(self, contents: JournalContents) -> None:
        """Rebuilds the run's state and its digest from the journal."""
        for at_ms, event in contents.entries:
            self._count(at_ms, event)
        self._newest = dict(self.state.truths)
        self._sampled_ms = contents.last_ms

    def _ends(self, at_ms: MissionMs) -> list[Start]:
        """The aMussels' places and charges: from the truth, or from the beliefs where there is none."""
        ends = {
            belief.agent_id: Start(
                belief.agent_id, belief.north_m, belief.east_m, belief.primary, belief.secondary
            )
            for belief in self._beliefs
            if belief.agent_id in self._agent_ids
        }
        for truth in self.truths_at(at_ms):
            ends[truth.agent_id] = Start(
                truth.agent_id, truth.north_m, truth.east_m, truth.primary, truth.secondary
            )
        return [ends[agent_id] for agent_id in sorted(ends)]
