"""The facts and failures that the docking port gets from a generation A aPad, its surprises included."""

from __future__ import annotations

import math
from functools import partial

import pytest
from stack_benches import cleared

from apad_bridge.events.vehicle import DocksDisagree
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandFailed,
    DockClosed,
    DockOpened,
    DocksNamed,
    GoalOfOthers,
    GoTo,
    Hold,
    OpenDock,
    PoseReported,
    ReleaseByName,
    ReleaseWanted,
)
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import (
    GO_TO,
    PERCH,
    RELEASE,
    DocksReceived,
    GoalCode,
    GoalOrder,
    GoalSeen,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
)
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.link import Carried, Cleared, LetGo, LinkFact
from apad_bridge.vehicle.stack_messages import PoseReceived
from apad_bridge.world.contacts import why_out_of_reach

THERE = GoTo(1, 5.0, 6.0, 0.5, 0.5)


@pytest.fixture
def core() -> GenerationACore:
    return GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run")


def sent(goal: Cleared[GoalOrder] | None) -> GoalOrder | None:
    return None if goal is None else goal.order


def says(core: GenerationACore, at_ms: int, key: str, code: GoalCode, text: str = "") -> None:
    core.receive(GoalStatusReceived(at_ms, (GoalStatusEntry(key, code, text),), whole=False), at_ms)


def shows(core: GenerationACore, at_ms: int, agent_id: int, released: bool = False) -> None:
    core.receive(HeldPositionReceived(at_ms, agent_id, 2.0, 3.0, released), at_ms)
    core.take_question()  # that after a docking, which a test of its own has


def is_at(core: GenerationACore, at_ms: int) -> None:
    core.receive(PoseReceived(at_ms, 2.1, 3.1, 0.0), at_ms)


def tells(core: GenerationACore, now_ms: int) -> list[LinkFact]:
    """The new facts, without readings of pose and battery, acceptances, and the docks' service's word."""
    readings = PoseReported | BatteryReported | CommandAccepted | DocksNamed
    return [it for it in core.advance(now_ms) if not isinstance(it, readings)]


def test_commands_become_goals_of_the_three_kinds(core: GenerationACore) -> None:
    assert sent(core.command(cleared(THERE), 0)) == GoalOrder("run-1", GO_TO, 5.0, 6.0)
    assert sent(core.command(cleared(Hold(2, 7.0, 8.0)), 0)) == GoalOrder("run-2", GO_TO, 7.0, 8.0)
    assert sent(core.command(cleared(CloseDock(3, 2, 7)), 0)) == GoalOrder("run-3", PERCH, name="amussel7")
    assert sent(core.command(cleared(OpenDock(4, 2, 7)), 0)) == GoalOrder("run-4", RELEASE, name="amussel7")


def test_a_go_to_that_succeeds_has_arrived_once(core: GenerationACore) -> None:
    core.command(cleared(THERE), 0)
    core.receive(GoalStatusReceived(1_000, (GoalStatusEntry("run-1", GoalCode.ACTIVE),), whole=True), 1_000)
    assert tells(core, 1_000) == []
    says(core, 9_000, "run-1", GoalCode.SUCCEEDED)
    core.receive(
        GoalStatusReceived(9_000, (GoalStatusEntry("run-1", GoalCode.SUCCEEDED),), whole=True), 9_000
    )
    assert tells(core, 9_000) == [Arrived(9_000, 1)]


@pytest.mark.parametrize("command", [THERE, Hold(1, 5.0, 6.0)])
def test_a_goal_is_accepted_once_when_the_server_runs_it(core: GenerationACore, command: GoTo | Hold) -> None:
    core.command(cleared(command), 0)
    says(core, 1_000, "run-1", GoalCode.PENDING)
    assert core.advance(1_000) == []
    for at_ms in (2_000, 3_000):
        says(core, at_ms, "run-1", GoalCode.ACTIVE)
    assert core.advance(3_000) == [CommandAccepted(2_000, 1)]


def test_the_result_of_a_hold_is_no_news(core: GenerationACore) -> None:
    core.command(cleared(Hold(1, 5.0, 6.0)), 0)
    says(core, 1_000, "run-1", GoalCode.SUCCEEDED)
    assert tells(core, 20_000) == []


