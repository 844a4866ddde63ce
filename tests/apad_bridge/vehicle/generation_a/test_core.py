"""The facts and failures that the docking port gets from a generation A aPad, its surprises included."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import pytest
from stack_benches import cleared, fed

from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    DockClosed,
    DockOpened,
    DocksNamed,
    GoalOfOthers,
    GoTo,
    Hold,
    OpenDock,
    PoseReported,
    Primitive,
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
from apad_bridge.vehicle.vehicle_link import Carried, LetGo, LinkFact
from apad_bridge.world.contacts import why_out_of_reach

THERE = GoTo(1, 5.0, 6.0, 0.5, 0.5)


@pytest.fixture
def core() -> GenerationACore:
    return GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run")


@pytest.fixture
def holds_7(core: GenerationACore) -> GenerationACore:
    """One that holds aMussel 7 in its first dock since 0, and has told so."""
    played(core, shown(0, 7))
    return core


ASKED = "the docks' service is asked"


def played(core: GenerationACore, *story: Any) -> list[LinkFact | str]:
    """The new facts of a story: of messages, of orders with their times, and of times that merely come.

    Left out are readings of pose and battery, acceptances, and the word of the docks' service; not that it is asked.
    """
    told: list[LinkFact | str] = []
    for it in story:
        at_ms = fed(core, it)
        readings = PoseReported | BatteryReported | CommandAccepted | DocksNamed
        told += [it for it in core.advance(at_ms) if not isinstance(it, readings)]
        if core.take_question():
            told.append(ASKED)
            assert not core.take_question()
    return told


def status(at_ms: int, key: str, code: GoalCode, text: str = "") -> GoalStatusReceived:
    """The word of one goal."""
    return GoalStatusReceived(at_ms, (GoalStatusEntry(key, code, text),), whole=False)


def statuses(at_ms: int, **goals: GoalCode) -> GoalStatusReceived:
    """The list of all goals that the server knows."""
    entries = (GoalStatusEntry(key.replace("_", "-"), code) for key, code in goals.items())
    return GoalStatusReceived(at_ms, tuple(entries), whole=True)


def shown(at_ms: int, agent_id: int, released: bool = False) -> HeldPositionReceived:
    return HeldPositionReceived(at_ms, agent_id, 2.0, 3.0, released)


def there(at_ms: int) -> PoseReported:
    """The vehicle is heard, near the aMussels that `shown` tells of."""
    return PoseReported(at_ms, 2.1, 3.1, 0.0)


def docked(at_ms: int, agent_id: int, dock_index: int = 0) -> list[LinkFact | str]:
    """After each docking the vehicle is asked what it holds."""
    return [DockClosed(at_ms, dock_index, agent_id), Carried(at_ms, agent_id, 2.0, 3.0), ASKED]


def released(at_ms: int, agent_id: int) -> list[LinkFact]:
    return [DockOpened(at_ms, 0, agent_id), LetGo(at_ms, agent_id)]


@pytest.mark.parametrize(
    ("command", "goal"),
    [
        (THERE, GoalOrder("run-1", GO_TO, 5.0, 6.0)),
        (Hold(1, 7.0, 8.0), GoalOrder("run-1", GO_TO, 7.0, 8.0)),
        (CloseDock(1, 2, 7), GoalOrder("run-1", PERCH, name="amussel7")),
        (OpenDock(1, 2, 7), GoalOrder("run-1", RELEASE, name="amussel7")),
    ],
)
def test_commands_become_goals_of_the_three_kinds(
    core: GenerationACore, command: Primitive, goal: GoalOrder
) -> None:
    assert core.command(cleared(command), 0).order == goal


OTHERS = [statuses(at_ms, others=GoalCode.ACTIVE) for at_ms in range(3_000, 9_000, 1_000)]
REPLACED = "the aPad's action server reports PREEMPTED: another client's goal replaced it"
HOLDS_NOTHING = "the aPad reports a perch, but holds nothing: is a dock free?"
SILENT = "silence on position_static, taken for a release"
PERCHED_TWICE = [
    (0, CloseDock(1, 0, 7)),
    status(100, "run-1", GoalCode.SUCCEEDED),
    1_200,
    (1_200, CloseDock(2, 0, 7)),
    shown(1_250, 7),
    status(1_300, "run-2", GoalCode.SUCCEEDED),
    (60_000, OpenDock(3, 0, 7)),
    shown(60_050, 7, True),
    status(60_050, "run-3", GoalCode.SUCCEEDED),
]
"""aMussel 7's position came too late for the first perch, and the server carried out the second, too."""
RELEASED_ONCE = [CommandFailed(1_200, 1, HOLDS_NOTHING), *docked(1_250, 7), *released(60_050, 7)]
STORIES: dict[str, tuple[list[Any], list[LinkFact | str]]] = {
    "a go-to that succeeds has arrived once": (
        [
            (0, THERE),
            statuses(1_000, run_1=GoalCode.ACTIVE),
            status(9_000, "run-1", GoalCode.SUCCEEDED),
            statuses(9_000, run_1=GoalCode.SUCCEEDED),
        ],
        [Arrived(9_000, 1)],
    ),
    "the result of a hold is no news": (
        [(0, Hold(1, 5.0, 6.0)), status(1_000, "run-1", GoalCode.SUCCEEDED), 20_000],
        [],
    ),
    **{
        f"a goal that ends as {code.name} has failed": (
            [(0, THERE), status(2_000, "run-1", code, "because")],
            [CommandFailed(2_000, 1, f"the aPad's action server says {code.name}: because")],
        )
        for code in (GoalCode.ABORTED, GoalCode.REJECTED, GoalCode.RECALLED)
    },
    "a goal that another party's pre-empted fails when that one has ended": (
        [
            (0, THERE),
            status(2_000, "run-1", GoalCode.PREEMPTED),
            *OTHERS,
            statuses(9_000, others=GoalCode.SUCCEEDED),
        ],
        [CommandFailed(9_000, 1, REPLACED)],
    ),
    "a goal pre-empted by our next one has not failed": (
        [
            (0, THERE),
            (2_000, Hold(2, 1.0, 1.0)),
            status(2_000, "run-1", GoalCode.PREEMPTED),
            status(2_000, "run-2", GoalCode.ACTIVE),
            20_000,
        ],
        [],
    ),
    "a perch that succeeds and does nothing, since all docks are taken, has failed": (
        [
            *(shown(0, agent_id) for agent_id in range(1, 5)),
            (0, CloseDock(1, 0, 7)),
            status(0, "run-1", GoalCode.SUCCEEDED),
            999,
            1_000,
        ],
        [
            *(it for n in range(4) for it in docked(0, n + 1, n)),
            CommandFailed(1_000, 1, HOLDS_NOTHING),
        ],
    ),
    "a perch of one already held is answered": (
        [shown(0, 7), (0, CloseDock(1, 3, 7)), status(100, "run-1", GoalCode.SUCCEEDED)],
        [*docked(0, 7), DockClosed(100, 0, 7)],
    ),
    "a perch that missed is none": (
        [
            (0, CloseDock(1, 0, 7)),
            status(100, "run-1", GoalCode.ABORTED, "missed"),
            (1_000, CloseDock(2, 0, 7)),
            shown(1_050, 7),
            (5_000, OpenDock(3, 0, 7)),
            shown(5_050, 7, True),
            shown(5_100, 7),
        ],
        [
            CommandFailed(100, 1, "the aPad's action server says ABORTED: missed"),
            *docked(1_050, 7),
            *released(5_050, 7),
            *docked(5_100, 7),
        ],
    ),
    "the last message opens the dock": (
        [
            shown(0, 7),
            (1_000, OpenDock(1, 0, 7)),
            shown(1_000, 7, True),
            status(1_000, "run-1", GoalCode.SUCCEEDED),
            20_000,
        ],
        [*docked(0, 7), *released(1_000, 7)],
    ),
    "a release that was accepted and never answers is one after two seconds of silence": (
        [
            shown(0, 7),
            (0, OpenDock(1, 0, 7)),
            status(0, "run-1", GoalCode.ACTIVE),
            *(there(at_ms) for at_ms in (1_900, 2_000, 60_000)),
        ],
        [*docked(0, 7), *released(2_000, 7), SILENT],
    ),
    "a release before whose acceptance the server crashes is one after five": (
        [shown(0, 7), (0, OpenDock(1, 0, 7)), *(there(at_ms) for at_ms in (4_900, 5_000, 60_000))],
        [*docked(0, 7), *released(5_000, 7), SILENT],
    ),
    "a release on its way is none while position_static stalls": (
        [
            shown(0, 7),
            (0, OpenDock(1, 0, 7)),
            there(3_000),
            shown(3_500, 7),
            statuses(4_000, run_1=GoalCode.ACTIVE),
            there(5_900),
            there(6_000),
        ],
        [*docked(0, 7), Carried(3_500, 7, 2.0, 3.0), *released(6_000, 7), SILENT],
    ),
    "a refused release leaves the dock closed": (
        [
            shown(0, 7),
            (0, OpenDock(1, 0, 7)),
            status(0, "run-1", GoalCode.ABORTED),
            shown(4_000, 7),
            there(7_000),
        ],
        [
            *docked(0, 7),
            CommandFailed(0, 1, "the aPad's action server says ABORTED"),
            Carried(4_000, 7, 2.0, 3.0),
        ],
    ),
    "a release of one never heard to be held is answered": (
        [(0, OpenDock(1, 2, 7)), status(0, "run-1", GoalCode.SUCCEEDED)],
        [DockOpened(0, 2, 7)],
    ),
    "a goal that somebody cancelled fails with the next status": (
        [(0, THERE), status(2_000, "run-1", GoalCode.PREEMPTED), statuses(3_000, run_1=GoalCode.PREEMPTED)],
        [CommandFailed(3_000, 1, REPLACED)],
    ),
    "a server that restarted has lost the goal": (
        [
            (0, THERE),
            statuses(500),
            statuses(1_000, run_1=GoalCode.ACTIVE),
            statuses(2_000, others=GoalCode.ACTIVE),
        ],
        [CommandFailed(2_000, 1, "the aPad's action server says LOST: did it restart?")],
    ),
    "one that was perched twice is released twice and docked once": (
        [*PERCHED_TWICE, shown(60_100, 7), shown(60_150, 7), shown(60_200, 7, True), shown(61_000, 7)],
        [
            *RELEASED_ONCE,
            ReleaseWanted(60_100, 0, 7),
            *docked(61_000, 7),
            "position_static of an aMussel that was held twice: released again",
        ],
    ),
    "a person may dock one again that seemed to be perched twice": (
        [*PERCHED_TWICE, shown(71_000, 7)],
        [*RELEASED_ONCE, *docked(71_000, 7)],
    ),
    # It may be held all the same, and would be released otherwise.
    "a refused answer makes the silence a release": (
        [shown(0, 7), there(10_000), DocksReceived(11_000, None), there(11_000), shown(12_000, 7)],
        [
            *docked(0, 7),
            ASKED,
            *released(11_000, 7),
            ReleaseWanted(11_000, 0, 7),
            *docked(12_000, 7),
            f"{SILENT} without an order",
        ],
    ),
    **{
        f"a place that cannot be, {bad:g}, is dropped and counted": (
            [HeldPositionReceived(0, 7, 0.0, bad, False)],
            ["position_static: east_m is outside -50000 to 50000"],
        )
        for bad in (math.nan, 1e308)
    },
    "a release whose place cannot be opens the dock, and the place is counted": (
        [shown(0, 7), HeldPositionReceived(1_000, 7, 0.0, math.nan, True)],
        [*docked(0, 7), *released(1_000, 7), "position_static: east_m is outside -50000 to 50000"],
    ),
    "messages of an unknown aMussel disturb nothing": (
        [shown(0, 99)],
        ["position_static of an aMussel that is not of this fleet"],
    ),
    "a fifth that is held is counted": (
        [shown(0, agent_id) for agent_id in range(1, 6)],
        [
            *(it for n in range(4) for it in docked(0, n + 1, n)),
            "position_static of more aMussels than there are docks",
        ],
    ),
    "without an order the vehicle is asked after ten seconds of silence": (
        [shown(0, 7), there(9_900), there(10_000), DocksReceived(10_500, frozenset({"amussel8"}))],
        [
            *docked(0, 7),
            ASKED,
            *released(10_500, 7),
            ReleaseWanted(10_500, 0, 7),
            f"{SILENT} without an order",
        ],
    ),
    "an aMussel that the vehicle says it holds is carried beside it and asked about again": (
        [
            shown(0, 7),
            there(10_000),
            DocksReceived(10_000, frozenset({"amussel7"})),
            *(there(now_ms) for now_ms in range(11_000, 21_000, 1_000)),
        ],
        [
            *docked(0, 7),
            ASKED,
            *(Carried(now_ms, 7, 2.0, 3.0) for now_ms in range(10_000, 21_000, 1_000)),
            ASKED,
            "silence on position_static of an aMussel that the aPad holds: dead reckoning",
        ],
    ),
    "after a gap in the wifi the silence is counted anew": (
        [shown(0, 7), there(1_000), there(60_000), there(64_000), shown(64_000, 7)],
        [*docked(0, 7), Carried(64_000, 7, 2.0, 3.0)],
    ),
    "silence of the whole vehicle is no release": ([shown(0, 7), there(1_000), 600_000], docked(0, 7)),
}


