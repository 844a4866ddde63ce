"""The link's messages, and an agent behind its link: repeated requests, an old supervisor, garbage."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import msgpack
import pytest
from fleets import PAPER, STILL
from hypothesis import given
from hypothesis import strategies as st

from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.hosting.agent_loop import MOST_AHEAD, WindowHandler, answer_one, message_buffer, serve
from agents.hosting.host import Grant, Reply
from agents.hosting.link_protocol import (
    LIMIT_BYTES,
    NEVER,
    Ahead,
    AheadWindow,
    LinkError,
    Repeat,
    RunAhead,
    WindowAnswer,
    WindowGrant,
    WindowRefusal,
    decode_from_agent,
    decode_to_agent,
    encode_answer,
)
from agents.mussel.agent import Agent
from agents.mussel.outputs import Output, SoundSent, StimulusDropped, Truth, WifiSent
from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved, SoundArrived, WifiArrived
from agents.mussel.truths import decode as decode_telling
from agents.nursery.state_file import RecordRing
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

FLEET = replace(PAPER, body=STILL.body)
TIMES = st.integers(0, 2**63)
KEYS = st.tuples(st.integers(1, 2**32 - 1), st.integers(0, 2**63))
FACTS = st.tuples(
    TIMES,
    st.builds(ContactClosed, st.integers(-(2**62), 2**62), st.integers(-(2**62), 2**62))
    | st.builds(DockMoved, st.integers(-(2**62), 2**62), st.integers(-(2**62), 2**62))
    | st.builds(ContactOpened)
    | st.builds(SoundArrived, st.binary(max_size=40))
    | st.builds(WifiArrived, st.binary(max_size=40)),
)
OUTPUTS: st.SearchStrategy[Output] = (
    st.builds(WifiSent, TIMES, st.just(7), st.binary(max_size=40))
    | st.builds(SoundSent, TIMES, st.just(7), st.binary(max_size=40))
    | st.builds(StimulusDropped, TIMES, st.just(7), st.text(max_size=40))
)


WINDOWS = st.builds(WindowGrant, KEYS, st.builds(Grant, TIMES, st.lists(FACTS, max_size=5).map(tuple)))


@given(WINDOWS | st.builds(RunAhead, KEYS, st.integers(0, 2**32), TIMES))
def test_a_window_and_an_order_to_run_ahead_cross_the_link(message: WindowGrant | RunAhead) -> None:
    assert decode_to_agent(message.encode()) == message


TRUTHS = st.builds(
    lambda at_ms, state: Truth(at_ms, 7, state, resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0)),
    TIMES,
    st.sampled_from(State),
)
AHEAD = st.builds(
    AheadWindow,
    TIMES,
    st.builds(Reply, st.none() | TIMES, st.lists(OUTPUTS, max_size=3).map(tuple)),
    st.lists(TRUTHS, max_size=3).map(tuple),
)


@given(key=KEYS, windows=st.lists(AHEAD, max_size=MOST_AHEAD))
def test_windows_ahead_cross_the_link(key: tuple[int, int], windows: list[AheadWindow]) -> None:
    ahead = Ahead(key, tuple(windows))
    assert decode_from_agent(ahead.encode(), 7) == ahead


@given(key=KEYS, due_ms=st.none() | TIMES, outputs=st.lists(OUTPUTS, max_size=700))
def test_an_answer_crosses_the_link_in_parts(
    key: tuple[int, int], due_ms: int | None, outputs: list[Output]
) -> None:
    frames = encode_answer(key, (1, 2), 30, 4, Reply(due_ms, tuple(outputs)))
    answers = [decode_from_agent(frame, 7) for frame in frames]
    assert all(len(frame) <= LIMIT_BYTES for frame in frames)
    came: list[Output] = []
    for part, answer in enumerate(answers):
        assert isinstance(answer, WindowAnswer)
        assert (answer.key, answer.window, answer.granted_ms, answer.truths) == (key, (1, 2), 30, 4)
        assert (answer.part, answer.parts, answer.reply.next_due_ms) == (part, len(frames), due_ms)
        came += answer.reply.outputs
    assert came == outputs


@given(sizes=st.lists(st.integers(0, 1024), min_size=60, max_size=300))
def test_an_answer_of_large_packets_is_parted_by_their_bytes(sizes: list[int]) -> None:
    outputs = tuple(WifiSent(n, 7, bytes(size)) for n, size in enumerate(sizes))
    frames = encode_answer((1, 3), (1, 2), 30, 4, Reply(None, outputs))
    assert all(len(frame) <= LIMIT_BYTES for frame in frames)
    answers = [decode_from_agent(frame, 7) for frame in frames]
    came = [it for answer in answers if isinstance(answer, WindowAnswer) for it in answer.reply.outputs]
    assert tuple(came) == outputs
    assert len(frames) <= 1 + (sum(sizes) + 32 * len(sizes)) // 7_000 + len(sizes) // 256


@given(data=st.binary(max_size=60))
def test_garbage_is_a_link_error_either_way(data: bytes) -> None:
    for decode in (decode_to_agent, partial(decode_from_agent, agent_id=7)):
        try:
            decode(data)
        except LinkError:
            continue


@pytest.mark.parametrize(("part", "parts"), [(0, 0), (1, 1), (7, 2)])
def test_a_part_beyond_the_last_one_is_a_link_error(part: int, parts: int) -> None:
    """The supervisor would look for the parts that are missing, and find none."""
    with pytest.raises(LinkError, match="a part beyond the last one"):
        decode_from_agent(msgpack.packb([3, 1, 1, 1, 1, 100, 0, part, parts, None, []]), 7)


def test_a_truncated_word_is_a_link_error() -> None:
    whole = WindowGrant((1, 1), Grant(30, ((7, SoundArrived(b"abc")),))).encode()
    for size in range(len(whole)):
        with pytest.raises(LinkError):
            decode_to_agent(whole[:size])


def test_a_window_too_large_for_the_link_is_the_granters_mistake() -> None:
    facts = tuple((0, SoundArrived(bytes(1000))) for _ in range(66))
    with pytest.raises(ValueError, match="a link carries 65536"):
        WindowGrant((1, 1), Grant(0, facts)).encode()
    with pytest.raises(LinkError, match="longer than 65536 bytes"):
        decode_to_agent(bytes(LIMIT_BYTES + 1))


@contextmanager
def serving(fleet: FleetConfig = FLEET) -> Iterator[tuple[WindowHandler, socket.socket, RecordRing]]:
    """An agent behind its link, the end of its truth socket, and its records."""
    slots = os.memfd_create("slots")
    ring = RecordRing(slots, 0, 7)
    physical = resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0)
    ring.initial_state(physical)
    hearer, witness = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    agent = Agent(fleet.maker().config(7), MusselbedCodec(), physical, 0, ResetCause.POWER_ON)
    with hearer, witness:
        yield WindowHandler(agent, ring, witness, NEVER, 0), hearer, ring
    os.close(slots)


@pytest.mark.parametrize("closes", ["before the answer", "with the answer unread", "with the answer read"])
def test_an_agent_ends_with_its_link(closes: str) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs, serving() as (servant, _, _):
        ours.send(WindowGrant((1, 1), Grant(40_000)).encode())
        if closes != "before the answer":
            assert answer_one(theirs, message_buffer(), servant)
        if closes == "with the answer read":
            ours.recv(LIMIT_BYTES)
        ours.close()
        serve(theirs, message_buffer(), servant)


def outputs_of(reply: Reply) -> str:
    told = [f"{type(it).__name__} at {it.at_ms}" for it in reply.outputs]
    times = [it.at_ms for it in reply.outputs]
    return f"{len(told)}, {times[0]} to {times[-1]}" if len(told) > 3 else ", ".join(told)


def word(data: bytes) -> str:
    """An agent's message in a row."""
    match decode_from_agent(data, 7):
        case WindowAnswer(key, window, granted_ms, truths, reply=reply):
            due = f"{truths} truths, due at {reply.next_due_ms}"
            return f"{key} answers {window} to {granted_ms}, {due}: {outputs_of(reply)}"
        case WindowRefusal(key, fenced, reason):
            return f"{key} is refused: {reason}" + ", for ever" * fenced
        case Ahead(key, windows):
            return f"{key} " + "; ".join(f"to {it.until_ms}: {outputs_of(it.reply)}" for it in windows)


