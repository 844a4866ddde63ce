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


def truth(
    at_ms, agent_id, charge, flow=Flow.RESTING, *, docked=False, secondary=1.0, north_m=1.0, **physically
):
    state = State.CHARGING if docked else State.ACTIVE
    batteries = Battery(at_ms, grains(charge), flow), Battery(at_ms, grains(secondary), Flow.RESTING)
    physical = Physical(*batteries, round(north_m * 1e6), 2_000_000, 5, 6, Buoyancy.FLOAT, docked)
    return Truth(at_ms, agent_id, state, replace(physical, **physically))


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


@pytest.mark.parametrize("changes", [{}, {"pin_due_ms": 5, "samples": 7, "acknowledged": 3}])
def test_a_truth_in_the_journal_is_exact(changes):
    it = truth(123_457, 3, 0.123456789, Flow.CHARGING, docked=True, **changes)
    assert truth_of(truth_event(it)) == it


def believed(t, agent_id, charge, **more):
    line = {"t": t, "kind": "belief", "id": agent_id, "heard": t, "state": "ACTIVE", "charge": charge}
    return {**line, "secondary": 1.0, "north_m": 5.0, "east_m": 6.0, **more}


def interval(t, charge, low, high):
    return believed(t, 1, charge, sd=0.02, low=low, high=high, mode="IDLE")


def mission(t, phase, **snapshot):
    return {"t": t, "kind": "mission", "phase": phase, "snapshot": snapshot}


def at_the_end(t):
    return {"t": t, "kind": "end", "reason": "mission time"}