@pytest.mark.parametrize(("story", "told"), STORIES.values(), ids=STORIES)
def test_a_story_tells(core: GenerationACore, story: list[Any], told: list[LinkFact | str]) -> None:
    """Each fact bears the time of the step that tells it; last comes what was dropped, each once."""
    assert [*played(core, *story), *core.dropped.elements()] == told


@pytest.mark.parametrize("command", [THERE, Hold(1, 5.0, 6.0)])
def test_a_goal_is_accepted_once_when_the_server_runs_it(core: GenerationACore, command: GoTo | Hold) -> None:
    core.command(cleared(command), 0)
    for at_ms, code in ((1_000, GoalCode.PENDING), (2_000, GoalCode.ACTIVE), (3_000, GoalCode.ACTIVE)):
        core.receive(status(at_ms, "run-1", code), at_ms)
    assert core.advance(3_000) == [CommandAccepted(2_000, 1)]


def test_a_goal_that_nobody_takes_fails_after_five_seconds(core: GenerationACore) -> None:
    assert played(core, (1_000, THERE), 5_999) == [] and core.unacknowledged == ["run-1"]
    failed = CommandFailed(6_000, 1, "no action server took the goal within 5 s")
    assert played(core, 6_000) == [failed] and core.unacknowledged == []


def test_the_first_position_static_is_the_contact_and_the_vehicle_chooses_the_dock(
    core: GenerationACore,
) -> None:
    """The command names dock 3, and the vehicle takes the first free dock."""
    perched = status(0, "run-1", GoalCode.SUCCEEDED)
    assert played(core, (0, CloseDock(1, 3, 7)), perched, shown(50, 7)) == docked(50, 7)
    assert not core.awaited_mechanisms


