"""The watch of somebody's master: a connection that ended is asked for until it is back, or its publisher is gone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from xmlrpc.client import MultiCall, ServerProxy

import pytest
from xmlrpc_answers import CUT_SHORT, answering_with, whole

from apad_bridge.doctor.network import Unreachable
from apad_bridge.events.graph_events import MasterGone
from apad_bridge.ros.system import master_watch
from apad_bridge.ros.system.master_watch import MasterWatch, _answers

SOON_S = 10.0

HEARD = (1, "http://far:1/", "i", "TCPROS", "/musselbed/heard", True, "")
POSITION = (3, "http://far:1/", "i", "TCPROS", "/amussel3/position", True, "")
SAID = (2, "/musselbed_fleet_5", "o", "TCPROS", "/musselbed/said", True, "")


Graph = Any
"""The connections of this node, the clock, and the times at which everything was registered, or `said` named again."""


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    found: Any = SimpleNamespace(connections=[HEARD, SAID], subscriptions=["/musselbed/heard"], now_s=0.0)
    found.registered_s, found.named_s = [], []
    found.get_publications = lambda: [("/musselbed/said", "std_msgs/String")]
    found.has_subscription = lambda topic: topic in found.subscriptions
    found.get_pub_sub_info = lambda: list(found.connections)
    monkeypatch.setattr(master_watch, "get_topic_manager", lambda: found)
    monkeypatch.setattr(master_watch, "time", SimpleNamespace(monotonic=lambda: found.now_s))
    monkeypatch.setattr(master_watch, "call_for_reply", lambda *_: (1, "", "http://here:1/"))
    monkeypatch.setattr(MasterWatch, "_register_again", lambda _: found.registered_s.append(found.now_s) or 2)
    monkeypatch.setattr(master_watch, "name_again", lambda topic, kind: found.named_s.append(found.now_s))
    return found


def look_for(graph: Graph, watch: MasterWatch, seconds: int) -> None:
    for _ in range(seconds):
        graph.now_s += 1
        watch._look()


def watch_by_hand() -> MasterWatch:
    watch = MasterWatch("http://h:1", period_s=1.0)
    watch._ended.set()  # its own thread would look too
    watch._thread.join()
    return watch


WATCHED: dict[str, list[tuple[list[tuple[object, ...]], int, list[int], list[int]]]] = {
    # The connections, for how many seconds, and the times at which all was registered, or `said` named, meanwhile.
    "a lost connection is asked for ever more seldom until it is back, and the next loss at once": [
        ([HEARD, SAID], 5, [], []),
        ([SAID], 100, [6, 7, 9, 13, 21, 37, 67, 97], []),
        ([HEARD, SAID], 100, [], []),
        ([SAID], 1, [206], []),
    ],
    "a reader that is lost is called back until it comes, or five minutes are over": [
        ([HEARD, SAID], 5, [], []),
        ([HEARD], 20, [], [6, 7, 8, 10, 14, 22]),
        ([HEARD, SAID], 100, [], []),
        ([HEARD], 1000, [], [126, 127, 128, 130, 134, 142, 158, *range(188, 426, 30)]),
    ],
}


@pytest.mark.parametrize("steps", WATCHED.values(), ids=WATCHED)
def test_what_is_lost_is_asked_for(
    graph: Graph, steps: list[tuple[list[tuple[object, ...]], int, list[int], list[int]]]
) -> None:
    watch, found = watch_by_hand(), []
    for graph.connections, seconds, _, _ in steps:
        graph.registered_s, graph.named_s = [], []
        look_for(graph, watch, seconds)
        found.append((graph.connections, seconds, graph.registered_s, graph.named_s))
    assert found == steps and watch.take() == []


def test_an_answer_that_is_cut_short_is_a_master_that_is_gone() -> None:
    with answering_with(CUT_SHORT) as uri:
        watch = MasterWatch(uri, period_s=0.01)
        assert [type(it) for it in watch._events.take(SOON_S)] == [MasterGone]
        watch.close()


@pytest.mark.parametrize("answer", [7, [], [7], [{}], [[7]], [[[1, ""]]], [[[1, "", []]]] * 2])
def test_answers_to_calls_together_that_are_none_are_a_failure_of_the_master(answer: object) -> None:
    with answering_with(whole(answer)) as uri, ServerProxy(uri) as master:
        together = MultiCall(master)
        together.registerPublisher("/musselbed/said")
        with pytest.raises(Unreachable):
            _answers(together(), 1)


def test_a_connection_of_a_topic_that_was_left_is_not_asked_for(graph: Graph) -> None:
    watch = watch_by_hand()
    graph.connections = [HEARD, POSITION]
    graph.subscriptions.append("/amussel3/position")
    look_for(graph, watch, 1)
    graph.connections = [HEARD]
    graph.subscriptions.pop()
    look_for(graph, watch, 100)
    assert graph.registered_s == []