@pytest.mark.parametrize("code", [GoalCode.ABORTED, GoalCode.REJECTED, GoalCode.RECALLED])
def test_a_goal_that_ends_otherwise_has_failed(core: GenerationACore, code: GoalCode) -> None:
    core.command(cleared(THERE), 0)
    says(core, 2_000, "run-1", code, "because")
    assert tells(core, 2_000) == [
        CommandFailed(2_000, 1, f"the aPad's action server says {code.name}: because")
    ]


def test_a_goal_that_another_partys_pre_empted_fails_when_that_one_has_ended(core: GenerationACore) -> None:
    core.command(cleared(THERE), 0)
    says(core, 2_000, "run-1", GoalCode.PREEMPTED)
    for now_ms in range(3_000, 9_000, 1_000):
        others = (GoalStatusEntry("another's", GoalCode.ACTIVE),)
        core.receive(GoalStatusReceived(now_ms, others, whole=True), now_ms)
        assert tells(core, now_ms) == []
    others = (GoalStatusEntry("another's", GoalCode.SUCCEEDED),)
    core.receive(GoalStatusReceived(9_000, others, whole=True), 9_000)
    assert tells(core, 9_000) == [
        CommandFailed(
            9_000, 1, "the aPad's action server reports PREEMPTED: another client's goal replaced it"
        )
    ]


def test_a_goal_that_somebody_cancelled_fails_with_the_next_status(core: GenerationACore) -> None:
    core.command(cleared(THERE), 0)
    says(core, 2_000, "run-1", GoalCode.PREEMPTED)
    core.receive(
        GoalStatusReceived(3_000, (GoalStatusEntry("run-1", GoalCode.PREEMPTED),), whole=True), 3_000
    )
    assert [type(it) for it in tells(core, 3_000)] == [CommandFailed]


def test_a_goal_pre_empted_by_our_next_one_has_not_failed(core: GenerationACore) -> None:
    core.command(cleared(THERE), 0)
    core.command(cleared(Hold(2, 1.0, 1.0)), 2_000)
    says(core, 2_000, "run-1", GoalCode.PREEMPTED)
    says(core, 2_000, "run-2", GoalCode.ACTIVE)
    assert tells(core, 20_000) == []


def test_a_goal_that_nobody_takes_fails_after_five_seconds(core: GenerationACore) -> None:
    core.command(cleared(THERE), 1_000)
    assert core.unacknowledged == ["run-1"]
    assert tells(core, 5_999) == []
    assert tells(core, 6_000) == [CommandFailed(6_000, 1, "no action server took the goal within 5 s")]
    assert core.unacknowledged == []


def test_a_server_that_restarted_has_lost_the_goal(core: GenerationACore) -> None:
    core.command(cleared(THERE), 0)
    core.receive(GoalStatusReceived(500, (), whole=True), 500)
    assert tells(core, 500) == []  # not yet taken, so not lost
    core.receive(GoalStatusReceived(1_000, (GoalStatusEntry("run-1", GoalCode.ACTIVE),), whole=True), 1_000)
    core.receive(
        GoalStatusReceived(2_000, (GoalStatusEntry("another's", GoalCode.ACTIVE),), whole=True), 2_000
    )
    (failed,) = tells(core, 2_000)
    assert isinstance(failed, CommandFailed) and "LOST" in failed.reason


def test_the_first_position_static_is_the_contact_and_the_vehicle_chooses_the_dock(
    core: GenerationACore,
) -> None:
    core.command(
        cleared(CloseDock(1, 3, 7)), 0
    )  # the command names dock 3, the vehicle takes the first free dock
    says(core, 0, "run-1", GoalCode.SUCCEEDED)
    assert tells(core, 0) == []
    shows(core, 50, 7)
    assert tells(core, 50) == [DockClosed(50, 0, 7), Carried(50, 7, 2.0, 3.0)]
    assert not core.awaited_mechanisms


def test_a_perch_that_succeeds_and_does_nothing_has_failed(core: GenerationACore) -> None:
    for agent_id in range(1, 5):
        shows(core, 0, agent_id)
    tells(core, 0)
    core.command(cleared(CloseDock(1, 0, 7)), 0)
    says(core, 0, "run-1", GoalCode.SUCCEEDED)
    assert tells(core, 999) == []
    assert tells(core, 1_000) == [
        CommandFailed(1_000, 1, "the aPad reports a perch, but holds nothing: is a dock free?")
    ]


