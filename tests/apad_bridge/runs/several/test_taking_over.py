"""One of two aPads fails and the other takes over: the aMussels lost with and without that, in flights in memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from scenario_files import WHOLE_FILE

from apad_bridge.assembly.division import members
from apad_bridge.runs.in_memory import OpenedLockstep, open_lockstep
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import save_starts, starts_of
from apad_bridge.scenario.starts_table import Start

NEEDY = (5, 6, 7)
"""These lie in the north, where apad2 fetches them."""
DURATION_S = 6000


def two_apads(
    folder: Path, *, transfers: bool, battery: float, water: dict[str, Any] | None = None
) -> Scenario:
    """Two heaps of four aMussels with the whole board; apad2, with a nearly empty battery, starts between them."""
    data = resolve(load(WHOLE_FILE))
    data.update(name="two", theta=10, duration_s=DURATION_S, sharing={"transfers": transfers})
    data["area"]["polygon_m"] = [[0, 0], [60, 0], [60, 20], [0, 20]]
    starts = [
        Start(n, 5.0 + n if n <= 4 else 46.0 + n, 10.0, 0.12 if n in NEEDY else 0.9, 0.05)
        for n in range(1, 9)
    ]
    save_starts(folder / "two.csv", starts, load(WHOLE_FILE).area.origin)
    data["fleet"].update(count=8, start=str(folder / "two.csv"), hosting="one_process")
    data["board"]["whole"]["cycle"]["alarm_s"] = 1200
    data["board"]["whole"]["last_resort"]["action"] = "wait"
    data["mission"].update(pool_threshold=0.5, batch=3, full_when="primary")
    data["apad"]["start_m"] = [6, 10]
    data["apads"] = [{"name": "apad2", "start_m": [20, 10], "battery_start_fraction": battery}]
    data["water"] = water
    if water is not None:
        data["hearing"]["mode"] = "physical"
    return from_data(data, "two")


def open_in(
    folder: Path, *, transfers: bool, battery: float = 0.005, water: dict[str, Any] | None = None
) -> OpenedLockstep:
    scenario = two_apads(folder, transfers=transfers, battery=battery, water=water)
    return open_lockstep(members(scenario, starts_of(scenario)), scenario.sharing)


def events_of(opened: OpenedLockstep, apad: str, kind: str) -> list[dict[str, Any]]:
    lines = (it.line for it in opened.recorders[apad].journal.entries)
    return [it for it in lines if it["kind"] == kind]


def test_at_every_tick_each_is_in_exactly_one_share(tmp_path: Path) -> None:
    opened = open_in(tmp_path, transfers=True)
    supervisors = [it.flight.supervisor for it in opened.flights.values()]
    tick = opened.flights["apad2"].flight.step

    def watched() -> bool:
        served = sorted(agent_id for it in supervisors for agent_id in it.allocation.served)
        assert served == list(range(1, 9))
        # And no aPad plans for an aMussel that another serves.
        for it in supervisors:
            assert {step.agent_id for step in it.mission.state.plan} <= it.allocation.served
        return tick()

    opened.flights["apad2"].flight.step = watched  # type: ignore[method-assign]
    opened.runner.run()
    assert [len(it.allocation.served) for it in supervisors] == [8, 0]


def test_a_guest_is_handed_on_again_when_its_server_fails(tmp_path: Path) -> None:
    """apad2 fails first, apad3 a quarter of an hour later: aMussels that apad3 took from apad2 go to apad1 with its own."""
    data = resolve(two_apads(tmp_path, transfers=True, battery=0.005))
    data["duration_s"] = 2400
    data["apads"].append({"name": "apad3", "start_m": [50, 10], "battery_start_fraction": 0.03})
    data["mission"]["collection"] = "none"
    three = from_data(data, "three")
    opened = open_lockstep(members(three, starts_of(three)), three.sharing)
    opened.runner.run()
    downs = [events_of(opened, name, "stands_down")[0]["t"] for name in ("apad2", "apad3")]
    assert downs[0] < 200_000 and 600_000 < downs[1] < 1_500_000
    first = {it.agent_id: it.taker for at_ms, it in opened.runner.moves if at_ms < downs[1]}
    then = {it.agent_id: it for at_ms, it in opened.runner.moves if at_ms > downs[1]}
    homes = {name: set(it.flight.supervisor.allocation.own) for name, it in opened.flights.items()}
    served_for_others = {it for it in homes["apad2"] if first[it] == "apad3"}
    assert served_for_others and all(
        then[it].giver == "apad3" and then[it].taker == "apad1" for it in served_for_others
    )
    assert opened.runner.assignment.shares == {
        "apad1": frozenset(range(1, 9)),
        "apad2": frozenset(),
        "apad3": frozenset(),
    }
    # apad3 has no beliefs of the aMussels that it served for apad2; apad1 has beliefs of all.
    beliefs = opened.flights["apad3"].flight.supervisor.beliefs
    assert {it.agent_id for it in beliefs.all()} == homes["apad3"]
    assert {it.agent_id for it in opened.flights["apad1"].flight.supervisor.beliefs.all()} == set(range(1, 9))
    assert sum(it["counted_s"] for it in opened.figures().values()) == 8 * 2400


def test_whom_its_docks_hold_stay_with_it(tmp_path: Path) -> None:
    """With a little more in its battery apad2 has docked all three before it comes to an end."""
    opened = open_in(tmp_path, transfers=True, battery=0.03)
    opened.runner.run()
    (down,) = events_of(opened, "apad2", "stands_down")
    docked = [
        it["agent"] for it in events_of(opened, "apad2", "dock") if it["closed"] and it["t"] < down["t"]
    ]
    assert sorted(docked) == list(NEEDY)
    assert [it["id"] for it in events_of(opened, "apad2", "handed_on")] == [8]
    assert opened.runner.assignment.shares["apad2"] == frozenset(NEEDY)
    assert opened.figures()["apad2"]["amussels_lost"] == 0


@pytest.mark.parametrize("beyond_sound", [False, True], ids=["all are well", "beyond the range of sound"])
def test_nothing_differs_from_flying_alone(tmp_path: Path, beyond_sound: bool) -> None:
    """With two heaps 45 m apart, and sound that reaches 20 m, each packet that ends is one of its own flight's."""
    water = {"wifi": {}, "sound": {"range_limit_m": 20, "reverberation_s": 0.1}} if beyond_sound else None
    scenario = two_apads(tmp_path, transfers=True, battery=1.0, water=water)
    data = resolve(scenario)
    data["duration_s"] = 2400 if beyond_sound else 3000
    data["apads"][0]["start_m"] = [54, 10] if beyond_sound else [20, 10]
    each = members(from_data(data, "two"), starts_of(scenario))
    together = open_lockstep(each, scenario.sharing)
    together.runner.run()
    assert together.runner.handed_on_count == 0
    for member in each:
        alone = open_lockstep([member], scenario.sharing)
        alone.runner.run()
        assert alone.recorders[member.name].journal == together.recorders[member.name].journal
        assert alone.figures()[member.name] == together.figures()[member.name]
        assert bool(events_of(alone, member.name, "packet")) is beyond_sound