ABOVE, CANDIDATE, CHARGING = ColourStatus.ABOVE, ColourStatus.CANDIDATE, ColourStatus.CHARGING
EMPTY, LOST, UNKNOWN = ColourStatus.EMPTY, ColourStatus.LOST, ColourStatus.UNKNOWN
DIED = {"t": 2000, "kind": "died", "id": 1, "agent_ms": 20_000, "gave_up": "it died too often"}
PACKET = {"t": 3000, "kind": "packet", "from": 2, "address": None, "what": "ping", "bytes": 4, "data": ""}
PACKET |= {"began_ms": 20_000, "lasted_ms": 200, "timeslot": 7, "unsent": None}
PACKET |= {"heard": [[0, "received", 1.0, 1, 1.0, 1.0], [1, "noise", 1.0, 1, 1.0, 1.0]]}
PLAN = {
    "t": 2000,
    "kind": "plan",
    "what": "collect",
    "strategy": "exact",
    "steps": [],
    "costs": {},
    "beliefs": [],
}
PLAN |= {"options": [{"agents": [1], "cost": 2.0, "parts": {"way": 2.0}}]}
STEPS = [{"agent": 4, "dock": 0}, {"agent": 2, "dock": 1}]
TOUR = [["collect", 4, 0], ["deploy", 5, 1], ["collect", 2, 1], ["deploy", 6, 2]]
COSTS = {"distance_m": 4.5, "demand": 1.0, "distance_cost": 4.5, "energy_cost": 1.0}
PLANNED = {"kind": "plan", "strategy": "any", "costs": COSTS, "beliefs": []}
GO_TO = {"kind": "primitive", "name": "go to point", "north_m": 1.0, "east_m": 2.0}
PAGES = {
    "a threshold, a dock and two batteries give the colours; charging and empty ones are not active": (
        6,
        [
            *truth_lines(truth(0, 1, 0.81), truth(0, 2, 0.80), truth(0, 3, 0.5)),
            *truth_lines(truth(20_000, 3, 0.5, Flow.CHARGING, docked=True)),
            *truth_lines(truth(0, 4, 0.0), truth(0, 5, 0.0), truth(30_000, 5, 0.0, secondary=0.0)),
            at_the_end(4000),
        ],
        {
            "times_ms": [0, 1000, 2000, 3000, 4000],
            "agents.0.status": [ABOVE] * 5,
            "agents.1.status": [CANDIDATE] * 5,
            "agents.2.status": [CANDIDATE] * 2 + [CHARGING] * 3,
            "agents.3.status": [EMPTY] * 5,
            "agents.4.status": [EMPTY] * 3 + [LOST] * 2,
            "agents.5.status": [UNKNOWN] * 5,
            **{f"agents.{n}.uptime.-1": share for n, share in enumerate((100, 100, 25, 0, 0, 0))},
            "active": [3, 3, 2, 2, 2],
            "ended_by": "mission time",
        },
    ),
    # A mission minute is ten minutes of agent time.
    "charge follows equation 1 between truths": (
        1,
        [*truth_lines(truth(0, 1, 0.9, Flow.DISCHARGING)), {"t": 600_000, "kind": "tick"}],
        {
            "times_ms": [2000 * n for n in range(301)],
            "agents.0.charge": pytest.approx([0.9 - n / 3 * 0.0010427134 for n in range(301)], abs=1e-4),
        },
    ),
    "a docked one is where the aPad is": (
        1,
        [
            *truth_lines(truth(0, 1, 0.5, north_m=7.0), truth(20_000, 1, 0.5, docked=True, north_m=7.0)),
            apad(0, 3.0),
            apad(3000, 12.0, docks=(-1, 1, -1, -1)),
            {"t": 4000, "kind": "tick"},
        ],
        {
            "agents.0.north": [7.0, 7.0, 3.0, 12.0, 12.0],
            "docks.-1": [None, 1, None, None],
            "apad.0": [3.0, 0.0, 0.5, 0.9],
            "trace": [[0, 3.0, 0.0], [3000, 12.0, 0.0]],
        },
    ),
    "without truth it shows what was believed": (
        1,
        [
            believed(1000, 1, 0.9),
            believed(2000, 1, 0.7, reported={"depth_m": 3.5}),
            apad(3000, 9.0, docks=(1, -1, -1, -1)),
        ],
        {
            "has_truth": False,
            "agents.0.charge": [None, 0.9, 0.7, 0.7],
            "agents.0.status": [UNKNOWN, ABOVE, CANDIDATE, CHARGING],
            "agents.0.north": [None, 5.0, 5.0, 9.0],
        },
    ),
    "one that was given up is grey": (
        1,
        [
            *truth_lines(truth(0, 1, 0.9)),
            DIED | {"cause": "BROWN_OUT", "reason": "killed"},
            {"t": 4000, "kind": "tick"},
        ],
        {"agents.0.status": [ABOVE] * 2 + [LOST] * 3, "active": [1, 1, 0, 0, 0]},
    ),
    # The second has no interval; the third has no truth.
    "an estimate stands beside the truth with its interval": (
        3,
        [
            *truth_lines(truth(0, 1, 0.8), truth(0, 2, 0.8)),
            believed(0, 2, 0.8),
            interval(1000, 0.75, 0.71, 0.79),
            interval(3000, 0.7, 0.66, 0.74),
            interval(2000, 0.6, 0.58, 0.62) | {"id": 3},
            at_the_end(4000),
        ],
        {
            "agents.0.charge": [0.8] * 5,
            "agents.0.believed": [None, 0.75, 0.75, 0.7, 0.7],
            "agents.0.low": [None, 0.71, 0.71, 0.66, 0.66],
            "agents.0.high": [None, 0.79, 0.79, 0.74, 0.74],
            "agents.1.believed": [0.8] * 5,
            **{"agents.1.low": None, "agents.1.high": None, "agents.2.believed": None},
            "agents.2.charge": [None, None, 0.6, 0.6, 0.6],
            "agents.2.low": [None, None, 0.58, 0.58, 0.58],
        },
    ),
    "packets and plans with their reasons are those of the journal": (
        2,
        [*truth_lines(truth(0, 1, 0.5, secondary=0.25)), PLAN, PACKET],
        {
            "packets": [(2000, 200, 2, "ping", None, None, ((0, "received"),), 1, 7)],
            "earlier_packets": 0,
            "plans.0.options": PLAN["options"],
            **{"agents.0.secondary.-1": 0.25, "agents.1.secondary.-1": None, "agents.0.state.-1": 2},
            "states.2": "active",
        },
    ),
    "samples of the log are counted where a board has one": (
        2,
        [
            *truth_lines(
                truth(0, 1, 0.9), truth(10_000, 1, 0.9, samples=7, acknowledged=3), truth(0, 2, 0.9)
            ),
            {"t": 2000, "kind": "tick"},
        ],
        {
            "agents.0.taken": [None, 7, 7],
            "agents.0.acknowledged": [None, 3, 3],
            **{"agents.1.taken": None, "agents.1.acknowledged": None},
        },
    ),
    "texts and cost follow the mission": (
        4,
        [
            {"t": 1000, **PLANNED, "what": "collect", "steps": STEPS},
            {"t": 1000, **GO_TO, "phase": "started"},
            {"t": 1000, **GO_TO, "name": "hold position", "phase": "succeeded"},
            {"t": 1000, "kind": "leg", "metres": 4.5},
            mission(1000, "go to aMussel", plan=[["collect", 4, 0], ["collect", 2, 1]], cost_m=2.5),
            {"t": 2000, **GO_TO, "phase": "succeeded"},
            {"t": 3000, "kind": "primitive", "name": "dock", "phase": "started", "agent": 4, "dock": 0},
            mission(3000, "dock", plan=[["collect", 2, 1]], cost_m=3.5),
            apad(3000, 9.0, docks=(4, -1, -1, -1)),
        ],
        {
            "now.0.primitive": "",
            "now.0.plan": None,
            "now.1.primitive": "go to point 1.0 m north, 2.0 m east",
            "now.1.plan": {
                "what": "collect",
                "strategy": "any",
                "steps": [[4, 0], [2, 1]],
                "places": [],
                "done": 0,
            },
            "now.2.primitive": "",
            "now.3.primitive": "dock aMussel 4, dock 1",
            "now.3.plan.done": 1,
            "now.3.phase": "dock",
            "cost": [0, 2.5, 2.5, 3.5],
            "docks.3": [4, None, None, None],
        },
    ),
    # They exchanged places: 4 is brought back to where 2 was. A tour on which some leave has two collections left.
    "a plan goes to the places that are the aMussels' then and counts its own steps": (
        4,
        [
            {"t": 0, **PLANNED, "what": "collect", "steps": STEPS},
            mission(0, "idle wait", plan=TOUR, cost_m=0, homes=[[2, 7.0, 8.0], [4, 1.0, 2.0]]),
            {"t": 1000, **PLANNED, "what": "redeploy", "steps": STEPS},
            apad(0, 1.0),
            apad(1000, 1.0),
        ],
        {"now.0.plan.done": 0, "now.0.plan.places": [], "now.1.plan.places": [[1.0, 2.0], [7.0, 8.0]]},
    ),
}
"""How many aMussels there are, what the journal has, and what the page shows."""