def test_a_perch_of_one_already_held_is_answered(core: GenerationACore) -> None:
    shows(core, 0, 7)
    tells(core, 0)
    core.command(cleared(CloseDock(1, 3, 7)), 0)
    says(core, 100, "run-1", GoalCode.SUCCEEDED)
    assert tells(core, 100) == [DockClosed(100, 0, 7)]


def perched_twice(core: GenerationACore) -> None:
    """aMussel 7's position comes too late for the first perch, and the server carries out the second, too."""
    core.command(cleared(CloseDock(1, 0, 7)), 0)
    says(core, 100, "run-1", GoalCode.SUCCEEDED)
    (failed,) = tells(core, 1_200)
    assert isinstance(failed, CommandFailed)
    core.command(cleared(CloseDock(2, 0, 7)), 1_200)
    shows(core, 1_250, 7)
    assert tells(core, 1_250) == [DockClosed(1_250, 0, 7), Carried(1_250, 7, 2.0, 3.0)]
    says(core, 1_300, "run-2", GoalCode.SUCCEEDED)
    core.command(cleared(OpenDock(3, 0, 7)), 60_000)
    shows(core, 60_050, 7, released=True)
    says(core, 60_050, "run-3", GoalCode.SUCCEEDED)
    assert tells(core, 60_050) == [DockOpened(60_050, 0, 7), LetGo(60_050, 7)]


def test_one_that_was_perched_twice_is_released_twice_and_docked_once(core: GenerationACore) -> None:
    perched_twice(core)
    shows(core, 60_100, 7)
    assert tells(core, 60_100) == [ReleaseWanted(60_100, 0, 7)]
    shows(core, 60_150, 7)
    shows(core, 60_200, 7, released=True)
    assert tells(core, 60_200) == []
    assert list(core.dropped.values()) == [1]
    shows(core, 61_000, 7)
    assert tells(core, 61_000) == [DockClosed(61_000, 0, 7), Carried(61_000, 7, 2.0, 3.0)]


def test_a_person_may_dock_one_again_that_seemed_to_be_perched_twice(core: GenerationACore) -> None:
    perched_twice(core)
    shows(core, 71_000, 7)
    facts = tells(core, 71_000)
    assert DockClosed(71_000, 0, 7) in facts and not any(isinstance(it, ReleaseWanted) for it in facts)


def test_a_perch_that_missed_is_none(core: GenerationACore) -> None:
    core.command(cleared(CloseDock(1, 0, 7)), 0)
    says(core, 100, "run-1", GoalCode.ABORTED, "missed")
    core.command(cleared(CloseDock(2, 0, 7)), 1_000)
    shows(core, 1_050, 7)
    core.command(cleared(OpenDock(3, 0, 7)), 5_000)
    shows(core, 5_050, 7, released=True)
    shows(core, 5_100, 7)
    assert [type(it) for it in tells(core, 5_100)][-2:] == [DockClosed, Carried]


def test_of_places_only_the_newest_is_told(core: GenerationACore) -> None:
    shows(core, 0, 7)
    tells(core, 0)
    for at_ms in range(50, 1_050, 50):
        core.receive(HeldPositionReceived(at_ms, 7, at_ms / 1000, 0.0, False), at_ms)
    assert tells(core, 1_000) == [Carried(1_000, 7, 1.0, 0.0)]
    assert tells(core, 1_000) == []


def test_the_last_message_opens_the_dock(core: GenerationACore) -> None:
    shows(core, 0, 7)
    tells(core, 0)
    core.command(cleared(OpenDock(1, 0, 7)), 1_000)
    shows(core, 1_000, 7, released=True)
    says(core, 1_000, "run-1", GoalCode.SUCCEEDED)
    assert tells(core, 1_000) == [DockOpened(1_000, 0, 7), LetGo(1_000, 7)]
    assert tells(core, 20_000) == []


