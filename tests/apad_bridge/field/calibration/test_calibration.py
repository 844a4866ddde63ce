"""A vehicle's numbers from its logs: vehicles whose numbers only the test knows are flown, logged and measured."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands import main
from apad_bridge.field.calibration.calibration import Calibration, ReadBag, calibrate
from apad_bridge.field.calibration.intervals import Figure, mean, share
from apad_bridge.field.calibration.losses import by_range, of_wifi
from apad_bridge.field.field_log.log_facts import PacketLogged, Posed, Witness
from apad_bridge.field.field_log.reader import FactReader
from apad_bridge.field.field_log.vehicle_log import vehicle_log
from apad_bridge.records.bag import RecordedMessage
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load, write_resolved
from apad_bridge.scenario.text.yaml_text import parse_yaml
from apad_bridge.vehicle.generation_a.messages import GO_TO, GoalOrder
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.generation_a.simulated_messages import (
    BatteryAndProgressPublished,
    GoalEnded,
    GoalOutcome,
)
from apad_bridge.world.simulated_stack import PosePublished
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import load_codec
from firmware_model.states import State
from tests.apad_bridge.field.calibration.field_days import (
    Recorder,
    Vehicle,
    drawn,
    of_generation_a,
    of_generation_b,
    write_bag,
)

POOL = load(POOL_FILE)
SEEDS = range(3)
GO_TOS = 15
DAYS = {"a": of_generation_a, "b": of_generation_b}


@cache
def day(generation: str, seed: int) -> tuple[Vehicle, list[RecordedMessage]]:
    vehicle = drawn(POOL.apad, seed)
    return vehicle, DAYS[generation](vehicle, seed, GO_TOS)


def measured(messages: list[RecordedMessage]) -> Calibration:
    reader = FactReader("the log", "apad1")
    facts = [fact for it in messages for fact in reader.read(it)]
    return calibrate([ReadBag(vehicle_log("the log", facts, reader.missing.values()), facts)], POOL)


@cache
def measured_day(generation: str, seed: int) -> Calibration:
    return measured(day(generation, seed)[1])


def truths(vehicle: Vehicle) -> dict[str, float]:
    config = vehicle.config
    return {
        "speed": vehicle.speed_m_s,
        "stopping distance": vehicle.stopping_m,
        "power at rest": config.battery.hotel_w,
        "power per thrust": config.thruster_w_per_n,
        "power per dock": config.battery.charging_w_per_dock,
        "dockings missed": config.dock_miss_probability,
        "drift north": config.drift_m_s[0],
        "drift east": config.drift_m_s[1],
    }


@cache
def trials(generation: str) -> list[tuple[str, float, Figure]]:
    """(name, truth, figure) of several vehicles."""
    return [
        (name, truth, figures[name])
        for seed in SEEDS
        for figures in [measured_day(generation, seed).figures]
        for name, truth in truths(day(generation, seed)[0]).items()
        if name in figures
    ]


OF_BOTH = {"speed", "stopping distance", "power at rest", "power per thrust"}


@pytest.mark.parametrize(
    ("generation", "names"),
    [
        ("a", OF_BOTH | {"power per dock", "dockings missed"}),
        ("b", OF_BOTH | {"drift north", "drift east"}),
    ],
)
def test_each_true_value_lies_in_its_interval_as_often_as_it_says(generation: str, names: set[str]) -> None:
    found = trials(generation)
    assert sorted(name for name, _, _ in found) == sorted([*names] * len(SEEDS))
    # Of 18 with 95 % each, 15 or fewer would come once in 17 times.
    inside = [it for it in found if it[2].low <= it[1] <= it[2].high]
    assert len(inside) >= 16, [it for it in found if it not in inside]
    # They are narrow enough to be of use: in shares of the truth, and of a drift in m/s.
    widest = {"speed": 0.02, "stopping distance": 0.2, "power per thrust": 0.8}
    for name, truth, figure in found:
        most = 0.005 if name.startswith("drift") else widest.get(name, math.inf) * truth
        assert (figure.high - figure.low) / 2 < most, name


def test_what_a_log_of_each_generation_cannot_tell_has_its_reason() -> None:
    of_a, of_b = measured_day("a", 0), measured_day("b", 0)
    assert {"drift north", "docking time", "leeway"} <= of_a.unmeasured.keys()
    assert {"dockings missed", "power per dock", "leeway"} <= of_b.unmeasured.keys()
    for found in (of_a, of_b):
        assert all(found.unmeasured.values()) and not found.unmeasured.keys() & found.figures.keys()


def test_a_go_to_that_is_flown_again_by_the_measured_numbers_takes_as_long() -> None:
    residuals = measured_day("a", 1).residuals
    assert residuals.go_tos == GO_TOS and residuals.rms_s < 0.5 and residuals.mean_go_to_s > 10


def proportional_day() -> list[RecordedMessage]:
    """Go-tos of the published simulator's controller: a speed of a third of the distance that is left; a still battery."""
    recorder = Recorder("apad1", np.random.default_rng(3), 0.02)
    place, velocity, now_ms = np.zeros(2), np.zeros(2), 0
    for n in range(8):
        goal = np.array([(12.0, 3.0), (0.0, 10.0), (15.0, 15.0), (-4.0, 2.0)][n % 4])
        recorder.goal(now_ms, GoalOrder(f"goal {n}", GO_TO, float(goal[0]), float(goal[1]), ""))
        arrived = False
        for _ in range(300):
            now_ms += 100
            change = (goal - place) / 3 - velocity
            velocity = velocity + change * min(1.0, 0.2 / max(float(np.hypot(*change)), 1e-9))
            place = place + 0.1 * velocity
            recorder.take([PosePublished(now_ms, Pose(float(place[0]), float(place[1])))])
            if now_ms % 1000 == 0:
                recorder.take([BatteryAndProgressPublished(now_ms, 50.0, None, 0.0)])
            if not arrived and np.hypot(*(goal - place)) < 0.5:
                arrived = True
                recorder.take([GoalEnded(now_ms, f"goal {n}", GoalOutcome.SUCCEEDED)])
    return recorder.messages


