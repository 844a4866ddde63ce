"""Tests run.bag without ROS: reading gives what was written, and the repair of an unclosed bag keeps all whole messages."""

import os
import signal
import subprocess
import sys
import tracemalloc
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import ReaderError

from agents.time_scale import TimeScale
from apad_bridge.events.sound_events import PacketPassed
from apad_bridge.records.bag import CHUNK_MS, BagWriter, recorded_messages, repair_bag
from apad_bridge.records.bag_messages import BELIEFS as BELIEFS_NAME
from apad_bridge.records.bag_messages import TRUTH as TRUTH_NAME
from apad_bridge.records.bag_messages import Messages, typestore
from apad_bridge.records.bag_samples import instants
from apad_bridge.records.packet_lines import sound_rows
from apad_bridge.records.samples import APadSample, BeliefSample, TruthSample

TRUTH = TruthSample(7, 5, 0.25, 1.0, 1.5, -2.5, 3.0, True, 60_000)
BELIEF = BeliefSample(7, 2, 0.5, 0.75, 1.25, -2.0, 4.5)
APAD = APadSample(10.0, 11.0, pi, 15.5, 0.875, "dock", (7, -1, -1, 9))
HEARD = [(0, "received", 51.5, 3_900_893, 200.0, 300.0), (4, "collided", 12.0, 3_900_793, 100.0, 150.0)]
PACKET = PacketPassed(3, None, "broadcast", 3, 1000, 693, None, None, HEARD, "0102ff")


def read(path):
    """Every message as (topic, stamp in ms, message)."""
    with Reader(path) as reader:
        return [
            (connection.topic, stamp_ns / 1e6, typestore().deserialize_ros1(data, connection.msgtype))
            for connection, stamp_ns, data in reader.messages()
        ]


def write_ticks(bag, ticks):
    for tick in range(ticks):
        bag.sample(1000 * tick, [TRUTH], [BELIEF], APAD)


@contextmanager
def new_bag(path, theta=30, **how):
    """A bag at the path, closed at the end."""
    bag = BagWriter(path, TimeScale(theta), **how)
    yield bag
    bag.close()


FLOATS = st.floats(width=32)
TRUTHS = st.builds(
    TruthSample,
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFF),
    *[FLOATS] * 2,
    *[st.floats()] * 2,
    FLOATS,
    st.booleans(),
    st.integers(0, 2**64 - 1),
)
BELIEFS_ = st.builds(
    BeliefSample,
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFF),
    *[FLOATS] * 2,
    *[st.floats()] * 2,
    *[FLOATS] * 9,
    st.lists(FLOATS, max_size=9).map(tuple),
    *[FLOATS] * 2,
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFF),
    st.lists(st.floats(), max_size=3).map(tuple),
    st.lists(FLOATS, max_size=6).map(tuple),
)


@settings(max_examples=40, deadline=None)
@given(st.lists(TRUTHS, max_size=4), st.lists(BELIEFS_, max_size=4))
def test_a_fleets_rows_are_the_bytes_that_the_library_makes_of_the_same_values(truths, beliefs):
    messages, store = Messages(TimeScale(30)), typestore()
    for name, data, rows in (
        (TRUTH_NAME, messages.truth(2500, truths), truths),
        (BELIEFS_NAME, messages.beliefs(2500, beliefs), beliefs),
    ):
        read_back = store.deserialize_ros1(data, name)
        assert store.serialize_ros1(read_back, name).tobytes() == data
        # A message's constants follow its fields.
        found = [
            [it.tolist() if hasattr(it, "tolist") else it for it in list(vars(message).values())[: len(row)]]
            for row, message in zip(rows, read_back.agents, strict=True)
        ]
        wanted = [[list(it) if isinstance(it, tuple) else it for it in row] for row in rows]
        assert repr(found) == repr(wanted)  # by their text, because NaN is not equal to itself


def test_a_sample_comes_back_with_both_clocks(tmp_path):
    """The rows of a fleet are those of the law above."""
    with new_bag(tmp_path / "run.bag") as bag:
        bag.sample(2500, [TRUTH], [BELIEF], APAD)
        bag.event(2500, "dock", '{"dock":0}')
    messages = read(bag.path)
    names = ("truth", "beliefs", "apad", "mission")
    assert [it[:2] for it in messages] == [(f"/musselbed/{name}", 2500) for name in names]
    truth, beliefs, apad, event = its = [message for _, _, message in messages]
    times = {(it.header.stamp.sec, it.header.stamp.nanosec, it.mission_time_ms) for it in its}
    assert times == {(2, 500_000_000, 2500)} and truth.agent_time_ms == beliefs.agent_time_ms == 75_000
    found = apad.north, apad.east, apad.heading, apad.voltage, apad.battery_fraction, apad.primitive
    assert found == (10.0, 11.0, pi, 15.5, 0.875, "dock")
    assert (apad.docks.tolist(), event.kind, event.data) == ([7, -1, -1, 9], "dock", '{"dock":0}')


