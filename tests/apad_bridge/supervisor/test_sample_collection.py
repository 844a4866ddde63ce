"""The way of a sample from the flash to the disk: nothing lost, nothing twice, whatever happens between the two."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.mussel.logbook import Logbook
from agents.mussel.sensor_bus import SensorBus
from agents.time_scale import TimeScale
from agents.water.fields import WaterFields
from agents.water.patches import CALM
from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.facts import PlacedSample, SampleSource
from apad_bridge.records.sample_file import SampleFile, sample_line
from apad_bridge.supervisor.sample_collection import SampleCollection, Taken
from firmware_model.packets import LogAck, LogRecords, decode
from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.sampling.sensors import NO_COUNTS
from firmware_model.states import State

WATER = WaterFields.by_key({key: waters.field() for key, waters in CALM.items()})
AGENT = 7
SENSORS = SensorBus(AGENT, 1, WATER, lambda now_ms: (1, 2, 3_000_000))


def record(sequence: int) -> SampleRecord:
    return SampleRecord(sequence, 1000 * sequence, NO_COUNTS, 0)


def placed(sequence: int) -> PlacedSample:
    return PlacedSample(record(sequence), None)


def packet(first: int, covered: int, *sequences: int, oldest: int = 0) -> LogRecords:
    return LogRecords.of(AGENT, oldest, first, covered, tuple(map(record, sequences)))


@pytest.mark.parametrize(
    ("kept", "rows", "acknowledged"),
    [
        pytest.param(
            [],
            [(packet(0, 2, 0, 1), [0, 1], []), (packet(4, 2, 4, 5), [4, 5], [])],
            [LogAck(AGENT, 2)],
            id="up to the first hole",
        ),
        pytest.param(
            [0, 1, 4, 5], [(packet(1, 4, 1, 2, 3, 4), [2, 3], [])], [LogAck(AGENT, 6)], id="a hole is filled"
        ),
        pytest.param(
            [],
            [(packet(3, 3, 3, 5, oldest=3), [3, 5], [0, 1, 2, 4]), (packet(3, 3, 3, 5, oldest=3), [], [])],
            [LogAck(AGENT, 6)],
            id="what never will come is said once and not waited for",
        ),
        pytest.param(
            [0, 1, 4],
            [(packet(0, 6, 0, 1, 2, 3, 4, 5), [2, 3, 5], [])],
            [LogAck(AGENT, 6)],
            id="what a former supervisor kept",
        ),
        pytest.param(
            [],
            [(packet(2**31, 1, 2**31, oldest=2**31), "records that an aMussel cannot have", [])],
            [],
            id="an impossible packet",
        ),
        pytest.param(None, [(packet(0, 1, 0), "records of an unknown aMussel", [])], [], id="a stranger"),
    ],
)
def test_what_came_is_taken_once_and_acknowledged(
    kept: list[int] | None,
    rows: list[tuple[LogRecords, list[int] | str, list[int]]],
    acknowledged: list[LogAck],
) -> None:
    """Who kept nothing collects of this aMussel, but for the last row."""
    collection = SampleCollection(
        [8] if kept is None else [AGENT, 8], {SampleSource(AGENT): kept} if kept else {}
    )
    for said, samples, gone in rows:
        found = collection.take(said)
        if isinstance(found, Taken):
            assert ([it.record.sequence for it in found.samples], list(found.gone)) == (samples, gone)
        else:
            assert found == samples
    assert (collection.acknowledgements(), collection.acknowledgements()) == (acknowledged, [])
    assert set().union(*collection.gone.values()) == {it for _, _, gone in rows for it in gone}


def test_each_board_of_an_id_is_told_to_forget_its_own_samples_alone() -> None:
    """The simulated one's first 200 are kept. The real one, after a resume too, was rid of 6 when it took the id."""
    simulated, real = SampleSource(AGENT), SampleSource(AGENT, 60_000)
    collection = SampleCollection([AGENT], {simulated: range(200), real: [7, 8]}, [real])
    found = [collection.take(packet(7, 3, 7, 8, 9, oldest=6)), collection.take(packet(6, 1, 6, oldest=6))]
    assert [[it.record.sequence for it in each.samples] for each in found] == [[9], [6]]
    assert [each.gone for each in found] == [(), ()]
    assert collection.acknowledgements() == [LogAck(AGENT, 10)]
    collection.change_board(simulated)
    assert len(collection.take(packet(199, 2, 199, 200)).samples) == 1
    assert collection.acknowledgements() == [LogAck(AGENT, 201)]


