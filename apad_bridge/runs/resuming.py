"""What the journal of a run says to a supervisor that goes on with it."""

from __future__ import annotations

from dataclasses import replace

from apad_bridge.mission.state import MissionState
from apad_bridge.records.journal import JournalContents
from apad_bridge.records.recorder import Resumed
from apad_bridge.runs.failures import PeerFailed
from apad_bridge.runs.flying import GoOn


def go_on(journal: JournalContents, epoch: int) -> GoOn:
    """The newest mission snapshot and time; PeerFailed when the journal has none or the run has ended."""
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
    return GoOn(journal.last_ms // 1000 * 1000, state, epoch, fraction)


def what_was_lost(resumed: Resumed) -> list[str]:
    """Lines for a person, one for each thing that the crash took."""
    lost: list[str] = []
    if resumed.journal.dropped or resumed.journal_torn_bytes:
        lost.append(f"the journal's last line was torn: {resumed.journal_torn_bytes} bytes of it are lost")
    if resumed.bag is not None:
        lost.append(f"{resumed.bag} was repaired; {resumed.bag_lost_ms / 1000:g} s of samples are lost")
    return lost
