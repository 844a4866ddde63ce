"""Somebody else's mission beside ours: whose decisions agree, and what later packets say of our estimates."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import ANY

import pytest
from journals import lines_in
from scenario_files import POOL_FILE, SOUND_FILE

from apad_bridge.commands import main
from apad_bridge.field.field_log.log_facts import (
    AmusselCharged,
    AmusselPlaced,
    BeliefsReport,
    Held,
    LoggedFact,
    PacketLogged,
    Posed,
    Witness,
    Work,
    WorkBegan,
    WorkEnded,
)
from apad_bridge.field.shadow.compared import ELSEWHERE, WAIT, TheirMove
from apad_bridge.field.shadow.shadow import Shadow
from apad_bridge.planning.dispatch_rule import Places
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load, with_overrides, write_resolved
from apad_bridge.scenario.schema import Scenario
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
    for line in lines_in(bag.parent / "journal.jsonl"):
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


DEPLOY_7, OUR_WAIT, AWAY = TheirMove(StepKind.DEPLOY, 7), TheirMove(WAIT), TheirMove(ELSEWHERE)


def seen(at_s: float, *held: tuple[int, bool]) -> list[LoggedFact]:
    """A supervisor's sample at the origin, and what it says of aMussels in docks."""
    return [
        Posed(at_s, Witness.SUPERVISOR, None, (0.0, 0.0)),
        *(Held(at_s, Witness.SUPERVISOR, *it) for it in held),
    ]


TO_7: list[LoggedFact] = [go_to(1.0, 5.0), perch(3.0, 7)]
LETS_GO = [Held(6.0, Witness.VEHICLE, 7, False), Held(7.0, Witness.VEHICLE, 7, True), at(8.0, 5.0)]
ONE_DOCK = replace(POOL, apad=replace(POOL.apad, docks=1), mission=replace(POOL.mission, batch=1))
THEIRS: dict[str, tuple[list[LoggedFact], list[tuple[float, TheirMove, TheirMove]]]] = {
    "who a go-to is for is told by the docking after it": (
        [*HEARD, go_to(1.0, 5.0), at(2.0, 4.0), perch(3.0, 7), Held(4.0, Witness.VEHICLE, 7, True)],
        [(1.0, COLLECT_7, COLLECT_7)],
    ),
    "a docking without a go-to is judged by the docks before it": (
        [*HEARD, perch(5.0, 7), Held(5.05, Witness.VEHICLE, 7, True), at(6.0)],
        [(5.0, COLLECT_7, COLLECT_7)],
    ),
    "who a go-to without a docking is for is told by its place": (
        [*HEARD, go_to(1.0, 9.4), at(5.0, 9.0), go_to(9.0, 20.0), at(10.0, 12.0)],
        [(1.0, COLLECT_3, COLLECT_7), (9.0, AWAY, COLLECT_3)],
    ),
    "another try and another teller are no other decision": (
        [
            *HEARD,
            go_to(1.0, 5.0),
            go_to(1.0, 5.0, Witness.SUPERVISOR),
            at(5.0, 4.0),
            perch(6.0, 7),
            WorkEnded(7.0, Witness.VEHICLE, "perch 6.0", False, True),
            go_to(8.0, 6.2),  # it has drifted
            perch(9.0, 7),
            Held(9.5, Witness.VEHICLE, 7, True),
        ],
        [(1.0, COLLECT_7, COLLECT_7)],
    ),
    "ours would wait": ([*HIGH, go_to(1.0, 5.0), at(3.0, 4.0), perch(4.0, 7)], [(1.0, COLLECT_7, OUR_WAIT)]),
    # The vehicle's topics of docks come in one after the other; a docking comes after its order.
    "in a dock as the shadow begins": ([Held(0.0, Witness.VEHICLE, 3, True), *HEARD, DOCKED_7, at(9.0)], []),
    "docked by an order": ([*HEARD, perch(1.0, 7), DOCKED_7, at(9.0)], [(1.0, COLLECT_7, COLLECT_7)]),
    "docked a minute later": (
        [*HEARD, Held(60.0, Witness.VEHICLE, 7, True), at(70.0)],
        [(60.0, COLLECT_7, COLLECT_7)],
    ),
    "what makes no sense is left out": (
        [
            at(0.0),
            packet(0.0, 999, 0.5, 5.0),
            PacketLogged(0.0, 7, "wifi", b"no packet"),
            go_to(1.0, 5.0),
            at(2.0, 1.0),
        ],
        [(1.0, AWAY, OUR_WAIT)],
    ),
    "a vehicle that falls silent about a dock lets nobody go while a supervisor says what it holds": (
        [*HEARD, *seen(0.5), *TO_7, *seen(4.0, (7, True))[1:], *LETS_GO],
        [(1.0, COLLECT_7, COLLECT_7)],
    ),
    "a vehicle alone that falls silent about a dock lets go": (
        [*HEARD, *TO_7, Held(5.0, Witness.VEHICLE, 7, True), *LETS_GO],
        [(1.0, COLLECT_7, ANY), (6.0, DEPLOY_7, ANY), (7.0, COLLECT_7, ANY)],
    ),
    "an aMussel that a supervisor's first sample shows docked is no decision until it leaves": (
        [
            *HEARD,
            *seen(200.0, (7, True)),
            at(230.0),
            *seen(300.0, (3, True)),
            at(330.0),
            *seen(400.0, (7, False))[1:],
            at(430.0),
            *seen(500.0, (7, True))[1:],
            at(530.0),
        ],
        [(300.0, COLLECT_3, ANY), (400.0, DEPLOY_7, ANY), (500.0, COLLECT_7, ANY)],
    ),
}


