"""What the planner of several aPads sees of one of them: what its supervisor believes, and nothing else."""

from __future__ import annotations

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import LIKELY, SUBMERGED, Mode
from apad_bridge.mission.appearances import floats
from apad_bridge.mission.state import Phase
from apad_bridge.runs.several.assignment import Seen
from apad_bridge.supervisor.core import Supervisor
from firmware_model.state_groups import AT_WORK, BEYOND_HELP, STRANDED


def seen_of(name: str, start_m: tuple[float, float], supervisor: Supervisor) -> Seen:
    """`start_m` is where it is taken to be before it was ever heard."""
    state, pose = supervisor.mission.state, supervisor.pose
    is_down = state.phase is Phase.STANDS_DOWN
    busy = {step.agent_id for step in state.plan.steps} | set(dict(state.docked).values())
    served = [it for it in supervisor.share.all() if not _is_lost(it)]
    return Seen(
        name,
        is_down,
        start_m if pose is None else (pose.north_m, pose.east_m),
        {it.agent_id: (it.north_m, it.east_m) for it in served},
        frozenset(it.agent_id for it in served if it.agent_id not in busy and _is_free(it, is_down)),
    )


def _is_lost(belief: Belief) -> bool:
    if belief.is_carried:
        return belief.probability_of(Mode.LOST) >= LIKELY
    return belief.state in BEYOND_HELP


def _is_free(belief: Belief, is_down: bool) -> bool:
    """It rests below. One that floats is told to sink if nobody comes for it, unless it is empty, and cannot (`Strays`)."""
    if is_down and belief.primary <= 0 and floats(belief):
        return True
    if belief.is_carried:
        return belief.probability_of(*SUBMERGED) >= LIKELY
    return belief.state in AT_WORK | STRANDED
