"""Texts about events, from lines that the journal's own table accepts."""

import pytest

from apad_bridge.events.all_events import EVENTS, event_of
from apad_bridge.events.event import Category, Event
from apad_bridge.records.field_types import fault_of

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
    assert fault_of(line["kind"], line) is None and event_of(line["kind"], line).text() == text


FAILED = {"name": "go to point", "phase": "failed", "north_m": 1.0, "east_m": 2.0}
STOP = {"number": 1, "mode": "off", "by": "Anna"}


@pytest.mark.parametrize(
    ("kind", "data", "category"),
    [
        ("primitive", FAILED | {"reason": "no GPS"}, "alarm"),
        ("primitive", FAILED | {"reason": "pre-empted"}, "news"),
        ("primitive", FAILED | {"phase": "started"}, "news"),
        (
            "refused",
            {"order": "permit to surface", "agent": 3, "guard": "fence", "reason": "outside"},
            "alarm",
        ),
        ("refused", {"order": "dock", "guard": "fence", "reason": "outside"}, "trouble"),
        ("stop", STOP | {"state": "not taken"}, "alarm"),
        ("stop", STOP | {"state": "refused"}, "alarm"),
        ("stop", STOP | {"state": "taken"}, "news"),
        ("vehicle_silent", {"name": "apad1", "since_ms": 5}, "trouble"),
        ("vehicle_heard", {"name": "apad1", "since_ms": 5}, "relief"),
        ("plan", {"what": "collect", "strategy": "mine", "steps": [], "costs": {}, "beliefs": []}, "plan"),
        ("operator", {"order": "stop", "by": "Anna"}, "word"),
        ("tick", {}, "news"),
    ],
)
def test_people_find_an_event_by_its_category(kind, data, category):
    event = event_of(kind, data)
    assert event.category == category
    assert event.category.is_trouble == (category in ("alarm", "trouble"))


def test_every_alarm_and_trouble_has_a_text():
    for kind in EVENTS.values():
        if isinstance(kind.category, Category) and kind.category.is_trouble:
            assert kind.text is not Event.text, kind.kind


@pytest.mark.parametrize("line", [line for line, _ in TEXTS])
def test_a_line_comes_back_from_its_event(line):
    data = {key: value for key, value in line.items() if key != "kind"}
    assert event_of(line["kind"], line).data == data