def test_of_places_only_the_newest_is_told(holds_7: GenerationACore) -> None:
    for at_ms in range(50, 1_050, 50):
        holds_7.receive(HeldPositionReceived(at_ms, 7, at_ms / 1000, 0.0, False), at_ms)
    assert played(holds_7, 1_000, 1_000) == [Carried(1_000, 7, 1.0, 0.0)]


@pytest.mark.parametrize("answer", [None, frozenset(), frozenset({"amussel9"})])
def test_where_the_answer_tells_nothing_a_living_server_holds_what_it_held(
    holds_7: GenerationACore, answer: frozenset[str] | None
) -> None:
    told: list[LinkFact | str] = []
    for now_ms in range(1_000, 40_000, 1_000):
        told += (asked := played(holds_7, statuses(now_ms), there(now_ms)))
        if ASKED in asked and answer is not None:
            told += played(holds_7, DocksReceived(now_ms, answer))
    assert not any(isinstance(it, DockOpened) for it in told)
    silent = "silence on position_static of an aMussel that the aPad holds: dead reckoning"
    assert holds_7.dropped[silent] == 1
    refusal = status(40_000, "run-1", GoalCode.ABORTED, "holds no amussel7")
    assert DockOpened(40_000, 0, 7) in played(holds_7, (40_000, OpenDock(1, 0, 7)), refusal)


