"""Somebody else's mission beside ours: whose decisions agree, and what later packets say of our estimates."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from scenario_files import POOL_FILE, SOUND_FILE

from apad_bridge.commands import main
from apad_bridge.field.field_log.log_facts import (
    AmusselCharged,
    AmusselPlaced,
    Held,
    LoggedFact,
    PacketLogged,
    Posed,
    Witness,
    Work,
    WorkBegan,
    WorkEnded,
)
from apad_bridge.field.shadow import ELSEWHERE, WAIT, Shadow, TheirMove
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load, with_overrides, write_resolved
from apad_bridge.scenario.schema import Places, Scenario
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import load_codec
from firmware_model.states import State

POOL = load(POOL_FILE)
Told = dict[str, Any]
COLLECT_7, COLLECT_3 = TheirMove(StepKind.COLLECT, 7), TheirMove(StepKind.COLLECT, 3)


TWENTY_MINUTES = replace(POOL, duration_s=1200.0)
EXCHANGED = replace(
    POOL, mission=replace(POOL.mission, batch=3, charge_to=0.9, places=Places.EXCHANGED), duration_s=1800.0
)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., tuple[Path, Path]]:
    """A run of ours by a strategy: its scenario and its bag."""
    made: dict[str, tuple[Path, Path]] = {}

    def fly(strategy: str, flies: Scenario = TWENTY_MINUTES) -> tuple[Path, Path]:
        if strategy not in made:
            folder = tmp_path_factory.mktemp(strategy)
            fleet = replace(POOL.fleet, hosting=Hosting.ONE_PROCESS)
            scenario = with_overrides(replace(flies, fleet=fleet), strategy=strategy)
            write_resolved(folder / "flown.yaml", scenario)
            out = folder / "run"
            words = ["run", str(folder / "flown.yaml"), "--time", "asap", "--out", str(out), "--json"]
            assert main.main(words) == 0
            made[strategy] = folder / "flown.yaml", out / "run.bag"
        return made[strategy]

    return fly


def shadowed(files: tuple[Path, Path], strategy: str, capsys: pytest.CaptureFixture[str]) -> Told:
    capsys.readouterr()
    assert main.main(["shadow", *map(str, files), "--strategy", strategy, "--json"]) == 0
    told: Told = json.loads(capsys.readouterr().out)
    return told


def plans_of(bag: Path) -> list[tuple[str, int]]:
    """What the journal says was planned, in order: an independent record of their decisions."""
    steps = []
    for text in (bag.parent / "journal.jsonl").read_text().splitlines():
        line = json.loads(text)
        if line["kind"] == "plan":
            kind = "collect" if line["what"] == "collect" else "deploy"
            releases = {it["collected"]: it["released"] for it in line.get("exchanged", ())}
            for step in line["steps"]:
                steps.append((kind, step["agent"]))
                if step["agent"] in releases:
                    steps.append(("deploy", releases[step["agent"]]))
    return steps


@pytest.mark.parametrize(
    ("strategy", "scenario", "begins"),
    [
        ("greedy", TWENTY_MINUTES, 12 * ["collect"]),
        ("cautious", TWENTY_MINUTES, 12 * ["collect"]),
        ("blend", EXCHANGED, [*3 * ["collect"], *4 * ["collect", "deploy"]]),
    ],
    ids=["greedy", "cautious", "places exchanged"],
)
def test_a_run_of_ours_agrees_with_its_own_strategy_in_every_decision(
    flown: Callable[..., tuple[Path, Path]],
    strategy: str,
    scenario: Scenario,
    begins: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = flown(strategy, scenario)
    told = shadowed(files, strategy, capsys)
    theirs = [(it["theirs"]["kind"], it["theirs"]["agent_id"]) for it in told["decisions"]]
    assert theirs == plans_of(files[1])[: len(theirs)] and len(theirs) >= len(begins)
    if scenario is EXCHANGED:
        assert [kind for kind, _ in theirs[: len(begins)]] == begins
    assert told["agreed"] == len(theirs), [it for it in told["decisions"] if not it["agrees"]]


def test_greedy_shadowed_by_cautious_differs_where_the_nearest_is_not_the_emptiest(
    flown: Callable[[str], tuple[Path, Path]], capsys: pytest.CaptureFixture[str]
) -> None:
    """Cautious weighs charge, and Greedy takes the nearest: so where they differ, ours is the emptier one's plan."""
    files = flown("greedy")
    told = shadowed(files, "cautious", capsys)
    others = [it for it in told["decisions"] if not it["agrees"]]
    assert others and all(it["theirs"]["kind"] == it["ours"]["kind"] == "collect" for it in others)
    # The redeployment is the same strategy's for both.
    assert all(it["agrees"] for it in told["decisions"] if it["theirs"]["kind"] == "deploy")


# By facts: what was heard of another's mission, without a run of ours.


