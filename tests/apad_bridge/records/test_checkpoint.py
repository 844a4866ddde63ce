"""Tests the checkpoint: a supervisor may be killed anywhere, and its successor believes the same after the same events."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.flight_parts import fleet_beliefs
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.measurement import (
    Docked,
    Fixed,
    Measurement,
    Permitted,
    Ranged,
    Released,
    TimeslotSilent,
)
from apad_bridge.records import checkpoint
from apad_bridge.records.checkpoint import Checkpoint, NoCheckpoint, restore
from apad_bridge.records.line_file import LineFile
from apad_bridge.scenario.blocks.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.loader import load
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.states import State

POOL = load(POOL_FILE)
TWIN = Beliefs(
    estimator=EstimatorKind.TWIN,
    twin=TwinModel(
        drain_deviation=0.1,
        sensor_noise=0.015,
        bias_deviation=0.01,
        unscheduled=0.03,
        fix_deviation_m=1.0,
        current_deviation_m_s=0.02,
    ),
)
IDS = (1, 2, 3)


def of_a_twin() -> FleetBeliefs:
    fleet = replace(POOL.fleet, count=len(IDS))
    return fleet_beliefs(flight_config(replace(POOL, fleet=fleet, beliefs=TWIN)))


ESTIMATORS = {"hold_last": lambda: HoldLast(IDS), "twin": of_a_twin}


@dataclass(frozen=True)
class Event:
    agent_id: int
    after_ms: int
    do: Callable[[FleetBeliefs, int, int], object]
    """Its arguments are the beliefs, an id and the time."""


def status(
    state: State, primary: float, secondary: float, east_m: float, sequence: int, late_ms: int
) -> object:
    told = sequence, state, primary, secondary, 2.0, east_m, 3.0
    return lambda beliefs, agent_id, now_ms: beliefs.hear(
        StatusPacket(agent_id, *told, POOL.theta * (now_ms - late_ms)), now_ms
    )


def short_status(state: State, charge: float) -> object:
    return lambda beliefs, agent_id, now_ms: beliefs.hear_short(
        ShortStatus(agent_id, state, charge, charge), now_ms
    )


def measured(measurement: Measurement) -> object:
    return lambda beliefs, agent_id, now_ms: beliefs.learn(agent_id, measurement, now_ms)


CHARGES, METRES = st.floats(0, 1), st.floats(-50, 50)
STATES = st.sampled_from(list(State))
ACTIONS = st.one_of(
    st.builds(
        status, STATES, CHARGES, CHARGES, METRES, st.integers(0, 3), st.sampled_from((0, 0, 0, 60_000))
    ),
    st.builds(short_status, STATES, CHARGES),
    st.sampled_from(
        [
            measured(TimeslotSilent()),
            measured(Permitted()),
            measured(Docked()),
            measured(Released(3.0, 4.0)),
            measured(Fixed(1.0, 2.0, 0.25)),
            lambda beliefs, agent_id, now_ms: beliefs.forget(agent_id),
        ]
    ),
    METRES.map(lambda m: measured(Ranged(abs(m), 1.0, 2.0, 0.25))),
)
EVENTS = st.lists(
    st.builds(Event, st.sampled_from(IDS), st.sampled_from((0, 1000, 30_000, 900_000)), ACTIONS),
    min_size=1,
    max_size=30,
)


@pytest.fixture(autouse=True)
def full_records_come_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "ROWS", 4)


def tick(beliefs: FleetBeliefs, event: Event, now_ms: int) -> int:
    now_ms += event.after_ms
    beliefs.advance(now_ms)
    event.do(beliefs, event.agent_id, now_ms)
    beliefs.all()  # reading the beliefs at each tick changes nothing
    return now_ms


@pytest.mark.parametrize("estimator", ESTIMATORS)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(events=EVENTS, killed_after=st.integers(0, 30), gap_ms=st.sampled_from((0, 5000, 7_200_000)))
def test_killed_anywhere_it_goes_on_with_the_same_beliefs_to_the_last_bit(
    estimator: str,
    events: list[Event],
    killed_after: int,
    gap_ms: int,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path = tmp_path_factory.mktemp("run") / "checkpoint.jsonl"
    uninterrupted, killed = ESTIMATORS[estimator](), ESTIMATORS[estimator]()
    writer, now_ms = Checkpoint(path, killed, 0), 0
    for event in events[:killed_after]:
        tick(uninterrupted, event, now_ms)
        now_ms = tick(killed, event, now_ms)
        writer.flush(now_ms)
    killed.forget(1)  # the tick in which it dies is not flushed

    resumed = ESTIMATORS[estimator]()
    assert restore(path, resumed).whole
    writer = Checkpoint(path, resumed, now_ms)
    now_ms += gap_ms
    for event in events[killed_after:]:
        tick(uninterrupted, event, now_ms)
        now_ms = tick(resumed, event, now_ms)
        writer.flush(now_ms)
    for beliefs in (uninterrupted, resumed):
        beliefs.advance(now_ms + gap_ms)
    assert resumed.kept() == uninterrupted.kept() and resumed.all() == uninterrupted.all()
    # It would take an old packet for new if it did not remember the newest packet's time.
    late = status(State.ACTIVE, 0.5, 0.5, 0.0, 9, 600_000)
    for beliefs, agent_id in product((uninterrupted, resumed), IDS):
        late(beliefs, agent_id, now_ms + gap_ms)
    assert resumed.kept() == uninterrupted.kept()


def written_checkpoint(path: Path) -> tuple[list[bytes], list[object]]:
    """The lines of a checkpoint file, and the beliefs after each line."""
    beliefs = of_a_twin()
    writer, now_ms, kept = Checkpoint(path, beliefs, 0), 0, [[]]
    for n in range(3):
        event = Event(1 + n % 2, 60_000, status(State.ACTIVE, 0.9 - 0.1 * n, 1.0, 3.0, n, 0))
        now_ms = tick(beliefs, event, now_ms)
        writer.flush(now_ms)
        kept.append(beliefs.kept())
    writer.close()
    return path.read_bytes().splitlines(keepends=True), kept


def test_torn_at_any_byte_it_gives_what_was_whole(tmp_path: Path) -> None:
    lines, kept = written_checkpoint(tmp_path / "checkpoint.jsonl")
    whole, torn = b"".join(lines), tmp_path / "torn.jsonl"
    ends = [len(b"".join(lines[: n + 1])) for n in range(len(lines))]
    for size in range(0, len(whole), 7):
        torn.write_bytes(whole[:size])
        beliefs = of_a_twin()
        after = sum(end <= size for end in ends) - 1
        if after < 0:
            with pytest.raises(NoCheckpoint, match="another version, or damaged"):
                restore(torn, beliefs)
        else:
            restored = restore(torn, beliefs)
            assert (restored.whole, restored.until_ms) == (size in ends, 60_000 * after)
        assert beliefs.kept() == kept[max(after, 0)]


@pytest.mark.parametrize(
    "damaged",
    [
        b"\0\0",
        b'{"t":120000}',
        b'{"t":120000,"learned":[[]]}',
        b'{"t":120000,"learned":[["admitted",7]]}',
        b'{"t":120000,"learned":5}',
        b'{"learned":[]}',
        b'{"t":120000,"learned":[],"counts":7}',
    ],
)
def test_what_follows_damage_is_not_believed(tmp_path: Path, damaged: bytes) -> None:
    path = tmp_path / "checkpoint.jsonl"
    lines, kept = written_checkpoint(path)
    path.write_bytes(lines[0] + lines[1] + damaged + b"\n" + lines[3])
    beliefs = of_a_twin()
    restored = restore(path, beliefs)
    assert (restored.whole, restored.until_ms, beliefs.kept()) == (False, 60_000, kept[1])


def test_it_stays_small_and_a_silent_fleet_writes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.jsonl"
    beliefs = HoldLast(IDS)
    writer = Checkpoint(path, beliefs, 0)
    rows = []
    for n in range(50):
        tick(beliefs, Event(1, 1000, status(State.ACTIVE, 0.5, 1.0, 3.0, n, 0)), 1000 * n)
        writer.flush(1000 * n + 1000)
        rows.append(restore(path, HoldLast(IDS)).rows)
    assert max(rows) == checkpoint.ROWS
    before = path.stat()
    writer.flush(100_000_000)
    assert (path.stat().st_size, path.stat().st_ino) == (before.st_size, before.st_ino)


def test_after_ten_minutes_a_full_record_is_due(tmp_path: Path) -> None:
    """Replaying a twin's day of hourly packets takes longer than writing a full record."""
    path = tmp_path / "checkpoint.jsonl"
    beliefs = HoldLast(IDS)
    writer = Checkpoint(path, beliefs, 0)
    for now_ms in (599_000, 600_000, 601_000):
        beliefs.hear(StatusPacket(1, 0, State.ACTIVE, 0.5, 1.0, 2.0, 3.0, 3.0, now_ms), now_ms)
        writer.flush(now_ms)
    assert restore(path, HoldLast(IDS)) == checkpoint.Restored(601_000, 1, whole=True, counts=Counter())


