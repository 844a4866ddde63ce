"""What the journal of a run says to a supervisor that goes on with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from apad_bridge.mission.state import MissionState
from apad_bridge.records.journal import JournalContents
from apad_bridge.records.recorder import Resumed
from apad_bridge.runs.failures import PeerFailed
from apad_bridge.runs.flying import GoOn
from apad_bridge.runs.options import RunOptions


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


def what_was_lost(resumed: Resumed) -> list[str]:
    """Lines for a person, one for each thing that the crash took."""
    lost: list[str] = []
    if resumed.journal.dropped or resumed.journal_torn_bytes:
        lost.append(f"the journal's last line was torn: {resumed.journal_torn_bytes} bytes of it are lost")
    if resumed.bag is not None:
        lost.append(f"{resumed.bag} was repaired; {resumed.bag_lost_ms / 1000:g} s of samples are lost")
    return lost
