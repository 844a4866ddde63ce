"""A run in each format, read back by that format's own reader."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from collections import Counter

import pytest
from journals import lines_in
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pyarrow import parquet
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import loadmat

from apad_bridge.analysis.export.formats import Format, default_path, export
from apad_bridge.analysis.export.tables import tables_of
from apad_bridge.commands.main import main
from apad_bridge.records.bag_messages import TRUTH
from apad_bridge.records.run_directory import RunDirectory

OCTAVE = shutil.which("octave")


def test_every_kind_of_event_and_every_sample_has_its_table(pool_run):
    tables, lines = {it.name: it for it in tables_of(pool_run)}, lines_in(pool_run.journal)
    rows = {it.name: it.rows for it in tables.values()}
    assert {it.name: {len(own) for own in it.columns.values()} for it in tables.values()} == {
        name: {count} for name, count in rows.items()
    }
    kinds = Counter(f"event_{line['kind']}" for line in lines)
    for kind in ("truth", "belief", "apad", "tick"):
        del kinds[f"event_{kind}"]
    assert {name: count for name, count in rows.items() if name.startswith("event_")} == kinds
    assert (rows["truth"], rows["apad"]) == (12 * 601, 601)
    closed = [line["agent"] for line in lines if line["kind"] == "dock"]
    assert tables["event_dock"].columns["agent"] == closed
    assert tables["summary_amussels"].columns["id"] == list(range(1, 13))
    beliefs = tables["beliefs"].columns
    assert set(beliefs["depth_m"]) >= {0.0, max(tables["truth"].columns["depth"])}, "what it reports, by name"
    assert not [name for name in beliefs if name.startswith("reported")]


def test_mcap_has_the_bag_s_messages_with_their_definitions(pool_run, tmp_path):
    rows = export(pool_run, Format.MCAP, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros1"
        messages = list(reader.iter_messages(topics="/musselbed/truth"))
        assert len(messages) == rows["/musselbed/truth"] == 601
        schema, channel, message = messages[-1]
        found = schema.name, schema.encoding, channel.message_encoding, message.log_time
        assert found == ("musselbed_msgs/FleetTruth", "ros1msg", "ros1", 600 * 10**9)
        store = get_typestore(Stores.ROS1_NOETIC)
        types = get_types_from_msg(schema.data.decode(), TRUTH)
        store.register({name: fields for name, fields in types.items() if name not in store.types})
        fleet = store.deserialize_ros1(message.data, TRUTH)
        assert {it.id: it.primary for it in fleet.agents} == charges(pool_run)
        assert {it.name for it in reader.iter_attachments()} == {"scenario.yaml", "summary.json"}


def test_an_mcap_in_ros_2_s_form_is_read_by_the_decoder_of_its_format(pool_run, tmp_path):
    """mcap-ros2-support decodes by the definitions in the file; rosbags, which wrote them, has no part in it."""
    rows, heard, newest = export(pool_run, Format.ROS2, tmp_path / "run.mcap"), Counter(), {}
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, _, message in reader.iter_decoded_messages():
            heard[channel.topic] += 1
            newest[channel.topic] = schema, channel, message
        assert reader.get_header().profile == "ros2"
        assert [it.name for it in reader.iter_attachments()] == ["scenario.yaml", "summary.json"]
    assert heard == rows and rows["/musselbed/apad"] == 601
    schema, channel, status = newest["/musselbed/apad"]
    kinds, text = (schema.name, schema.encoding, channel.message_encoding), schema.data.decode()
    assert kinds == ("musselbed_msgs/msg/APadStatus", "ros2msg", "cdr")
    assert "builtin_interfaces/Time" in text and "uint32 seq" not in text
    *_, line = (it for it in lines_in(pool_run.journal) if it["kind"] == "apad")
    stamp, keys = status.header.stamp, ("north_m", "east_m", "heading_rad", "voltage_v", "battery")
    found = [status.north, status.east, status.heading, status.voltage, status.battery_fraction]
    assert found == pytest.approx([line[key] for key in keys], abs=0.02)
    told = (stamp.sec, stamp.nanosec, status.mission_time_ms, status.header.frame_id, status.primitive)
    assert (*told, *status.docks) == (600, 0, 600_000, "musselbed/ned", line["primitive"], *line["docks"])
    assert {it.id: it.primary for it in newest["/musselbed/truth"][2].agents} == charges(pool_run)


def test_csv_and_parquet_say_the_same(pool_run, tmp_path):
    rows = export(pool_run, Format.CSV, tmp_path / "csv")
    assert export(pool_run, Format.PARQUET, tmp_path / "parquet") == rows
    assert {it.stem for it in (tmp_path / "csv").iterdir()} == rows.keys()
    for name, count in rows.items():
        table = parquet.read_table(tmp_path / "parquet" / f"{name}.parquet")
        with (tmp_path / "csv" / f"{name}.csv").open(newline="") as file:
            read = list(csv.DictReader(file))
        assert len(read) == table.num_rows == count and list(read[0]) == table.column_names
    truths = parquet.read_table(tmp_path / "parquet" / "truth.parquet").to_pylist()
    with (tmp_path / "csv" / "truth.csv").open(newline="") as file:
        assert [float(it["primary"]) for it in csv.DictReader(file)] == [it["primary"] for it in truths]
    assert truths[0]["docked"] is False


def test_mat_has_a_struct_for_each_table(pool_run, tmp_path):
    rows = export(pool_run, Format.MAT, tmp_path / "run.mat")
    data = loadmat(tmp_path / "run.mat", simplify_cells=True)
    assert rows.keys() <= data.keys()
    assert (len(data["truth"]["primary"]), data["event_plan"]["strategy"][0]) == (rows["truth"], "cautious")


@pytest.mark.skipif(OCTAVE is None, reason="octave is not installed: scipy has read the file above")
def test_octave_opens_the_mat_file(pool_run, tmp_path):
    rows = export(pool_run, Format.MAT, tmp_path / "run.mat")
    look = "load run.mat; printf('%d %d %s', numel(truth.primary), numel(event_dock.agent), event_plan.strategy{1})"
    command = [OCTAVE, "--no-gui", "--no-init-file", "--eval", look]
    answered = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=120)
    assert answered.stdout == f"{rows['truth']} {rows['event_dock']} cautious"


@pytest.fixture
def copy(pool_run, tmp_path):
    return RunDirectory(shutil.copytree(pool_run.path, tmp_path / "run"))


def test_a_run_that_was_killed_is_exported_and_left_as_it_is(copy, tmp_path):
    bag = copy.bags[0]
    torn = bytearray(bag.read_bytes()[: bag.stat().st_size * 2 // 3])
    # A bag that was never closed has an index at 0.
    at = torn.index(b"index_pos=") + len(b"index_pos=")
    torn[at : at + 8] = bytes(8)
    bag.write_bytes(torn)
    assert 100 < export(copy, Format.MCAP, tmp_path / "run.mcap")["/musselbed/truth"] < 601
    assert bag.read_bytes() == torn


def test_samples_that_were_uploaded_go_along(copy, tmp_path):
    sample = {"id": 3, "sequence": 0, "mission_ms": 1500, "oxygen": 7.5, "counts": [1, 2], "saturated": []}
    copy.samples.write_text(json.dumps(sample) + "\n")
    (samples,) = (it for it in tables_of(copy) if it.name == "samples")
    assert samples.columns["oxygen"] == [7.5] and samples.columns["counts"] == ["[1,2]"]
    export(copy, Format.MCAP, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        ((schema, _, message),) = make_reader(file).iter_messages(topics="/musselbed/samples")
    assert schema.encoding == "jsonschema" and json.loads(message.data) == sample
    assert json.loads(schema.data)["properties"]["oxygen"] == {"type": "number"}


def charges(run):
    summary = json.loads(run.summary.read_text())["amussels"]
    return pytest.approx({int(n): it["final_charge"] for n, it in summary.items()}, abs=1e-5)


@pytest.mark.parametrize("to", list(Format))
def test_a_folder_that_is_not_there_is_made(pool_run, tmp_path, to):
    export(pool_run, to, tmp_path / "new" / "one" / "x")
    assert (tmp_path / "new" / "one" / "x").exists()


def test_the_command(pool_run, tmp_path, capsys):
    assert main(["export", str(pool_run.path), "--to", "mcap", "--json", "--out", str(tmp_path / "a")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["path"] == str(tmp_path / "a") and answer["rows"]["/musselbed/apad"] == 601
    assert default_path(pool_run, Format.CSV) == pool_run.path / "export-csv"
    assert main(["export", str(pool_run.path), "--to", "mat", "--out", str(tmp_path / "a" / "a.mat")]) == 2
    assert re.search("File exists|Not a directory", capsys.readouterr().err)


@pytest.mark.parametrize("to", list(Format))
def test_a_damaged_chunk_of_a_bag_is_one_line(copy, tmp_path, capsys, to):
    data = bytearray(copy.bags[0].read_bytes())
    data[len(data) // 2 : len(data) // 2 + 3000] = bytes(3000)
    copy.bags[0].write_bytes(data)
    assert main(["export", "--to", to, str(copy.path), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert f"{copy.bags[0]}: " in told and "damaged" in told and len(told.splitlines()) == 1


SUMMARY_READERS = ("check", "export --to csv", "report", "replay")
DAMAGES = ["", "{", "[]", "null", '{"services": ']


@pytest.mark.parametrize(
    ("command", "text", "why"),
    [
        *((command, text, "") for command in SUMMARY_READERS for text in DAMAGES),
        ("check", "{}", ", or of another version: 'cost_m'"),
    ],
)
def test_a_damaged_summary_is_one_line(copy, capsys, command, text, why):
    copy.summary.write_text(text)
    assert main([*command.split(), str(copy.path)]) == 2
    # On a busy machine a command that writes says so before.
    (told,) = (it for it in capsys.readouterr().err.splitlines() if not it.startswith("writing "))
    assert f"{copy.summary} is damaged{why}" in told
