"""What the mission is for, counted: samples that were taken, that came ashore, and that never will."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from types import MappingProxyType
from typing import Any

from firmware_model.sampling.flash import PAGE_BYTES, PAGES, Ring

SAMPLE_KEYS = ("samples_taken", "samples_uploaded", "samples_lost", "samples_waiting")


def sample_figures(
    taken: Mapping[int, int],
    kept: Mapping[int, Set[int]],
    gone: Mapping[int, Set[int]],
    apart: Mapping[int, Sequence[range]] = MappingProxyType({}),
) -> dict[str, Any]:
    """The summary's keys. `taken` is from the truth, and empty where there is none: then only what came is known.

    `apart` are the sequences that were taken by a twin of a real aMussel, or out of the water: they count as nothing. Nor
    does what a real one uploaded in the name of a simulated one, beyond what that has taken.

    A sample is one reading of all four sensors, written into the log. Lost are those that the log has overwritten before
    they were uploaded, whether anybody has heard of that or not, and those that became unreadable.
    """
    if not taken:
        uploaded, lost = (sum(map(len, it.values())) for it in (kept, gone))
        return dict(zip(SAMPLE_KEYS, (None, uploaded, lost, None), strict=True))
    ring, nothing = Ring(PAGES, PAGE_BYTES), frozenset[int]()
    total = uploaded = lost = 0
    for agent_id, count in taken.items():
        own = set(range(count)).difference(*apart.get(agent_id, ()))
        came = own & kept.get(agent_id, nothing)
        never = (own & gone.get(agent_id, nothing)) | (own & set(range(ring.oldest(count))))
        total, uploaded, lost = total + len(own), uploaded + len(came), lost + len(never - came)
    return dict(zip(SAMPLE_KEYS, (total, uploaded, lost, total - uploaded - lost), strict=True))
