"""Exchange of places: a charged aMussel takes the place of one that is collected, so that one way serves both.

One for whom nobody waits takes the nearest of the places that stand empty, which are those of the docked ones. Most often
that is the place at which the aPad charges them, so no way is driven for the release.

All aMussels measure alike, so as many of the mission's places are covered whoever is where. The paper brings each back to
its own place, and names other redeployments as possible (section V).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.dispatch_rule import ServiceRules
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import nearest_first


def tour(collection: Solution, situation: Situation) -> Solution:
    """The steps of a collection and of `situation.leaving`: at each stop one is collected and the next one is released.

    A free dock takes the collected one first. Without one the release comes first. The steps get their docks anew. Those
    who find no place leave last.
    """
    releases = [Step(StepKind.DEPLOY, it.agent_id, _dock(it.dock_index)) for it in situation.leaving]
    leaves_empty = {it.dock_index for it in releases}
    free = [dock_index for dock_index in situation.free_docks if dock_index not in leaves_empty]
    steps: list[Step] = []
    for step in collection.steps:
        release = releases.pop(0) if releases else None
        if release is not None and not free:
            steps.append(release)
            free.append(release.dock_index)
            release = None
        steps.append(step._replace(dock_index=free.pop(0)))
        if release is not None:
            steps.append(release)
            free.append(release.dock_index)
    return Solution((*steps, *releases))


def is_worth_it(leaving: float, waiting: float, rules: ServiceRules) -> bool:
    """One that is not full does well to take the place of one with `waiting`: it makes room for it and has more charge.

    A release looks at the lowest charge in the pool, and a strategy may prefer a neighbour. In the neighbour's place a
    partly charged aMussel would bring less than its lead, so neighbours would take turns while others stood empty.
    """
    return rules.leaves_for(leaving, waiting) and waiting < leaving


def exchanges(collection: Solution, situation: Situation) -> list[tuple[int, int]]:
    """The pairs (released, collected) of a tour, who exchange places."""
    return [
        (leaving.agent_id, step.agent_id)
        for leaving, step in zip(situation.leaving, collection.steps, strict=False)
    ]


def nearest_places(
    leaving: Sequence[int], homes_m: Mapping[int, tuple[float, float]], from_m: tuple[float, float]
) -> list[tuple[int, int]]:
    """The pairs (released, docked), who exchange places so that those that leave get the nearest ones.

    `homes_m` has the places of the docked ones by id, in m; one that leaves without a place is left out. The first place is
    the nearest to `from_m`, the second the nearest to the first, and so on. Whoever has one of them keeps it.
    """
    going = [it for it in leaving if it in homes_m]
    owners = list(islice(nearest_first(from_m, homes_m), len(going)))
    return list(
        zip((it for it in going if it not in owners), (it for it in owners if it not in going), strict=True)
    )


def _dock(dock_index: int | None) -> int:
    assert dock_index is not None  # who leaves is docked
    return dock_index