NAMED = "position_static is silent, check_docking_availability names it: taken for held"
UNNAMED = (
    "position_static is silent, check_docking_availability names others, and no release was ordered: "
    "taken for released"
)
UNSEEN = "check_docking_availability names it, and no position_static shows it: taken for free"


@pytest.mark.parametrize(
    ("names", "told"),
    [
        ({"amussel8"}, {7: UNNAMED}),
        ({"amussel7"}, {7: NAMED}),
        ({"amussel7", "amussel9"}, {7: NAMED, 9: UNSEEN}),
        ({"amussel7", "amussel8", "amussel55"}, {7: NAMED}),
    ],
)
def test_witnesses_of_a_dock_that_disagree_are_told_once(names: set[str], told: dict[int, str]) -> None:
    gate = Gate.without_guards()
    core = GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run", gate=gate)
    played(core, shown(0, 7))
    for now_ms in range(1_000, 40_000, 1_000):
        played(core, statuses(now_ms), shown(now_ms, 8))
        if ASKED in played(core, there(now_ms)):
            played(core, DocksReceived(now_ms, frozenset(names)))
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
        core.receive(shown(at_ms, agent_id), at_ms)
        assert core.take_question() and not core.take_question()
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


def test_without_an_answer_for_five_seconds_the_silence_is_a_release(holds_7: GenerationACore) -> None:
    opened = [ASKED, *released(15_000, 7), ReleaseWanted(15_000, 0, 7)]
    assert played(holds_7, there(10_000), there(14_900), there(15_000)) == opened
    release = holds_7.command(cleared(ReleaseByName(-1, 0, 7)), 15_000)
    assert release.order == GoalOrder("run-own-1", RELEASE, name="amussel7")
    assert played(holds_7, PoseReported(16_000, 26.0, 3.0, 0.0), (16_000, OpenDock(5, 0, 7))) == [
        CommandFailed(
            16_000, 5, "aMussel 7 is in no dock: its dock opened, by the last report, 24.0 m from here"
        )
    ]


