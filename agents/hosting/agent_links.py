"""The links of all living agents: asks many at once, and waits for the whole answer or the death of each.

The watchdog kills an agent that has not answered in time if its process is stopped. It asks an agent that only waits for
a processor again, and kills it after `_PATIENCE` such times in a row in which no other agent answered either. So neither a
busy machine nor the boot of a large fleet changes a trace. `dropped` counts messages that are no answers; they leave the
window open.
"""

from __future__ import annotations

import select
import socket
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import islice

from agents.hosting.host import Death, Reply
from agents.hosting.link_protocol import (
    LIMIT_BYTES,
    Ahead,
    Key,
    LinkError,
    WindowAnswer,
    WindowRefusal,
    decode_from_agent,
    hung_up,
)
from agents.hosting.nursery_client import Fenced, NurseryDied, NurseryLink
from agents.mussel.outputs import Output, Truth
from agents.mussel.truths import TruthReceiver
from agents.nursery.protocol import WATCHDOG_FIRED
from firmware_model.stimuli import ResetCause

_PATIENCE = 10
_ASKED_AT_ONCE = 200
"""More agents than these wait for each other longer than the watchdog waits for one, when all of a large fleet boots."""
_REASON_TIMEOUT_S = 1.0


@dataclass(frozen=True, slots=True)
class WindowAnswered:
    """The whole outcome of `window`, after which the agent has lived to `granted_ms`, and the truths within it."""

    window: Key
    granted_ms: int
    reply: Reply
    truths: tuple[Truth, ...]


@dataclass(slots=True)
class _Living:
    agent_id: int
    pid: int
    link: socket.socket


@dataclass(slots=True)
class _Open:
    """A request without its whole answer."""

    key: Key
    frame: bytes
    parts: dict[int, tuple[Output, ...]] = field(default_factory=dict)


_Outcomes = dict[int, WindowAnswer | Ahead | Death]


