"""The replay page of a small run, in a real browser without a network: what it says, and what it paints."""

from __future__ import annotations

import json
import re
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from browsers import LEAST_CONTRAST, cells, load_page, low_contrast, scheme, screen, text
from scenario_files import POOL_FILE
from selenium import webdriver

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from apad_bridge.analysis.replay.build import build_replay
from apad_bridge.beliefs.belief import Belief, CapacityLeft
from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.mission_events import (
    MissionChanged,
    MissionState,
    Phase,
    PlanMade,
    PrimitiveChanged,
    PrimitivePhase,
)
from apad_bridge.events.run_events import RunEnded
from apad_bridge.events.sound_events import PacketPassed
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import journal_start
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow, grains
from firmware_model.states import State

pytestmark = pytest.mark.system
GREEN, AMBER, PURPLE, GREY = [0x2B, 0x9A, 0x57], [0xB0, 0x74, 0x00], [0x7B, 0x48, 0xC8], [0x8B, 0x92, 0x9B]
WHITE = [255, 255, 255]
PLACES = {1: (5.0, 5.0), 2: (5.0, 15.0), 3: (22.0, 5.0), 4: (22.0, 15.0)}
DOCKED_S, LOST_S, END_S = 60, 90, 120


def truth(at_s: int, agent_id: int, charge: float, *, docked: bool = False, secondary: float = 1.0) -> Truth:
    north_m, east_m = PLACES[agent_id]
    primary = Battery(30_000 * at_s, grains(charge), Flow.RESTING)
    backup = Battery(30_000 * at_s, grains(secondary), Flow.RESTING)
    place = (round(north_m * 1e6), round(east_m * 1e6))
    physical = Physical(primary, backup, *place, 0, 3_000_000, Buoyancy.SINK, docked)
    return Truth(30_000 * at_s, agent_id, State.CHARGING if docked else State.ACTIVE, physical)


