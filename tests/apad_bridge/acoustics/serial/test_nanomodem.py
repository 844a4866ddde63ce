"""Tests the queue before a physical modem, with its input by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.acoustics.serial.nanomodem import (
    ANSWER_MS,
    MAX_WAITING,
    WAIT_MS,
    AnswerReader,
    Framing,
    Line,
    ModemNotice,
    ModemQueue,
    ModemRanged,
    ModemStage,
    NanomodemAction,
    PacketDirection,
    PacketDropped,
    PacketReceived,
    PacketSent,
    Priority,
    ReceivedData,
    RoutedPacket,
    WriteLine,
)
from firmware_model.packets import EVERYONE

IDENTITY = b"#A001V21845R001.006.000B2024-02-15T00:00:00\r\n"


def report(agent_id: int, data: bytes = b"status") -> RoutedPacket:
    return RoutedPacket(PacketDirection.FROM_AMUSSEL, agent_id, data)


def command(agent_id: int) -> RoutedPacket:
    return RoutedPacket(PacketDirection.TO_AMUSSEL, agent_id, b"rise!!")


def ready() -> ModemQueue:
    queue = ModemQueue()
    queue.port_opened(0)
    queue.read(IDENTITY, 50)
    return queue


def written(actions: list[NanomodemAction]) -> bytes:
    return b"".join(it.data for it in actions if isinstance(it, WriteLine))


TEXTS: dict[type, Callable[[Any], str]] = {
    WriteLine: lambda it: str(it.data),
    PacketSent: lambda it: f"{it.packet.agent_id} sent at {it.at_ms}",
    PacketReceived: lambda it: f"{it.packet.direction.name} {it.packet.agent_id} {it.packet.data!r}",
    PacketDropped: lambda it: (
        f"{it.packet.agent_id if it.packet else 'nobody'}: {it.reason.removeprefix('sound: ')}"
    ),
    ModemRanged: lambda it: f"{it.agent_id} {it.steps} at {it.at_ms}",
    ModemNotice: lambda it: it.what,
}


def shown(actions: list[NanomodemAction]) -> str:
    """The bytes for the modem, and what is told of packets, ranges and the modem."""
    return "; ".join(TEXTS[type(it)](it) for it in actions)


Act = Callable[[ModemQueue], list[NanomodemAction]]


def reports(agent_id: int, at_ms: int, data: bytes = b"status") -> Act:
    return lambda it: it.send(report(agent_id, data), Priority.REPORT, at_ms)


def commands(agent_id: int, at_ms: int) -> Act:
    return lambda it: it.send(command(agent_id), Priority.COMMAND, at_ms)


def pings(agent_id: int, at_ms: int) -> Act:
    return lambda it: it.ping(agent_id, at_ms)


def reads(data: bytes, at_ms: int) -> Act:
    return lambda it: it.read(data, at_ms)


def waits(at_ms: int) -> Act:
    return lambda it: it.advance(at_ms)


def opens(at_ms: int) -> Act:
    return lambda it: it.port_opened(at_ms)


OPENED = [(opens(0), "b'$W'; b'$?'"), (reads(IDENTITY, 50), "the modem is there, with address 1")]
NO_ADDRESS = "a ping of an id that is no modem's address (1 to 255)"
NOT_ASKED = "nobody: a range that was not asked for"
SCENES: dict[str, tuple[dict[str, int], list[tuple[Act, str]]]] = {
    # A sleeping modem answers only the second command; a modem that is awake answers both.
    "it asks who is there and never sets an address": (
        {},
        [
            (opens(0), "b'$W'; b'$?'"),
            (reads(b"$W\r\n", 20), ""),
            (reads(IDENTITY, 60), "the modem is there, with address 1"),
        ],
    ),
    # 105 + (9 + 16) x 12.5 = 417.5 ms of sound, and 20 ms of turnaround.
    "one packet at a time, with its id, and commands first": (
        {},
        [
            *OPENED,
            (reports(7, 100), "b'$B09\\xb1\\x07\\x00status'"),
            (reports(8, 110), ""),
            (commands(300, 120), ""),
            (reads(b"$B09\r\n", 130), ""),
            (waits(567), ""),
            (waits(600), "7 sent at 548; b'$B09\\xb2,\\x01rise!!'"),
        ],
    ),
    "a newer report takes the place of one that waits": (
        {"sound: overtaken by a newer report": 1},
        [
            *OPENED,
            (reports(1, 100), "b'$B09\\xb1\\x01\\x00status'"),
            (reports(2, 100, b"old"), ""),
            (reports(2, 200, b"new"), "2: overtaken by a newer report"),
            (reads(b"$B09\r\n", 210), ""),
            (waits(1000), "1 sent at 628; b'$B06\\xb1\\x02\\x00new'"),
        ],
    ),
    "no answer is tried again and then given up": (
        {"sound: the modem did not take it, 3 times": 1},
        [
            *OPENED,
            (reports(7, 100), "b'$B09\\xb1\\x07\\x00status'"),
            (waits(100 + ANSWER_MS), "b'$W'; b'$?'"),
            (
                reads(IDENTITY, 110 + ANSWER_MS),
                "the modem is there, with address 1; b'$B09\\xb1\\x07\\x00status'",
            ),
            (waits(110 + 2 * ANSWER_MS), "b'$W'; b'$?'"),
            (
                reads(IDENTITY, 120 + 2 * ANSWER_MS),
                "the modem is there, with address 1; b'$B09\\xb1\\x07\\x00status'",
            ),
            (waits(120 + 3 * ANSWER_MS), "7: the modem did not take it, 3 times; b'$W'; b'$?'"),
        ],
    ),
    "an error is tried again at once": (
        {"sound: the modem did not take it, 3 times": 1},
        [
            *OPENED,
            (reports(7, 100), "b'$B09\\xb1\\x07\\x00status'"),
            (reads(b"E\r\n", 120), "b'$B09\\xb1\\x07\\x00status'"),
            (reads(b"E\r\n", 140), "b'$B09\\xb1\\x07\\x00status'"),
            (reads(b"E\r\n", 160), "7: the modem did not take it, 3 times"),
        ],
    ),
    # One is being sent.
    "a full queue drops the last of the lowest priority": (
        {"sound: the modem's queue is full": 1},
        [
            *OPENED,
            (reports(0, 100), "b'$B09\\xb1\\x00\\x00status'"),
            *((reports(agent_id, 100), "") for agent_id in range(1, MAX_WAITING + 1)),
            (commands(5, 100), f"{MAX_WAITING}: the modem's queue is full"),
        ],
    ),
    "what waits too long is dropped and told": (
        {"sound: waited too long for the modem": 1},
        [
            (reports(7, 100), ""),
            (waits(99 + WAIT_MS), ""),
            (waits(100 + WAIT_MS), "7: waited too long for the modem"),
        ],
    ),
    "a lost port is told, and what was being sent is sent again": (
        {},
        [
            *OPENED,
            (reports(7, 100), "b'$B09\\xb1\\x07\\x00status'"),
            (reads(b"$B09\r\n", 120), ""),
            (
                lambda it: it.port_lost("unplugged", 200),
                "the modem is gone, and its port is tried again: unplugged",
            ),
            (waits(5000), ""),
            (opens(5000), "b'$W'; b'$?'"),
            (reads(IDENTITY, 5050), "the modem is there, with address 1; b'$B09\\xb1\\x07\\x00status'"),
        ],
    ),
    "packets from the water carry their ids, and the rest is dropped": (
        {"sound: without an aMussel's id": 1, "sound: a range that was not asked for": 1},
        [
            *OPENED,
            (reads(b"#B00909\xb1\x09\x00status\r\n", 300), "FROM_AMUSSEL 9 b'status'"),
            (reads(b"#U09\xb2\x07\x00rise!!\r\n", 310), "TO_AMUSSEL 7 b'rise!!'"),
            (reads(b"#B00902hi\r\n", 320), "nobody: without an aMussel's id"),
            (reads(b"#R007T03200\r\n", 330), NOT_ASKED),
        ],
    ),
    "a ping is answered by the one that was pinged and by nobody else": (
        {"sound: a range that was not asked for": 4},
        [
            *OPENED,
            (pings(7, 100), "b'$P007'"),
            (reads(b"$P007\r\n", 110), ""),
            *(
                (reads(it, 200), NOT_ASKED)
                for it in (b"#R008T00640\r\n", b"#R007T0064\r\n", b"#R007T006400\r\n")
            ),
            (reads(b"#R007T00640\r\n", 260), "7 640 at 260"),
            (reads(b"#R007T00640\r\n", 270), NOT_ASKED),
        ],
    ),
    # 105 ms of sound, and the manual's 4 s: until then the modem has its ping.
    "a ping without an answer is told, and the queue goes on": (
        {"sound: a ping that was not answered": 1},
        [
            *OPENED,
            (pings(7, 100), "b'$P007'"),
            (reads(b"$P007\r\n", 110), ""),
            (commands(9, 120), ""),
            (waits(110 + 105 + 4000), ""),
            (reads(b"#TO\r\n", 4_230), "7: a ping that was not answered; b'$B09\\xb2\\t\\x00rise!!'"),
        ],
    ),
    "a modem that forgets its ping is asked who it is, and pings again": (
        {},
        [
            *OPENED,
            (pings(7, 100), "b'$P007'"),
            (reads(b"$P007\r\n", 110), ""),
            (waits(110 + 105 + 4000 + ANSWER_MS), "b'$W'; b'$?'"),
            (reads(IDENTITY, 5_300), "the modem is there, with address 1; b'$P007'"),
        ],
    ),
    **{
        f"{agent_id} is no address and gives no range": (
            {f"sound: {NO_ADDRESS}": 1},
            [*OPENED, (pings(agent_id, 100), f"{agent_id}: {NO_ADDRESS}"), (pings(255, 110), "b'$P255'")],
        )
        for agent_id in (EVERYONE, 256, 65_535)
    },
    "too many bytes are one reason, however many": (
        {"sound: more than the 61 bytes that a modem carries besides the id": 200},
        [
            *OPENED,
            *(
                (
                    reports(7, 100, bytes(size)),
                    "7: more than the 61 bytes that a modem carries besides the id",
                )
                for size in range(62, 262)
            ),
            (reports(7, 100, bytes(61)), str(b"$B64\xb1\x07\x00" + bytes(61))),
        ],
    ),
}


@pytest.mark.parametrize(("dropped", "steps"), SCENES.values(), ids=SCENES)
def test_what_goes_to_the_modem_and_what_is_told(
    dropped: dict[str, int], steps: list[tuple[Act, str]]
) -> None:
    queue = ModemQueue()
    assert [shown(act(queue)) for act, _ in steps] == [shown for _, shown in steps]
    assert queue.dropped == dropped


def test_a_modem_that_answered_has_its_address_and_is_due_when_its_sound_is_over() -> None:
    queue = ready()
    assert (queue.stage, queue.address, queue.waiting) == (ModemStage.READY, 1, 0)
    queue.send(report(7), Priority.REPORT, 100)
    queue.send(report(8), Priority.REPORT, 110)
    queue.read(b"$B09\r\n", 130)
    assert (queue.next_due_ms, queue.waiting) == (130 + 418 + 20, 1)


@given(
    st.lists(st.binary(max_size=90) | st.sampled_from([b"#U64", b"#B00164$", b"$B09", b"E\r\n"]), max_size=8)
)
def test_after_any_noise_a_modem_is_found_again(noise: list[bytes]) -> None:
    queue = ready()
    queue.send(report(7), Priority.REPORT, 100)
    now_ms = 100
    for data in noise:
        now_ms += 10
        queue.read(data, now_ms)
    for _ in range(4):
        now_ms += 2 * ANSWER_MS
        command_bytes = written(queue.advance(now_ms))
        if command_bytes.endswith(b"$?"):
            queue.read(IDENTITY, now_ms)
    assert queue.stage is not ModemStage.IDENTIFYING and queue.address == 1
    queue.port_lost("unplugged", now_ms)
    assert queue.stage is ModemStage.CLOSED


@given(
    st.lists(st.sampled_from(["ping", "command", "report", "answer", "#TO", "stranger", "wait"]), max_size=40)
)
def test_a_modem_is_left_alone_until_its_ping_has_an_outcome_and_commands_go_before_pings(
    acts: list[str],
) -> None:
    """The modem is this test's: it takes each command at once, and is silent on a ping until an act says otherwise."""
    queue, now_ms, pinged = ready(), 100, 0
    asked: list[int] = []
    outcomes: list[int] = []
    waiting = {b"\xb2": 0, b"P": 0, b"\xb1": 0}
    kinds = {"command": b"\xb2", "ping": b"P", "report": b"\xb1"}
    told: dict[str, Callable[[int], list[NanomodemAction]]] = {
        "ping": lambda number: queue.ping(number, now_ms),
        "command": lambda number: queue.send(command(number), Priority.COMMAND, now_ms),
        "report": lambda number: queue.send(report(number), Priority.REPORT, now_ms),
        "wait": lambda _: [] if pinged else queue.advance(now_ms),
        "answer": lambda _: queue.read(b"#R%03dT00640\r\n" % pinged, now_ms) if pinged else [],
        "#TO": lambda _: queue.read(b"#TO\r\n", now_ms),
        "stranger": lambda _: queue.read(b"#R200T00640\r\n", now_ms),
    }
    # At the end each ping gets its answer, and each packet its time.
    for number, act in enumerate([*acts, *["answer", "wait"] * (len(acts) + 1)], start=1):
        now_ms += 510 if act == "wait" and not pinged else 10
        before, actions = pinged, told[act](number)
        if act in kinds:
            waiting[kinds[act]] += 1
            asked += [number] * (act == "ping")
        pinged = 0 if act in ("answer", "#TO") else pinged
        outcomes += [it.agent_id for it in actions if isinstance(it, ModemRanged)]
        outcomes += [it.packet.agent_id for it in actions if isinstance(it, PacketDropped) and it.packet]
        if line := written(actions):
            assert not before or not pinged, "it was given a command while it waited for an answer"
            kind = b"P" if line.startswith(b"$P") else line[4:5]
            waiting[kind] -= 1
            assert not any(waiting[it] for it in list(waiting)[: list(waiting).index(kind)])
            if kind == b"P":
                pinged = int(line[2:])
            assert written(queue.read(line[: 5 if kind == b"P" else 4] + b"\r\n", now_ms)) == b""
    assert outcomes == asked and not any(waiting.values())


