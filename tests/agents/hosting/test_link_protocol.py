"""The link's messages, and an agent behind its link: repeated requests, an old supervisor, garbage."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

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


@pytest.fixture
def served() -> Iterator[tuple[WindowHandler, socket.socket, RecordRing]]:
    """An agent of FLEET behind its link, the end of its truth socket, and its records."""
    yield from serving(FLEET)


def serving(fleet: FleetConfig) -> Iterator[tuple[WindowHandler, socket.socket, RecordRing]]:
    slots = os.memfd_create("slots")
    pair = RecordRing(slots, 0, 7)
    physical = resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0)
    pair.initial_state(physical)
    hearer, witness = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    agent = Agent(fleet.maker().config(7), MusselbedCodec(), physical, 0, ResetCause.POWER_ON)
    with hearer, witness:
        yield WindowHandler(agent, pair, witness, NEVER, 0), hearer, pair
    os.close(slots)


def test_the_same_question_gets_the_same_answer_and_happens_once(
    served: tuple[WindowHandler, socket.socket, RecordRing],
) -> None:
    servant, hearer, pair = served
    window = WindowGrant((1, 1), Grant(40_000)).encode()
    first = servant.take(window)
    told = decode_telling(hearer.recv(LIMIT_BYTES))
    assert servant.take(window) == first
    with pytest.raises(BlockingIOError):
        hearer.recv(LIMIT_BYTES, socket.MSG_DONTWAIT)
    answer = decode_from_agent(first[0], 7)
    assert isinstance(answer, WindowAnswer)
    assert (answer.granted_ms, answer.truths) == (40_000, len(told.truths))
    assert [type(output) for output in answer.reply.outputs] == [WifiSent]
    newest = pair.newest(None)
    assert newest is not None and (newest.key, newest.granted_ms) == ((1, 1), 40_000)


@pytest.mark.parametrize("closes", ["before the answer", "with the answer unread", "with the answer read"])
def test_an_agent_ends_with_its_link(
    closes: str, served: tuple[WindowHandler, socket.socket, RecordRing]
) -> None:
    servant, _, _ = served
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        ours.send(WindowGrant((1, 1), Grant(40_000)).encode())
        if closes != "before the answer":
            assert answer_one(theirs, message_buffer(), servant)
        if closes == "with the answer read":
            ours.recv(LIMIT_BYTES)
        ours.close()
        serve(theirs, message_buffer(), servant)


def test_an_old_epoch_is_fenced_off_and_moves_nothing(
    served: tuple[WindowHandler, socket.socket, RecordRing],
) -> None:
    servant, _, pair = served
    servant.take(WindowGrant((1, 5), Grant(10_000)).encode())
    servant.take(Repeat((2, 0)).encode())
    refusal = decode_from_agent(servant.take(WindowGrant((1, 6), Grant(20_000)).encode())[0], 7)
    assert refusal == WindowRefusal((1, 6), True, "fenced off: epoch 2 has taken over from epoch 1")
    newest = pair.newest(None)
    assert newest is not None and newest.granted_ms == 10_000


def test_repeat_says_the_last_window_again_and_the_present_truth(
    served: tuple[WindowHandler, socket.socket, RecordRing],
) -> None:
    servant, hearer, _ = served
    last = decode_from_agent(servant.take(WindowGrant((1, 5), Grant(40_000)).encode())[0], 7)
    hearer.recv(LIMIT_BYTES)
    again = decode_from_agent(servant.take(Repeat((2, 0)).encode())[0], 7)
    assert isinstance(last, WindowAnswer) and isinstance(again, WindowAnswer)
    assert (again.key, again.window, again.granted_ms) == ((2, 0), (1, 5), 40_000)
    assert again.reply == last.reply
    telling = decode_telling(hearer.recv(LIMIT_BYTES))
    assert telling.key == (2, 0)
    assert [truth.at_ms for truth in telling.truths] == [40_000]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "not msgpack"),
        (b"\xc1", "not msgpack"),
        (bytes(LIMIT_BYTES + 1), "longer than 65536 bytes"),
        (WindowGrant((1, 2), Grant(9_999)).encode(), "time went back: 9999 before 10000"),
        (WindowGrant((1, 2), Grant(20_000, ((30_000, ContactOpened()),))).encode(), "time went back: 20000"),
        (WindowGrant((1, 0), Grant(20_000)).encode(), "not after the last window: "),
    ],
)
def test_a_bad_message_is_refused_and_the_next_good_one_works(
    served: tuple[WindowHandler, socket.socket, RecordRing], data: bytes, reason: str
) -> None:
    servant, _, _ = served
    servant.take(WindowGrant((1, 1), Grant(10_000)).encode())
    refusal = decode_from_agent(servant.take(data)[0], 7)
    assert isinstance(refusal, WindowRefusal) and not refusal.fenced and reason in refusal.reason
    answer = decode_from_agent(servant.take(WindowGrant((1, 2), Grant(20_000)).encode())[0], 7)
    assert isinstance(answer, WindowAnswer) and answer.granted_ms == 20_000


def ran_ahead(servant: WindowHandler, key: tuple[int, int], windows: int, counted_ms: int) -> Ahead:
    ahead = decode_from_agent(servant.take(RunAhead(key, windows, counted_ms).encode())[0], 7)
    assert isinstance(ahead, Ahead)
    return ahead


def test_windows_ahead_are_those_that_would_be_granted(
    served: tuple[WindowHandler, socket.socket, RecordRing],
) -> None:
    """FLEET's aMussels report once a mission second, which is 30 s of theirs."""
    servant, _, ring = served
    servant.take(WindowGrant((1, 1), Grant(30_000)).encode())
    ahead = ran_ahead(servant, (1, 2), 3, 30_000)
    assert [it.until_ms for it in ahead.windows] == [60_000, 90_000, 120_000]
    assert [[output.at_ms for output in it.reply.outputs] for it in ahead.windows] == [
        [60_000],
        [90_000],
        [120_000],
    ]
    assert [ring.newest((1, 2), at_ms).granted_ms for at_ms in (59_999, 60_000, 119_999)] == [
        30_000,
        60_000,
        90_000,
    ]  # type: ignore[union-attr]


