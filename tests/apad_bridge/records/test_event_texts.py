"""Texts about events, from lines that the journal's own table accepts."""

import pytest

from apad_bridge.events.union import text_of
from apad_bridge.records.line_types import fault_of

TEXTS = [
    ({"kind": "dock", "dock": 0, "agent": 2, "closed": False}, "dock 1 let go aMussel 2"),
    (
        {
            "kind": "primitive",
            "name": "dock",
            "phase": "failed",
            "agent": 3,
            "dock": 1,
            "reason": "it missed",
        },
        "dock (aMussel 3, dock 2) failed: it missed",
    ),
    (
        {"kind": "given_up", "agent": 3, "what": "collect", "reason": "it missed"},
        "aMussel 3 is not collected this time: it missed",
    ),
    (
        {"kind": "left_alone", "agent": 3, "tries": 5, "reason": "it missed"},
        "aMussel 3 is left alone from now on: 5 tries in a row failed, the last one: it missed",
    ),
    ({"kind": "override", "taken": True}, "a person took the aPad over"),
    ({"kind": "operator", "order": "stop", "by": "Anna"}, "Anna ordered: stop"),
    ({"kind": "remark", "text": "gulls", "by": "Anna"}, "Anna: gulls"),
    (
        {"kind": "refused", "order": "dock", "guard": "fence", "reason": "outside the fence"},
        "refused to dock, by the guard fence: outside the fence",
    ),
    (
        {"kind": "guard", "cause": "late", "reaction": "hold", "reason": "no position", "calls_pilot": True},
        "PILOT, TAKE IT: the aPad holds where it is: no position",
    ),
    ({"kind": "guard_over", "cause": "late"}, "no longer in danger (late)"),
    ({"kind": "tick"}, None),
]


@pytest.mark.parametrize(("line", "text"), TEXTS)
def test_an_event_has_its_text(line, text):
    assert fault_of(line["kind"], line) is None
    assert text_of(line["kind"], line) == text