def packet(
    at_s: float, agent_id: int, charge: float, north_m: float, scenario: Scenario = POOL
) -> PacketLogged:
    status = StatusPacket(
        agent_id, 0, State.FLOATING, charge, 1.0, north_m, 0.0, 0.0, round(1000 * at_s) * scenario.theta
    )
    return PacketLogged(at_s, agent_id, "wifi", load_codec(scenario.hearing.codec).encode(status))


def at(at_s: float, north_m: float = 0.0) -> Posed:
    return Posed(at_s, Witness.VEHICLE, None, (north_m, 0.0))


def go_to(at_s: float, north_m: float, witness: Witness = Witness.VEHICLE) -> WorkBegan:
    return WorkBegan(at_s, witness, f"go {at_s} {witness}", Work.GO_TO, (north_m, 0.0))


def perch(at_s: float, agent_id: int) -> WorkBegan:
    return WorkBegan(at_s, Witness.VEHICLE, f"perch {at_s}", Work.DOCK, None, agent_id)


def decided(facts: list[LoggedFact], strategy: str = "greedy", scenario: Scenario = POOL) -> Shadow:
    shadow = Shadow(with_overrides(scenario, strategy=strategy))
    for it in facts:
        shadow.take(it)
    shadow.end()
    return shadow


HEARD: list[LoggedFact] = [at(0.0), packet(0.0, 3, 0.2, 9.0), packet(0.0, 7, 0.6, 5.0)]
"""3 is the emptier one, and 7 the nearer one."""


HIGH: list[LoggedFact] = [at(0.0), packet(0.0, 7, 0.95, 5.0)]
DOCKED_7 = Held(2.5, Witness.VEHICLE, 7, True)


@pytest.mark.parametrize(
    ("facts", "decisions"),
    [
        pytest.param(
            [*HEARD, go_to(1.0, 5.0), at(2.0, 4.0), perch(3.0, 7), Held(4.0, Witness.VEHICLE, 7, True)],
            [(1.0, COLLECT_7, COLLECT_7)],
            id="who a go-to is for is told by the docking after it",
        ),
        pytest.param(
            [*HEARD, perch(5.0, 7), Held(5.05, Witness.VEHICLE, 7, True), at(6.0)],
            [(5.0, COLLECT_7, COLLECT_7)],
            id="a docking without a go-to is judged by the docks before it",
        ),
        pytest.param(
            [*HEARD, go_to(1.0, 9.4), at(5.0, 9.0), go_to(9.0, 20.0), at(10.0, 12.0)],
            [(1.0, COLLECT_3, COLLECT_7), (9.0, TheirMove(ELSEWHERE), COLLECT_3)],
            id="who a go-to without a docking is for is told by its place",
        ),
        pytest.param(
            [
                *(*HEARD, go_to(1.0, 5.0), go_to(1.0, 5.0, Witness.SUPERVISOR), at(5.0, 4.0), perch(6.0, 7)),
                WorkEnded(7.0, Witness.VEHICLE, "perch 6.0", False, True),
                go_to(8.0, 6.2),  # it has drifted
                *(perch(9.0, 7), Held(9.5, Witness.VEHICLE, 7, True)),
            ],
            [(1.0, COLLECT_7, COLLECT_7)],
            id="another try and another teller are no other decision",
        ),
        pytest.param(
            [*HIGH, go_to(1.0, 5.0), at(3.0, 4.0), perch(4.0, 7)],
            [(1.0, COLLECT_7, TheirMove(WAIT))],
            id="ours would wait",
        ),
        # The vehicle's topics of docks come in one after the other; a docking comes after its order.
        pytest.param(
            [Held(0.0, Witness.VEHICLE, 3, True), *HEARD, DOCKED_7, at(9.0)],
            [],
            id="in a dock as the shadow begins",
        ),
        pytest.param(
            [*HEARD, perch(1.0, 7), DOCKED_7, at(9.0)], [(1.0, COLLECT_7, COLLECT_7)], id="docked by an order"
        ),
        pytest.param(
            [*HEARD, Held(60.0, Witness.VEHICLE, 7, True), at(70.0)],
            [(60.0, COLLECT_7, COLLECT_7)],
            id="docked a minute later",
        ),
        pytest.param(
            [
                at(0.0),
                packet(0.0, 999, 0.5, 5.0),
                PacketLogged(0.0, 7, "wifi", b"no packet"),
                go_to(1.0, 5.0),
                at(2.0, 1.0),
            ],
            [(1.0, TheirMove(ELSEWHERE), TheirMove(WAIT))],
            id="what makes no sense is left out",
        ),
    ],
)
def test_their_decision_and_ours(
    facts: list[LoggedFact], decisions: list[tuple[float, TheirMove, TheirMove]]
) -> None:
    assert [(it.at_s, it.theirs, it.ours) for it in decided(facts).decisions] == decisions


