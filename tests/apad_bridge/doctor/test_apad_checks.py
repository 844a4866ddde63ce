"""Checks of an aPad whose services have other md5s than ours: services that we use fail, others warn."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import pytest

from apad_bridge.doctor.apad_checks import check_apads
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.live_apad import LiveAPad, NotAnnounced
from apad_bridge.ros import door
from apad_bridge.ros.door import DOOR

GO_TO = "4a0312be411e8ffc59f768d30e967664"
SERVICES = {
    "/boat/commander/primitive/go2point": GO_TO,
    "/boat/commander/primitive/dynamic_positioning": "b012ae796923d5321c7c678ac0cc7797",
    "/boat/commander/primitive/docking": "2f37c62380c61eaf8bf8692a9128c0fd",
    "/boat/commander/docking": "0" * 32,
}


def not_told(*_: object) -> Any:
    raise NotAnnounced("nobody publishes it")


def found_of(services: dict[str, str]) -> dict[str, tuple[CheckStatus, str]]:
    told = replace(
        DOOR,
        service_md5=lambda _, name: services[name],
        topic_md5=lambda *_: "d1c2e3fd518b63978e72fa7409f4ba71",
        stamp_offsets_s=not_told,
    )
    graph = Graph("http://127.0.0.1:1/", {}, {}, {name: ["/boat_node"] for name in services}, {})
    return {it.check: (it.status, it.found) for it in check_apads(told, graph)}


def test_what_is_beside_and_differs_is_a_warning_with_both_md5s() -> None:
    found = found_of(SERVICES)
    assert found["/boat"][0] is CheckStatus.OK
    status, line = found["/boat beside"]
    assert status is CheckStatus.WARN and f"commander/docking: md5 {'0' * 32}, ours " in line
    # The aPad has no simple go-to and no action, and the bench does not use them.
    assert "commander/go2point" not in line and "go2point/" not in line


def test_it_tells_what_can_be_asked_of_the_apad() -> None:
    assert found_of(SERVICES)["/boat capabilities"] == (
        CheckStatus.OK,
        "docks by its own eyes; holds a position; does not report what its docks hold; "
        "obeys the speed of a go-to; does not tell how many docks it has: its messages can name 4",
    )


@pytest.mark.parametrize(
    ("free", "held", "told"),
    [
        ([0, 1, 2, 3], [], "has 4 docks"),
        ([3], ["amussel7", "", "/amussel9"], "has 3 docks"),
        (None, [], "does not tell how many docks it has: its messages can name 16"),
    ],
)
def test_an_apad_of_generation_a_has_as_many_docks_as_it_counts_itself(
    monkeypatch: pytest.MonkeyPatch, free: list[int] | None, held: list[str], told: str
) -> None:
    """The answer as on the wire: int32[] available_slots, string[] slots."""
    numbers = struct.pack(f"<I{len(free or ())}i", len(free or ()), *(free or ()))
    names = b"".join(struct.pack("<I", len(it)) + it.encode() for it in held)
    answer = numbers + struct.pack("<I", len(held)) + names
    silent = replace(DOOR, service_md5=not_told, topic_md5=not_told, stamp_offsets_s=not_told)
    monkeypatch.setattr(door, "call_without_words", not_told if free is None else lambda *_: answer)
    goals = {"/boat/action_server/goal": ["/boat_node"]}
    services = {"/boat/check_docking_availability": ["/boat_node"]}
    graph = Graph("http://127.0.0.1:1/", {}, goals, services, {})
    (found,) = [it.found for it in check_apads(silent, graph) if it.check == "/boat capabilities"]
    assert found.endswith(f"; {told}")


def test_a_primitive_that_differs_is_a_failure() -> None:
    services = SERVICES | {"/boat/commander/primitive/go2point": "1" * 32}
    del services["/boat/commander/docking"]
    found = found_of(services)
    status, line = found["/boat"]
    assert status is CheckStatus.FAIL and "1" * 32 in line and GO_TO in line
    assert "/boat beside" not in found


def test_a_silent_battery_cannot_tell() -> None:
    status, line = found_of(SERVICES)["/boat battery"]
    assert status is CheckStatus.CANNOT_TELL and "/boat/battery_level: nobody publishes it" in line


def test_a_silent_battery_topic_leaves_the_charge_to_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer as on the wire: percent, x, y, z, type and an empty list of consumers."""

    answer = struct.pack("<4d", 62.5, 0.0, 0.0, 0.0) + struct.pack("<I7sI", 7, b"charger", 0)
    monkeypatch.setattr(door, "call_without_words", lambda *_: answer)
    for services, charge in (({}, None), ({"/boat/get_battery_level": ["/boat_node"]}, 0.625)):
        graph = Graph("http://127.0.0.1:1/", {}, {}, services, {})
        assert LiveAPad(replace(DOOR, messages=not_told), graph, "/boat").charge() == charge
