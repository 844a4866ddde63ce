"""Tests the queue before a physical modem, with its input by hand."""

from __future__ import annotations

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


def reasons(actions: list[NanomodemAction]) -> list[str]:
    return [it.reason for it in actions if isinstance(it, PacketDropped)]


def test_it_asks_who_is_there_and_never_sets_an_address() -> None:
    queue = ModemQueue()
    assert written(queue.port_opened(0)) == b"$W$?"
    # A sleeping modem answers only the second command; a modem that is awake answers both.
    assert queue.read(b"$W\r\n", 20) == []
    (reported,) = queue.read(IDENTITY, 60)
    assert isinstance(reported, ModemNotice) and "address 1" in reported.what
    assert (queue.stage, queue.address) == (ModemStage.READY, 1)


@pytest.fixture
def queue() -> ModemQueue:
    return ready()


def test_one_packet_at_a_time_with_its_id_and_commands_first(queue: ModemQueue) -> None:
    assert written(queue.send(report(7), Priority.REPORT, 100)) == b"$B09\xb1\x07\x00status"
    assert queue.send(report(8), Priority.REPORT, 110) == []
    assert queue.send(command(300), Priority.COMMAND, 120) == []
    assert queue.read(b"$B09\r\n", 130) == []
    # 105 + (9 + 16) x 12.5 = 417.5 ms of sound, and 20 ms of turnaround.
    assert queue.next_due_ms == 130 + 418 + 20
    actions = queue.advance(600)
    assert actions[0] == PacketSent(548, report(7))
    assert written(actions) == b"$B09\xb2\x2c\x01rise!!"


def test_a_newer_report_takes_the_place_of_one_that_waits(queue: ModemQueue) -> None:
    queue.send(report(1), Priority.REPORT, 100)
    queue.send(report(2, b"old"), Priority.REPORT, 100)
    assert reasons(queue.send(report(2, b"new"), Priority.REPORT, 200)) == [
        "sound: overtaken by a newer report"
    ]
    queue.read(b"$B09\r\n", 210)
    assert written(queue.advance(1000)).endswith(b"new")


def test_no_answer_is_tried_again_and_then_given_up(queue: ModemQueue) -> None:
    queue.send(report(7), Priority.REPORT, 100)
    now_ms = 100
    for _ in range(2):
        now_ms += ANSWER_MS
        assert written(queue.advance(now_ms)) == b"$W$?"
        assert b"status" in written(queue.read(IDENTITY, now_ms + 10))
        now_ms += 10
    given_up = queue.advance(now_ms + ANSWER_MS)
    assert reasons(given_up) == ["sound: the modem did not take it, 3 times"]
    assert queue.dropped == {"sound: the modem did not take it, 3 times": 1}


def test_an_error_is_tried_again_at_once(queue: ModemQueue) -> None:
    queue.send(report(7), Priority.REPORT, 100)
    assert b"status" in written(queue.read(b"E\r\n", 120))
    assert b"status" in written(queue.read(b"E\r\n", 140))
    assert reasons(queue.read(b"E\r\n", 160)) == ["sound: the modem did not take it, 3 times"]


def test_a_full_queue_drops_the_last_of_the_lowest_priority(queue: ModemQueue) -> None:
    for agent_id in range(MAX_WAITING + 1):  # one is being sent
        assert reasons(queue.send(report(agent_id), Priority.REPORT, 100)) == []
    full = queue.send(command(5), Priority.COMMAND, 100)
    assert [(it.reason, it.packet) for it in full if isinstance(it, PacketDropped)] == [
        ("sound: the modem's queue is full", report(MAX_WAITING))
    ]
    assert queue.waiting == MAX_WAITING


def test_what_waits_too_long_is_dropped_and_told() -> None:
    queue = ModemQueue()
    queue.send(report(7), Priority.REPORT, 100)
    assert queue.next_due_ms == 100 + WAIT_MS
    (late,) = queue.advance(100 + WAIT_MS)
    assert isinstance(late, PacketDropped) and late.packet == report(7)


def test_a_lost_port_is_told_and_what_was_being_sent_is_sent_again(queue: ModemQueue) -> None:
    queue.send(report(7), Priority.REPORT, 100)
    queue.read(b"$B09\r\n", 120)
    (lost,) = queue.port_lost("unplugged", 200)
    assert isinstance(lost, ModemNotice) and "unplugged" in lost.what
    assert queue.advance(5000) == [] and written(queue.port_opened(5000)) == b"$W$?"
    assert b"status" in written(queue.read(IDENTITY, 5050))


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


