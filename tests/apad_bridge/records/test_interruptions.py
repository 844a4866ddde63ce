"""The spans in which a person or a guard kept the mission from the aPad, against journals written by hand."""

from typing import Any

import pytest

from apad_bridge.events.all_events import event_of
from apad_bridge.records.failure_counts import Interruptions

STOP, CONTINUE = ("operator", {"order": "stop", "by": "x"}), ("operator", {"order": "continue", "by": "x"})
TAKEN, BACK = ("override", {"taken": True, "by": "person"}), ("override", {"taken": False, "by": "person"})
LATE, OVER = (
    ("guard", {"cause": "late", "reaction": "hold", "reason": "x", "calls_pilot": False}),
    ("guard_over", {"cause": "late"}),
)
UNCONFIRMED = ("refused", {"order": "go to", "guard": "person", "reason": "x"})
FENCED = ("refused", {"order": "go to", "guard": "fence", "reason": "x"})


@pytest.mark.parametrize(
    ("story", "spans"),
    [
        ([], []),
        ([(10, STOP), (10, TAKEN), (70, CONTINUE), (70, BACK)], [(10, 70)]),
        ([(10, TAKEN), (20, STOP), (30, CONTINUE), (50, BACK), (60, BACK)], [(10, 50)]),
        ([(10, LATE), (12, OVER), (20, LATE), (25, OVER)], [(10, 12), (20, 25)]),
        ([(10, LATE), (11, STOP), (12, OVER), (40, CONTINUE)], [(10, 40)]),
        ([(10, UNCONFIRMED), (11, UNCONFIRMED), (30, CONTINUE)], [(10, 30)]),
        ([(10, FENCED)], []),
        ([(10, STOP), (20, CONTINUE), (90, STOP)], [(10, 20), (90, 100)]),
    ],
)
def test_stops_begin_and_end_as_by_hand(
    story: list[tuple[int, tuple[str, dict[str, Any]]]], spans: list[tuple[int, int]]
) -> None:
    interruptions = Interruptions()
    for at_s, (kind, data) in story:
        interruptions.take(1000 * at_s, event_of(kind, data))
    assert interruptions.spans_ms(100_000) == [(1000 * begin_s, 1000 * end_s) for begin_s, end_s in spans]
    assert interruptions.stopped_s(100_000) == sum(end_s - begin_s for begin_s, end_s in spans)