def test_a_vehicle_without_a_cruise_speed_does_not_fit_and_a_still_battery_is_not_measured() -> None:
    found = measured(proportional_day())
    for name in ("speed", "stopping distance"):
        assert found.unmeasured[name].startswith("does not fit: "), found.unmeasured[name]
    assert not found.figures.keys() & {"speed", "stopping distance", "power at rest", "power per thrust"}
    assert found.unmeasured["power at rest"] == "the battery's level never moved from 50 %"
    assert "speed_m_s" not in found.block.get("mission", {}) and not found.block.get("apad")


Told = Callable[..., str]


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Told:
    """What `musselbed calibrate` prints of a bag, or, where it fails, the error."""

    def answered(bag: Path, *words: str, code: int = 0) -> str:
        capsys.readouterr()
        assert main.main(["calibrate", str(bag), "--scenario", str(POOL_FILE), *words]) == code
        return capsys.readouterr()[code > 0]

    return answered


def test_a_named_span_adrift_gives_the_drift_of_generation_a(tmp_path: Path, told: Told) -> None:
    """The track of a day, and then four minutes in which the water alone carries the vehicle."""
    _, messages = day("a", 2)
    positions = [it for it in messages if it.connection.topic == "/apad1/position"]
    (last,) = [it for it in FactReader("the log", "apad1").read(positions[-1]) if isinstance(it, Posed)]
    from_s = last.at_s - positions[0].stamp_ns / 1e9
    recorder = Recorder("apad1", np.random.default_rng(1), 0.05)
    sent_ms = round((last.at_s - 1.7e9) * 1000) // 100 * 100
    for n in range(1, 2400):
        place, at_ms = (last.place_m[0] + 0.005 * n, last.place_m[1] - 0.003 * n), sent_ms + 100 * n
        recorder.put(at_ms, "/apad1/position", "auv_msgs/msg/NavSts", recorder.nav(at_ms, place, 0))
    bag = write_bag(tmp_path / "day.bag", [*messages, *recorder.messages])
    found = json.loads(told(bag, "--json", "--adrift", f"{from_s + 1}:{from_s + 238}"))
    assert found["scenario"]["apad"]["drift_m_s"] == pytest.approx([0.05, -0.03], abs=0.002)
    assert found["figures"]["drift north"]["samples"] >= 6


def with_text(
    messages: list[RecordedMessage], topic: str, change: Callable[[str], str]
) -> Iterator[RecordedMessage]:
    for it in messages:
        if it.connection.topic == topic:
            connection = replace(it.connection, definition=change(it.connection.definition), md5="0" * 32)
            it = replace(it, connection=connection)
        yield it


def test_a_bag_is_read_by_its_own_definitions_and_a_field_that_it_lacks_costs_only_what_needs_it(
    tmp_path: Path, told: Told
) -> None:
    def of(name: str, change: Callable[[str], str]) -> Path:
        return write_bag(tmp_path / name, with_text(day("a", 0)[1], "/apad1/battery_level", change))

    other = told(of("other.bag", lambda text: text.replace("float64 data", "float64 percent")))
    other = " ".join(other.split())
    assert f"/apad1/battery_level (std_msgs/Float64, md5 {'0' * 32}) has no field `data`" in other
    assert "not measured: power at rest: no battery level in the bags" in other
    bags = of("longer.bag", lambda text: "uint8 SPARE=1\n" + text), of("plain.bag", str)
    longer, plain = (json.loads(told(it, "--json"))["figures"] for it in bags)
    assert longer == plain and "power at rest" in plain