def part_of(data, path):
    """The part of a page's data at a path, such as agents.0.north."""
    for step in path.split("."):
        data = data[step] if isinstance(data, dict) else data[int(step)]
    return data


@pytest.mark.parametrize(("count", "lines", "wanted"), PAGES.values(), ids=PAGES)
def test_the_page_shows_what_the_journal_says(count, lines, wanted):
    """The stage at each time is `now`."""
    data = data_of(run_line(*range(1, count + 1)), *lines)
    data["now"] = [data["stages"][n] for n in data["stage"]]
    assert {path: part_of(data, path) for path in wanted} == wanted


def test_what_it_reports_is_shown_by_its_quantity():
    data = data_of(run_line(1), believed(1000, 1, 0.9), believed(2000, 1, 0.7, reported={"depth_m": 3.5}))
    depth = data["quantities"].index(["depth_m", "depth", "m"])
    assert [it and it[depth] for it in data["agents"][0]["reported"]] == [None, None, 3.5]


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


def test_no_text_of_a_scenario_ends_the_pages_script_and_the_page_needs_no_network():
    hostile = "</script><script>alert(1)</script><!--SCRIPT-->"
    page = render([{**data_of(run_line(1)), "name": hostile, "description": hostile}])
    assert page.count("</script>") == 3 and "alert(1)</script>" not in page and "&lt;/script&gt;" in page
    # The library's name stands in a comment of its own.
    before, after = page.split("/*! https://github.com/leeoniya/uPlot (v1.6.32) */")
    references = ("http://", "https://", "src=", "@import", "url(", "<link")
    assert [it for it in references if it in before + after] == []
    assert len(render([{"name": "x"}]).encode()) < 400_000, "the page without its data is small"


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


def followed(lines, until_ms=5000):
    """A view of these lines that was sampled each second."""
    view = RunView(SCENARIO, journal_of(lines), 4000)
    for now_ms in range(0, until_ms, 1000):
        view.sample(now_ms)
    return view