def test_packets_from_the_water_carry_their_ids_and_the_rest_is_dropped(queue: ModemQueue) -> None:
    assert queue.read(b"#B00909\xb1\x09\x00status\r\n", 300) == [PacketReceived(300, report(9))]
    assert queue.read(b"#U09\xb2\x07\x00rise!!\r\n", 310) == [PacketReceived(310, command(7))]
    assert reasons(queue.read(b"#B00902hi\r\n", 320)) == ["sound: without an aMussel's id"]
    assert reasons(queue.read(b"#R007T03200\r\n", 330)) == ["sound: a range that was not asked for"]
    assert queue.stage is ModemStage.READY


def ping_of(agent_id: int) -> RoutedPacket:
    return RoutedPacket(PacketDirection.TO_AMUSSEL, agent_id, b"")


def test_a_ping_is_answered_by_the_one_that_was_pinged_and_by_nobody_else(queue: ModemQueue) -> None:
    assert written(queue.ping(7, 100)) == b"$P007"
    assert queue.read(b"$P007\r\n", 110) == []
    for stranger in (b"#R008T00640\r\n", b"#R007T0064\r\n", b"#R007T006400\r\n"):
        assert reasons(queue.read(stranger, 200)) == ["sound: a range that was not asked for"]
    assert queue.read(b"#R007T00640\r\n", 260) == [ModemRanged(260, 7, 640)]
    assert reasons(queue.read(b"#R007T00640\r\n", 270)) == ["sound: a range that was not asked for"]
    assert queue.stage is ModemStage.READY


def test_a_ping_without_an_answer_is_told_and_the_queue_goes_on(queue: ModemQueue) -> None:
    queue.ping(7, 100)
    queue.read(b"$P007\r\n", 110)
    assert queue.send(command(9), Priority.COMMAND, 120) == []
    # 105 ms of sound, and the manual's 4 s: until then the modem has its ping.
    assert queue.advance(110 + 105 + 4000) == []
    unanswered = queue.read(b"#TO\r\n", 4_230)
    assert unanswered[0] == PacketDropped(4_230, "sound: a ping that was not answered", ping_of(7))
    assert written(unanswered) == b"$B09\xb2\x09\x00rise!!"


def test_a_modem_that_forgets_its_ping_is_asked_who_it_is_and_pings_again(queue: ModemQueue) -> None:
    queue.ping(7, 100)
    queue.read(b"$P007\r\n", 110)
    assert written(queue.advance(110 + 105 + 4000 + ANSWER_MS)) == b"$W$?"
    assert b"$P007" in written(queue.read(IDENTITY, 5_300))


@pytest.mark.parametrize("agent_id", [EVERYONE, 256, 65_535])
def test_an_id_that_is_no_address_gives_no_range(queue: ModemQueue, agent_id: int) -> None:
    (dropped,) = queue.ping(agent_id, 100)
    assert isinstance(dropped, PacketDropped) and "no modem's address" in dropped.reason
    assert b"$P255" in written(queue.ping(255, 110))


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
    answers = {"answer": b"#R%03dT00640\r\n", "#TO": b"#TO\r\n", "stranger": b"#R200T00640\r\n"}
    # At the end each ping gets its answer, and each packet its time.
    for number, act in enumerate([*acts, *["answer", "wait"] * (len(acts) + 1)], start=1):
        now_ms += 10
        actions: list[NanomodemAction] = []
        before = pinged
        match act:
            case "ping":
                waiting[b"P"] += 1
                asked.append(number)
                actions = queue.ping(number, now_ms)
            case "command":
                waiting[b"\xb2"] += 1
                actions = queue.send(command(number), Priority.COMMAND, now_ms)
            case "report":
                waiting[b"\xb1"] += 1
                actions = queue.send(report(number), Priority.REPORT, now_ms)
            case "wait" if not pinged:
                now_ms += 500
                actions = queue.advance(now_ms)
            case "answer" | "#TO" | "stranger" if pinged or act != "answer":
                line = answers[act]
                actions = queue.read(line % pinged if act == "answer" else line, now_ms)
                pinged = 0 if act != "stranger" else pinged
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


def test_too_many_bytes_are_one_reason_however_many(queue: ModemQueue) -> None:
    for size in range(62, 262):
        (dropped,) = queue.send(report(7, bytes(size)), Priority.REPORT, 100)
        assert isinstance(dropped, PacketDropped)
    assert queue.dropped == {"sound: more than the 61 bytes that a modem carries besides the id": 200}
    assert b"$B64" in written(queue.send(report(7, bytes(61)), Priority.REPORT, 100))


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


def test_noise_between_answers_is_skipped_and_counted() -> None:
    reader = AnswerReader()
    answers = reader.take(b"\x00\xffboot" + IDENTITY + b"noise\r\n#TO\r\n")
    assert answers == [Line(IDENTITY[:-2]), Line(b"#TO")]
    assert reader.skipped_bytes == 6 + 7
