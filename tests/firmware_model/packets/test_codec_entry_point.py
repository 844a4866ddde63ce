"""A laboratory's own packet layout, installed as a distribution: the template of a codec, word for word."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import invalidate_caches
from pathlib import Path

import pytest
from doc_blocks import install_template
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from agents.coordinator import Coordinator
from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import WifiSent
from agents.mussel.stimuli import SoundArrived
from agents.packet_medium import Medium
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.mission.facts import AMusselHeard
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.starts import starts_of
from firmware_model.packets import CommandPacket, Kind, StatusPacket
from firmware_model.packets.codec import Codec, load_codec
from firmware_model.states import State

STATUS = StatusPacket(7, 9, State.FLOATING, 0.5, 1.0, -3.25, 12.5, 0.0, 1_800_000)
STATUS_LINE = b"$STATUS,7,9,FLOATING,0.50000,1.00000,-3.25,12.50,0.00,1800000*"


@pytest.fixture
def lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Codec:
    """The documented package, as pip leaves it behind."""
    install_template(tmp_path, "codec")
    monkeypatch.syspath_prepend(str(tmp_path))
    return load_codec("lines")


def test_the_layout_is_what_the_page_says(lines: Codec) -> None:
    assert lines.encode(STATUS).startswith(STATUS_LINE)
    assert lines.decode(lines.encode(STATUS)) == STATUS
    for kind in (Kind.PERMISSION, Kind.RELEASE):
        assert lines.decode(lines.encode(CommandPacket(kind, 7))) == CommandPacket(kind, 7)
    assert lines.encode(CommandPacket(Kind.RELEASE, 7)) == b"$COMMAND,RELEASE,7*39"


def test_bad_bytes_are_none(lines: Codec) -> None:
    good = lines.encode(STATUS)
    assert lines.decode(good) is not None

    @given(
        st.binary(max_size=80) | st.integers(0, len(good) - 1).map(lambda n: good[:n] + b"~" + good[n + 1 :])
    )
    def refused(data: bytes) -> None:
        assert lines.decode(data) is None

    refused()


def test_a_fleet_that_speaks_it_is_heard_and_obeys(lines: Codec) -> None:
    data = resolve(load(POOL_FILE))
    data["hearing"]["codec"] = "lines"
    scenario = from_data(data, "test")
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    fleet = Coordinator(
        InProcessHost(fleet_parts.fleet_config(flight_config(scenario)), initial_states),
        dict.fromkeys(initial_states, 0),
        scenario.time_scale,
    )
    supervisor = flight_parts.supervisor(flight_config(scenario))

    spoken = {}
    for now_ms in (1000, 2000):
        for heard in fleet.advance(now_ms):
            assert isinstance(heard, WifiSent)
            spoken[heard.agent_id] = heard.data
            supervisor.receive(AMusselHeard(Medium.WIFI, fleet.scale.mission_ms(heard.at_ms), heard.data))
        supervisor.advance(now_ms)
    assert all(line.startswith(f"$STATUS,{agent_id},".encode()) for agent_id, line in spoken.items())
    assert [belief.agent_id for belief in supervisor.beliefs.all()] == list(range(1, 13))
    assert {belief.state for belief in supervisor.beliefs.all()} == {State.ACTIVE}
    assert supervisor.dropped == {}

    fleet.receive(3, SoundArrived(lines.encode(CommandPacket(Kind.PERMISSION, 3))), 2000)
    for heard in fleet.advance(3000):
        assert isinstance(heard, WifiSent)
        supervisor.receive(AMusselHeard(Medium.WIFI, fleet.scale.mission_ms(heard.at_ms), heard.data))
    supervisor.advance(3000)
    surfacing = [belief.agent_id for belief in supervisor.beliefs.all() if belief.state is State.SURFACING]
    assert surfacing == [3]


def test_a_supervisor_of_another_layout_counts_what_it_cannot_read(lines: Codec) -> None:
    supervisor = flight_parts.supervisor(flight_config(load(POOL_FILE)))
    supervisor.receive(AMusselHeard(Medium.WIFI, 500, lines.encode(replace(STATUS, agent_id=1))))
    supervisor.advance(1000)
    assert supervisor.beliefs.all() == []
    assert dict(supervisor.dropped) == {"bytes that are no status packet": 1}


def test_a_codec_that_cannot_be_made_or_that_two_packages_bring_names_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lab_codec", raising=False)
    install_template(tmp_path, "codec")
    (tmp_path / "lab_codec.py").write_text("raise OSError('no table')\n")
    with pytest.raises(ValueError, match=r"codec 'lines' \(from lab_codec 1\.2, .*OSError: no table"):
        load_codec("lines")
    another = tmp_path / "other_codec-3.0.dist-info"
    another.mkdir()
    (another / "METADATA").write_text("Metadata-Version: 2.1\nName: other_codec\nVersion: 3.0\n")
    (another / "entry_points.txt").write_text("[musselbed.codecs]\nlines = other_codec:Lines\n")
    invalidate_caches()
    with pytest.raises(
        ValueError, match=r"'lines' is in each of lab_codec 1\.2, other_codec 3\.0: uninstall"
    ):
        load_codec("lines")


def test_a_codec_that_makes_no_bytes_is_named_with_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An agent that handed an integer on would fall silent, far from the cause."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lab_codec", raising=False)
    install_template(tmp_path, "codec")
    text = (tmp_path / "lab_codec.py").read_text()
    (tmp_path / "lab_codec.py").write_text(text.replace(".encode()\n\n    def", "\n\n    def"))
    with pytest.raises(
        TypeError, match=r"codec 'lines' \(from lab_codec 1\.2\) made str of a packet, and no bytes"
    ):
        load_codec("lines").encode(STATUS)