def test_an_agent_goes_back_and_what_happens_then_counts(
    served: tuple[WindowHandler, socket.socket, RecordRing],
) -> None:
    servant, _, ring = served
    servant.take(WindowGrant((1, 1), Grant(30_000)).encode())
    ran_ahead(servant, (1, 2), 3, 30_000)
    ran_ahead(servant, (1, 3), 3, 60_000)
    sunk = WindowGrant((1, 4), Grant(120_000, ((90_000, ContactClosed(0, 0)),)), 90_000)
    answer = decode_from_agent(servant.take(sunk.encode())[0], 7)
    assert isinstance(answer, WindowAnswer)
    assert [type(output) for output in answer.reply.outputs] == [StimulusDropped, WifiSent]
    assert [output.at_ms for output in answer.reply.outputs] == [90_000, 120_000]
    assert ring.newest((1, 3), 90_000).granted_ms == 90_000  # type: ignore[union-attr]
    assert ring.newest((1, 4), 120_000).key == (1, 4)  # type: ignore[union-attr]


def test_windows_with_many_outputs_are_fewer_so_that_one_message_carries_them() -> None:
    """Its 100 reports a mission second would be more than 100 000 bytes in 31 windows."""
    often = replace(FLEET, reports=replace(FLEET.reports, period_ms=300))
    for servant, _, _ in serving(often):
        servant.take(WindowGrant((1, 1), Grant(30_000)).encode())
        ahead = ran_ahead(servant, (1, 2), 31, 30_000)
        assert [window.until_ms for window in ahead.windows] == [60_000, 90_000, 120_000]
        assert [len(window.reply.outputs) for window in ahead.windows] == [100, 100, 100]
        assert ran_ahead(servant, (1, 3), 31, 120_000).windows[0].until_ms == 150_000


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (RunAhead((1, 9), MOST_AHEAD + 1, 60_000), "farther ahead than its records reach"),
        (RunAhead((1, 9), MOST_AHEAD - 1, 60_000), "farther ahead than its records reach"),
        (Repeat((2, 0)), "it ran ahead, and nobody names the time to go back to"),
        (WindowGrant((1, 9), Grant(120_000)), "it ran ahead, and nobody names the time to go back to"),
        (WindowGrant((1, 9), Grant(120_000), 29_999), "time went back: 29999 before 30000"),
        (WindowGrant((1, 9), Grant(59_999), 60_000), "time went back: 59999 before 60000"),
    ],
)
def test_an_agent_ahead_refuses_what_would_lose_its_time(
    served: tuple[WindowHandler, socket.socket, RecordRing],
    message: RunAhead | Repeat | WindowGrant,
    reason: str,
) -> None:
    """It has run to 120 s, and its windows count to 60 s: two are left that may be undone."""
    servant, _, _ = served
    servant.take(WindowGrant((1, 1), Grant(30_000)).encode())
    ran_ahead(servant, (1, 2), 3, 30_000)
    refusal = decode_from_agent(servant.take(message.encode())[0], 7)
    assert refusal == WindowRefusal(message.key, False, reason)
    answer = decode_from_agent(servant.take(WindowGrant((1, 10), Grant(90_000), 60_000).encode())[0], 7)
    assert isinstance(answer, WindowAnswer) and answer.granted_ms == 90_000
