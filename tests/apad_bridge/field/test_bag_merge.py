"""Two bags of one mission, on two machines: their clocks' offset, what each lacks, and one bag of both."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader, Writer

from apad_bridge.commands import main
from apad_bridge.field.bag_merge.bag_figures import figures_of
from apad_bridge.field.bag_merge.clocks import clock_offset
from apad_bridge.field.bag_merge.matching import _rising
from apad_bridge.records.bag import RecordedMessage, recorded_messages

ROOT = Path(__file__).parents[3]
EPOCH_S = 1.7e9
STEP_AT_S = 200.0


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 400 s whose bag is what two machines record."""
    folder = tmp_path_factory.mktemp("flown")
    data = yaml.safe_load((ROOT / "launch_scripts/scenarios/pool-12.yaml").read_text())
    data.update(name="logs", duration_s=400)
    data["fleet"].update(count=6, start={"charge": [0.5, 0.75]}, hosting="one_process")
    (folder / "logs.yaml").write_text(yaml.safe_dump(data))
    out = folder / "run"
    assert main.main(["run", str(folder / "logs.yaml"), "--time", "asap", "--out", str(out), "--json"]) == 0
    return out


def record(
    path: Path,
    messages: list[RecordedMessage],
    keep: Callable[[int], bool],
    clock_s: Callable[[float], float],
    late_s: Callable[[], float],
) -> None:
    """Writes what a machine with this clock records of the messages that it keeps."""
    with Writer(path) as writer:
        connections: dict[str, Any] = {}
        for place, message in enumerate(messages):
            own = message.connection
            if not keep(place):
                continue
            if own.topic not in connections:
                connections[own.topic] = writer.add_connection(
                    own.topic, own.kind, msgdef=own.definition, md5sum=own.md5, callerid=f"/{path.stem}"
                )
            true_s = message.stamp_ns / 1e9 + late_s()
            writer.write(connections[own.topic], round(1e9 * (EPOCH_S + clock_s(true_s))), message.data)


def contents(path: Path) -> Counter[tuple[str, bytes]]:
    return Counter((it.connection.topic, it.data) for it in recorded_messages(path))


def with_flags(messages: list[RecordedMessage]) -> list[RecordedMessage]:
    """The messages, with a flag without any stamp each second: always the same bytes."""
    connection = type(messages[0].connection)(
        "/flag", "std_msgs/msg/Bool", "bool data", "8b94c1b53db61fb6aed406028ad6332a"
    )
    flags = [RecordedMessage(connection, round(1e9 * (n + 0.5)), b"\x01") for n in range(400)]
    return sorted([*messages, *flags], key=lambda it: it.stamp_ns)


def apart(true_s: float) -> float:
    """A clock that is 2 s ahead of the other, until it is set in the middle."""
    return true_s + (2.0 if true_s < STEP_AT_S else -3.5)


