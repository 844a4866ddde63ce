"""An agent's process: one link, one loop, one thread. It acts only to answer a message."""

from __future__ import annotations

import mmap
import socket

from agents.hosting.host import Grant, Reply
from agents.hosting.link_protocol import (
    LIMIT_BYTES,
    Key,
    LinkError,
    Refusal,
    Window,
    decode_to_agent,
    encode_answer,
    hung_up,
)
from agents.mussel import truths
from agents.mussel.agent import Agent
from agents.mussel.outputs import Output, Truth
from agents.nursery.state_file import RecordPair


class WindowHandler:
    """An agent behind its link: takes a message, records the physical state, sends the truth, and makes the answer."""

    def __init__(
        self, agent: Agent, records: RecordPair, truth: socket.socket, key: Key, granted_ms: int
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

    def take(self, data: bytes | memoryview) -> list[bytes]:
        """The answer to one message. The agent refuses a window before anything has changed, or runs all of it."""
        try:
            message = decode_to_agent(data)
        except LinkError as error:
            return [Refusal(self._key, False, str(error)).encode()]
        key = message.key
        if key[0] < self._epoch:
            reason = f"fenced off: epoch {self._epoch} has taken over from epoch {key[0]}"
            return [Refusal(key, True, reason).encode()]
        if key == self._key and self._answer:
            return self._answer
        if key <= self._key:
            return [Refusal(key, False, f"not after the last window: {key} after {self._key}").encode()]
        if not isinstance(message, Window):
            self._repeat(key)
        elif (fault := self._fault(message.grant)) is not None:
            return [Refusal(key, False, fault).encode()]
        else:
            self._run(key, message.grant)
        self._epoch = key[0]
        self._key = key
        self._answer = encode_answer(key, self._window, self._granted_ms, self._truths_sent, self._reply)
        return self._answer

    def _fault(self, grant: Grant) -> str | None:
        before_ms = self._granted_ms
        for at_ms in (*[at_ms for at_ms, _ in grant.stimuli], grant.until_ms):
            if at_ms < before_ms:
                return f"time went back: {at_ms} before {before_ms}"
            before_ms = at_ms
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
    while answer_one(link, buffer, handler):
        pass


def answer_one(link: socket.socket, buffer: memoryview, handler: WindowHandler) -> bool:
    """Waits for a message and answers it; False at the end of the link."""
    size = link.recv_into(buffer)
    if size == 0 and hung_up(link):
        return False
    for frame in handler.take(buffer[:size]):
        link.send(frame)
    return True


def message_buffer() -> memoryview:
    """A buffer for `serve`. It is mapped, so only the pages that a message fills become memory of the receiving process."""
    return memoryview(mmap.mmap(-1, LIMIT_BYTES + 1, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS))