class AgentLinks:
    """Belongs to one thread. `timeout_s` is the watchdog's."""

    def __init__(self, nursery: NurseryLink, timeout_s: float) -> None:
        self._nursery = nursery
        self._timeout_s = timeout_s
        self._living: dict[int, _Living] = {}
        self._agent_of: dict[int, int] = {}
        self._dead: dict[int, Death] = {}
        self._buffer = memoryview(bytearray(LIMIT_BYTES + 1))
        self.nursery_died = False
        self.dropped: Counter[str] = Counter()
        self._running_ahead: dict[int, _Open] = {}
        """The agents that were told to run ahead, without their windows."""
        self._ran_ahead: dict[int, Ahead] = {}
        """Windows that came before anybody asked for them."""
        self._truth_receiver = TruthReceiver(nursery.truth, self.dropped)
        self._epoll = select.epoll()
        self._epoll.register(nursery, select.EPOLLIN)
        self._epoll.register(nursery.truth, select.EPOLLIN)

    @property
    def pids(self) -> dict[int, int]:
        return {agent_id: living.pid for agent_id, living in self._living.items()}

    def link(self, agent_id: int) -> socket.socket:
        """The supervisor's end of a living agent's link; KeyError for another agent."""
        return self._living[agent_id].link

    def add(self, agent_id: int, pid: int, descriptor: int) -> None:
        link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET, 0, descriptor)
        link.setblocking(False)
        self._living[agent_id] = _Living(agent_id, pid, link)
        self._agent_of[descriptor] = agent_id
        self._dead.pop(agent_id, None)
        self._truth_receiver.forget(agent_id)
        self.forget_ahead(agent_id)
        self._epoll.register(descriptor, select.EPOLLIN)

    def close(self) -> None:
        for living in self._living.values():
            living.link.close()
        self._living.clear()
        self._epoll.close()

    def ask(self, key: Key, frames: dict[int, bytes]) -> dict[int, WindowAnswered | Death]:
        """Sends each agent its frame, which carries `key`. Returns the outcomes in the order of `frames`.

        Raises Fenced if another supervisor has taken over, ValueError if an agent refuses its frame.
        """
        outcomes: _Outcomes = {}
        agent_ids = iter(frames)
        while some := list(islice(agent_ids, _ASKED_AT_ONCE)):
            self._ask(key, {agent_id: frames[agent_id] for agent_id in some}, outcomes)
        self._truth_receiver.receive()
        return {agent_id: self._complete(agent_id, key, outcomes[agent_id]) for agent_id in frames}

    def run_ahead(self, agent_id: int, key: Key, frame: bytes) -> None:
        """Tells an agent to run ahead; `take_ahead` has its windows, or its death."""
        # It may have died while others were waited for, and its windows from before are still used.
        if agent_id in self._living:
            self._running_ahead[agent_id] = _Open(key, frame)
            self._send(agent_id, frame)

    def take_ahead(self, agent_ids: list[int]) -> dict[int, Ahead | Death]:
        """Waits for the windows of agents that were told to run ahead, or for the death of each."""
        outcomes: _Outcomes = {}
        open_: dict[int, _Open] = {}
        for agent_id in agent_ids:
            if (ahead := self._ran_ahead.pop(agent_id, None)) is not None:
                outcomes[agent_id] = ahead
            elif agent_id in self._living:
                open_[agent_id] = self._running_ahead.pop(agent_id)
            else:
                outcomes[agent_id] = self._dead.get(agent_id, _NOT_RUNNING)
        self._await(open_, outcomes)
        return {
            agent_id: outcome
            for agent_id, outcome in outcomes.items()
            if not isinstance(outcome, WindowAnswer)
        }

    def forget_ahead(self, agent_id: int) -> None:
        """The windows that this agent ran ahead do not count."""
        self._running_ahead.pop(agent_id, None)
        self._ran_ahead.pop(agent_id, None)

    def _ask(self, key: Key, frames: dict[int, bytes], outcomes: _Outcomes) -> None:
        open_: dict[int, _Open] = {}
        for agent_id, frame in frames.items():
            if agent_id in self._living:
                open_[agent_id] = _Open(key, frame)
                self._send(agent_id, frame)
            else:
                outcomes[agent_id] = self._dead.get(agent_id, _NOT_RUNNING)
        self._await(open_, outcomes)

    def _await(self, open_: dict[int, _Open], outcomes: _Outcomes) -> None:
        """Waits until every request is answered, or its agent is dead."""
        asked_at_s = time.monotonic()
        impatience, unanswered = 0, len(open_)
        while open_:
            now_s = time.monotonic()
            if now_s >= asked_at_s + self._timeout_s:
                impatience = impatience + 1 if len(open_) == unanswered else 1
                asked_at_s, unanswered = now_s, len(open_)
                self._watch(open_, outcomes, impatience)
            self._wait(asked_at_s + self._timeout_s - now_s, open_, outcomes)

    def _complete(
        self, agent_id: int, key: Key, outcome: WindowAnswer | Ahead | Death
    ) -> WindowAnswered | Death:
        assert not isinstance(outcome, Ahead)  # nobody asks with the key of an order to run ahead
        if isinstance(outcome, Death):
            self._truth_receiver.forget(agent_id)
            return outcome
        truths = self._truth_receiver.take(agent_id, key)
        if len(truths) < outcome.truths:
            self.dropped["truth: lost"] += outcome.truths - len(truths)
        return WindowAnswered(outcome.window, outcome.granted_ms, outcome.reply, truths)

    def _send(self, agent_id: int, frame: bytes) -> None:
        try:
            self._living[agent_id].link.send(frame)
        except BlockingIOError:
            pass  # its link is full, since it does not read: the watchdog judges it
        except OSError:
            pass  # it is dead: the end of its link follows, and the nursery reports the reason

    def _wait(self, timeout_s: float, open_: dict[int, _Open], outcomes: _Outcomes) -> None:
        for descriptor, _ in self._epoll.poll(timeout_s) if open_ else ():
            if (agent_id := self._agent_of.get(descriptor)) is not None:
                self._receive(agent_id, open_, outcomes)
            elif descriptor == self._nursery.truth.fileno():
                self._truth_receiver.receive()
            elif descriptor == self._nursery.fileno():
                self._pump_nursery()

    def _receive(self, agent_id: int, open_: dict[int, _Open], outcomes: _Outcomes) -> None:
        link = self._living[agent_id].link
        try:
            size = link.recv_into(self._buffer)
        except BlockingIOError:
            return
        except OSError:
            size = 0
        if size == 0 and hung_up(link):
            death = self._remove_dead(agent_id, ResetCause.BROWN_OUT, None)
            if open_.pop(agent_id, None) is not None:
                outcomes[agent_id] = death
            return
        try:
            message = decode_from_agent(self._buffer[:size], agent_id)
        except LinkError as error:
            self.dropped[f"agent: {error}"] += 1
            return
        request = open_.get(agent_id)
        if isinstance(message, WindowRefusal):
            self._refused(agent_id, message, request or self._running_ahead.get(agent_id))
        elif isinstance(message, Ahead):
            self._take_ahead(agent_id, message, open_, outcomes)
        elif request is None or message.key != request.key:
            self.dropped["agent: an answer that was not waited for"] += 1
        elif (answer := _assemble(request, message)) is not None:
            del open_[agent_id]
            outcomes[agent_id] = answer

    def _take_ahead(
        self,
        agent_id: int,
        ahead: Ahead,
        open_: dict[int, _Open],
        outcomes: _Outcomes,
    ) -> None:
        """Keeps the windows that somebody still waits for: something else may have happened to the agent since."""
        request, running = open_.get(agent_id), self._running_ahead.get(agent_id)
        if request is not None and request.key == ahead.key:
            del open_[agent_id]
            outcomes[agent_id] = ahead
        elif running is not None and running.key == ahead.key:
            del self._running_ahead[agent_id]
            self._ran_ahead[agent_id] = ahead

    def _refused(self, agent_id: int, refusal: WindowRefusal, request: _Open | None) -> None:
        # A refusal for an old supervisor may reach this one: they hold the same end of the link.
        if refusal.fenced and refusal.key[0] == self._nursery.epoch:
            raise Fenced(refusal.reason)
        if request is not None and refusal.key == request.key:
            raise ValueError(f"aMussel {agent_id} refused its window: {refusal.reason}")
        # Details follow a colon.
        self.dropped[f"refused: {refusal.reason.partition(':')[0]}"] += 1

    def _watch(self, open_: dict[int, _Open], outcomes: _Outcomes, impatience: int) -> None:
        """Kills stopped or long silent agents. Asks the others again: an old supervisor may have their answers."""
        for agent_id, request in list(open_.items()):
            if impatience < _PATIENCE and not _stopped(self._living[agent_id].pid):
                self._send(agent_id, request.frame)
            else:
                reason = f"no answer within {impatience * self._timeout_s:g} s: killed by the watchdog"
                try:
                    self._nursery.kill(agent_id)
                except NurseryDied:
                    self._lose_nursery()
                outcomes[agent_id] = self._remove_dead(agent_id, ResetCause.WATCHDOG, reason)
                del open_[agent_id]

    def _remove_dead(self, agent_id: int, cause: ResetCause, reason: str | None) -> Death:
        living = self._living.pop(agent_id)
        self._epoll.unregister(living.link)
        del self._agent_of[living.link.fileno()]
        living.link.close()
        self._running_ahead.pop(agent_id, None)
        reason = reason or self._why(living.pid)
        if reason.startswith(WATCHDOG_FIRED):
            cause = ResetCause.WATCHDOG
        death = self._dead[agent_id] = Death(cause, reason)
        return death

    def _why(self, pid: int) -> str:
        if not self.nursery_died:
            try:
                return self._nursery.why(pid, _REASON_TIMEOUT_S)
            except NurseryDied:
                self._lose_nursery()
        return "its nursery died"

    def _pump_nursery(self) -> None:
        try:
            self._nursery.pump()
        except NurseryDied:
            self._lose_nursery()

    def _lose_nursery(self) -> None:
        if not self.nursery_died:
            self.nursery_died = True
            self._epoll.unregister(self._nursery)


_NOT_RUNNING = Death(ResetCause.BROWN_OUT, "it was not running")


def _assemble(request: _Open, answer: WindowAnswer) -> WindowAnswer | None:
    """The answer in one piece; None as long as a part of it is missing."""
    if answer.parts == 1:
        return answer
    request.parts[answer.part] = answer.reply.outputs
    if len(request.parts) < answer.parts:
        return None
    outputs = tuple([output for part in range(answer.parts) for output in request.parts[part]])
    return replace(answer, reply=Reply(answer.reply.next_due_ms, outputs))


def _stopped(pid: int) -> bool:
    """True if a signal or a debugger holds the process."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:
            return file.read().rpartition(b")")[2].split()[0] in (b"T", b"t")
    except OSError:
        return False  # it has just ended: the end of its link follows