def test_after_a_resume_the_docks_are_as_they_were() -> None:
    core = GenerationACore(ReportedDocks(range(1, 10), {1: 7, 2: 8}, 5_000), (10.5, 16.0), "run", 5_000)
    assert played(core, shown(5_000, 7)) == [Carried(5_000, 7, 2.0, 3.0), ASKED]
    assert played(core, shown(6_000, 9)) == docked(6_000, 9)
    # No message ever concerns 8.
    ticks = [(shown(at_ms, 7), shown(at_ms, 9), there(at_ms)) for at_ms in range(6_000, 16_000, 1_000)]
    assert played(core, *(it for tick in ticks for it in tick))[-1] == ASKED
    assert DockOpened(16_000, 2, 8) in played(
        core, DocksReceived(16_000, frozenset({"amussel7", "amussel9"}))
    )


def test_a_tick_is_heard_when_every_topic_has_spoken_up_to_it(core: GenerationACore) -> None:
    played(core, shown(950, 7))
    assert core.silent_topics(1_000) == ["position", "action_server/status", "/amussel7/position_static"]
    played(core, there(1_000), statuses(1_000), shown(1_000, 7))
    assert core.silent_topics(1_000) == []


def test_a_perch_from_afar_is_not_ordered() -> None:
    """The vehicle would take it, and would hold the aMussel at a place where the aMussel is not."""
    core = GenerationACore(
        ReportedDocks(range(1, 10)),
        (10.5, 16.0),
        "run",
        out_of_reach=partial(why_out_of_reach, lambda _: {7: (2.1, 13.1), 8: (2.1, 4.1)}),
    )
    assert played(core, there(0), (0, CloseDock(1, 0, 7))) == [
        CommandFailed(0, 1, "aMussel 7 floats 10.0 m away: go nearer than 5 m before docking it")
    ]
    assert core.command(cleared(CloseDock(2, 0, 8)), 0).order == GoalOrder("run-2", PERCH, name="amussel8")