def window(
    number: int, until_ms: int, *facts: tuple[int, Any], epoch: int = 1, back_ms: int | None = None
) -> bytes:
    return WindowGrant((epoch, number), Grant(until_ms, facts), back_ms).encode()


def ahead(number: int, windows: int, counted_ms: int) -> bytes:
    return RunAhead((1, number), windows, counted_ms).encode()


OFTEN = replace(FLEET, reports=replace(FLEET.reports, period_ms=300))
"""100 reports a mission second, which would be more than 100 000 bytes in 31 windows; FLEET's have one, 30 s of theirs."""
FIRST = (window(1, 30_000), "(1, 1) answers (1, 1) to 30000, 2 truths, due at 60000: WifiSent at 30000")
# It has run to 120 s, and its windows count to 60 s: two are left that may be undone.
RAN_AHEAD = [
    FIRST,
    (
        ahead(2, 3, 30_000),
        "(1, 2) to 60000: WifiSent at 60000; to 90000: WifiSent at 90000; to 120000: WifiSent at 120000",
    ),
]
AGAIN = (
    window(10, 90_000, back_ms=60_000),
    "(1, 10) answers (1, 10) to 90000, 0 truths, due at 120000: WifiSent at 90000",
)
TEN = (window(1, 10_000), "(1, 1) answers (1, 1) to 10000, 2 truths, due at 30000: ")
Step = tuple[bytes | tuple[Any, ...], str]
STORIES: dict[str, tuple[FleetConfig, list[Step]]] = {
    "the same question gets the same answer and happens once": (
        FLEET,
        [
            (window(1, 40_000), "(1, 1) answers (1, 1) to 40000, 2 truths, due at 60000: WifiSent at 30000"),
            ((), "(1, 1) [0, 2000]"),
            (window(1, 40_000), "(1, 1) answers (1, 1) to 40000, 2 truths, due at 60000: WifiSent at 30000"),
            ((), ""),
            ((None,), "(1, 1) to 40000"),
        ],
    ),
    "an old epoch is fenced off and moves nothing": (
        FLEET,
        [
            (window(5, 10_000), "(1, 5) answers (1, 5) to 10000, 2 truths, due at 30000: "),
            (Repeat((2, 0)).encode(), "(2, 0) answers (1, 5) to 10000, 1 truths, due at 30000: "),
            (
                window(6, 20_000),
                "(1, 6) is refused: fenced off: epoch 2 has taken over from epoch 1, for ever",
            ),
            ((None,), "(1, 5) to 10000"),
        ],
    ),
    "a repeat says the last window again and the present truth": (
        FLEET,
        [
            (window(5, 40_000), "(1, 5) answers (1, 5) to 40000, 2 truths, due at 60000: WifiSent at 30000"),
            ((), "(1, 5) [0, 2000]"),
            (
                Repeat((2, 0)).encode(),
                "(2, 0) answers (1, 5) to 40000, 1 truths, due at 60000: WifiSent at 30000",
            ),
            ((), "(2, 0) [40000]"),
        ],
    ),
    "a bad message is refused and the next good one works: empty": (
        FLEET,
        [
            TEN,
            (b"", "(1, 1) is refused: not msgpack: ValueError"),
            (window(2, 20_000), "(1, 2) answers (1, 2) to 20000, 0 truths, due at 30000: "),
        ],
    ),
    "a bad message is refused and the next good one works: no msgpack": (
        FLEET,
        [
            TEN,
            (b"\xc1", "(1, 1) is refused: not msgpack: FormatError"),
            (window(2, 20_000), "(1, 2) answers (1, 2) to 20000, 0 truths, due at 30000: "),
        ],
    ),
    "a bad message is refused and the next good one works: too long": (
        FLEET,
        [
            TEN,
            (bytes(LIMIT_BYTES + 1), "(1, 1) is refused: longer than 65536 bytes"),
            (window(2, 20_000), "(1, 2) answers (1, 2) to 20000, 0 truths, due at 30000: "),
        ],
    ),
    "a bad message is refused and the next good one works: time went back": (
        FLEET,
        [
            TEN,
            (window(2, 9_999), "(1, 2) is refused: time went back: 9999 before 10000"),
            (window(2, 20_000), "(1, 2) answers (1, 2) to 20000, 0 truths, due at 30000: "),
        ],
    ),
    "a bad message is refused and the next good one works: a fact beyond the end": (
        FLEET,
        [
            TEN,
            (
                window(2, 20_000, (30_000, ContactOpened())),
                "(1, 2) is refused: time went back: 20000 before 30000",
            ),
            (window(2, 20_000), "(1, 2) answers (1, 2) to 20000, 0 truths, due at 30000: "),
        ],
    ),
    "a bad message is refused and the next good one works: not after the last": (
        FLEET,
        [
            TEN,
            (window(0, 20_000), "(1, 0) is refused: not after the last window: (1, 0) after (1, 1)"),
            (window(2, 20_000), "(1, 2) answers (1, 2) to 20000, 0 truths, due at 30000: "),
        ],
    ),
    "windows ahead are those that would be granted": (
        FLEET,
        [
            *RAN_AHEAD,
            (((1, 2), 59_999), "(1, 1) to 30000"),
            (((1, 2), 60_000), "(1, 2) to 60000"),
            (((1, 2), 119_999), "(1, 2) to 90000"),
        ],
    ),
    "an agent goes back and what happens then counts": (
        FLEET,
        [
            *RAN_AHEAD,
            (
                ahead(3, 3, 60_000),
                "(1, 3) to 150000: WifiSent at 150000; to 180000: WifiSent at 180000; to 210000: WifiSent at 210000",
            ),
            (
                window(4, 120_000, (90_000, ContactClosed(0, 0)), back_ms=90_000),
                "(1, 4) answers (1, 4) to 120000, 0 truths, due at 150000: StimulusDropped at 90000, WifiSent at 120000",
            ),
            (((1, 3), 90_000), "(1, 2) to 90000"),
            (((1, 4), 120_000), "(1, 4) to 120000"),
        ],
    ),
    "windows with many outputs are fewer so that one message carries them": (
        OFTEN,
        [
            (window(1, 30_000), "(1, 1) answers (1, 1) to 30000, 2 truths, due at 30300: 94, 2100 to 30000"),
            (
                ahead(2, 31, 30_000),
                "(1, 2) to 60000: 100, 30300 to 60000; to 90000: 100, 60300 to 90000; to 120000: 100, 90300 to 120000",
            ),
            (
                ahead(3, 31, 120_000),
                "(1, 3) to 150000: 100, 120300 to 150000; to 180000: 100, 150300 to 180000; "
                "to 210000: 100, 180300 to 210000",
            ),
        ],
    ),
    "an agent ahead refuses what would lose its time: farther than its records": (
        FLEET,
        [
            *RAN_AHEAD,
            (ahead(9, MOST_AHEAD + 1, 60_000), "(1, 9) is refused: farther ahead than its records reach"),
            AGAIN,
        ],
    ),
    "an agent ahead refuses what would lose its time: farther by one": (
        FLEET,
        [
            *RAN_AHEAD,
            (ahead(9, MOST_AHEAD - 1, 60_000), "(1, 9) is refused: farther ahead than its records reach"),
            AGAIN,
        ],
    ),
    "an agent ahead refuses what would lose its time: a repeat": (
        FLEET,
        [
            *RAN_AHEAD,
            (
                Repeat((2, 0)).encode(),
                "(2, 0) is refused: it ran ahead, and nobody names the time to go back to",
            ),
            AGAIN,
        ],
    ),
    "an agent ahead refuses what would lose its time: no time to go back to": (
        FLEET,
        [
            *RAN_AHEAD,
            (window(9, 120_000), "(1, 9) is refused: it ran ahead, and nobody names the time to go back to"),
            AGAIN,
        ],
    ),
    "an agent ahead refuses what would lose its time: back beyond what counts": (
        FLEET,
        [
            *RAN_AHEAD,
            (window(9, 120_000, back_ms=29_999), "(1, 9) is refused: time went back: 29999 before 30000"),
            AGAIN,
        ],
    ),
    "an agent ahead refuses what would lose its time: an end before that time": (
        FLEET,
        [
            *RAN_AHEAD,
            (window(9, 59_999, back_ms=60_000), "(1, 9) is refused: time went back: 59999 before 60000"),
            AGAIN,
        ],
    ),
}
"""A message, and the agent's; or a key and a time, and the newest record up to them; or no key, and what it told since."""


@pytest.mark.parametrize(("fleet", "steps"), STORIES.values(), ids=STORIES)
def test_what_an_agent_answers(fleet: FleetConfig, steps: list[Step]) -> None:
    with serving(fleet) as (servant, hearer, ring):
        for asked, expected in steps:
            if isinstance(asked, bytes):
                assert word(servant.take(asked)[0]) == expected
            elif asked:
                newest = ring.newest(*asked)
                assert newest is not None and f"{newest.key} to {newest.granted_ms}" == expected
            else:
                assert told(hearer) == expected


def told(hearer: socket.socket) -> str:
    """The truths that have come since the last call, each message with its key and its times."""
    try:
        telling = decode_telling(hearer.recv(LIMIT_BYTES, socket.MSG_DONTWAIT))
    except BlockingIOError:
        return ""
    return f"{telling.key} {[it.at_ms for it in telling.truths]}{told(hearer)}"