def places_of(seen: list[tuple[int, State, float]], said: LogRecords) -> list[tuple[float, float] | None]:
    collection = SampleCollection([AGENT])
    for agent_ms, state, north_m in seen:
        collection.note_place(believed(state, north_m), agent_ms)
    return [it.place_m for it in collection.take(said).samples]


def believed(state: State, north_m: float) -> Belief:
    return Belief(AGENT, 0, state, 0.5, 0.5, north_m, 2.0)


def test_a_sample_was_taken_where_the_amussel_was_believed_under_water_between_two_docks() -> None:
    seen = [
        (2_500, State.TRANSMITTING, 10.0),
        (3_500, State.SLEEPING, 11.0),
        (4_500, State.FLOATING, 15.0),  # it drifts at the surface
        (5_500, State.CHARGING, 90.0),
        (6_500, State.REPORTING, 90.0),
        (8_500, State.SINKING, 40.0),
        (9_500, State.FLOATING, 44.0),
        (10_500, State.CHARGING, 90.0),
    ]
    assert places_of(seen, packet(0, 10, *range(10))) == [(11.0, 2.0)] * 7 + [(40.0, 2.0)] * 3


def test_a_sample_from_before_anything_was_believed_has_no_place() -> None:
    seen = [(5_500, State.CHARGING, 90.0), (7_500, State.SLEEPING, 10.0)]
    assert places_of(seen, packet(5, 2, 5, 6)) == [None, (10.0, 2.0)]
    line = sample_line(SampleSource(AGENT), placed(5), TimeScale(1))
    assert (line["north_m"], line["east_m"]) == (None, None)


def test_a_line_of_the_file() -> None:
    record = SampleRecord(5, 18_000_007, (29_094, 8147, 28_013, 417), 0b1010)
    line = sample_line(SampleSource(7), PlacedSample(record, (1.2345, -6.7)), TimeScale(30))
    assert line == {
        "id": 7,
        "sequence": 5,
        "agent_ms": 18_000_007,
        "mission_ms": 600_000,
        "north_m": 1.23,
        "east_m": -6.7,
        "oxygen_mg_l": 7.9983,  # 2.4e-4 * 29094 + 1.2e-9 * 29094^2
        "pressure_mbar": 1314.7,
        "temperature_c": 18.013,
        "turbidity_ntu": 5.0144,
        "counts": [29_094, 8147, 28_013, 417],
        "saturated": ["pressure", "turbidity"],
    }


def test_the_file_keeps_a_sample_once_and_goes_on_behind_a_torn_or_damaged_line(tmp_path: Path) -> None:
    path = tmp_path / "samples.jsonl"
    file = SampleFile(path, TimeScale(30))
    assert not path.exists()
    for agent_id, sequences in ((7, (0, 1)), (7, (1,)), (8, (0,))):
        file.append(SampleSource(agent_id), [placed(it) for it in sequences])
    assert [(it["id"], it["sequence"]) for it in read(path)] == [(7, 0), (7, 1), (8, 0)]
    file.close()
    path.write_bytes(b'{"id":7,"sequ\n{"id":7,"sequence":"1"}\n' + path.read_bytes()[:-5])
    again = SampleFile(path, TimeScale(30))
    assert (again.kept, again.unreadable) == ({SampleSource(7): {0, 1}}, 2)
    again.append(SampleSource(8), [placed(0)])
    again.close()
    assert path.read_text().splitlines()[-1].startswith('{"id":8')
    assert SampleFile(path, TimeScale(30)).kept == {SampleSource(7): {0, 1}, SampleSource(8): {0}}