def test_the_block_is_what_the_loader_reads_and_the_written_scenario_flies(
    tmp_path: Path, told: Told
) -> None:
    vehicle, messages = day("a", 1)
    bag, out = write_bag(tmp_path / "day.bag", messages), tmp_path / "like-the-real.yaml"
    block = parse_yaml(told(bag, "--out", str(out)).partition("# for the scenario\n")[2])
    written, speed_m_s = load(out), block["mission"]["speed_m_s"]
    assert written.mission.speed_m_s == speed_m_s == pytest.approx(vehicle.speed_m_s, rel=0.02)
    assert written.apad.battery.hotel_w == block["apad"]["battery"]["hotel_w"]
    assert written.apad.mass_kg == POOL.apad.mass_kg
    assert "exists already" in told(bag, "--out", str(out), code=2)


def test_a_run_of_ours_is_a_log_too(tmp_path: Path, told: Told) -> None:
    """Its own bag has places once a second, and every primitive: dockings with their time, but no brakings."""
    run, scenario = tmp_path / "run", tmp_path / "short.yaml"
    fleet = replace(POOL.fleet, hosting=Hosting.ONE_PROCESS)
    write_resolved(scenario, replace(POOL, duration_s=900.0, fleet=fleet))
    assert main.main(["run", str(scenario), "--time", "asap", "--out", str(run), "--json"]) == 0
    found = json.loads(told(run / "run.bag", "--json"))
    block, docking = found["scenario"], POOL.mission.docking
    assert found["figures"]["speed"]["value"] == pytest.approx(POOL.mission.speed_m_s, rel=0.01)
    assert block["mission"]["docking"]["dock_s"] == pytest.approx(docking.dock_s, abs=1)
    assert block["apad"]["battery"]["hotel_w"] == pytest.approx(POOL.apad.battery.hotel_w, rel=0.05)
    assert "record the vehicle's own, at 4 Hz or more" in found["unmeasured"]["stopping distance"]


@pytest.mark.parametrize("what", ["no file", "no bag", "another vehicle"])
def test_what_is_no_log_of_this_vehicle_is_one_line(tmp_path: Path, what: str, told: Told) -> None:
    bag = tmp_path / "other.bag"
    if what == "no bag":
        bag.write_bytes(b"#ROSBAG V1.1\n" + bytes(1000))
    if what == "another vehicle":
        theirs = ((it, it.connection.topic.replace("apad1", "otter")) for it in day("b", 0)[1][:500])
        write_bag(bag, [replace(it, connection=replace(it.connection, topic=topic)) for it, topic in theirs])
    error = told(bag, code=2)
    assert str(bag) in error and error.count("\n") == 1


def test_wifi_reports_that_were_due_and_did_not_come_are_lost_at_their_range() -> None:
    codec = load_codec(POOL.hearing.codec)

    def heard(at_s: float, north_m: float, state: State = State.FLOATING) -> PacketLogged:
        packet = StatusPacket(7, 0, state, 0.5, 1.0, north_m, 0.0, 0.0, round(1000 * at_s))
        return PacketLogged(at_s, 7, "wifi", codec.encode(packet))

    track = vehicle_log("", [Posed(at_s, Witness.VEHICLE, None, (0.0, 0.0)) for at_s in (0.0, 100.0)]).track
    near = [heard(float(n), 5.0) for n in range(11)]
    # Every second one of 20 is heard from 30 m; then it sinks, and is silent for a minute.
    far = [heard(10.0 + 2 * n, 30.0) for n in range(1, 11)]
    sunk = [heard(31.0, 30.0, State.ACTIVE), heard(90.0, 5.0), heard(91.0, 5.0)]
    losses = by_range(of_wifi([*near, *far, *sunk], track, codec, 1.0))
    found = [(it.from_m, it.to_m, round(it.lost.value, 3), it.lost.samples) for it in losses]
    assert found == [(0.0, 10.0, 0.0, 11), (20.0, 50.0, 0.5, 20)]


def test_intervals_are_those_of_the_books() -> None:
    # Wilson (1927) for 1 of 10, and Student for 1, 2, 3: t(0.975, 2) = 4.3027, standard error 1/sqrt(3).
    found, middle = share(1, 10), mean([1.0, 2.0, 3.0], "m")
    ends = [found.low, found.high, middle.low, middle.high]
    assert ends == pytest.approx([0.01788, 0.40415, -0.4841, 4.4841], abs=1e-4)
    assert mean([1.0, 2.0], "m") is None and share(0, 0) is None