def test_on_somebody_elses_master_a_bag_keeps_mission_time_and_the_masters(tmp_path):
    torn = tmp_path / "torn.bag"
    with new_bag(tmp_path / "run.bag", stamp_ms=lambda at_ms: 1_800_000_000_250 + at_ms) as bag:
        for now_ms in range(0, 25_000, 1000):
            bag.sample(now_ms, [TRUTH], [BELIEF], APAD)
            bag.event(now_ms, "dock", "{}")
        for row in sound_rows(PACKET):
            bag.sound(24_000, row)
        torn.write_bytes(bag.path.read_bytes())
    messages = read(bag.path)
    assert len({topic for topic, _, _ in messages}) == 5
    for _, stamp_ms, message in messages:
        mission_ms = 0 if stamp_ms < 1 else stamp_ms  # ROS reads a stamp of 0 as no time
        header = message.header.stamp
        found = getattr(message, "mission_time_ms", mission_ms), header.sec, header.nanosec
        assert found == (mission_ms, 1_800_000_000 + mission_ms // 1000, 250_000_000)
    # Readers go by mission time: the whole chunks of a torn bag end at second 20, and samples are asked for by period.
    assert repair_bag(torn)["last_ms"] == 20_000
    assert [it.at_ms for it in instants([bag.path], 10_000)] == [0, 10_000, 20_000]


def test_a_packet_is_told_for_each_listener(tmp_path):
    """The last one is a packet to the aPads' address, at another aPad."""
    to_apads = replace(PACKET, what="unicast", heard=[HEARD[0], (-1, *HEARD[1][1:])])
    with new_bag(tmp_path / "run.bag", theta=1) as bag:
        for row in sound_rows(PACKET) + sound_rows(to_apads):
            bag.sound(3_901_000, row)
    topics, _, its = zip(*read(bag.path), strict=True)
    assert set(topics) == {"/musselbed/sound"}
    assert [(it.message, it.duration, it.snr, it.range) for it in its[:1]] == [
        ("received 0102ff", 0.693, 51.5, 300.0)
    ]
    assert [(it.sender, it.receiver, it.listener_id, it.conflict) for it in its] == [
        (3, -1, 0, False),
        (3, -1, 4, True),
        (3, 0, 0, False),
        (3, 0, -1, True),
    ]
    assert its[1].message == "collided 0102ff"


def test_the_bag_names_the_definitions_that_genpy_generates(tmp_path):
    genmsg = pytest.importorskip("genmsg")
    from apad_bridge.ros.types.messages import DEFINITIONS

    with new_bag(tmp_path / "run.bag") as bag:
        write_ticks(bag, 1)
        bag.event(0, "end", "{}")
    context = genmsg.MsgContext.create_default()
    roots = ("/usr/share", "/opt/ros/noetic/share")
    folders = {
        package: [next(it for root in roots if os.path.isdir(it := f"{root}/{package}/msg"))]
        for package in ("std_msgs", "geometry_msgs")
    }
    own = ("musselbed_msgs", "auv_msgs", "underwater_msgs")
    folders |= {package: [str(DEFINITIONS / package / "msg")] for package in own}
    with Reader(bag.path) as reader:
        found = {it.msgtype.replace("/msg/", "/"): (it.digest, it.msgdef.data) for it in reader.connections}
    assert len(found) == 5
    for name, told in found.items():
        spec = genmsg.msg_loader.load_msg_by_type(context, name, folders)
        genmsg.msg_loader.load_depends(context, spec, folders)
        assert told == (genmsg.compute_md5(context, spec), genmsg.compute_full_text(context, spec)), name


def test_a_killed_bag_keeps_all_but_its_last_chunk(tmp_path):
    program = f"""
import sys
sys.path[:0] = {sys.path!r}
from pathlib import Path
from test_module import APAD, BELIEF, TRUTH, BagWriter, TimeScale, write_ticks
bag = BagWriter(Path({str(tmp_path / "run.bag")!r}), TimeScale(30))
write_ticks(bag, 200)
print("written", flush=True)
sys.stdin.read()
"""
    os.symlink(__file__, tmp_path / "test_module.py")
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=tmp_path
    ) as process:
        assert process.stdout.readline() == b"written\n"
        process.send_signal(signal.SIGKILL)
        assert process.wait(timeout=60) == -signal.SIGKILL
    with pytest.raises(ReaderError, match="not indexed"):
        read(tmp_path / "run.bag")
    repair = repair_bag(tmp_path / "run.bag")
    # Ticks 0..10, 11..20 and so on to 181..190 are whole chunks; 191..199 were never written.
    assert (repair["messages"], repair["last_ms"], repair["torn_bytes"]) == (3 * 191, 190_000, 0)
    assert len(read(tmp_path / "run.bag")) == 3 * 191
    assert repair_bag(tmp_path / "run.bag") is None


