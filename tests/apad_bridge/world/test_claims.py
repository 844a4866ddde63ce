"""The graph's claims about a fleet whose supervisor died, against its journal."""

from __future__ import annotations

import pytest

from apad_bridge.events.fleet_events import Presence
from apad_bridge.world.roster import Claim, PresenceChange, Presences, claim_conflicts, unclaimed_real_ids

PRESENCES = Presences(
    [1, 2, 3, 4],
    3.0,
    [PresenceChange(0, 2, Presence.REAL, "/lab"), PresenceChange(0, 3, Presence.RETIRED, "/other")],
)


def claim(node: str, real: bool, *ids: int) -> Claim:
    return Claim(node, real, 0.0, frozenset(ids), 1e9)


@pytest.mark.parametrize(
    ("claims", "lines"),
    [
        ([], []),
        ([claim("/lab", True, 2)], []),
        ([claim("/other", False, 3)], []),
        (
            [claim("/lab", True, 1, 2, 3)],
            [
                "aMussel 1 was simulated, and /lab claims it as real now: it is handed over",
                "aMussel 3 was retired, and /lab claims it as real now: it is handed over",
            ],
        ),
        (
            [claim("/new", False, 2, 4)],
            [
                "aMussel 2 was real, and /new claims it as simulated now: here it stays real",
                "aMussel 4 was simulated, and /new claims it as simulated now: ours is retired",
            ],
        ),
        ([claim("/lab", True)], ["aMussel 2 was real by /lab, which claims it no more: it is taken back"]),
        ([claim("/else", True, 77)], []),
    ],
)
def test_each_difference_is_told_in_a_line(claims: list[Claim], lines: list[str]) -> None:
    assert claim_conflicts(PRESENCES.of, PRESENCES.before, claims) == lines


def test_a_real_one_is_given_back_by_its_claimant_alone() -> None:
    before = PRESENCES.before
    assert unclaimed_real_ids(before, [claim("/lab", True, 4)]) == {2: "/lab"}
    assert unclaimed_real_ids(before, [claim("/lab", True, 2)]) == {}
    assert unclaimed_real_ids(before, [claim("/somebody", True, 4)]) == {}
    assert unclaimed_real_ids(before, []) == {}, "a claim that is merely not repeated changes nothing"