def test_a_release_that_never_answers_is_one_after_two_seconds_of_silence(core: GenerationACore) -> None:
    shows(core, 0, 7)
    core.command(cleared(OpenDock(1, 0, 7)), 0)
    says(core, 0, "run-1", GoalCode.ACTIVE)
    tells(core, 0)
    is_at(core, 1_900)
    assert tells(core, 1_900) == []
    is_at(core, 2_000)
    assert tells(core, 2_000) == [DockOpened(2_000, 0, 7), LetGo(2_000, 7)]
    is_at(core, 60_000)
    assert tells(core, 60_000) == []


def test_a_release_on_its_way_is_none_while_position_static_stalls(core: GenerationACore) -> None:
    shows(core, 0, 7)
    core.command(cleared(OpenDock(1, 0, 7)), 0)
    tells(core, 0)
    is_at(core, 3_000)
    assert tells(core, 3_000) == []
    shows(core, 3_500, 7)
    core.receive(GoalStatusReceived(4_000, (GoalStatusEntry("run-1", GoalCode.ACTIVE),), whole=True), 4_000)
    is_at(core, 5_900)
    assert [type(it) for it in tells(core, 5_900)] == [Carried]
    is_at(core, 6_000)
    assert tells(core, 6_000) == [DockOpened(6_000, 0, 7), LetGo(6_000, 7)]


def test_a_release_in_which_the_server_crashes_before_it_accepts_is_one_all_the_same(
    core: GenerationACore,
) -> None:
    shows(core, 0, 7)
    core.command(cleared(OpenDock(1, 0, 7)), 0)
    tells(core, 0)
    is_at(core, 5_000)
    assert tells(core, 5_000) == [DockOpened(5_000, 0, 7), LetGo(5_000, 7)]
    is_at(core, 6_000)
    assert tells(core, 6_000) == []


def test_without_an_order_the_vehicle_is_asked_after_ten_seconds_of_silence(core: GenerationACore) -> None:
    shows(core, 0, 7)
    tells(core, 0)
    is_at(core, 9_900)
    assert tells(core, 9_900) == [] and not core.take_question()
    is_at(core, 10_000)
    shows(core, 10_000, 8)
    tells(core, 10_000)
    assert core.take_question() and not core.take_question()
    core.receive(DocksReceived(10_500, frozenset({"amussel8"})), 10_500)
    assert tells(core, 10_500) == [DockOpened(10_500, 0, 7), LetGo(10_500, 7)]


@pytest.mark.parametrize("answer", [None, frozenset(), frozenset({"amussel9"})])
def test_where_the_answer_tells_nothing_a_living_server_holds_what_it_held(
    core: GenerationACore, answer: frozenset[str] | None
) -> None:
    shows(core, 0, 7)
    for now_ms in range(1_000, 40_000, 1_000):
        core.receive(GoalStatusReceived(now_ms, (), whole=True), now_ms)
        is_at(core, now_ms)
        assert not any(isinstance(it, DockOpened) for it in tells(core, now_ms))
        if core.take_question() and answer is not None:
            core.receive(DocksReceived(now_ms, answer), now_ms)
    assert core.dropped["silence on position_static of an aMussel that the aPad holds: dead reckoning"] == 1
    core.command(cleared(OpenDock(1, 0, 7)), 40_000)
    says(core, 40_000, "run-1", GoalCode.ABORTED, "holds no amussel7")
    assert DockOpened(40_000, 0, 7) in tells(core, 40_000), "it is believed for good"


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (
            {"amussel8"},
            {
                7: "position_static is silent, check_docking_availability names others, and no release was ordered: "
                "taken for released"
            },
        ),
        (
            {"amussel7"},
            {7: "position_static is silent, check_docking_availability names it: taken for held"},
        ),
        (
            {"amussel7", "amussel9"},
            {
                7: "position_static is silent, check_docking_availability names it: taken for held",
                9: "check_docking_availability names it, and no position_static shows it: taken for free",
            },
        ),
        (
            {"amussel7", "amussel8", "amussel55"},
            {7: "position_static is silent, check_docking_availability names it: taken for held"},
        ),
    ],
)
def test_witnesses_of_a_dock_that_disagree_are_told_once(names: set[str], told: dict[int, str]) -> None:
    gate = Gate.without_guards()
    core = GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run", gate=gate)
    shows(core, 0, 7)
    for now_ms in range(1_000, 40_000, 1_000):
        core.receive(GoalStatusReceived(now_ms, (), whole=True), now_ms)
        shows(core, now_ms, 8)
        is_at(core, now_ms)
        tells(core, now_ms)
        if core.take_question():
            core.receive(DocksReceived(now_ms, frozenset(names)), now_ms)
    events = [it for it in gate.take_events() if isinstance(it, DocksDisagree)]
    assert sorted((it.id, it.reason) for it in events) == sorted(told.items())


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (frozenset({"amussel7"}), [DocksNamed(2_000, frozenset({7, 8}), frozenset({7}))]),
        (frozenset({"amussel9"}), []),  # the published service knows nothing of perches
        (frozenset(), []),
        (None, []),
    ],
)
def test_the_vehicle_is_asked_after_each_docking_and_its_answer_frees_no_amussel_that_is_shown(
    core: GenerationACore, answer: frozenset[str] | None, told: list[DocksNamed]
) -> None:
    for at_ms, agent_id in ((0, 7), (1_000, 8)):
        core.receive(HeldPositionReceived(at_ms, agent_id, 2.0, 3.0, False), at_ms)
        assert core.take_question() and not core.take_question()
    tells(core, 1_000)
    core.receive(DocksReceived(2_000, answer), 2_000)
    assert [it for it in core.advance(2_000) if isinstance(it, DocksNamed | DockOpened)] == told
    assert core.docks.holds(7) and core.docks.holds(8)


