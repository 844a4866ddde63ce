"""An agent's process: one link, one loop, one thread. It acts only to answer a message."""

from __future__ import annotations

import mmap
import socket
from itertools import pairwise

from agents.hosting.host import Grant, Reply
from agents.hosting.link_protocol import (
    LIMIT_BYTES,
    OUTPUTS_AT_ONCE,
    Ahead,
    AheadWindow,
    Key,
    LinkError,
    Repeat,
    RunAhead,
    WindowGrant,
    WindowRefusal,
    decode_to_agent,
    encode_answer,
    hung_up,
)
from agents.mussel import truths
from agents.mussel.agent import Agent
from agents.mussel.outputs import Output, Truth
from agents.mussel.physical import Physical
from agents.nursery.state_file import RECORDS, RecordRing

MOST_AHEAD = RECORDS - 2
"""Windows that an agent may run ahead: a record stays for the last one that counts, and one for the next."""


class WindowHandler:
    """An agent behind its link: takes a message, records the physical state, sends the truth, and makes the answer."""

    def __init__(
        self, agent: Agent, records: RecordRing, truth: socket.socket, key: Key, granted_ms: int
    ) -> None:
        """`key` and `granted_ms` belong to the last answered window, from which a restarted agent goes on."""
        self._agent = agent
        self._records = records
        self._truth = truth
        self._agent_id = agent.config.board.agent_id
        self._epoch = key[0]
        self._key = key
        self._window = key
        self._granted_ms = granted_ms
        self._reply = Reply(agent.next_due_ms, ())
        self._truths_sent = 0
        self._answer: list[bytes] = []
        self._ran_ahead: list[int] = []
        """The ends of the windows since the last answer, which count only once a supervisor names their time."""
        self._copies: list[tuple[int, Agent]] = []
        """The agent as it was at these times, rising; it goes back to one of them and runs on from there."""

    def take(self, data: bytes | memoryview) -> list[bytes]:
        """The answer to one message. The agent refuses a window before anything has changed, or runs all of it."""
        try:
            message = decode_to_agent(data)
        except LinkError as error:
            return [WindowRefusal(self._key, False, str(error)).encode()]
        key = message.key
        if key[0] < self._epoch:
            reason = f"fenced off: epoch {self._epoch} has taken over from epoch {key[0]}"
            return [WindowRefusal(key, True, reason).encode()]
        if key == self._key and self._answer:
            return self._answer
        if key <= self._key:
            return [WindowRefusal(key, False, f"not after the last window: {key} after {self._key}").encode()]
        if (fault := self._fault(message)) is not None:
            return [WindowRefusal(key, False, fault).encode()]
        match message:
            case RunAhead():
                self._answer = [self._run_ahead(message).encode()]
            case WindowGrant(grant=grant, from_ms=from_ms):
                if from_ms is not None:
                    self._go_back(from_ms)
                self._run(key, grant)
                self._answer = self._encoded(key)
            case Repeat():
                self._repeat(key)
                self._answer = self._encoded(key)
        self._epoch = key[0]
        self._key = key
        return self._answer

    def _encoded(self, key: Key) -> list[bytes]:
        return encode_answer(key, self._window, self._granted_ms, self._truths_sent, self._reply)

    def _fault(self, message: WindowGrant | Repeat | RunAhead) -> str | None:
        """The reason why a message cannot be obeyed."""
        match message:
            case RunAhead(windows=windows, counted_ms=counted_ms):
                if self._agent.config.board.whole is not None or self._agent.config.firmware:
                    return "neither a whole board nor firmware in a process of its own runs ahead"
                ahead = sum(end_ms > counted_ms for end_ms in self._ran_ahead)
                return "farther ahead than its records reach" if ahead + windows > MOST_AHEAD else None
            case WindowGrant(grant=grant, from_ms=int() as before_ms):
                at_all = self._copies[0][0] if self._copies else self._granted_ms
                times = [at_all, before_ms]
            case WindowGrant(grant=grant) if not self._copies:
                times = [self._granted_ms]
            case _:
                return "it ran ahead, and nobody names the time to go back to" if self._copies else None
        times += [*(at_ms for at_ms, _ in grant.stimuli), grant.until_ms]
        for before_ms, at_ms in pairwise(times):
            if at_ms < before_ms:
                return f"time went back: {at_ms} before {before_ms}"
        return None

    def _run(self, key: Key, grant: Grant) -> None:
        agent = self._agent
        outputs: list[Output] = []
        for at_ms, stimulus in grant.stimuli:
            outputs += agent.receive(stimulus, at_ms)
        outputs += agent.advance(grant.until_ms)
        self._records.write(key, grant.until_ms, agent.physical)
        self._send_truths(key, agent.take_truths())
        self._window = key
        self._granted_ms = grant.until_ms
        self._reply = Reply(agent.next_due_ms, tuple(outputs))

    def _run_ahead(self, message: RunAhead) -> Ahead:
        """Runs windows on from a copy of the agent, and records each, so that a restart finds the state at its end."""
        agent, step_ms = self._agent, self._agent.config.water.step_ms
        self._copies.append((self._ran_ahead[-1] if self._ran_ahead else self._granted_ms, agent.copy()))
        while len(self._copies) > 1 and self._copies[1][0] <= message.counted_ms:
            del self._copies[0]
        self._ran_ahead = [end_ms for end_ms in self._ran_ahead if end_ms >= self._copies[0][0]]
        windows: list[AheadWindow] = []
        states: list[tuple[int, Physical]] = []
        outcomes = 0
        # One message carries all windows, so an agent that does much in each runs fewer of them.
        for _ in range(message.windows):
            due_ms = agent.next_due_ms
            if due_ms is None or outcomes >= OUTPUTS_AT_ONCE:
                break
            until_ms = -(-due_ms // step_ms) * step_ms
            outputs = tuple(agent.advance(until_ms))
            states.append((until_ms, agent.physical))
            found = tuple(agent.take_truths())
            windows.append(AheadWindow(until_ms, Reply(agent.next_due_ms, outputs), found))
            outcomes += len(outputs) + len(found)
        self._records.write_all(message.key, states)
        self._ran_ahead += [until_ms for until_ms, _ in states]
        return Ahead(message.key, tuple(windows))

    def _go_back(self, counted_ms: int) -> None:
        """Undoes the windows that ran ahead beyond `counted_ms`."""
        if undone := sum(end_ms > counted_ms for end_ms in self._ran_ahead):
            at_ms, agent = [it for it in self._copies if it[0] <= counted_ms][-1]
            for end_ms in self._ran_ahead:
                if at_ms < end_ms <= counted_ms:
                    agent.advance(end_ms)
            agent.take_truths()
            self._agent = agent
            self._records.take_back(undone)
        self._ran_ahead.clear()
        self._copies.clear()

    def _repeat(self, key: Key) -> None:
        agent = self._agent
        self._send_truths(key, [Truth(self._granted_ms, self._agent_id, agent.board.state, agent.physical)])

    def _send_truths(self, key: Key, sent: list[Truth]) -> None:
        self._truths_sent = len(sent)
        for datagram in truths.encode(self._agent_id, key, sent):
            self._truth.send(datagram)


def serve(link: socket.socket, buffer: memoryview, handler: WindowHandler) -> None:
    """Answers until the other end of the link is gone. The nursery bounds a fleet's wait for a supervisor.

    `buffer` holds more than `LIMIT_BYTES`, so that too long a message is noticed.
    """
    try:
        while answer_one(link, buffer, handler):
            pass
    except ConnectionError:
        return  # the other end was closed before it had read all answers


def answer_one(link: socket.socket, buffer: memoryview, handler: WindowHandler) -> bool:
    """Waits for a message and answers it; False at the end of the link.

    Raises ConnectionError if the other end was closed with an answer unread, or before the answer.
    """
    size = link.recv_into(buffer)
    if size == 0 and hung_up(link):
        return False
    for frame in handler.take(buffer[:size]):
        link.send(frame)
    return True


def message_buffer() -> memoryview:
    """A buffer for `serve`. It is mapped, so only the pages that a message fills become memory of the receiving process."""
    return memoryview(mmap.mmap(-1, LIMIT_BYTES + 1, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS))