def test_a_goal_that_was_sent_to_a_silent_vehicle_is_sent_again_when_it_is_heard(
    core: GenerationACore,
) -> None:
    played(core, there(0), 5_000)
    order = core.command(cleared(THERE), 6_000)
    assert played(core, *range(7_000, 30_000, 1_000)) == [] and core.take_orders() == []
    assert played(core, there(30_000)) == [] and core.take_orders() == [order]
    heard = (there(at_ms) for at_ms in range(31_000, 36_000, 1_000))
    assert played(core, *heard) == [CommandFailed(35_000, 1, "no action server took the goal within 5 s")]
    assert core.take_orders() == []


def test_a_stop_cancels_the_goals_that_run_and_those_on_their_way_by_their_keys(
    core: GenerationACore,
) -> None:
    """A cancel of all could come after the stop's own goal, on another connection, and end it."""
    goals = statuses(1_400, run_1=GoalCode.ACTIVE, joy_1=GoalCode.ACTIVE, joy_0=GoalCode.SUCCEEDED)
    seen = GoalSeen(1_500, "/neptus-7-3.0", GO_TO, 9.0, 9.0, "/neptus")
    played(core, (1_000, THERE), status(1_200, "run-1", GoalCode.ACTIVE), goals, seen)
    order = core.command(cleared(Hold(2, 1.0, 1.0, pre_empts=True)), 1_600)
    assert order is not None and set(order.order.ends) == {"run-1", "joy-1", "/neptus-7-3.0"}
    again = core.command(cleared(Hold(3, 1.0, 1.0)), 1_700)
    assert again is not None and again.order.ends == ()


@pytest.mark.parametrize("seen_ms", [700, 950, 1_300, None])
def test_another_s_goal_is_told_once_and_has_its_place_where_it_was_heard(seen_ms: int | None) -> None:
    """Its message and the statuses come over two connections, in any order; a status between may not know it yet.

    The message does not come where its client sent it before this bench was connected.
    """
    core = GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run", takes_back=False)
    runs = GoalStatusEntry("/neptus-7-3.0", GoalCode.ACTIVE)
    told: list[LinkFact] = []
    for at_ms in range(0, 4_000, 50):
        if at_ms == seen_ms:
            told += played(core, GoalSeen(at_ms, "/neptus-7-3.0", GO_TO, 9.0, 8.0, "/neptus"))
        if at_ms % 200 == 0:
            told += played(core, GoalStatusReceived(at_ms, (runs,) if at_ms >= 1_000 else (), whole=True))
    (other,) = (it for it in told if isinstance(it, GoalOfOthers))
    if seen_ms is not None:
        assert other == GoalOfOthers(seen_ms, "/neptus", 9.0, 8.0)
    else:
        assert (other.client, other.north_m) == ("/neptus", None) and 1_500 <= other.at_ms <= 2_000


@pytest.mark.parametrize("north_m", [51_000.0, math.nan])
def test_another_s_goal_to_no_place_of_any_water_is_told_once_and_counted(north_m: float) -> None:
    core = GenerationACore(ReportedDocks(range(1, 10)), (10.5, 16.0), "run", takes_back=False)
    seen = GoalSeen(800, "/neptus-7-3.0", GO_TO, north_m, 8.0, "/neptus")
    runs = GoalStatusEntry(seen.key, GoalCode.ACTIVE)
    told = played(core, statuses(700), seen, GoalStatusReceived(1_000, (runs,), whole=True), 3_000)
    why = "north_m is outside -50000 to 50000"
    assert told == [GoalOfOthers(800, "/neptus", None, None, why), CommandedByOthers(1_000, "/neptus")]
    assert core.dropped == {f"action_server/goal: {why}": 1}