def test_after_a_resume_the_vehicle_is_asked_what_it_holds() -> None:
    """The supervisor that died took the docks' word with it."""
    empty, resumed = (
        GenerationACore(ReportedDocks(range(1, 10), docked), (10.5, 16.0), "run") for docked in ({}, {0: 7})
    )
    assert not empty.take_question() and resumed.take_question()
    resumed.receive(DocksReceived(2_000, frozenset({"amussel7"})), 2_000)
    assert DocksNamed(2_000, frozenset({7}), frozenset({7})) in resumed.advance(2_000)


@pytest.mark.parametrize("refused", [True, False])
def test_without_an_answer_the_silence_is_a_release(core: GenerationACore, refused: bool) -> None:
    shows(core, 0, 7)
    is_at(core, 10_000)
    tells(core, 10_000)
    if refused:
        core.receive(DocksReceived(11_000, None), 11_000)
    at_ms = 11_000 if refused else 14_900
    is_at(core, at_ms)
    tells(core, at_ms)
    if not refused:
        assert core.docks.holds(7)
        at_ms = 15_000
        is_at(core, at_ms)
        wanted = ReleaseWanted(at_ms, 0, 7)
        assert tells(core, at_ms) == [DockOpened(at_ms, 0, 7), LetGo(at_ms, 7), wanted]
        release = sent(core.command(cleared(ReleaseByName(-1, 0, 7)), at_ms))
        assert release == GoalOrder("run-own-1", RELEASE, name="amussel7")
    assert not core.docks.holds(7)
    core.receive(PoseReceived(16_000, 26.0, 3.0, 0.0), 16_000)
    assert core.command(cleared(OpenDock(5, 0, 7)), 16_000) is None
    assert tells(core, 16_000) == [
        CommandFailed(
            16_000, 5, "aMussel 7 is in no dock: its dock opened, by the last report, 24.0 m from here"
        )
    ]


def test_an_amussel_that_the_vehicle_says_it_holds_is_carried_beside_it_and_asked_about_again(
    core: GenerationACore,
) -> None:
    shows(core, 0, 7)
    is_at(core, 10_000)
    tells(core, 10_000)
    assert core.take_question()
    core.receive(DocksReceived(10_000, frozenset({"amussel7"})), 10_000)
    is_at(core, 11_000)
    assert tells(core, 11_000) == [Carried(11_000, 7, 2.0, 3.0)]
    for now_ms in range(12_000, 20_000, 1_000):
        is_at(core, now_ms)
        tells(core, now_ms)
        assert not core.take_question()
    is_at(core, 20_000)
    tells(core, 20_000)
    assert core.take_question()


def test_after_a_gap_in_the_wifi_the_silence_is_counted_anew(core: GenerationACore) -> None:
    shows(core, 0, 7)
    is_at(core, 1_000)
    tells(core, 1_000)
    is_at(core, 60_000)
    assert tells(core, 60_000) == [] and not core.take_question()
    is_at(core, 64_000)
    shows(core, 64_000, 7)
    tells(core, 64_000)
    assert not core.take_question()


