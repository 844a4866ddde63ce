"""What several aPads' flights say of themselves, as one."""

from __future__ import annotations

from collections.abc import Sequence

from apad_bridge.runs.status import Status


def together(each: Sequence[Status], apads: int) -> Status:
    """The sums; of times the last one's, for the run ends with it."""
    return Status(
        min(it.now_ms for it in each),
        f"{apads} aPads",
        "",
        sum(it.agents for it in each),
        sum(it.active for it in each),
        sum(it.docked for it in each),
        sum(it.services for it in each),
        sum(it.cost_m for it in each),
        None,
        max(it.behind_s for it in each),
    )