def test_a_full_record_waits_while_strangers_hold_every_descriptor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, beliefs = tmp_path / "checkpoint.jsonl", HoldLast(IDS)
    writer = Checkpoint(path, beliefs, 0)

    def flush(now_ms: int) -> int:
        """The rows that a resumed supervisor replays."""
        beliefs.hear(StatusPacket(1, 0, State.ACTIVE, 0.5, 1.0, 2.0, 3.0, 3.0, now_ms), now_ms)
        writer.flush(now_ms)
        return restore(path, HoldLast(IDS)).rows

    def none_free(path: Path) -> LineFile:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as strangers:
        strangers.setattr(checkpoint, "LineFile", none_free)
        assert [flush(600_000), flush(601_000)] == [1, 2]
    assert flush(602_000) == 0


def test_another_estimators_checkpoint_is_refused_and_nothing_is_believed(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.jsonl"
    tick(twin := of_a_twin(), Event(1, 1000, status(State.ACTIVE, 0.5, 1.0, 3.0, 0, 0)), 0)
    Checkpoint(path, twin, 1000).close()
    beliefs = HoldLast(IDS)
    with pytest.raises(NoCheckpoint, match="another version"):
        restore(path, beliefs)
    assert beliefs.all() == []
    with pytest.raises(NoCheckpoint, match="No such file"):
        restore(tmp_path / "none.jsonl", beliefs)


def test_a_kill_while_a_full_record_is_written_leaves_the_former_file(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.jsonl"
    _, kept = written_checkpoint(path)
    (tmp_path / ".checkpoint.jsonl.fresh").write_bytes(b'{"t":0,"format":1,"bel')
    first, again = of_a_twin(), of_a_twin()
    restore(path, first)
    Checkpoint(path, first, 200_000).close()
    assert restore(path, again).until_ms == 200_000
    assert first.kept() == again.kept() == kept[-1]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_admitted_aMussel_comes_with_the_beliefs_of_others(name: str, tmp_path: Path) -> None:
    """It reported twice elsewhere. Afterwards both aPads believe the same, and so does a resumed supervisor."""
    elsewhere, here, restored = (ESTIMATORS[name]() for _ in range(3))
    newcomer = 3
    first, second, heard = (
        StatusPacket(newcomer, n, State.ACTIVE, charge, 1.0, 4.0, 5.0, 3.0, POOL.theta * at_ms)
        for n, charge, at_ms in ((0, 0.5, 1000), (0, 0.5, 9000), (1, 0.4, 20_000))
    )
    here.dismiss(newcomer)
    for packet, at_ms in ((first, 1000), (second, 9000)):
        elsewhere.advance(at_ms)
        elsewhere.hear(packet, at_ms)
    here.advance(10_000)
    assert here.hear(heard, 10_000) == "a status of an unknown aMussel"

    writer = Checkpoint(tmp_path / "checkpoint.jsonl", here, 10_000)
    here.admit(newcomer, here.estimator.restored(newcomer, elsewhere.estimator.kept(elsewhere.get(newcomer))))
    for beliefs in (elsewhere, here):
        beliefs.advance(20_000)
        assert beliefs.hear(heard, 20_000) is None
    writer.flush(20_000)
    writer.close()
    restore(tmp_path / "checkpoint.jsonl", restored)
    restored.advance(20_000)
    believed = here.get(newcomer)
    assert believed is not None and believed == elsewhere.get(newcomer) == restored.get(newcomer)
    here.dismiss(newcomer)
    assert here.get(newcomer) is None