def test_silence_of_the_whole_vehicle_is_no_release(core: GenerationACore) -> None:
    shows(core, 0, 7)
    is_at(core, 1_000)
    tells(core, 1_000)
    assert tells(core, 600_000) == []


def test_one_that_is_heard_again_is_docked_again(core: GenerationACore) -> None:
    shows(core, 0, 7)
    is_at(core, 10_000)
    tells(core, 10_000)
    core.receive(DocksReceived(10_000, None), 10_000)
    tells(core, 10_000)
    shows(core, 11_000, 7)
    closed = [DockClosed(11_000, 0, 7), Carried(11_000, 7, 2.0, 3.0)]
    assert tells(core, 11_000) == closed, "it would be released, though it is held"


def test_a_refused_release_leaves_the_dock_closed(core: GenerationACore) -> None:
    shows(core, 0, 7)
    core.command(cleared(OpenDock(1, 0, 7)), 0)
    says(core, 0, "run-1", GoalCode.ABORTED)
    assert CommandFailed(0, 1, "the aPad's action server says ABORTED") in tells(core, 0)
    shows(core, 4_000, 7)
    is_at(core, 7_000)
    assert [it for it in tells(core, 7_000) if isinstance(it, DockOpened)] == []


def test_a_release_of_one_never_heard_to_be_held_is_answered(core: GenerationACore) -> None:
    core.command(cleared(OpenDock(1, 2, 7)), 0)
    says(core, 0, "run-1", GoalCode.SUCCEEDED)
    assert tells(core, 0) == [DockOpened(0, 2, 7)]


def test_after_a_resume_the_docks_are_as_they_were() -> None:
    core = GenerationACore(ReportedDocks(range(1, 10), {1: 7, 2: 8}, 5_000), (10.5, 16.0), "run", 5_000)
    shows(core, 5_000, 7)
    assert tells(core, 5_000) == [Carried(5_000, 7, 2.0, 3.0)]
    shows(core, 6_000, 9)
    assert DockClosed(6_000, 0, 9) in tells(core, 6_000)
    for at_ms in range(6_000, 16_000, 1_000):  # no message ever concerns 8
        shows(core, at_ms, 7)
        shows(core, at_ms, 9)
        is_at(core, at_ms)
    tells(core, 15_000)
    assert core.take_question()
    core.receive(DocksReceived(16_000, frozenset({"amussel7", "amussel9"})), 16_000)
    assert DockOpened(16_000, 2, 8) in tells(core, 16_000)


@pytest.mark.parametrize("bad", [math.nan, 1e308])
def test_a_place_that_cannot_be_is_dropped_and_counted(core: GenerationACore, bad: float) -> None:
    core.receive(HeldPositionReceived(0, 7, 0.0, bad, False), 0)
    assert core.advance(0) == []
    assert core.dropped == {"position_static: east_m is outside -50000 to 50000": 1}


def test_messages_of_an_unknown_amussel_disturb_nothing(core: GenerationACore) -> None:
    shows(core, 0, 99)
    assert core.advance(0) == []
    assert core.dropped.total() == 1


def test_a_fifth_that_is_held_is_counted(core: GenerationACore) -> None:
    for agent_id in range(1, 6):
        shows(core, 0, agent_id)
    docks = [it.dock_index for it in tells(core, 0) if isinstance(it, DockClosed)]
    assert docks == [0, 1, 2, 3]
    assert core.dropped.total() == 1


def test_a_tick_is_heard_when_every_topic_has_spoken_up_to_it(core: GenerationACore) -> None:
    shows(core, 950, 7)
    assert core.silent_topics(1_000) == ["position", "action_server/status", "/amussel7/position_static"]
    is_at(core, 1_000)
    core.receive(GoalStatusReceived(1_000, (), whole=True), 1_000)
    shows(core, 1_000, 7)
    assert core.silent_topics(1_000) == []