def test_a_run_that_is_followed_shows_the_same_as_one_that_is_read_at_its_end():
    lines = story()
    view = RunView(SCENARIO, journal_of(lines[:1]), 4000)
    view.sample(-1)
    for line in lines[1:]:
        view.add(journal_of([line]))
    for now_ms in range(0, 5000, 1000):
        view.sample(now_ms)
    whole, live = data_of(*lines), view.data(None)
    columns = [live[name] for name in ("times_ms", "active", "cost", "apad", "docks", "stage")]
    its = ("north", "east", "charge", "status", "uptime", "secondary", "state")
    for column in [*columns, *(agent[name] for agent in live["agents"] for name in its)]:
        del column[0]
    assert live == whole


def test_a_sample_that_is_taken_again_has_the_lines_that_came_after_it():
    *lines, end = story()
    view = followed(lines)
    assert not view.has_late_lines and view.ended_by is None
    view.add(journal_of([end]))
    assert view.has_late_lines
    view.sample(4000)
    assert not view.has_late_lines and view.data(None) == data_of(*story())


SUSPECT = {"t": 3000, "kind": "suspect", "id": 2, "reason": "its charge rose in the water"}
CAPACITY, NOTHING = {"kind": "capacity", "id": 2}, ("trace", "events", "plans", "packets")
VIEWS = {
    "the newest sample brings what a page lacks and no more": [
        (story()[1:4], 0, {}),
        (
            story()[4:],
            4000,
            {
                "newest.t": 4000,
                "newest.docks": [2, None, None, None],
                "newest.trace": [[3000, 5.0, 0.0]],
                "newest.events": [
                    [1000, "plan", "dock 1 closed around aMussel 2", 2],
                    [3000, "word", "Anna: a <b>boat", None],
                    [4000, "news", "the mission ended: mission time", None],
                ],
            },
        ),
        ([], 4000, {f"newest.{name}": [] for name in NOTHING}),
    ],
    "a suspect is named with its time and its reason, to a page that is open already, too": [
        ([], 0, {"data.suspects": []}),
        (
            [SUSPECT],
            3000,
            {f"{it}.suspects": [(3000, 2, SUSPECT["reason"], None)] for it in ("newest", "data")},
        ),
        (
            [{"t": 5000, "kind": "suspect_over", "id": 2}],
            5000,
            {f"{it}.suspects": [(3000, 2, SUSPECT["reason"], 5000)] for it in ("newest", "data")},
        ),
    ],
    "what a twin learned of a capacity holds until it knows better; without twins there is no such column": [
        ([], 0, {"data.agents.0.capacity": None, "data.agents.1.capacity": None}),
        ([{"t": 1000, **CAPACITY, "low": 0.6, "high": 1.0}], 1000, {}),
        ([], 2000, {}),
        (
            [{"t": 3000, **CAPACITY, "low": 0.7312, "high": 0.8188}],
            3000,
            {
                "data.agents.0.capacity": None,
                "data.agents.1.capacity": [None, [0.6, 1.0], [0.6, 1.0], [0.73, 0.82]],
                f"newest.agents.1.{COLUMNS.index('capacity')}": [0.73, 0.82],
            },
        ),
    ],
}
"""The lines that come, the time of the sample, and what the newest sample and the whole data show then."""


@pytest.mark.parametrize("steps", VIEWS.values(), ids=VIEWS)
def test_a_view_that_is_followed(steps):
    view = RunView(SCENARIO, journal_of([run_line(1, 2)]), 4000)
    for lines, now_ms, wanted in steps:
        before = view.counts
        view.add(journal_of(lines))
        view.sample(now_ms)
        shown = {"newest": view.newest(before), "data": view.data(None)}
        assert {path: part_of(shown, path) for path in wanted} == wanted


def test_thinning_keeps_the_newest_sample_and_the_columns_alike_long():
    view = followed(story())
    view.thin()
    data = view.data(None)
    statuses = [agent["status"] for agent in data["agents"]]
    assert data["times_ms"] == [0, 2000, 4000]
    assert statuses == [[ABOVE] * 3, [CANDIDATE, CHARGING, CHARGING]]
    assert {len(data[name]) for name in ("active", "cost", "apad", "docks", "stage")} == {3}


