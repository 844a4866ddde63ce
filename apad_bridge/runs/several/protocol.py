"""What the parent of several aPads orders one of their supervisors, in a file of its run's directory.

A file, because it is read by whoever comes next, too: a supervisor that died is resumed with the share that it has now.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from apad_bridge.mission.allocation import Allocation
from apad_bridge.runs.several.assignment import Seen
from apad_bridge.scenario.loader import write_atomically

NAME = "squad.json"


@dataclass(frozen=True, slots=True)
class Handed:
    """What was believed of an aMussel where it was served before, at that mission time: `Estimator.kept`, or nothing."""

    at_ms: int = 0
    kept: Any = None


@dataclass(frozen=True, slots=True)
class Orders:
    serves: Mapping[int, Handed]
    """Whom it shall serve from now on; of its own fleet, and of others."""
    stands_down: str | None = None
    """Why it shall."""

    def save(self, run_dir: Path) -> None:
        serves = [[agent_id, it.at_ms, it.kept] for agent_id, it in sorted(self.serves.items())]
        data = {"serves": serves, "stands_down": self.stands_down}
        write_atomically(run_dir / NAME, json.dumps(data) + "\n")

    @classmethod
    def load(cls, run_dir: Path) -> Orders | None:
        """None where nothing was ordered yet. ValueError, KeyError or TypeError for what is nothing of the kind."""
        try:
            data = json.loads((run_dir / NAME).read_text())
        except FileNotFoundError:
            return None
        return cls(
            {agent_id: Handed(at_ms, kept) for agent_id, at_ms, kept in data["serves"]},
            data["stands_down"],
        )


def seen_data(seen: Seen, allocation: Allocation) -> dict[str, Any]:
    return {**asdict(seen), "movable": sorted(seen.movable), "served": sorted(allocation.served)}


def seen_from(data: dict[str, Any]) -> tuple[Seen, frozenset[int]]:
    """What a seat said of its aPad, and whom that serves."""
    north_m, east_m = data["place_m"]
    places_m = {int(agent_id): (at[0], at[1]) for agent_id, at in data["places_m"].items()}
    seen = Seen(data["name"], data["is_down"], (north_m, east_m), places_m, frozenset(data["movable"]))
    return seen, frozenset(data["served"])