@given(st.sampled_from(PacketDirection), st.integers(0, 65535), st.binary(min_size=1, max_size=61))
def test_the_header_goes_and_comes(direction: PacketDirection, agent_id: int, data: bytes) -> None:
    packet = RoutedPacket(direction, agent_id, data)
    assert Framing.HEADER.decode(Framing.HEADER.encode(packet)) == packet


@given(
    st.lists(
        st.one_of(
            st.builds(ReceivedData, st.integers(0, 255) | st.none(), st.binary(min_size=2, max_size=64)),
            st.builds(Line, st.sampled_from([b"#TO", b"E", b"$P002", b"#R002T03200", b"#A001V21845"])),
        ),
        max_size=6,
    ),
    st.sampled_from([b"", b"Q20D+000", b"T00000000000001", b"Q07D-123T00000000000001"]),
    st.randoms(use_true_random=False),
)
def test_answers_are_counted_however_they_are_cut(
    sent: list[ReceivedData | Line], appended: bytes, random: object
) -> None:
    data = b""
    for it in sent:
        if isinstance(it, Line):
            data += it.text + b"\r\n"
        else:
            head = b"#U" if it.source is None else b"#B%03d" % it.source
            data += head + b"%02d" % len(it.data) + it.data + appended + b"\r\n"
    reader, answers = AnswerReader(), []
    while data:
        size = random.randint(1, 30)  # type: ignore[attr-defined]
        answers += reader.take(data[:size])
        data = data[size:]
    assert answers == sent
    assert reader.skipped_bytes == 0


def test_answers_behind_a_torn_message_are_read() -> None:
    """A unicast lost its end. The acceptance of our own packet and three whole messages follow."""
    found = AnswerReader().take(b"#U05ab" + b"$B05\r\n" + 3 * b"#B00705hello\r\n")
    assert Line(b"$B05") in found and found.count(ReceivedData(7, b"hello")) == 3


def test_noise_between_answers_is_skipped_and_counted() -> None:
    reader = AnswerReader()
    answers = reader.take(b"\x00\xffboot" + IDENTITY + b"noise\r\n#TO\r\n")
    assert answers == [Line(IDENTITY[:-2]), Line(b"#TO")]
    assert reader.skipped_bytes == 6 + 7