def test_a_vehicle_that_falls_silent_about_a_dock_lets_nobody_go_while_a_supervisor_says_what_it_holds() -> (
    None
):
    docked: list[LoggedFact] = [
        *HEARD,
        Posed(0.5, Witness.SUPERVISOR, None, (0.0, 0.0)),
        go_to(1.0, 5.0),
        perch(3.0, 7),
        Held(4.0, Witness.SUPERVISOR, 7, True),
        Held(6.0, Witness.VEHICLE, 7, False),
        Held(7.0, Witness.VEHICLE, 7, True),
        at(8.0, 5.0),
    ]
    assert [it.theirs for it in decided(docked).decisions] == [COLLECT_7]
    alone = [it for it in docked if not (isinstance(it, Posed | Held) and it.witness is Witness.SUPERVISOR)]
    alone.insert(-3, Held(5.0, Witness.VEHICLE, 7, True))
    found = [it.theirs for it in decided(alone).decisions]
    assert found == [COLLECT_7, TheirMove(StepKind.DEPLOY, 7), COLLECT_7]


def test_an_amussel_that_a_supervisors_first_sample_shows_docked_is_no_decision_until_it_leaves() -> None:
    facts: list[LoggedFact] = [
        *HEARD,
        Posed(200.0, Witness.SUPERVISOR, None, (0.0, 0.0)),
        Held(200.0, Witness.SUPERVISOR, 7, True),
        at(230.0),
        Posed(300.0, Witness.SUPERVISOR, None, (0.0, 0.0)),
        Held(300.0, Witness.SUPERVISOR, 3, True),
        at(330.0),
        Held(400.0, Witness.SUPERVISOR, 7, False),
        at(430.0),
        Held(500.0, Witness.SUPERVISOR, 7, True),
        at(530.0),
    ]
    found = [it.theirs for it in decided(facts).decisions]
    assert found == [COLLECT_3, TheirMove(StepKind.DEPLOY, 7), COLLECT_7]


def test_what_we_would_do_is_judged_by_the_docks_that_were_full_before() -> None:
    """One dock, full of an aMussel that charges: ours waits, and does not collect into it."""
    one_dock = replace(POOL, apad=replace(POOL.apad, docks=1), mission=replace(POOL.mission, batch=1))
    facts: list[LoggedFact] = [
        at(0.0),
        packet(0.0, 3, 0.2, 9.0),
        packet(0.0, 7, 0.6, 5.0),
        go_to(1.0, 9.0),
        at(2.0, 1.0),
        Held(2.5, Witness.VEHICLE, 7, True),
        at(4.0, 3.0),
    ]
    (decision,) = decided(facts, scenario=one_dock).decisions
    assert (decision.theirs, decision.ours) == (COLLECT_3, TheirMove(WAIT))


def test_the_topics_of_amussels_without_packets_are_believed_too() -> None:
    told: list[LoggedFact] = [at(0.0)]
    for agent_id, charge, north_m in ((3, 0.2, 9.0), (7, 0.6, 5.0)):
        told += [AmusselPlaced(0.0, agent_id, (north_m, 0.0)), AmusselCharged(0.0, agent_id, charge)]
    (decision,) = decided([*told, go_to(1.0, 5.0), at(2.0, 4.0), perch(3.0, 7)]).decisions
    assert decision.agrees and decision.estimate is not None
    assert (decision.estimate.charge, decision.estimate.place_m) == (0.6, (5.0, 0.0))


def test_a_later_packet_tells_how_far_the_estimate_was_wrong() -> None:
    """The last report holds for an estimator without a model: 0.6 at 5 m, and a minute later 0.5 at 8 m."""
    facts: list[LoggedFact] = [
        *HEARD,
        go_to(30.0, 5.0),
        perch(40.0, 7),
        at(41.0, 5.0),
        packet(60.0, 7, 0.5, 8.0),
        packet(61.0, 7, 0.1, 8.0),
    ]
    shadow = decided(facts)
    (decision,) = shadow.decisions
    estimate = decision.estimate
    assert estimate is not None and estimate.age_s == 30.0
    assert (estimate.charge_error, estimate.place_error_m, estimate.told_after_s) == pytest.approx(
        (0.1, 3.0, 30.0), abs=1e-4
    )
    accuracy = shadow.accuracy
    assert accuracy.packets == 1 and accuracy.inside is None  # the second came after a second
    assert (accuracy.charge_rms, accuracy.place_rms_m) == pytest.approx((0.1, 3.0), abs=1e-4)


def test_twins_foretell_the_charge_of_silent_amussels_and_give_an_interval() -> None:
    scenario = load(SOUND_FILE)
    agent_id = scenario.fleet.ids[0]
    facts: list[LoggedFact] = [at(0.0), packet(0.0, agent_id, 0.9, 5.0, scenario), at(120.0)]
    facts.append(packet(120.0, agent_id, 0.9, 5.0, scenario))
    accuracy = decided(facts, scenario=scenario).accuracy
    assert accuracy.packets == 1 and accuracy.inside in (0.0, 1.0)