@pytest.mark.parametrize(("facts", "decisions"), THEIRS.values(), ids=THEIRS)
def test_their_decision_and_ours(
    facts: list[LoggedFact], decisions: list[tuple[float, TheirMove, TheirMove]]
) -> None:
    found = decided(facts).decisions
    assert [(it.at_s, it.theirs, it.ours) for it in found] == decisions


def test_what_we_would_do_is_judged_by_the_docks_that_were_full_before() -> None:
    """One dock, full of an aMussel that charges: ours waits, and does not collect into it."""
    facts = [*HEARD, go_to(1.0, 9.0), at(2.0, 1.0), Held(2.5, Witness.VEHICLE, 7, True), at(4.0, 3.0)]
    (decision,) = decided(facts, scenario=ONE_DOCK).decisions
    assert (decision.theirs, decision.ours) == (COLLECT_3, OUR_WAIT)


def test_the_topics_of_amussels_without_packets_are_believed_too() -> None:
    heard = [(3, 0.2, 9.0), (7, 0.6, 5.0)]
    places = [AmusselPlaced(0.0, agent_id, (north_m, 0.0)) for agent_id, _, north_m in heard]
    charges = [AmusselCharged(0.0, agent_id, charge) for agent_id, charge, _ in heard]
    (decision,) = decided([at(0.0), *places, *charges, *TO_7, at(4.0, 4.0)]).decisions
    assert decision.agrees and decision.estimate is not None
    assert (decision.estimate.charge, decision.estimate.place_m) == (0.6, (5.0, 0.0))


def test_a_later_packet_tells_how_far_the_estimate_was_wrong() -> None:
    """The last report holds for an estimator without a model: 0.6 at 5 m, and a minute later 0.5 at 8 m."""
    later = [packet(60.0, 7, 0.5, 8.0), packet(61.0, 7, 0.1, 8.0)]
    shadow = decided([*HEARD, go_to(30.0, 5.0), perch(40.0, 7), at(41.0, 5.0), *later])
    (estimate,) = (it.estimate for it in shadow.decisions)
    errors = (estimate.charge_error, estimate.place_error_m, estimate.told_after_s, estimate.age_s)
    assert errors == pytest.approx((0.1, 3.0, 30.0, 30.0), abs=1e-4)
    accuracy = shadow.accuracy
    assert (accuracy.packets, accuracy.inside) == (1, None)  # the second came after a second
    assert (accuracy.charge_rms, accuracy.place_rms_m) == pytest.approx((0.1, 3.0), abs=1e-4)


def test_twins_foretell_the_charge_of_silent_amussels_and_give_an_interval() -> None:
    scenario = load(SOUND_FILE)
    first, second = (packet(at_s, scenario.fleet.ids[0], 0.9, 5.0, scenario) for at_s in (0.0, 120.0))
    accuracy = decided([at(0.0), first, at(120.0), second], scenario=scenario).accuracy
    assert accuracy.packets == 1 and accuracy.inside in (0.0, 1.0)


@pytest.mark.parametrize(
    "bad",
    [{"age_s": math.nan}, {"age_s": -math.inf}, {"state": 99}, {"charge": math.nan}, {"north": math.nan}],
    ids=lambda it: str(it),
)
def test_a_senseless_belief_of_others_does_not_end_the_shadow(bad: dict[str, float]) -> None:
    """Anybody may publish on the graph beside which it listens."""
    good = {"id": 1, "age_s": 0.0, "charge": 0.5, "secondary": 1.0, "north": 0.0, "east": 0.0, "state": 2}
    shadow = Shadow(load(POOL_FILE))
    shadow.take(BeliefsReport(1.0, 1000, (SimpleNamespace(**good | bad),)))
    shadow.end()
    assert not shadow.decisions