def test_a_sample_has_each_module_that_was_on_since_the_one_before():
    """Of switches between two samples none is lost, however short it was on."""
    data = data_of(run_line(1, 2), *truth_lines(truth(0, 1, 0.9)), {"t": 3000, "kind": "tick"})
    wifi, motors = bits(Rail.WIFI), bits(Rail.MOTORS)
    # Ten times faster: 10 000 ms of the board are a sample's second.
    add_rails(data, {1: [(0, wifi), (12_000, wifi | motors), (12_001, wifi), (25_000, 0)]})
    assert [agent.get("rails") for agent in data["agents"]] == [[wifi, wifi, wifi | motors, wifi], None]
    assert data["rails"][Rail.MOTORS] == "motors"


def uploaded(agent_id, sequence, mission_ms, **values):
    return KeptSample(agent_id, sequence, {"mission_ms": mission_ms, **values})


def test_measured_values_stand_beside_the_truth_of_the_water_where_the_aMussel_is():
    """On the bottom, 3 m deep. Oxygen falls from 8.5 at the surface to 6 in 8 m, and a patch without any grows over it."""
    scenario = load(ROOT / "launch_scripts" / "scenarios" / "sound-12.yaml")
    patch = Patch(begins_s=60.0, growing_s=30.0, place_m=(1.0, 2.0), radius_m=5.0, oxygen_mg_l=0.0)
    fields = replace(scenario.water.fields, oxygen_mg_l=((0.0, 8.5), (8.0, 6.0)), patches=(patch,))
    scenario = replace(scenario, water=replace(scenario.water, fields=fields))
    below = {"depth_um": 3_000_000, "depth_anchor_ms": 0, "buoyancy": Buoyancy.SINK}
    resting, docked = truth(0, 1, 0.9, **below), truth(0, 2, 0.9, docked=True)
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
    measured = [[2000.0, 1, 7.5, None, 18.01, None], [1000.0, 1, 7.6, None, None, None]]
    assert (data["sensors"][0], data["measured"]) == (["oxygen", "mg/l"], measured)
    calm, water = 8.5 - 2.5 * 3 / 8, data["agents"][0]["water"]
    mbar = 1013.25 + 1025 * 9.80665 * 3 / 100
    # The mission's third second is the board's 90th: the patch has grown for all of its 30 s.
    assert water[0] == pytest.approx([calm, mbar, 18.0, 5.0], abs=1e-4)
    assert [it[0] for it in water] == pytest.approx([calm, calm, calm, 0.0], abs=1e-4)
    # In a dock it is out of the water, and of the third nobody knows where it is.
    assert [agent["water"] for agent in data["agents"][1:]] == [None, None]


def test_a_followed_run_has_each_uploaded_sample_once_with_its_next_tick():
    view = followed(story(), 1)
    before = view.counts
    view.take_samples([uploaded(1, 0, 0.0, oxygen_mg_l=8.0)])
    assert view.newest(before)["measured"] == view.data(None)["measured"] == []
    view.sample(1000)
    assert view.newest(before)["measured"] == view.data(None)["measured"] == [[0.0, 1, 8.0, None, None, None]]
    assert view.newest(view.counts)["measured"] == []


def test_a_thinned_track_keeps_its_ends_and_says_how_far_off_it_is():
    straight = [apad(1000 * n, float(n)) for n in range(2 * MAX_TRACE)]
    bent = [*straight[:4001], {**straight[4001], "east_m": 2.5}, *straight[4002:]]
    plain, data = (data_of(run_line(1), *it) for it in (straight, bent))
    assert (plain["thinned"]["track_m"], data["thinned"]["track_m"]) == (0, 2.5)
    (first_ms, *_), *_, (last_ms, *_) = data["trace"]
    assert (first_ms, last_ms) == (0, 1000 * (2 * MAX_TRACE - 1)) and len(data["trace"]) <= MAX_TRACE + 1


def test_boards_with_timeslots_state_them():
    assert data_of(run_line(1))["timeslots"] is None
    scenario = load(ROOT / "launch_scripts" / "scenarios" / "sound-12.yaml")
    slots = whole_view(scenario, journal_of([run_line(1)])).data(None)["timeslots"]
    assert slots == {"frame_ms": 300_000, "slot_ms": 5000}
