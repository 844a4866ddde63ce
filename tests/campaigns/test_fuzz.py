"""Some of the inputs of the campaign to each door, and failures that it would find."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fuzz import campaign as fuzz

from agents.modem import command_handler
from agents.modem.modem import Modem, ModemTimer
from firmware_model.packets import StatusPacket

DOORS = (
    "modem",
    "packets",
    "agent link",
    "nursery socket",
    "ROS messages",
    "scenario",
    "journal",
    "bag",
    "console",
)


def test_no_input_of_the_modem_or_the_packets_loses_anything() -> None:
    modems = fuzz.tried("modem", 6_000, seed=1)["came"]
    assert modems["modem: answered afterwards"] == 6_000
    assert min(modems[f"modem: {kind}"] for kind in ("bytes", "frame", "power")) > 500
    packets = fuzz.tried("packets", 4_000, seed=1)["came"]
    assert sum(packets.values()) == 4_000 and len(packets) >= 10 and packets["packet: none"] > 500


@pytest.mark.parametrize("door", DOORS)
def test_every_door_stands_some_inputs_and_the_same_ones_for_a_seed(door: str) -> None:
    first, again = (fuzz.tried(door, 60, seed=1) for _ in range(2))
    assert first["inputs"] == 60 and first["came"] == again["came"]


def test_there_is_no_other_door() -> None:
    assert tuple(fuzz.DOORS) == DOORS


def test_a_modem_that_forgets_its_address_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    start_up = Modem._start_up

    def forgetful(modem: Modem) -> None:
        start_up(modem)
        modem.address = 1

    monkeypatch.setattr(Modem, "_start_up", forgetful)
    with pytest.raises(fuzz.Broken, match="the address being"):
        fuzz.tried("modem", 10_000, seed=1)


def test_a_modem_that_hangs_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    handle = command_handler.handle
    monkeypatch.setattr(
        command_handler,
        "handle",
        lambda modem, item, *at: handle(modem, item, *at) if modem.question is None else [],
    )
    monkeypatch.setattr(
        Modem,
        "_timers",
        lambda modem: tuple(it for it in _TIMERS(modem) if it[1] is not ModemTimer.QUESTION_TIMES_OUT),
    )
    with pytest.raises(fuzz.Broken, match="is answered with"):
        fuzz.tried("modem", 10_000, seed=1)


_TIMERS = Modem._timers


def test_a_packet_that_changes_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    encode = StatusPacket.encode
    monkeypatch.setattr(StatusPacket, "encode", lambda packet: encode(packet)[:-1] + b"\0")
    with pytest.raises(fuzz.Broken, match="does not decode"):
        fuzz.tried("packets", 1_000, seed=1)


def test_an_input_that_takes_for_ever_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def endless(rng: Any, counts: Any) -> None:
        while True:
            pass

    @contextmanager
    def door(_: Path) -> Iterator[Any]:
        yield endless

    monkeypatch.setattr(fuzz, "_HANG_S", 0.05)
    monkeypatch.setitem(fuzz.DOORS, "endless", door)
    with pytest.raises(fuzz.Broken, match="took a processor"):
        fuzz.tried("endless", 1)