def estimate(now_ms: int) -> Belief:
    """Of the first, which holds 0.95: 0.8 with a deviation of 0.05. From 30 s on its twin knows the batteries' age."""
    modes = tuple(float(mode is Mode.IDLE) for mode in Mode)
    return Belief(
        1,
        now_ms,
        State.ACTIVE,
        0.8,
        1.0,
        5.0,
        5.0,
        0,
        (0.0025, 0.0, 0.0),
        mode_probabilities=modes,
        capacity_left=None if now_ms < 30_000 else CapacityLeft(0.7149, 0.8611),
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes: 1 stays above the threshold, 2 is docked at 60 s, 3 is a candidate, 4 is lost at 90 s."""
    scenario = load(POOL_FILE)
    directory = RunDirectory.create(
        "story", datetime(2026, 5, 4, tzinfo=UTC), tmp_path_factory.mktemp("runs") / "story"
    )
    directory.write_inputs(scenario, starts_of(scenario)[:4])
    recorder = Recorder(directory, scenario, PLACES)
    journal_start(recorder, scenario, [Start(n, *place, 1.0, 1.0) for n, place in PLACES.items()])
    told = {
        0: [truth(0, 1, 0.95), truth(0, 2, 0.6), truth(0, 3, 0.5), truth(0, 4, 0.0)],
        DOCKED_S: [truth(DOCKED_S, 2, 0.6, docked=True)],
        LOST_S: [truth(LOST_S, 4, 0.0, secondary=0.0)],
    }
    for now_s in range(END_S + 1):
        now_ms = 1000 * now_s
        recorder.truths(told.get(now_s, []))
        slots: tuple[int | None, ...] = (2, None, None, None) if now_s >= DOCKED_S else (None,) * 4
        if now_s == 10:
            steps = [{"agent": 2, "dock": 0}, {"agent": 3, "dock": 1}]
            costs = {"distance_m": 22.5, "demand": 0.9, "distance_cost": 22.5, "energy_cost": 0.9}
            candidates = [{"id": n, "charge": n / 10, "north_m": 5.0, "east_m": 15.0} for n in (2, 3, 4)]
            candidates[0]["reported"] = {"depth_m": 2.5}
            recorder.event(
                now_ms,
                PlanMade(
                    what="collect",
                    strategy="cautious",
                    steps=steps,
                    costs=costs,
                    beliefs=candidates,
                    options=[
                        {"agents": [2, 3], "cost": 1.5, "parts": {"charge": 1.5}},
                        {"agents": [2, 4], "cost": 1.75, "parts": {"charge": 1.75}},
                        {"agents": [3, 4], "cost": 2.0, "parts": {"charge": 2.0}},
                    ],
                ),
            )
            collect = tuple(Step(StepKind.COLLECT, it["agent"], it["dock"]) for it in steps)
            state = MissionState(Phase.GO_COLLECT, plan=collect, cost_m=7.5)
            recorder.event(now_ms, MissionChanged(state.phase, state))
            recorder.event(
                now_ms, PrimitiveChanged("go to point", PrimitivePhase.STARTED, north_m=5.0, east_m=15.0)
            )
        if now_s in (20, 21):
            heard = [(0, "received"), (4, "collided"), (1, "out_of_range")] if now_s == 20 else []
            packet = PacketPassed(
                from_=3 if now_s == 20 else 1,
                address=255,
                what="unicast",
                bytes=45,
                began_ms=30 * (now_ms - 500),
                lasted_ms=868,
                timeslot=0,
                unsent=None if now_s == 20 else "the modem is busy",
                heard=[(listener, outcome, 20.0, 30 * now_ms, 5.0, 7.5) for listener, outcome in heard],
                data_="",
            )
            recorder.event(now_ms, packet)
        pose = PoseReported(now_ms, 14.0, 2.0 + min(now_s, DOCKED_S) / 10, 1.0)
        recorder.tick(
            now_ms, [estimate(now_ms)], pose, BatteryReported(now_ms, 15.0, 0.9), "go to point", slots
        )
    recorder.event(1000 * END_S, RunEnded("mission time"))
    recorder.close()
    return build_replay(directory.path)


def browse(browser: webdriver.Chrome, page: Path, at: str = "") -> None:
    """Opens the page from disk."""
    load_page(browser, page.as_uri() + at)


def shown(browser: webdriver.Chrome) -> dict[str, object]:
    """Returns the text that a person would read, and of each aMussel its status and its charge."""
    names = (
        "mission-clock",
        "agent-clock",
        "primitive",
        "docks",
        "active-now",
        "cost-now",
        "uptime-now",
    )
    chips = """
      return Object.fromEntries([...document.querySelectorAll("#agents li")].map((it) =>
        [it.dataset.agent, [it.dataset.status, it.querySelector("span").textContent]]));
    """
    agents = {int(it): tuple(found) for it, found in browser.execute_script(chips).items()}
    return {name: text(browser, name) for name in names} | {"plan": plan_of(browser), "agents": agents}


def plan_of(browser: webdriver.Chrome) -> str:
    """The plan's words, between which its page leaves room."""
    words = "return $('plan').innerHTML.replace(/<[^>]+>/g, ' ').replace(/\\s+/g, ' ').trim()"
    return str(browser.execute_script(words))


def test_the_page_shows_the_time_that_its_address_or_its_scrubber_names(
    page: Path, browser: webdriver.Chrome
) -> None:
    browse(browser, page, at="#t=5")
    assert shown(browser) == {
        "mission-clock": "00:00:05",
        "agent-clock": "00:02:30",
        "primitive": "no order under way",
        "plan": "none yet",
        "docks": "free · free · free · free",
        "active-now": "3 of 4",
        "cost-now": "0 m",
        "uptime-now": "mean 3.1 %",  # 5 of 120 ticks for three of four
        "agents": {
            1: ("above", "95 %"),
            2: ("candidate", "60 %"),
            3: ("candidate", "50 %"),
            4: ("empty", "0 %"),
        },
    }
    # As a hand on the scrubber does it: its value changes and it says `input`.
    drag = (
        "const it = document.getElementById('scrub'); it.value = '100'; it.dispatchEvent(new Event('input'))"
    )
    browser.execute_script(drag)
    now = shown(browser)
    assert (now["mission-clock"], now["agent-clock"]) == ("00:01:40", "00:50:00")
    assert now["primitive"] == "go to point 5.0 m north, 15.0 m east"
    assert now["plan"] == "collect (cautious): 2 3"
    assert (now["docks"], now["active-now"], now["cost-now"]) == ("2 · free · free · free", "2 of 4", "8 m")
    assert now["agents"] == {
        1: ("above", "95 %"),
        2: ("charging", "60 %"),
        3: ("candidate", "50 %"),
        4: ("lost", "0 %"),
    }


def test_uploaded_samples_are_series_with_units_beside_the_waters_truth(
    page: Path, browser: webdriver.Chrome, tmp_path_factory: pytest.TempPathFactory
) -> None:
    run = tmp_path_factory.mktemp("runs") / "measured"
    shutil.copytree(page.parent, run)
    lines = [
        {"id": n, "sequence": k, "mission_ms": 1000 * at_s, "oxygen_mg_l": oxygen, "pressure_mbar": 1314.8}
        for n, k, at_s, oxygen in ((1, 1, 60, 7.5), (1, 0, 30, 8.0), (2, 0, 30, 2.0))
    ]
    (run / "samples.jsonl").write_text("".join(json.dumps(it) + "\n" for it in lines))
    browse(browser, build_replay(run), at="#t=45&aMussel=1")
    read = """
      const card = document.getElementById("measured-card");
      return [card.hidden, card.querySelector("h2").innerText.trim(),
        ...[...card.querySelectorAll("figcaption")].map((it) => [...it.children].map((one) => one.textContent).join(": ")),
        charts.get("measured-0").plot.data.slice(1).map((it) => [...it].filter((one) => one !== undefined))];
    """
    hidden, heading, *charts, series = browser.execute_script(read)
    assert (hidden, heading) == (
        False,
        "Measured and uploaded 2 samples of aMussel 1, the newest of 00:00:30",
    )
    assert charts == [
        "Oxygen, mg/l: 8.00",
        "Pressure, mbar: 1314.80",
        "Temperature, degrees Celsius: ",
        "Turbidity, NTU: ",
    ]
    assert series == [[8.0, 7.5]]
    browser.execute_script(
        "data.agents[0].water = data.times_ms.map((ms) => (ms < 50000 ? [8.1, 1314.7, 18, 5] : null));"
        "select(1); select(1);"
    )
    _, heading, oxygen, *_, series = browser.execute_script(read)
    assert (
        heading
        == "Measured and uploaded; dashed: the water's true value there 2 samples of aMussel 1, the newest of 00:00:30"
    )
    assert oxygen == "Oxygen, mg/l: 8.00, true now 8.10"
    assert series[0] == [8.0, 7.5] and set(series[1]) == {8.1, None}
    browser.execute_script("select(1);")
    _, heading, oxygen, *_ = browser.execute_script(read)
    assert (heading.endswith("3 samples"), oxygen) == (True, "Oxygen, mg/l: ")
    browse(browser, page)
    assert browser.execute_script("return document.getElementById('measured-card').hidden")


def test_playing_moves_the_time_at_the_chosen_speed_and_stops_at_the_end(
    page: Path, browser: webdriver.Chrome
) -> None:
    # A clock and frames of our own, so that how long the browser takes does not matter.
    press = """
      let now = 0; const frames = [], seen = [], press = (id) => document.getElementById(id).click();
      performance.now = () => now; window.requestAnimationFrame = (it) => frames.push(it);
      const pass = (ms) => { now += ms; for (const it of frames.splice(0)) it(); seen.push(document.body.dataset.timeMs); };
      document.getElementById("speed").value = "20";
      press("play"); pass(1500); pass(500); press("play"); pass(500); press("play"); pass(1000); pass(5000); pass(5000);
      return seen.join(" ");
    """
    browse(browser, page)
    assert browser.execute_script(press) == "30000 40000 40000 60000 120000 120000"
    label = "return document.getElementById('play').getAttribute('aria-label')"
    assert browser.execute_script(label) == "Play"


def test_the_map_is_painted_in_the_colours_of_its_legend(page: Path, browser: webdriver.Chrome) -> None:
    early, late = (painted(browser, page, at) for at in ("#t=5", "#t=100"))
    assert early["1"] == late["1"] == GREEN
    assert early["3"] == late["3"] == AMBER
    # An empty one is hollow: not in the colour of one that only has less than it could have.
    assert (early["4"], late["4"]) == (WHITE, GREY)
    # The docked one has left its place and is painted at the aPad.
    assert early["2"] == AMBER and late["2"] not in (AMBER, GREEN, PURPLE, GREY)
    assert early["purple"] == 0 and late["purple"] > 50


def test_the_times_in_which_the_mission_was_kept_from_the_aPad_are_shaded_in_every_chart(
    page: Path, browser: webdriver.Chrome, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A person's stop from 20 to 40 s, a pilot from 60 to 80 s; what a chart leaves empty is else not painted at all."""
    run = shutil.copytree(page.parent, tmp_path_factory.mktemp("shaded") / "stopped")
    lines = [json.loads(it) for it in (run / "journal.jsonl").read_text().splitlines()]
    lines += [
        {"t": 20_000, "kind": "operator", "order": "stop", "by": "Anna"},
        {"t": 40_000, "kind": "operator", "order": "continue", "by": "Anna"},
        {"t": 60_000, "kind": "override", "taken": True, "by": "vehicle"},
        {"t": 80_000, "kind": "override", "taken": False, "by": "person"},
    ]
    told = sorted(lines, key=lambda line: line["t"])
    (run / "journal.jsonl").write_text("".join(json.dumps(it) + "\n" for it in told))
    look = """
      const commonest=(values)=>{
        const counts=new Map();
        for(const it of values)counts.set(it,(counts.get(it)||0)+1);
        return [...counts].sort((a,b)=>b[1]-a[1])[0][0];
      };
      const opacity=({ctx,bbox},plot,ms)=>{
        const x=Math.round(plot.valToPos(ms,"x",true));
        const pixels=ctx.getImageData(x,bbox.top,1,bbox.height).data;
        return commonest([...pixels].filter((_,n)=>n%4===3));
      };
      return Object.fromEntries([...charts].filter(([,it])=>it.plot.bbox.height>0)
        .map(([name,{plot}])=>[name,[15,30,50,70,110].map((s)=>opacity(plot,plot,1000*s))]));
    """
    browse(browser, build_replay(run))
    opacities = browser.execute_script(look)
    assert len(opacities) > 3
    for name, (before, stopped, between, flown_by_hand, after) in opacities.items():
        assert before == between == after < stopped == flown_by_hand, (name, opacities[name])


def test_a_marked_one_is_shown_with_its_estimate_its_state_and_both_batteries(
    page: Path, browser: webdriver.Chrome
) -> None:
    """Where it lies with 95 % is shaded, around the estimate and not around the truth."""
    look = """
      const {plot} = charts.get("charge");
      const at = (value) => [...plot.ctx.getImageData(200, Math.round(plot.valToPos(value, "y", true)), 1, 1).data];
      return [0.85, 0.75, 0.66, 0.92].map(at);
    """
    browse(browser, page, at="#t=100&aMussel=1")
    assert text(browser, "charge-now") == "1: 95.0 %, believed 80.0 % (70.2 to 89.8)"
    upper, lower, below, above = browser.execute_script(look)
    assert upper == lower and upper[:3] != below[:3] and below == above
    browse(browser, page, at="#t=100&aMussel=4")
    assert text(browser, "one-now") == "4: active; primary 0.0 %, secondary 0.0 %; never heard"
    browse(browser, page, at="#t=100")
    assert re.fullmatch(r"mean 51\.\d %, least 0\.0 %", text(browser, "charge-now"))
    assert browser.execute_script("return document.getElementById('one-card').hidden")


def test_a_plan_has_its_candidates_and_costs(page: Path, browser: webdriver.Chrome) -> None:
    browse(browser, page, at="#t=15&why=1")
    assert [row[:7] for row in cells(browser, "#candidates tr")] == [
        ["aMussel", "place in the plan", "charge", "second battery", "unserved", "north, east", "depth m"],
        ["2", "1", "20.0 %", "", "", "5.0, 15.0", "2.50"],
        ["3", "2", "30.0 %", "", "", "5.0, 15.0", ""],
        ["4", "", "40.0 %", "", "", "5.0, 15.0", ""],
    ]
    # The plan beside its runner-up and the others, as `musselbed explain` has them.
    assert cells(browser, "#options tr") == [
        ["", "the plan", "runner-up", "3."],
        ["aMussels", "2, 3", "2, 4", "3, 4"],
        ["cost", "1.500", "1.750", "2.000"],
        ["charge", "1.500", "1.750", "2.000"],
    ]
    reasons = browser.page_source
    assert "way planned 22.5 m, demand 0.90 batteries; scaled 22.5 and 0.9" in reasons
    assert "the runner-up costs 0.250 more" in reasons
    browse(browser, page, at="#t=15")
    assert "<td>" not in browser.page_source


def test_what_lies_under_the_pointer_is_named_with_its_value(page: Path, browser: webdriver.Chrome) -> None:
    browse(browser, page, at="#t=100")
    move = """
      const [of, x, y] = arguments, element = document.querySelector(of), box = element.getBoundingClientRect();
      const place = {clientX: box.left + x, clientY: box.top + y, bubbles: true};
      element.dispatchEvent(new MouseEvent("mousemove", place));
      element.dispatchEvent(new PointerEvent("pointermove", place));
    """
    hovered = (
        "return document.getElementById('hover').hidden ? '' : document.getElementById('hover').textContent"
    )
    y = browser.execute_script("return charts.get('charge').plot.valToPos(0.5, 'y')")
    for of, at, words in (
        ("#charge .u-over", (20, y), "aMussel 3: 50.0 %"),
        ("#active .u-over", (0.5, 20), "00:00:00  3"),
        ("#apad .u-over", (30, 20), "90.0 %"),
        ("#uptime", (80, 60), "aMussel 1: 83.3 % so far, 100.0 % at the end"),
    ):
        browser.execute_script(move, of, *at)
        assert words in browser.execute_script(hovered), of
    north, east = PLACES[3]
    place = browser.execute_script(
        "const to = mapScale($('map').clientWidth, $('map').clientHeight); return [to.x(arguments[1]), to.y(arguments[0])]",
        north,
        east,
    )
    browser.execute_script(move, "#map", *place)
    assert "aMussel 3: 50.0 %" in browser.execute_script(hovered)


def test_the_legend_has_what_is_there_and_the_events_follow_the_time(
    page: Path, browser: webdriver.Chrome
) -> None:
    browse(browser, page, at="#t=100")
    listed = "return [...document.querySelectorAll('#legend li')].filter((it) => !it.hidden).map((it) => it.textContent)"
    assert browser.execute_script(listed) == [
        *(
            "above the pool's threshold",
            "candidate: below the threshold",
            "charging",
            "primary battery empty",
        ),
        *("lost", "home", "aPad with its docks", "its way", "its plan"),
        *("packet received", "collided", "missed otherwise"),
    ]
    # A suspect has its mark, and its reason, from its time on.
    suspected = """
      data.suspects = [[50000, 3, "its charge rose in the water", 55000]];
      showLegend(); show(1000 * arguments[0]);
      const item = document.querySelector("[data-agent='3']");
      const words = "suspect since 00:00:50: its charge rose in the water";
      return [item.classList.contains("suspect"), item.title.includes(words)];
    """
    assert browser.execute_script(suspected, 49) == [False, False]
    assert browser.execute_script(suspected, 50) == [True, True]
    assert browser.execute_script(suspected, 55) == [False, False]
    assert "suspect: its packets contradict physics" in browser.execute_script(listed)
    # A list that is higher than its window keeps the event of the time shown in sight.
    script = """
      addEvents(Array.from({length: 200}, (_, n) => [100000 + 100 * n, "remark", "event " + n, null]));
      endMs = 121000; show(1000 * arguments[0]);
      const list = document.getElementById("events").getBoundingClientRect();
      const now = document.querySelector("#events .now"), box = now.getBoundingClientRect();
      return [now.textContent, box.top >= list.top && box.bottom <= list.bottom];
    """
    for second, words in ((119, "event 190"), (105, "event 50")):
        text, in_sight = browser.execute_script(script, second)
        assert words in text and in_sight


def test_packets_say_what_became_of_them_and_are_filtered_by_amussel(
    page: Path, browser: webdriver.Chrome
) -> None:
    told = [
        "00:00:20 1 unicast not sent: the modem is busy",
        "00:00:19 3 unicast received: aPad; collided: 4; out of range or too weak: 1",
    ]
    listed = "return [...document.querySelectorAll('#packets li')].map((it) => it.innerText.replace(/\\s+/g, ' ').trim())"
    for at, wanted in (
        ("#t=25", told),
        ("#t=19.7", told[1:]),
        ("#t=25&aMussel=4", told[1:]),
        ("#t=25&aMussel=2", []),
    ):
        browse(browser, page, at=at)
        assert browser.execute_script(listed) == wanted


def test_the_age_of_batteries_that_a_twin_has_learned_stands_at_its_aMussel(
    page: Path, browser: webdriver.Chrome
) -> None:
    words = "71 to 86 % of its capacity left"
    for at_s, is_known in ((29, False), (31, True)):
        browse(browser, page, at=f"#t={at_s}&aMussel=1")
        titles = "return [...document.querySelectorAll('#agents li')].map((it) => it.title)"
        assert [words in it for it in browser.execute_script(titles)] == [is_known, False, False, False]
        assert (words in text(browser, "one-now")) is is_known


def test_the_address_shows_the_same_moment_to_somebody_else(page: Path, browser: webdriver.Chrome) -> None:
    """What clicks chose is in the address, and the address chooses it."""
    press = """
      document.querySelector("#agents [data-agent='3']").click();
      document.getElementById("theme").click();
      document.querySelector("#events button").click();
      return location.hash;
    """
    browse(browser, page, at="#t=5")
    at = browser.execute_script(press)
    assert at == "#t=10&aMussel=3&theme=contrast"
    browse(browser, page, at=at)
    assert browser.execute_script("return document.documentElement.dataset.theme") == "contrast"
    assert text(browser, "mission-clock") == "00:00:10" and text(browser, "one-now").startswith("3: active")


@pytest.mark.parametrize(("width", "name"), [(390, "dark"), (800, "light"), (1400, "dark")])
def test_the_page_fits_a_screen_follows_the_system_and_cuts_no_time(
    page: Path, browser: webdriver.Chrome, width: int, name: str
) -> None:
    screen(browser, width)
    scheme(browser, name)
    load_page(browser, page.as_uri())
    sides = "const page = document.documentElement; return [page.scrollWidth, page.clientWidth]"
    content, room = browser.execute_script(sides)
    assert content == room > width - 20  # beside a scroll bar
    look = "return getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).map(Number)"
    background = browser.execute_script(look)
    assert max(background) < 64 if name == "dark" else min(background) > 192
    # A chart's last time stands about the end of its axis, and half of it beyond.
    room, half = browser.execute_script("""
      const ctx = document.createElement("canvas").getContext("2d");
      ctx.font = FONT;
      const beyond = ({plot}) => plot.width - (plot.bbox.left + plot.bbox.width) / uPlot.pxRatio;
      return [Math.min(...[...charts.values()].map(beyond)), ctx.measureText("00:00:00").width / 2];
    """)
    assert room >= half > 10
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_high_contrast_is_7_to_1_or_more(page: Path, browser: webdriver.Chrome) -> None:
    """WCAG 2.1, 1.4.6, of texts and of the colours that carry a meaning, against the card and the page."""
    look = """
      const of = ["ink", "soft", "accent", ...STATUSES.slice(0, 4), "received", "collided", "half-duplex", "missed", "bad"];
      const light = (name) => {
        const probe = document.createElement("i"); probe.style.color = colour(name); document.body.append(probe);
        const parts = getComputedStyle(probe).color.match(/\\d+/g).map((it) => it / 255)
          .map((it) => it <= 0.03928 ? it / 12.92 : ((it + 0.055) / 1.055) ** 2.4);
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
      };
      const ratio = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
      return Math.min(...of.map((it) => ratio(light(it), light("card"))));
    """
    browse(browser, page, at="#t=5&theme=contrast")
    assert browser.execute_script(look) >= 7


@pytest.mark.parametrize("at", ["#t=5", "#t=100&aMussel=3&why=1", "#t=100&theme=contrast"])
def test_every_text_stands_out_from_the_page(page: Path, browser: webdriver.Chrome, at: str) -> None:
    browse(browser, page, at=at)
    assert low_contrast(browser) == []
    for name in ("light", "dark"):
        scheme(browser, name)
        ids = """
          const ctx = document.createElement("canvas").getContext("2d");
          return STATUS_COLOURS.map((it) => { ctx.fillStyle = it; return [ctx.fillStyle, inkOn(ctx)]; });
        """
        for colour, ink in browser.execute_script(ids):
            # Black is 0 and white 1: the contrast of either follows from the light of the other colour alone.
            light = luminance(colour)
            assert (1.05 / (light + 0.05) if ink == "#fff" else (light + 0.05) / 0.05) >= LEAST_CONTRAST
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def luminance(colour: str) -> float:
    """WCAG 2.1 of a colour #rrggbb."""
    parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    red, green, blue = (it / 12.92 if it <= 0.03928 else ((it + 0.055) / 1.055) ** 2.4 for it in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_several_apads_have_one_page(
    page: Path, browser: webdriver.Chrome, tmp_path_factory: pytest.TempPathFactory
) -> None:
    run = tmp_path_factory.mktemp("several")
    for name in ("apad1", "apad2"):
        shutil.copytree(page.parent, run / name)
    journal = run / "apad2" / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"strategy":"cautious"', '"strategy":"greedy"'))
    several = build_replay(run)
    assert several == run / "replay.html"
    for at, plan in (
        ("#t=100", "collect (cautious): 2 3"),
        ("#t=100&aPad=apad2", "collect (greedy): 2 3"),
    ):
        browse(browser, several, at=at)
        assert plan_of(browser) == plan
        assert re.findall(r'<option value="(apad\d)"', browser.page_source) == ["apad1", "apad2"]


def painted(browser: webdriver.Chrome, page: Path, at: str) -> dict[str, Any]:
    """The colour that the map has left of the number of each aMussel, by id, and how many purple pixels there are."""
    look = """
      const map=document.getElementById("map"), ctx=map.getContext("2d");
      const to=mapScale(map.clientWidth,map.clientHeight);
      const pixels=ctx.getImageData(0,0,map.width,map.height).data, found={purple:0};
      for (const [id,[n,e]] of Object.entries(data.homes))
        found[id]=[...ctx.getImageData(Math.round(to.x(e))-6,Math.round(to.y(n)),1,1).data].slice(0,3);
      for (let i=0;i<pixels.length;i+=4) found.purple+=pixels[i]===0x7b&&pixels[i+1]===0x48&&pixels[i+2]===0xc8;
      return found;
    """
    browse(browser, page, at)
    found: dict[str, Any] = browser.execute_script(look)
    return found
