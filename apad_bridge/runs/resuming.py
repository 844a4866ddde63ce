"""What the journal of a run says to a supervisor that goes on with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from agents.coordinator import Coordinator
from agents.stimuli import Placed, from_wire, to_wire
from apad_bridge.mission.state import MissionState
from apad_bridge.presence import Became, Presence, Presences
from apad_bridge.records.journal import JournalContents, Line
from apad_bridge.records.recorder import Recorder, Resumed
from apad_bridge.runs.failures import PeerFailed
from apad_bridge.runs.flying import GoOn
from apad_bridge.runs.options import RunOptions

_PLACED = to_wire(Placed(0, 0, 0, 0, 0))[0]


def gap_ms(options: RunOptions, journal: Path, now_s: float) -> int:
    """Mission time that went by without a supervisor, to be granted to the fleet at once; `now_s` is since the epoch.

    A real vehicle's time went on, for as long as the journal, which every tick writes to, has stood still. On a master of
    our own /clock stood still with the supervisor.
    """
    if options.owns_master:
        return 0
    return max(0, round((now_s - journal.stat().st_mtime) * 1000))


def go_on(journal: JournalContents, epoch: int, gap_ms: int) -> GoOn:
    """The newest mission snapshot, and the time with the gap granted; PeerFailed when the run has ended."""
    state, fraction = MissionState(), None
    for line in journal.lines:
        if line["kind"] == "mission":
            state = MissionState.from_json(line["snapshot"])
        elif line["kind"] == "dock":
            held = {slot: agent_id for slot, agent_id in state.docked if slot != line["slot"]}
            if line["closed"]:
                held[line["slot"]] = line["agent"]
            state = replace(state, docked=tuple(sorted(held.items())))
        elif line["kind"] == "apad" and fraction is None:
            fraction = line["battery"]
        elif line["kind"] == "end":
            raise PeerFailed("this run has ended: there is nothing to go on with")
    # Ticks stand on whole seconds; the journal's last line may lie between two.
    return GoOn((journal.last_ms + gap_ms) // 1000 * 1000, state, epoch, fraction)


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


def who_was_who(presences: Presences) -> list[str]:
    """A line for a person for what is restored of who was real, and who retired."""
    lines = []
    for presence in (Presence.REAL, Presence.RETIRED):
        those = sorted(it.agent_id for it in presences.before.values() if it.presence is presence)
        if those:
            lines.append(f"still {presence}: aMussels {', '.join(map(str, those))}")
    return lines


def what_was_lost(resumed: Resumed) -> list[str]:
    """Lines for a person, one for each thing that the crash took."""
    lost: list[str] = []
    if resumed.journal.dropped or resumed.journal_torn_bytes:
        lost.append(f"the journal's last line was torn: {resumed.journal_torn_bytes} bytes of it are lost")
    if resumed.bag is not None:
        lost.append(f"{resumed.bag} was repaired; {resumed.bag_lost_ms / 1000:g} s of samples are lost")
    return lost
