"""Tests how the generation of a live aPad is recognised, on a master that a busy machine keeps from answering."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest

from apad_bridge.assembly.stacks import stacks
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.links import vehicles
from apad_bridge.ros.links.vehicles import live_generation
from apad_bridge.vehicle.link_errors import VehicleNotReady

SILENT = Unreachable("getSystemState at http://here:1: no answer within 2 s")
EMPTY = Graph("http://here:1", {}, {}, {}, {})
OF_A = Graph(
    "http://here:1",
    {},
    {f"/apad1/{action}/goal": ["/apad1_simulated"] for action in stacks()[0].recognised_actions},
    {f"/apad1/{service}": ["/apad1_simulated"] for service in stacks()[0].recognised_services},
    {},
)


def of_answers(monkeypatch: pytest.MonkeyPatch, *answers: Graph | Unreachable) -> MagicMock:
    """The master's answers, to one question after the other."""
    read = MagicMock(side_effect=answers)
    monkeypatch.setattr(vehicles.Graph, "read", read)
    return read


def test_a_master_that_answers_late_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    read = of_answers(monkeypatch, SILENT, EMPTY, SILENT, OF_A)
    assert live_generation("apad1", 60.0) is stacks()[0].generation
    assert read.call_count == 4


@pytest.mark.parametrize(
    ("answer", "told"),
    [(SILENT, "no answer within 2 s"), (EMPTY, "/apad1 is not there after 0.2 s: no subscriber on")],
)
def test_what_never_comes_is_told_when_the_time_is_over(
    monkeypatch: pytest.MonkeyPatch, answer: Graph | Unreachable, told: str
) -> None:
    of_answers(monkeypatch, *[answer] * 10_000)
    with pytest.raises(VehicleNotReady, match=told):
        live_generation("apad1", 0.2)