def test_a_bag_cut_anywhere_is_repaired_to_what_is_whole(tmp_path):
    with new_bag(tmp_path / "whole.bag") as bag:
        write_ticks(bag, 130)
    whole, expected = bytearray(bag.path.read_bytes()), read_stamps(bag.path)
    index_pos = whole.index(b"index_pos=") + 10
    whole[index_pos : index_pos + 8] = bytes(8)
    torn, counts = tmp_path / "torn.bag", []
    for cut in sorted({0, 5, 13, 20, 4000, 4116, 4117, *range(4118, len(whole), 997), len(whole)}):
        torn.write_bytes(whole[:cut])
        repair, stamps = repair_bag(torn), read_stamps(torn)
        last_ms = stamps[-1][1] // 1_000_000 if stamps else 0
        assert (stamps, repair["messages"]) == (expected[: len(stamps)], len(stamps))
        assert repair["last_ms"] == last_ms
        counts.append(len(stamps))
    assert counts == sorted(counts) and counts[-1] == len(expected)


def read_stamps(path):
    with Reader(path) as reader:
        return [(connection.topic, stamp_ns) for connection, stamp_ns, _ in reader.messages()]


def test_a_written_chunk_takes_a_hundred_bytes_of_memory_until_the_bag_ends(tmp_path):
    chunks, sizes = 400, []
    with new_bag(tmp_path / "run.bag") as bag:
        tracemalloc.start()
        for chunk in range(20 + chunks):  # what is made once is made in the first twenty
            for tick in range(3):
                bag.sample(CHUNK_MS * chunk + 1000 * tick, [TRUTH], [BELIEF], APAD)
            bag.event(CHUNK_MS * chunk, "dock", "{}")
            if chunk in (19, 19 + chunks):
                sizes.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert sizes[1] - sizes[0] < 100 * chunks
    assert len(read_stamps(bag.path)) == 10 * (20 + chunks)


@settings(max_examples=40, deadline=None)
@given(
    damage=st.lists(
        st.tuples(st.integers(0, 60_000), st.binary(min_size=1, max_size=4)), min_size=1, max_size=4
    ),
    is_closed=st.booleans(),
)
def test_damaged_bytes_cost_messages_and_raise_nothing(tmp_path_factory, damage, is_closed):
    path = tmp_path_factory.mktemp("damaged") / "run.bag"
    with new_bag(path) as bag:
        write_ticks(bag, 60)
    raw = bytearray(path.read_bytes())
    if not is_closed:  # as a kill leaves it
        raw[13 + 4 + 4 + len("index_pos=") :][:8] = bytes(8)
    for at, noise in damage:
        raw[at % len(raw) : at % len(raw) + len(noise)] = noise
    path.write_bytes(raw)
    kept = sum(1 for _ in recorded_messages(path))
    repaired = repair_bag(path)
    if repaired is not None:
        assert sum(1 for _ in recorded_messages(path)) == repaired["messages"] == kept
        with Reader(path) as reader:
            assert reader.message_count == repaired["messages"]


ROOM_IN_INDEX = 200
"""More bytes than the index at the end of a bag has for a chunk."""
LARGE_FLEET = 300
"""So many aMussels that a chunk is longer than a file's buffer, and a full disk shows while the chunk is written."""


def write_fleet(bag, count):
    truths = [TRUTH._replace(agent_id=it, primary=1 / (it + 1), north_m=1 / (it + 2)) for it in range(count)]
    for tick in range(250):
        bag.sample(1000 * tick, truths, [BELIEF], APAD)


@pytest.fixture(scope="module")
def references(tmp_path_factory):
    """Whole bags and what they hold, by the sizes of their fleets."""
    written = {}
    for count in (1, LARGE_FLEET):
        with new_bag(tmp_path_factory.mktemp("whole") / "run.bag") as bag:
            write_fleet(bag, count)
        written[count] = bag.path, read(bag.path)
    return written


@settings(max_examples=20, deadline=None)
@given(percent=st.integers(0, 100), count=st.sampled_from([1, LARGE_FLEET]))
def test_a_full_disk_leaves_a_bag_that_opens_with_all_chunks_for_which_there_is_room(
    tmp_path_factory, references, files_of_at_most, percent, count
):
    reference, whole = references[count]
    bag = BagWriter(tmp_path_factory.mktemp("full") / "run.bag", TimeScale(30))
    smallest = bag.path.stat().st_size + 20_000  # the header, and an index without chunks
    limit = smallest + (reference.stat().st_size - smallest) * percent // 100
    failed = True
    with files_of_at_most(limit):
        with suppress(OSError):
            write_fleet(bag, count)
            bag.close()
            failed = False
        with suppress(OSError):
            bag.close()
    kept = read(bag.path)
    assert [(topic, stamp) for topic, stamp, _ in kept] == [it[:2] for it in whole[: len(kept)]]
    assert failed is (len(kept) < len(whole))
    with Reader(reference) as reader:
        places = [chunk.pos for chunk in reader.chunk_infos]
    longest = max(end - begin for begin, end in pairwise(places))
    assert not failed or bag.path.stat().st_size > limit - longest - ROOM_IN_INDEX