@pytest.mark.parametrize("first_steps", [False, True])
def test_two_bags_2_s_apart_with_a_step_and_5_percent_missing_become_one_whole_bag(
    run_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], first_steps: bool
) -> None:
    clocks = (apart, float) if first_steps else (float, apart)
    sign = -1 if first_steps else 1
    draw = random.Random(1)
    messages = with_flags(list(recorded_messages(run_dir / "run.bag")))
    lost_first, lost_second = ({it for it in range(len(messages)) if draw.random() < 0.05} for _ in range(2))
    first, second, out = (tmp_path / name for name in ("apad.bag", "station.bag", "whole.bag"))
    for path, lost, clock in ((first, lost_first, clocks[0]), (second, lost_second, clocks[1])):
        record(
            path, messages, lambda it, lost=lost: it not in lost, clock, lambda: draw.expovariate(1 / 0.01)
        )
    assert main.main(["logs", "merge", str(first), str(second), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)

    assert [it["offset_s"] for it in told["clock"]] == pytest.approx([sign * 2.0, sign * -3.5], abs=0.02)
    assert told["steps_s"] == pytest.approx([sign * -5.5], abs=0.03)

    # Everything that either machine recorded, once. Flags have no stamp, and pair by time alone, also at the step.
    both = lost_first & lost_second
    whole = Counter((it.connection.topic, it.data) for place, it in enumerate(messages) if place not in both)
    merged, flag = contents(out), ("/flag", b"\x01")
    assert abs(merged[flag] - whole[flag]) <= 2
    assert {**merged, flag: 0} == {**whole, flag: 0}
    for name, lost, others in (("first", lost_first, lost_second), ("second", lost_second, lost_first)):
        missing = Counter(messages[place].connection.topic for place in lost - others)
        found = Counter({topic: its[f"missing_in_{name}"] for topic, its in told["topics"].items()})
        assert {**+found, flag[0]: 0} == {**missing, flag[0]: 0}

    # By the first one's clock: what only the second recorded stands where it belongs.
    with Reader(out) as reader:
        at_s = {(it.topic, bytes(data)): stamp / 1e9 - EPOCH_S for it, stamp, data in reader.messages()}
    for it in messages:
        if (key := (it.connection.topic, it.data)) != flag and merged[key] == 1:
            assert at_s[key] == pytest.approx(clocks[0](it.stamp_ns / 1e9), abs=0.2)

    # The run's figures, from both and from either alone.
    summary = json.loads((run_dir / "summary.json").read_text())
    uptime, figures = summary["uptime_paper"]["mean"], told["figures"]
    assert figures["merged"]["uptime_paper_mean"] == pytest.approx(uptime, abs=0.5)
    assert figures["merged"]["cost_m"] == pytest.approx(summary["cost_m"], abs=0.01)
    for alone in (figures["first"], figures["second"]):
        assert alone["uptime_paper_mean"] == pytest.approx(uptime, abs=1.5)
        assert alone["cost_m"] == pytest.approx(summary["cost_m"], rel=0.1)
        assert 0.02 < alone["ticks_missing"] / 400 < 0.09


def test_the_bag_of_a_run_gives_the_figures_of_its_summary(run_dir: Path) -> None:
    figures, summary = figures_of(run_dir / "run.bag"), json.loads((run_dir / "summary.json").read_text())
    uptimes = [
        getattr(figures, f"uptime_paper_{it}") - summary["uptime_paper"][it] for it in ("mean", "max", "min")
    ]
    # A sample shows a docking one tick later than the truth.
    assert uptimes == pytest.approx([0, 0, 0], abs=100 / 400)
    assert figures.cost_m == pytest.approx(summary["cost_m"], abs=0.01)
    told = figures.services, figures.ended_by, figures.ticks_missing
    assert told == (summary["services"], summary["ended_by"], 0)


def test_a_bag_of_the_graph_has_no_truth_and_gives_the_believed_uptime(run_dir: Path, tmp_path: Path) -> None:
    messages = list(recorded_messages(run_dir / "run.bag"))
    heard = tmp_path / "station.bag"
    record(heard, messages, lambda it: "truth" not in messages[it].connection.topic, float, lambda: 0.0)
    figures, summary = figures_of(heard), json.loads((run_dir / "summary.json").read_text())
    assert figures is not None and (figures.samples, figures.ticks_missing) == ("beliefs", 0)
    # An aMussel reports that it is docked some seconds after the dock has closed.
    assert figures.uptime_paper_mean == pytest.approx(summary["uptime_paper"]["mean"], abs=2.0)
    assert figures.cost_m == pytest.approx(summary["cost_m"], abs=0.01)


def test_a_gap_is_told_with_its_length(
    run_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = list(recorded_messages(run_dir / "run.bag"))
    first, second = tmp_path / "apad.bag", tmp_path / "station.bag"
    away = {n for n, it in enumerate(messages) if 100 <= it.stamp_ns / 1e9 < 160}
    record(first, messages, lambda it: it not in away, lambda true_s: true_s, lambda: 0.0)
    record(second, messages, lambda it: True, lambda true_s: true_s + 2.0, lambda: 0.0)
    assert main.main(["logs", "merge", str(first), str(second), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (gap,) = told["gaps"]
    assert (gap["in"], gap["messages"]) == ("first", len(away))
    assert [gap["from_s"], gap["to_s"]] == pytest.approx([EPOCH_S + 100, EPOCH_S + 159], abs=1.0)
    assert contents(tmp_path / "apad-merged.bag") == contents(run_dir / "run.bag")
    assert main.main(["logs", "merge", str(first), str(second)]) == 2  # the merged bag is there
    assert "exists already" in capsys.readouterr().err
    assert main.main(["logs", "merge", str(first), str(second), "--out", str(tmp_path / "again.bag")]) == 0
    assert "A has nothing for 59" in capsys.readouterr().out


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    steps=st.lists(st.tuples(st.integers(30, 120), st.floats(0.5, 1e4), st.booleans()), max_size=3),
    drift=st.floats(-50e-6, 50e-6),
    jitter_s=st.floats(0.0, 0.02),
)
def test_steps_and_drift_are_found_from_common_messages(
    seed: int, steps: list[tuple[int, float, bool]], drift: float, jitter_s: float
) -> None:
    draw = np.random.default_rng(seed)
    true_s, offsets, of_clocks, offset = list[float](), list[float](), list[float](), 2.0
    for count, size_s, is_back in [*steps, (60, 0.0, False)]:
        for _ in range(count):
            true_s.append(len(true_s) * 1.0)
            of_clocks.append(offset + drift * true_s[-1])
            offsets.append(of_clocks[-1] + jitter_s * float(draw.exponential()))
        offset += -size_s if is_back else size_s
    times = [a + b for a, b in zip(true_s, offsets, strict=True)]
    found = clock_offset(range(len(times)), times, offsets)
    assert len(found.stretches) == 1 + len(steps)
    for place, (time_s, expected) in enumerate(zip(times, of_clocks, strict=True)):
        assert found.at(place, time_s) == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize("drift", [40e-6, -40e-6])
def test_a_drift_is_followed_over_a_day(drift: float) -> None:
    """A crystal's 40 in a million make 3.5 s."""
    times_s = np.arange(0.0, 86_400.0, 60.0)
    offsets_s = 2.0 + drift * times_s
    found = clock_offset(range(len(times_s)), times_s, offsets_s)
    assert found.steps_s == []
    assert [found.at(n, it) for n, it in enumerate(times_s)] == pytest.approx(offsets_s, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_bursts_of_late_messages_are_no_steps_of_a_clock(seed: int) -> None:
    """A link that loses packets: each way stands still ten times a minute for up to 6 s, and then gives all at once."""
    draw = np.random.default_rng(seed)
    count, seconds = 24_000, 1080.0
    sent_s = np.sort(draw.uniform(0.0, seconds, count))
    ways_s = np.full((2, count), 0.2)
    for way_s in ways_s:
        at_s = 0.0
        while at_s < seconds:
            at_s += draw.exponential(6.0)
            lasts_s = draw.choice([0.4, 0.8, 1.6, 3.2, 6.4], p=[0.4, 0.3, 0.15, 0.1, 0.05])
            late = (sent_s >= at_s) & (sent_s < at_s + lasts_s)
            way_s[late] += at_s + lasts_s - sent_s[late]
    from_vehicle = draw.random(count) < 0.8
    offsets_s = np.where(sent_s < 400.0, -2.0, 1.0)  # the second clock is set once
    measured_s = offsets_s + np.where(from_vehicle, ways_s[0], -ways_s[1])
    recorded_s = sent_s + np.where(from_vehicle, ways_s[0], 0.0)
    order = np.argsort(recorded_s, kind="stable")
    times_s, offsets_s = (recorded_s + offsets_s)[order], offsets_s[order]
    found = clock_offset(range(count), times_s, measured_s[order])
    assert len(found.steps_s) <= 5 and any(it == pytest.approx(3.0, abs=0.1) for it in found.steps_s)
    errors_s = [abs(found.at(n, times_s[n]) - offsets_s[n]) for n in range(0, count, 20)]
    assert np.percentile(errors_s, 95) < 0.5


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("at_s", [0.0, 300.0, 877.0])
def test_a_second_in_which_a_way_stands_still_is_no_step_of_a_clock(seed: int, at_s: float) -> None:
    draw = np.random.default_rng(seed)
    times_s = np.sort(draw.uniform(0.0, 878.0, 26_000))
    late = (times_s >= at_s) & (times_s < at_s + 1.0)
    measured_s = 0.2 + draw.exponential(0.01, len(times_s)) - 0.57 * late
    found = clock_offset(range(len(times_s)), times_s, measured_s)
    assert found.steps_s == []
    assert found.at(13_000, times_s[13_000]) == pytest.approx(0.2, abs=0.02)


def test_pairing_takes_as_long_for_each_message_of_a_long_recording() -> None:
    """By the number of comparisons, which no busy machine changes: log2 of them for each message, and not all."""

    class Place(int):
        compared = 0

        def __lt__(self, other: object) -> bool:
            Place.compared += 1
            return int(self) < int(other)  # type: ignore[call-overload,no-any-return]

    count = 4096
    pairs = [(n, Place(n)) for n in range(count)]
    assert _rising(pairs) == pairs
    assert 0 < Place.compared < 2 * 12 * count


@pytest.mark.parametrize("what", ["no bag", "nothing in it", "nothing in common", "no file"])
def test_what_cannot_be_merged_is_one_line(
    run_dir: Path, tmp_path: Path, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, other = run_dir / "run.bag", tmp_path / "other.bag"
    messages = list(recorded_messages(bag))
    changed = [RecordedMessage(it.connection, it.stamp_ns, it.data + b"x") for it in messages[:50]]
    if what == "no bag":
        other.write_bytes(b"#ROSBAG V1.1\n" + bytes(1000))
    elif what != "no file":
        record(other, changed if what == "nothing in common" else [], lambda _: True, float, lambda: 0.0)
    out = tmp_path / "out.bag"
    assert main.main(["logs", "merge", str(bag), str(other), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and str(other) in said
    assert not out.exists()
