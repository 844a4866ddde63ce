"""Tests flights in memory on twins: the aPad pings aMussels with an uncertain place, and asks aMussels with an uncertain
charge for their status."""

from __future__ import annotations

from typing import Any

import pytest
from journals import facts_of
from scenario_files import POOL_FILE, SOUND_FILE

from apad_bridge.runs.in_memory import MemoryRecorder, open_flight
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve
from firmware_model.packets import CommandPacket, Kind, ShortStatus
from firmware_model.packets.codec import MusselbedCodec

TWIN = {
    "drain_deviation": 0.1,
    "sensor_noise": 0.015,
    "bias_deviation": 0.02,
    "unscheduled": 0.03,
    "fix_deviation_m": 2.0,
}


def scenario(**talk: float) -> dict[str, Any]:
    """Fifteen minutes of the pool with sound, on batteries so low that every aMussel has to be collected at some time."""
    data = resolve(load(SOUND_FILE))
    data.update(name="asking", duration_s=900)
    data["fleet"].update(count=4, start={"charge": [0.55, 0.62]})
    data["mission"]["batch"] = 4
    data["beliefs"] = {"estimator": "twin", "twin": TWIN}
    data["water"]["localisation"] = {}
    data["water"]["talk"].update(talk)
    return dict(data)


def flown(data: dict[str, Any]) -> tuple[MemoryRecorder, dict[str, int]]:
    flight, recorder = open_flight(from_data(data, "asking"))
    flight.run()
    return recorder, dict(flight.all_dropped)


def events(recorder: MemoryRecorder, kind: str) -> list[tuple[int, dict[str, Any]]]:
    return [(at_ms, event) for at_ms, its_kind, event in facts_of(recorder) if its_kind == kind]


def ranges(data: dict[str, Any]) -> list[int]:
    recorder, _ = flown(data)
    return [event["id"] for _, event in events(recorder, "range")]


def requests_and_answers(recorder: MemoryRecorder) -> list[tuple[str, int, dict[str, Any]]]:
    """The status requests and answers in the water, as (kind, aMussel, the journal's line)."""
    found = []
    for _, event in events(recorder, "packet"):
        packet = MusselbedCodec().decode(bytes.fromhex(event["data"]))
        if isinstance(packet, CommandPacket) and packet.kind is Kind.PING:
            found.append(("question", packet.agent_id, event))
        elif isinstance(packet, ShortStatus):
            found.append(("answer", packet.agent_id, event))
    return found


def test_whom_it_may_have_to_look_for_is_pinged_and_nobody_without_need() -> None:
    assert ranges(scenario()) == []
    asked = ranges(scenario(ping_worth_m=1.0))
    assert asked and set(asked) <= {1, 2, 3, 4}
    assert len(ranges(scenario(ping_worth_m=50.0))) == 0  # no place is so uncertain


def test_whose_charge_it_is_unsure_of_is_asked_and_answers_into_the_quiet() -> None:
    recorder, dropped = flown(scenario(ask_worth_answers=1))
    asked = [event["id"] for _, event in events(recorder, "asked")]
    packets = requests_and_answers(recorder)
    assert asked and [agent_id for kind, agent_id, _ in packets if kind == "question"] == asked
    # Every request is answered, in order, and nothing else is on the air meanwhile.
    assert [agent_id for kind, agent_id, _ in packets if kind == "answer"] == asked
    assert events(recorder, "unanswered") == []
    assert not any("asked" in reason or "overtook" in reason for reason in dropped)
    assert [kind for kind, _, _ in packets] == ["question", "answer"] * len(asked)
    assert {outcome for _, _, event in packets for _, outcome, *_ in event["heard"]} == {"received"}
    slots_ms = 4 * 5000  # of every frame of five minutes; each answer has arrived before the next one
    assert all(event["began_ms"] % 300_000 >= slots_ms for _, _, event in packets)
    assert requests_and_answers(flown(scenario())[0]) == []


WORST_CASE = {"board": resolve(load(POOL_FILE))["board"], "mission": {"full_when": "primary"}}


@pytest.mark.parametrize(
    ("key", "wrong", "why"),
    [
        ("ping_worth_m", {"beliefs": {"estimator": "hold_last"}}, "estimator: twin"),
        ("ask_worth_answers", {"beliefs": {"estimator": "hold_last"}}, "estimator: twin"),
        ("ask_worth_answers", WORST_CASE, "the worst case does not answer"),
    ],
)
def test_it_takes_boards_that_answer_and_beliefs_that_know_how_sure_they_are(
    key: str, wrong: dict[str, Any], why: str
) -> None:
    data = scenario(**{key: 1.0})
    mission = data["mission"] | wrong.get("mission", {})
    with pytest.raises(ScenarioError, match=rf"water\.talk\.{key}.*{why}"):
        from_data(data | wrong | {"mission": mission}, "asking")