def test_a_perch_from_afar_is_not_ordered() -> None:
    """The vehicle would take it, and would hold the aMussel at a place where the aMussel is not."""
    core = GenerationACore(
        ReportedDocks(range(1, 10)),
        (10.5, 16.0),
        "run",
        out_of_reach=partial(why_out_of_reach, lambda _: {7: (2.1, 13.1), 8: (2.1, 4.1)}),
    )
    is_at(core, 0)
    assert core.command(cleared(CloseDock(1, 0, 7)), 0) is None
    assert tells(core, 0) == [
        CommandFailed(0, 1, "aMussel 7 floats 10.0 m away: go nearer than 5 m before docking it")
    ]
    assert sent(core.command(cleared(CloseDock(2, 0, 8)), 0)) == GoalOrder("run-2", PERCH, name="amussel8")


def test_a_goal_that_was_sent_to_a_silent_vehicle_is_sent_again_when_it_is_heard(
    core: GenerationACore,
) -> None:
    is_at(core, 0)
    tells(core, 5_000)
    order = core.command(cleared(THERE), 6_000)
    for now_ms in range(7_000, 30_000, 1_000):
        assert tells(core, now_ms) == [] and core.take_orders() == []
    is_at(core, 30_000)
    assert tells(core, 30_000) == []
    assert core.take_orders() == [order]
    assert core.take_orders() == []
    for now_ms in range(31_000, 35_000, 1_000):
        is_at(core, now_ms)
        assert tells(core, now_ms) == []
    is_at(core, 35_000)
    assert tells(core, 35_000) == [CommandFailed(35_000, 1, "no action server took the goal within 5 s")]


def test_a_stop_cancels_the_goals_that_run_and_those_on_their_way_by_their_keys(
    core: GenerationACore,
) -> None:
    """A cancel of all could come after the stop's own goal, on another connection, and end it."""
    core.command(cleared(THERE), 1_000)
    says(core, 1_200, "run-1", GoalCode.ACTIVE)
    words = (
        GoalStatusEntry("run-1", GoalCode.ACTIVE),
        GoalStatusEntry("/joy-1-2.0", GoalCode.ACTIVE),
        GoalStatusEntry("/joy-0-1.0", GoalCode.SUCCEEDED),
    )
    core.receive(GoalStatusReceived(1_400, words, whole=True), 1_400)
    core.receive(GoalSeen(1_500, "/neptus-7-3.0", GO_TO, 9.0, 9.0, "/neptus"), 1_500)
    order = core.command(cleared(Hold(2, 1.0, 1.0, pre_empts=True)), 1_600)
    assert order is not None and set(order.order.ends) == {"run-1", "/joy-1-2.0", "/neptus-7-3.0"}
    again = core.command(cleared(Hold(3, 1.0, 1.0)), 1_700)
    assert again is not None and again.order.ends == ()


def test_another_s_goal_that_runs_and_was_not_heard_is_told_once() -> None:
    """Its client sent it when the server, and not yet this bench, was connected to it."""
    core = GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run", takes_back=False)
    told: list[LinkFact] = []
    for at_ms in range(0, 4_000, 200):
        words = (GoalStatusEntry("/neptus-7-3.0", GoalCode.ACTIVE),) if at_ms >= 1_000 else ()
        core.receive(GoalStatusReceived(at_ms, words, whole=True), at_ms)
        told += [it for it in tells(core, at_ms) if isinstance(it, GoalOfOthers)]
    (unseen,) = told
    assert (unseen.client, unseen.north_m) == ("/neptus", None)
    assert 1_500 <= unseen.at_ms <= 2_000


@pytest.mark.parametrize("seen_ms", [700, 950, 1_300])
def test_another_s_goal_that_was_heard_has_its_place_and_is_told_once(seen_ms: int) -> None:
    """Its message and the statuses come over two connections, in any order; a status between may not know it yet."""
    core = GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run", takes_back=False)
    told: list[LinkFact] = []
    for at_ms in range(0, 4_000, 50):
        if at_ms == seen_ms:
            core.receive(GoalSeen(at_ms, "/neptus-7-3.0", GO_TO, 9.0, 8.0, "/neptus"), at_ms)
        if at_ms % 200 == 0:
            words = (GoalStatusEntry("/neptus-7-3.0", GoalCode.ACTIVE),) if at_ms >= 1_000 else ()
            core.receive(GoalStatusReceived(at_ms, words, whole=True), at_ms)
        told += [it for it in tells(core, at_ms) if isinstance(it, GoalOfOthers)]
    assert told == [GoalOfOthers(seen_ms, "/neptus", 9.0, 8.0)]
