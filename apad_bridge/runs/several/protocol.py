"""Orders from the parent of several aPads to one of their supervisors, in a file of its run's directory.

A file, because the next supervisor reads it too: a supervisor that died is resumed with its current share.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apad_bridge.scenario.loader import write_atomically

ORDERS_FILE = "squad.json"


@dataclass(frozen=True, slots=True)
class TransferredBelief:
    """The former server's belief of an aMussel at mission time `at_ms`: the result of `Estimator.kept`, or None."""

    at_ms: int = 0
    estimate: Any = None


@dataclass(frozen=True, slots=True)
class Orders:
    serves: Mapping[int, TransferredBelief]
    """The aMussels to serve from now on, of the supervisor's own fleet and of others."""
    stands_down: str | None = None
    """The reason to stand down; None to fly on."""

    def save(self, run_dir: Path) -> None:
        serves = [[agent_id, it.at_ms, it.estimate] for agent_id, it in sorted(self.serves.items())]
        data = {"serves": serves, "stands_down": self.stands_down}
        write_atomically(run_dir / ORDERS_FILE, json.dumps(data) + "\n")

    @classmethod
    def load(cls, run_dir: Path) -> Orders | None:
        """None where there are no orders yet. ValueError, KeyError or TypeError when the file holds no orders."""
        try:
            data = json.loads((run_dir / ORDERS_FILE).read_text())
        except FileNotFoundError:
            return None
        return cls(
            {agent_id: TransferredBelief(at_ms, estimate) for agent_id, at_ms, estimate in data["serves"]},
            data["stands_down"],
        )