def test_the_guards_of_each_apad_know_where_the_other_is(tmp_path: Path) -> None:
    opened = open_in(tmp_path, transfers=True)
    first, second = opened.flights["apad1"].flight, opened.flights["apad2"].flight
    for _ in range(30):
        first.step()
        second.step()
    for flight, other, name in ((first, second, "apad2"), (second, first, "apad1")):
        (body,) = flight._vehicle.gate.situation(flight.now_ms).bodies
        pose = other.supervisor.pose
        assert pose is not None and body.agent_id is None and body.name == name
        # One of the two is told at its next tick.
        assert body.place_m == pytest.approx((pose.north_m, pose.east_m), abs=1.0)


def test_who_was_handed_on_is_heard_and_called_by_the_other_aPads_own_modem(tmp_path: Path) -> None:
    opened = open_in(tmp_path, transfers=True, water={"wifi": {}})
    opened.runner.run()
    handed_on = {it["id"]: it["t"] for it in events_of(opened, "apad2", "handed_on")}
    assert handed_on.keys() == {5, 6, 7, 8}
    calls = [it for it in events_of(opened, "apad1", "packet") if it["from"] == 0]
    assert {row[0] for it in calls for row in it["heard"]} >= set(NEEDY)
    # apad2 calls nobody after it has handed them on.
    last = max(handed_on.values())
    assert [it for it in events_of(opened, "apad2", "packet") if it["from"] == 0 and it["t"] > last] == []
    # Each packet of theirs is recorded once, where they are simulated, with its outcome at both aPads.
    after = [it for it in events_of(opened, "apad2", "packet") if it["t"] > last and it["unsent"] is None]
    assert after and all([row[0] for row in it["heard"]].count(-1) == 1 for it in after)
    assert {it["from"] for it in events_of(opened, "apad1", "packet")} <= {0, 1, 2, 3, 4}
    beliefs = opened.flights["apad1"].flight.supervisor.beliefs
    heard_ms = {it.agent_id: it.heard_ms for it in beliefs.all()}
    assert all(heard_ms[it] > at_ms + 1_000_000 for it, at_ms in handed_on.items())
    assert {it["agent"] for it in events_of(opened, "apad1", "released") if it["full"]} == set(NEEDY)
    assert opened.figures()["apad2"]["amussels_lost"] == 0
    # Their samples are kept once, beside the fleet that they belong to.
    uploaded = opened.recorders["apad2"].uploaded
    assert set(NEEDY) <= uploaded.keys() and opened.recorders["apad1"].uploaded.keys() <= {1, 2, 3, 4}
    for records in uploaded.values():
        assert [record.sequence for record in records] == list(range(len(records)))


