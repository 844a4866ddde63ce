"""Tests the page's data on journals written by hand, whose figures can be computed on paper."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from journals import journal_of
from scenario_files import POOL_FILE

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from apad_bridge.analysis.replay.build import render
from apad_bridge.analysis.replay.series import (
    COLUMNS,
    MAX_SAMPLES,
    MAX_TRACE,
    MAX_VALUES,
    ColourStatus,
    RunView,
    add_rails,
    sample_times,
    whole_view,
)
from apad_bridge.records.sample_file import KeptSample
from apad_bridge.records.truth_lines import truth_event, truth_of
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.water.water_options import Patch
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow, grains
from firmware_model.power.rails import Rail, bits
from firmware_model.states import State

ROOT = Path(__file__).parents[4]
SCENARIO = replace(load(POOL_FILE), theta=10)


def truth(at_ms, agent_id, charge, flow=Flow.RESTING, *, docked=False, secondary=1.0, north_m=1.0):
    state = State.CHARGING if docked else State.ACTIVE
    batteries = Battery(at_ms, grains(charge), flow), Battery(at_ms, grains(secondary), Flow.RESTING)
    physical = Physical(*batteries, round(north_m * 1e6), 2_000_000, 5, 6, Buoyancy.FLOAT, docked)
    return Truth(at_ms, agent_id, state, physical)


def truth_lines(*truths):
    return [{"t": -(-it.at_ms // 10), "kind": "truth", **truth_event(it).data} for it in truths]


def apad(t, north_m, docks=(-1, -1, -1, -1), battery=0.9):
    return {
        "t": t,
        "kind": "apad",
        "north_m": north_m,
        "east_m": 0.0,
        "heading_rad": 0.5,
        "voltage_v": 15.0,
        "battery": battery,
        "primitive": "hold position",
        "docks": list(docks),
    }


def run_line(*ids):
    agents = [{"id": n, "north_m": 1.0, "east_m": 2.0, "primary": 1.0, "secondary": 1.0} for n in ids]
    told = {"scenario": "pool-12", "theta": 10, "seed": 1, "duration_s": 2400.0}
    thresholds = {"pool_threshold": 0.8, "full_threshold": 0.99}
    return {"t": 0, "kind": "run", "format": 2, "agents": agents, **told, **thresholds}


def data_of(*lines, summary=None, dropped=0):
    return whole_view(SCENARIO, journal_of(sorted(lines, key=lambda line: line["t"]), dropped)).data(summary)


def test_a_truth_in_the_journal_is_exact():
    it = truth(123_457, 3, 0.123456789, Flow.CHARGING, docked=True)
    assert truth_of(truth_event(it)) == it
    sampled = replace(it, physical=replace(it.physical, pin_due_ms=5, samples=7, acknowledged=3))
    assert truth_of(truth_event(sampled)) == sampled


def test_colours_say_what_a_threshold_a_dock_and_two_batteries_say():
    lines = truth_lines(
        truth(0, 1, 0.81),
        truth(0, 2, 0.80),
        truth(0, 3, 0.5),
        truth(20_000, 3, 0.5, Flow.CHARGING, docked=True),
        truth(0, 4, 0.0),
        truth(0, 5, 0.0),
        truth(30_000, 5, 0.0, secondary=0.0),
    )
    data = data_of(run_line(1, 2, 3, 4, 5, 6), *lines, {"t": 4000, "kind": "end", "reason": "mission time"})
    assert data["times_ms"] == [0, 1000, 2000, 3000, 4000]
    assert {agent["id"]: agent["status"] for agent in data["agents"]} == {
        1: [ColourStatus.ABOVE] * 5,
        2: [ColourStatus.CANDIDATE] * 5,
        3: [ColourStatus.CANDIDATE] * 2 + [ColourStatus.CHARGING] * 3,
        4: [ColourStatus.EMPTY] * 5,
        5: [ColourStatus.EMPTY] * 3 + [ColourStatus.LOST] * 2,
        6: [ColourStatus.UNKNOWN] * 5,
    }
    # In 4 ticks 1 and 2 are always active, 3 until it is docked at the second tick, 4 and 5 never.
    assert [agent["uptime"][-1] for agent in data["agents"]] == [100, 100, 25, 0, 0, 0]
    assert (data["active"], data["ended_by"]) == ([3, 3, 2, 2, 2], "mission time")


def test_charge_follows_equation_1_between_truths():
    data = data_of(
        run_line(1), *truth_lines(truth(0, 1, 0.9, Flow.DISCHARGING)), {"t": 600_000, "kind": "tick"}
    )
    # A mission minute is ten minutes of agent time: 0.0010427134 a minute.
    charge = dict(zip(data["times_ms"], data["agents"][0]["charge"], strict=True))
    assert charge[0] == 0.9
    for minute in (1, 5, 10):
        assert charge[minute * 60_000] == pytest.approx(0.9 - minute * 10 * 0.0010427134, abs=1e-4)


def test_a_docked_one_is_where_the_aPad_is():
    lines = [
        *truth_lines(truth(0, 1, 0.5, north_m=7.0), truth(20_000, 1, 0.5, docked=True, north_m=7.0)),
        apad(0, 3.0),
        apad(3000, 12.0, docks=(-1, 1, -1, -1)),
        {"t": 4000, "kind": "tick"},
    ]
    data = data_of(run_line(1), *lines)
    assert data["agents"][0]["north"] == [7.0, 7.0, 3.0, 12.0, 12.0]
    assert (data["docks"][-1], data["apad"][0]) == ([None, 1, None, None], [3.0, 0.0, 0.5, 0.9])
    assert data["trace"] == [[0, 3.0, 0.0], [3000, 12.0, 0.0]]


def test_texts_and_cost_follow_the_mission():
    plan = {
        "what": "collect",
        "strategy": "cautious",
        "steps": [{"agent": 4, "dock": 0}, {"agent": 2, "dock": 1}],
        "costs": {"distance_m": 4.5, "demand": 1.0, "distance_cost": 4.5, "energy_cost": 1.0},
        "beliefs": [],
    }
    before = {"plan": [["collect", 4, 0], ["collect", 2, 1]], "cost_m": 2.5}
    lines = [
        {"t": 1000, "kind": "plan", **plan},
        {
            "t": 1000,
            "kind": "primitive",
            "name": "go to point",
            "phase": "started",
            "north_m": 1.0,
            "east_m": 2.0,
        },
        {
            "t": 1000,
            "kind": "primitive",
            "name": "hold position",
            "phase": "succeeded",
            "north_m": 0,
            "east_m": 0,
        },
        {"t": 1000, "kind": "leg", "metres": 4.5},
        {
            "t": 1000,
            "kind": "mission",
            "phase": "go to aMussel",
            "snapshot": before,
        },
        {
            "t": 2000,
            "kind": "primitive",
            "name": "go to point",
            "phase": "succeeded",
            "north_m": 1.0,
            "east_m": 2.0,
        },
        {"t": 3000, "kind": "primitive", "name": "dock", "phase": "started", "agent": 4, "dock": 0},
        {
            "t": 3000,
            "kind": "mission",
            "phase": "dock",
            "snapshot": {"plan": [["collect", 2, 1]], "cost_m": 3.5},
        },
        apad(3000, 9.0, docks=(4, -1, -1, -1)),
    ]
    data = data_of(run_line(2, 4), *lines)
    stages = [data["stages"][n] for n in data["stage"]]
    assert [stage["primitive"] for stage in stages] == [
        "",
        "go to point 1.0 m north, 2.0 m east",
        "",
        "dock aMussel 4, dock 1",
    ]
    assert stages[0]["plan"] is None
    assert stages[1]["plan"] == {
        "what": "collect",
        "strategy": "cautious",
        "steps": [[4, 0], [2, 1]],
        "places": [],
        "done": 0,
    }
    assert stages[3]["plan"]["done"] == 1 and stages[3]["phase"] == "dock"
    assert (data["cost"], data["docks"][3]) == ([0, 2.5, 2.5, 3.5], [4, None, None, None])


def test_a_plan_goes_to_the_places_that_are_the_aMussels_then_and_counts_its_own_steps():
    """They exchanged places: 4 is brought back to where 2 was. A tour on which some leave has two collections left."""
    homes, costs = [[2, 7.0, 8.0], [4, 1.0, 2.0]], {"distance_m": 1, "demand": 1, "distance_cost": 1}
    plan = {"kind": "plan", "strategy": "any", "costs": costs, "beliefs": []}
    steps = [{"agent": 4, "dock": 0}, {"agent": 2, "dock": 1}]
    tour = [["collect", 4, 0], ["deploy", 5, 1], ["collect", 2, 1], ["deploy", 6, 2]]
    lines = [
        {"t": 0, **plan, "what": "collect", "steps": steps},
        {
            "t": 0,
            "kind": "mission",
            "phase": "idle wait",
            "snapshot": {"plan": tour, "cost_m": 0, "homes": homes},
        },
        apad(0, 1.0),
        {"t": 1000, **plan, "what": "redeploy", "steps": steps},
        apad(1000, 1.0),
    ]
    data = data_of(run_line(2, 4), *lines)
    first, second = [data["stages"][n]["plan"] for n in data["stage"]]
    assert first["done"] == 0 and first["places"] == []
    assert second["places"] == [[1.0, 2.0], [7.0, 8.0]]


def test_without_truth_the_page_shows_what_was_believed():
    belief = {
        "kind": "belief",
        "heard": 0,
        "state": "ACTIVE",
        "secondary": 1.0,
        "north_m": 5.0,
        "east_m": 6.0,
    }
    lines = [
        {"t": 1000, "id": 1, "charge": 0.9, **belief},
        {"t": 2000, "id": 1, "charge": 0.7, **belief, "reported": {"depth_m": 3.5}},
        apad(3000, 9.0, docks=(1, -1, -1, -1)),
    ]
    data = data_of(run_line(1), *lines)
    assert data["has_truth"] is False
    (agent,) = data["agents"]
    assert agent["charge"] == [None, 0.9, 0.7, 0.7]
    depth = data["quantities"].index(["depth_m", "depth", "m"])
    assert [it and it[depth] for it in agent["reported"]] == [None, None, 3.5, 3.5]
    assert agent["status"] == [
        ColourStatus.UNKNOWN,
        ColourStatus.ABOVE,
        ColourStatus.CANDIDATE,
        ColourStatus.CHARGING,
    ]
    assert agent["north"] == [None, 5.0, 5.0, 9.0]


def test_one_that_was_given_up_is_grey():
    died = {"t": 2000, "kind": "died", "id": 1, "agent_ms": 20_000, "gave_up": "it died too often"}
    died |= {"cause": "BROWN_OUT", "reason": "killed"}
    data = data_of(run_line(1), *truth_lines(truth(0, 1, 0.9)), died, {"t": 4000, "kind": "tick"})
    assert data["agents"][0]["status"] == [ColourStatus.ABOVE] * 2 + [ColourStatus.LOST] * 3
    assert data["active"] == [1, 1, 0, 0, 0]


@pytest.mark.parametrize(
    ("end_ms", "agents"), [(0, 1), (1500, 1), (2_400_000, 12), (864_000_000, 24), (864_000_000, 5000)]
)
def test_a_page_stays_small_however_long_the_run(end_ms, agents):
    times = sample_times(end_ms, agents)
    assert times[0] == 0 and times[-1] == end_ms // 1000 * 1000
    assert times == sorted(set(times)) and all(time % 1000 == 0 for time in times)
    assert len(times) <= MAX_SAMPLES
    assert len(times) * agents <= max(MAX_VALUES, 60 * agents)


def test_a_journal_that_never_began_is_said():
    with pytest.raises(ValueError, match="no line `run`"):
        data_of({"t": 0, "kind": "tick"})


def test_no_text_of_a_scenario_ends_the_pages_script():
    hostile = "</script><script>alert(1)</script><!--SCRIPT-->"
    data = {**data_of(run_line(1)), "name": hostile, "description": hostile}
    page = render([data])
    assert page.count("</script>") == 3
    assert "alert(1)</script>" not in page and "&lt;/script&gt;" in page


def test_the_page_needs_no_network():
    page = render([data_of(run_line(1))])
    named = (
        "/*! https://github.com/leeoniya/uPlot (v1.6.32) */"  # the library's name, in a comment of its own
    )
    assert page.count(named) == 1
    page = page.replace(named, "")
    for reference in ("http://", "https://", "src=", "@import", "url(", "<link"):
        assert reference not in page


def test_an_estimate_stands_beside_the_truth_with_its_interval():
    def believed(t, agent_id, charge, **more):
        line = {"t": t, "kind": "belief", "id": agent_id, "heard": t, "state": "ACTIVE", "charge": charge}
        return {**line, "secondary": 1.0, "north_m": 1.0, "east_m": 2.0, **more}

    lines = [
        *truth_lines(truth(0, 1, 0.8), truth(0, 2, 0.8)),
        believed(0, 2, 0.8),
        believed(1000, 1, 0.75, sd=0.02, low=0.71, high=0.79, mode="IDLE"),
        believed(2000, 3, 0.6, sd=0.01, low=0.58, high=0.62, mode="IDLE"),
        believed(3000, 1, 0.7, sd=0.02, low=0.66, high=0.74, mode="IDLE"),
        {"t": 4000, "kind": "end", "reason": "mission time"},
    ]
    agents = {agent["id"]: agent for agent in data_of(run_line(1, 2, 3), *lines)["agents"]}
    assert (agents[1]["charge"], agents[1]["believed"]) == ([0.8] * 5, [None, 0.75, 0.75, 0.7, 0.7])
    assert agents[1]["low"] == [None, 0.71, 0.71, 0.66, 0.66]
    assert agents[1]["high"] == [None, 0.79, 0.79, 0.74, 0.74]
    # The second has no interval; the third has no truth.
    assert (agents[2]["believed"], agents[2]["low"], agents[2]["high"]) == ([0.8] * 5, None, None)
    assert agents[3]["believed"] is None and agents[3]["charge"] == [None, None, 0.6, 0.6, 0.6]
    assert agents[3]["low"] == [None, None, 0.58, 0.58, 0.58]


def story():
    return [
        run_line(1, 2),
        *truth_lines(truth(0, 1, 0.81), truth(0, 2, 0.5)),
        apad(0, 3.0),
        {"t": 1000, "kind": "dock", "dock": 0, "agent": 2, "closed": True},
        *truth_lines(truth(20_000, 2, 0.5, Flow.CHARGING, docked=True)),
        apad(3000, 5.0, docks=(2, -1, -1, -1)),
        {"t": 3000, "kind": "remark", "text": "a <b>boat", "by": "Anna"},
        {"t": 4000, "kind": "end", "reason": "mission time"},
    ]


def test_a_run_that_is_followed_shows_the_same_as_one_that_is_read_at_its_end():
    lines = story()
    followed = RunView(SCENARIO, journal_of(lines[:1]), 4000)
    followed.sample(-1)
    for line in lines[1:]:
        followed.add(journal_of([line]))
    for now_ms in range(0, 5000, 1000):
        followed.sample(now_ms)
    whole, live = data_of(*lines), followed.data(None)
    for agent in live["agents"]:
        for name in ("north", "east", "charge", "status", "uptime", "secondary", "state"):
            del agent[name][0]
    for name in ("times_ms", "active", "cost", "apad", "docks", "stage"):
        del live[name][0]
    assert live == whole


def test_a_sample_that_is_taken_again_has_the_lines_that_came_after_it():
    *lines, end = story()
    view = RunView(SCENARIO, journal_of(lines), 4000)
    for now_ms in range(0, 5000, 1000):
        view.sample(now_ms)
    assert not view.has_late_lines and view.ended_by is None
    view.add(journal_of([end]))
    assert view.has_late_lines
    view.sample(4000)
    assert not view.has_late_lines and view.data(None) == data_of(*story())


def test_the_newest_sample_brings_what_a_page_lacks_and_no_more():
    lines = story()
    view = RunView(SCENARIO, journal_of(lines[:4]), 4000)
    view.sample(0)
    before = view.counts
    view.add(journal_of(lines[4:]))
    view.sample(4000)
    newest = view.newest(before)
    assert newest["t"] == 4000 and newest["docks"] == [2, None, None, None]
    assert newest["trace"] == [[3000, 5.0, 0.0]]
    assert newest["events"] == [
        [1000, "plan", "dock 1 closed around aMussel 2", 2],
        [3000, "word", "Anna: a <b>boat", None],
        [4000, "news", "the mission ended: mission time", None],
    ]
    for name in ("trace", "events", "plans", "packets"):
        assert view.newest(view.counts)[name] == []


def test_thinning_keeps_the_newest_sample_and_the_columns_alike_long():
    view = RunView(SCENARIO, journal_of(story()), 4000)
    for now_ms in range(0, 5000, 1000):
        view.sample(now_ms)
    view.thin()
    data = view.data(None)
    assert data["times_ms"] == [0, 2000, 4000]
    assert [agent["status"] for agent in data["agents"]] == [
        [ColourStatus.ABOVE] * 3,
        [ColourStatus.CANDIDATE, ColourStatus.CHARGING, ColourStatus.CHARGING],
    ]
    assert {len(data[name]) for name in ("active", "cost", "apad", "docks", "stage")} == {3}


def test_packets_and_plans_are_those_of_the_journal():
    packet = {
        "t": 3000,
        "kind": "packet",
        "from": 2,
        "address": None,
        "what": "ping",
        "bytes": 4,
        "began_ms": 20_000,
        "lasted_ms": 200,
        "timeslot": 7,
        "unsent": None,
        "heard": [[0, "received", 1.0, 1, 1.0, 1.0], [1, "noise", 1.0, 1, 1.0, 1.0]],
        "data": "",
    }
    plan = {"t": 2000, "kind": "plan", "what": "collect", "strategy": "exact", "steps": [], "costs": {}}
    plan |= {"beliefs": [], "options": [{"agents": [1], "cost": 2.0, "parts": {"way": 2.0}}]}
    data = data_of(run_line(1, 2), *truth_lines(truth(0, 1, 0.5, secondary=0.25)), plan, packet)
    assert data["packets"] == [(2000, 200, 2, "ping", None, None, ((0, "received"),), 1, 7)]
    assert data["earlier_packets"] == 0
    # The reasons of a plan go along.
    assert [it["options"] for it in data["plans"]] == [plan["options"]]
    assert data["agents"][0]["secondary"][-1] == 0.25 and data["agents"][1]["secondary"][-1] is None
    assert data["states"][data["agents"][0]["state"][-1]] == "active"


def test_a_suspect_is_named_with_its_time_and_its_reason():
    """To a page that is open already, too."""
    suspect = {"t": 3000, "kind": "suspect", "id": 2, "reason": "its charge rose in the water"}
    view = RunView(SCENARIO, journal_of([run_line(1, 2)]))
    view.sample(0)
    assert view.data(None)["suspects"] == []
    before = view.counts
    view.add(journal_of([suspect]))
    view.sample(3000)
    assert view.newest(before)["suspects"] == [(3000, 2, "its charge rose in the water", None)]
    assert view.data(None)["suspects"] == view.newest(view.counts)["suspects"]
    view.add(journal_of([{"t": 5000, "kind": "suspect_over", "id": 2}]))
    view.sample(5000)
    assert view.data(None)["suspects"] == [(3000, 2, "its charge rose in the water", 5000)]


def test_what_a_twin_learned_of_a_capacity_holds_until_it_knows_better():
    """To a page that is open already, too; a run without twins has no such column."""
    view = RunView(SCENARIO, journal_of([run_line(1, 2)]))
    view.sample(0)
    assert [it["capacity"] for it in view.data(None)["agents"]] == [None, None]
    learned = [
        {"t": 1000, "kind": "capacity", "id": 2, "low": 0.6, "high": 1.0},
        {"t": 3000, "kind": "capacity", "id": 2, "low": 0.7312, "high": 0.8188},
    ]
    view.add(journal_of(learned))
    for now_ms in (1000, 2000, 3000):
        view.sample(now_ms)
    assert [it["capacity"] for it in view.data(None)["agents"]] == [
        None,
        [None, [0.6, 1.0], [0.6, 1.0], [0.73, 0.82]],
    ]
    assert view.newest(view.counts)["agents"][1][COLUMNS.index("capacity")] == [0.73, 0.82]


def test_the_page_without_its_data_is_small():
    assert len(render([{"name": "x"}]).encode()) < 400_000


def test_a_sample_has_each_module_that_was_on_since_the_one_before():
    """Of switches between two samples none is lost, however short it was on."""
    data = data_of(run_line(1, 2), *truth_lines(truth(0, 1, 0.9)), {"t": 3000, "kind": "tick"})
    wifi, motors = bits(Rail.WIFI), bits(Rail.MOTORS)
    # Ten times faster: 10 000 ms of the board are a sample's second.
    add_rails(data, {1: [(0, wifi), (12_000, wifi | motors), (12_001, wifi), (25_000, 0)]})
    assert [agent.get("rails") for agent in data["agents"]] == [[wifi, wifi, wifi | motors, wifi], None]
    assert data["rails"][Rail.MOTORS] == "motors"


def test_samples_of_the_log_are_counted_where_a_board_has_one():
    logged = truth(10_000, 1, 0.9)
    logged = replace(logged, physical=replace(logged.physical, samples=7, acknowledged=3))
    lines = truth_lines(truth(0, 1, 0.9), logged, truth(0, 2, 0.9))
    first, second = data_of(run_line(1, 2), *lines, {"t": 2000, "kind": "tick"})["agents"]
    assert (first["taken"], first["acknowledged"]) == ([None, 7, 7], [None, 3, 3])
    assert (second["taken"], second["acknowledged"]) == (None, None)


def uploaded(agent_id, sequence, mission_ms, **values):
    return KeptSample(agent_id, sequence, {"mission_ms": mission_ms, **values})


def test_measured_values_stand_beside_the_truth_of_the_water_where_the_aMussel_is():
    """On the bottom, 3 m deep. Oxygen falls from 8.5 at the surface to 6 in 8 m, and a patch without any grows over it."""
    scenario = load(ROOT / "launch_scripts" / "scenarios" / "sound-12.yaml")
    patch = Patch(begins_s=60.0, growing_s=30.0, place_m=(1.0, 2.0), radius_m=5.0, oxygen_mg_l=0.0)
    fields = replace(scenario.water.fields, oxygen_mg_l=((0.0, 8.5), (8.0, 6.0)), patches=(patch,))
    scenario = replace(scenario, water=replace(scenario.water, fields=fields))
    resting = truth(0, 1, 0.9)
    below = replace(resting.physical, depth_um=3_000_000, depth_anchor_ms=0, buoyancy=Buoyancy.SINK)
    resting, docked = replace(resting, physical=below), truth(0, 2, 0.9, docked=True)
    lines = [*truth_lines(resting, docked), {"t": 3000, "kind": "tick"}]
    samples = [
        uploaded(
            1, 1, 2000.0, oxygen_mg_l=7.5, temperature_c=18.01, turbidity_ntu=math.nan, pressure_mbar="x"
        ),
        uploaded(1, 0, 1000.0, oxygen_mg_l=7.6),
        uploaded(1, 2, None, oxygen_mg_l=7.7),
    ]
    data = whole_view(scenario, journal_of([run_line(1, 2, 3), *lines]), samples).data(None)
    assert [it[0] for it in data["sensors"]] == ["oxygen", "pressure", "temperature", "turbidity"]
    assert data["sensors"][0] == ["oxygen", "mg/l"]
    assert data["measured"] == [
        [2000.0, 1, 7.5, None, 18.01, None],
        [1000.0, 1, 7.6, None, None, None],
    ]
    calm, water = 8.5 - 2.5 * 3 / 8, data["agents"][0]["water"]
    mbar = 1013.25 + 1025 * 9.80665 * 3 / 100
    # The mission's third second is the board's 90th: the patch has grown for all of its 30 s.
    assert water[0] == pytest.approx([calm, mbar, 18.0, 5.0], abs=1e-4)
    assert [it[0] for it in water] == pytest.approx([calm, calm, calm, 0.0], abs=1e-4)
    # In a dock it is out of the water, and of the third nobody knows where it is.
    assert [agent["water"] for agent in data["agents"][1:]] == [None, None]


def test_a_followed_run_has_each_uploaded_sample_once_with_its_next_tick():
    view = RunView(SCENARIO, journal_of(story()), 4000)
    view.sample(0)
    before = view.counts
    view.take_samples([uploaded(1, 0, 0.0, oxygen_mg_l=8.0)])
    assert view.newest(before)["measured"] == view.data(None)["measured"] == []
    view.sample(1000)
    assert view.newest(before)["measured"] == view.data(None)["measured"] == [[0.0, 1, 8.0, None, None, None]]
    assert view.newest(view.counts)["measured"] == []


def test_a_thinned_track_keeps_its_ends_and_says_how_far_off_it_is():
    straight = [apad(1000 * n, float(n)) for n in range(2 * MAX_TRACE)]
    assert data_of(run_line(1), *straight)["thinned"]["track_m"] == 0
    bent = [*straight[:4001], {**straight[4001], "east_m": 2.5}, *straight[4002:]]
    data = data_of(run_line(1), *bent)
    assert data["thinned"]["track_m"] == 2.5 and len(data["trace"]) <= MAX_TRACE + 1
    assert (data["trace"][0][0], data["trace"][-1][0]) == (0, 1000 * (2 * MAX_TRACE - 1))


def test_boards_with_timeslots_state_them():
    assert data_of(run_line(1))["timeslots"] is None
    scenario = load(ROOT / "launch_scripts" / "scenarios" / "sound-12.yaml")
    slots = whole_view(scenario, journal_of([run_line(1)])).data(None)["timeslots"]
    assert slots == {"frame_ms": 300_000, "slot_ms": 5000}
