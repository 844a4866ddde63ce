"""What the mission is for, counted: samples that were taken, that came ashore, and that never will."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

from firmware_model.flash import PAGE_BYTES, PAGES, Ring

SAMPLE_KEYS = ("samples_taken", "samples_uploaded", "samples_lost", "samples_waiting")


def sample_figures(
    taken: Mapping[int, int], kept: Mapping[int, Set[int]], gone: Mapping[int, Set[int]]
) -> dict[str, Any]:
    """The summary's keys. `taken` is from the truth, and empty where there is none: then only what came is known.

    A sample is one reading of all four sensors, written into the log. Lost are those that the log has overwritten before
    they were uploaded, whether anybody has heard of that or not, and those that became unreadable.
    """
    uploaded = sum(map(len, kept.values()))
    if not taken:
        lost = sum(map(len, gone.values()))
        return dict(zip(SAMPLE_KEYS, (None, uploaded, lost, None), strict=True))
    ring, lost = Ring(PAGES, PAGE_BYTES), 0
    for agent_id, count in taken.items():
        never = gone.get(agent_id, frozenset()) | set(range(ring.oldest(count)))
        lost += len(never - kept.get(agent_id, frozenset()))
    total = sum(taken.values())
    return dict(zip(SAMPLE_KEYS, (total, uploaded, lost, total - uploaded - lost), strict=True))
