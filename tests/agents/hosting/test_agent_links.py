"""The watchdog of the agents' links: whom it waits for, and whom it kills. The other ends are sockets in a thread."""

from __future__ import annotations

import os
import select
import socket
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import cast

import pytest

from agents.hosting.agent_links import AgentLinks, WindowAnswered
from agents.hosting.host import Death, Grant, Reply
from agents.hosting.link_protocol import WindowGrant, decode_to_agent, encode_answer
from agents.hosting.nursery_client import NurseryLink
from firmware_model.stimuli import ResetCause

TIMEOUT_S = 0.1
PATIENCE = 10
FLEET = range(1, PATIENCE + 5)
KEY = (1, 1)


class Nursery:
    """A nursery whose agents do not end when they are killed."""

    def __init__(self) -> None:
        self.truth, self._truths = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._link, self._end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.truth.setblocking(False)
        self.killed: list[int] = []

    def fileno(self) -> int:
        return self._link.fileno()

    def kill(self, agent_id: int) -> None:
        self.killed.append(agent_id)

    def close(self) -> None:
        for it in (self.truth, self._truths, self._link, self._end):
            it.close()


class Fleet:
    """Agents of which each answers when `answers_now(id, how often it was asked)` is true, in a thread of their own."""

    def __init__(self, stack: ExitStack, answers_now: Callable[[int, int], bool]) -> None:
        self.nursery = Nursery()
        stack.callback(self.nursery.close)
        self.links = AgentLinks(cast(NurseryLink, self.nursery), TIMEOUT_S)
        stack.callback(self.links.close)
        self._ends: dict[int, tuple[int, socket.socket]] = {}
        for agent_id in FLEET:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            stack.callback(theirs.close)
            self.links.add(agent_id, os.getpid(), ours.detach())
            self._ends[theirs.fileno()] = agent_id, theirs
        self._answers_now = answers_now
        self._over, self._end = socket.socketpair()
        stack.callback(self._over.close)
        executor = stack.enter_context(ThreadPoolExecutor(1))
        running = executor.submit(self._answer)
        stack.callback(running.result)
        stack.callback(self._end.close)

    def ask(self) -> dict[int, WindowAnswered | Death]:
        return self.links.ask(KEY, dict.fromkeys(FLEET, WindowGrant(KEY, Grant(1000, ())).encode()))

    def _answer(self) -> None:
        poll = select.poll()
        poll.register(self._over, select.POLLIN)
        for descriptor in self._ends:
            poll.register(descriptor, select.POLLIN)
        asked: Counter[int] = Counter()
        while True:
            for descriptor, _ in poll.poll():
                if descriptor == self._over.fileno():
                    return
                agent_id, link = self._ends[descriptor]
                data = link.recv(1000)
                if not data:
                    poll.unregister(descriptor)
                    continue
                assert decode_to_agent(data).key == KEY
                asked[agent_id] += 1
                if self._answers_now(agent_id, asked[agent_id]):
                    (answer,) = encode_answer(KEY, KEY, 1000, 0, Reply(None, ()))
                    link.send(answer)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize("silent", [None, FLEET[3]], ids=["one after the other", "one stays silent"])
def test_who_answers_late_is_waited_for_and_who_stays_silent_is_killed(
    stack: ExitStack, silent: int | None
) -> None:
    """The last one answers long after the watchdog's patience with one agent, but all the while others did."""

    def answers_now(agent_id: int, asked: int) -> bool:
        return asked == agent_id if silent is None else agent_id != silent and asked == 1

    fleet = Fleet(stack, answers_now)
    outcomes = fleet.ask()
    assert list(outcomes) == list(FLEET)
    if silent is not None:
        reason = f"no answer within {PATIENCE * TIMEOUT_S:g} s: killed by the watchdog"
        assert outcomes.pop(silent) == Death(ResetCause.WATCHDOG, reason)
    assert all(isinstance(it, WindowAnswered) for it in outcomes.values())
    assert fleet.nursery.killed == ([] if silent is None else [silent])