def read(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


class Story:
    """An aMussel, a supervisor with a real file, and a radio link that may do anything to a packet."""

    def __init__(self, path: Path, pages: int) -> None:
        self.path = path
        self.flash = MemoryFlash(pages, 50 * RECORD_BYTES)
        self.book = Logbook(AGENT, SENSORS, self.flash, 0, 0)
        self.truth: list[SampleRecord] = []
        self.air: list[bytes] = []
        self.torn = 0
        self.start()

    def start(self) -> None:
        """A supervisor, the first or one after a kill -9."""
        self.file = SampleFile(self.path, TimeScale(30))
        self.collection = SampleCollection([AGENT], self.file.kept)

    def sample(self, count: int) -> None:
        for _ in range(count):
            now_ms = 1000 * len(self.truth)
            self.book.take_sample(now_ms, now_ms)
            newest = self.book.log.newest()
            assert newest is not None
            self.truth.append(newest)

    def reset(self) -> None:
        """A brown-out: registers and flash are as they were."""
        log = self.book.log
        self.book = Logbook(AGENT, SENSORS, self.flash, log.next_sequence, log.acknowledged)

    def wake(self) -> None:
        self.air += [it.encode() for it in self.book.begin_upload()]

    def tick(self, tear_at: float | None) -> None:
        """The supervisor receives all packets in the air; `tear_at` kills it in its last write, before it acknowledges."""
        said, self.air = self.air, []
        before = self.path.stat().st_size if self.path.exists() else 0
        for data in said:
            heard = decode(data)
            found = self.collection.take(heard)
            self.file.append(SampleSource(AGENT), found.samples)
        if tear_at is not None:
            if self.file._file is not None:
                os.close(self.file._file._descriptor)  # buffered bytes are lost with it
            if self.path.exists():
                size = self.path.stat().st_size
                os.truncate(self.path, before + round(tear_at * (size - before)))
            self.start()
            return
        for ack in self.collection.acknowledgements():
            heard_ack = decode(ack.encode())
            follow = self.book.acknowledge(heard_ack.next_sequence)
            self.air += [it.encode() for it in follow]

    def end(self) -> list[dict[str, object]]:
        """No more packets are lost: the wake lasts until all records are acknowledged."""
        self.air.clear()
        for _ in range(100):
            if self.book.log.waiting == 0:
                break
            self.wake()
            self.tick(None)
        assert self.book.log.waiting == 0
        self.file.close()
        return read(self.path)


STEPS = st.one_of(
    st.tuples(st.just("sample"), st.integers(1, 120)),
    st.tuples(st.just("wake"), st.none()),
    st.tuples(st.just("tick"), st.none()),
    st.tuples(st.just("tick"), st.floats(0, 1)),
    st.tuples(st.just("reset"), st.none()),
    st.tuples(st.just("lose"), st.integers(0, 9)),
    st.tuples(st.just("repeat"), st.integers(0, 9)),
    st.tuples(st.just("shuffle"), st.randoms(use_true_random=False)),
)


@settings(max_examples=80, deadline=None)
@given(steps=st.lists(STEPS, max_size=30), pages=st.sampled_from([4, 40]))
def test_nothing_is_lost_and_nothing_is_there_twice(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[str, object]], pages: int
) -> None:
    story = Story(tmp_path_factory.mktemp("run") / "samples.jsonl", pages)
    for what, how in steps:
        if what == "lose" and story.air:
            del story.air[how % len(story.air)]
        elif what == "repeat" and story.air:
            story.air.append(story.air[how % len(story.air)])
        elif what == "shuffle":
            how.shuffle(story.air)  # type: ignore[attr-defined]
        elif what in ("sample", "wake", "tick", "reset"):
            getattr(story, what)(*(() if what in ("wake", "reset") else (how,)))
    kept = story.end()

    sequences = [line["sequence"] for line in kept]
    assert len(sequences) == len(set(sequences)), "a sample is there twice"
    by_sequence = {line["sequence"]: line for line in kept}
    for sequence, line in by_sequence.items():
        assert line == sample_line(
            SampleSource(AGENT), PlacedSample(story.truth[int(str(sequence))], None), TimeScale(30)
        )
    missing = set(range(len(story.truth))) - set(map(int, map(str, sequences)))
    if pages == 40:
        assert not missing
    else:
        assert missing == story.collection.gone[SampleSource(AGENT)] - set(map(int, map(str, sequences)))
        oldest_ever = story.book.log.oldest
        assert all(sequence < oldest_ever for sequence in missing), "only what the ring overwrote"