def agreeing(
    folder: Path, *, third: bool, battery: float, duration_s: float, **network: Any
) -> OpenedLockstep:
    data = resolve(two_apads(folder, transfers=True, battery=battery))
    data["duration_s"] = duration_s
    data["sharing"]["consensus"] = {"loss": 0.3, "delay_s": 5, **network}
    if third:
        data["apads"].append({"name": "apad3", "start_m": [50, 10]})
    scenario = from_data(data, "agreeing")
    return open_lockstep(members(scenario, starts_of(scenario)), scenario.sharing)


def fly_watched(opened: OpenedLockstep) -> dict[str, set[int]]:
    """Flies to the end; an observer of all aPads finds no aMussel granted to two, nor a dock that closes without a grant.

    Returns the aMussels that each aPad docked.
    """
    docked: dict[str, set[int]] = {name: set() for name in opened.flights}
    holding: dict[str, set[int]] = {name: set() for name in opened.flights}
    parts, now_ms, is_over = opened.runner.consensus.parts, 0, False
    recent: list[dict[str, frozenset[int]]] = []
    while not is_over:
        # A docking ends within a minute of its order, for which a grant was there.
        recent = [*recent[-6:], {name: it.granted for name, it in parts.items()}]
        now_ms += 10_000
        opened.runner.run(now_ms)
        is_over = all(it.flight.supervisor.has_ended for it in opened.flights.values())
        granted = [agent_id for it in parts.values() for agent_id in it.granted]
        assert len(granted) == len(set(granted))
        for name, it in opened.flights.items():
            held = set(dict(it.flight.supervisor.mission.state.docked).values())
            assert held - holding[name] <= frozenset().union(*(grants[name] for grants in recent))
            holding[name], docked[name] = held, docked[name] | held
    return docked


def test_an_aPad_that_stands_down_is_followed_by_the_others_agreement(tmp_path: Path) -> None:
    opened = agreeing(tmp_path, third=False, battery=0.005, duration_s=3000)
    docked = fly_watched(opened)
    assert not docked["apad2"] and docked["apad1"] >= set(NEEDY)
    down_ms = events_of(opened, "apad2", "stands_down")[0]["t"]
    took = {it["id"]: it["t"] for it in events_of(opened, "apad1", "took_on")}
    # Nobody has to wait for a lease: the aPad tells that it stands down, and votes for the other.
    assert took.keys() == {5, 6, 7, 8} and max(took.values()) - down_ms < 120_000
    assert opened.runner.handed_on_count == 4


def test_two_take_over_from_a_third_that_falls_silent_and_leave_what_it_has_docked(tmp_path: Path) -> None:
    """It falls silent on its way. It leaves the aMussels to them within a lease, and they dock none that it holds."""
    silences = [{"apad": "apad2", "from_s": 30}]
    opened = agreeing(tmp_path, third=True, battery=1.0, duration_s=3000, silences=silences)
    fly_watched(opened)
    left = {it["id"]: it["t"] for it in events_of(opened, "apad2", "handed_on")}
    took = {it["id"]: it["t"] for name in ("apad1", "apad3") for it in events_of(opened, name, "took_on")}
    assert left and left.keys() <= took.keys()
    assert max(took.values()) <= 30_000 + 180_000 + 2_000 + 7 * 10_000 + 10_000
    consensus = opened.runner.consensus
    assert consensus is not None and consensus.parts["apad2"].granted == frozenset()
