"""Ten thousand of the fuzz benchmark's inputs; and a failure that the benchmark would find."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from agents.modem import command_handler
from agents.modem.modem import Modem, Timer
from firmware_model.packets import StatusPacket

BENCHMARK = Path(__file__).parents[3] / "benchmarks" / "fuzz.py"


@pytest.fixture(scope="module")
def fuzz() -> Any:
    spec = importlib.util.spec_from_file_location("fuzz", BENCHMARK)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_ten_thousand_inputs_lose_nothing(fuzz: Any) -> None:
    result = fuzz.measure(10_000, seed=1)
    came = result["came"]
    assert came["modem: answered afterwards"] == 6_000
    packets = {what: count for what, count in came.items() if what.startswith("packet: ")}
    assert sum(packets.values()) == 4_000 and len(packets) >= 10
    assert min(came["modem: bytes"], came["modem: frame"], came["modem: power"], came["packet: none"]) > 500
    assert fuzz.measure(1_000, seed=1)["came"] == fuzz.measure(1_000, seed=1)["came"]


def test_a_modem_that_forgets_its_address_is_seen(fuzz: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    start_up = Modem._start_up

    def forgetful(modem: Modem) -> None:
        start_up(modem)
        modem.address = 1

    monkeypatch.setattr(Modem, "_start_up", forgetful)
    with pytest.raises(fuzz.Broken, match="the address being"):
        fuzz.measure(10_000, seed=1)


def test_a_modem_that_hangs_is_seen(fuzz: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    handle = command_handler.handle
    monkeypatch.setattr(
        command_handler,
        "handle",
        lambda modem, item, *at: handle(modem, item, *at) if modem.question is None else [],
    )
    monkeypatch.setattr(
        Modem,
        "_timers",
        lambda modem: tuple(it for it in _TIMERS(modem) if it[1] is not Timer.QUESTION_TIMES_OUT),
    )
    with pytest.raises(fuzz.Broken, match="is answered with"):
        fuzz.measure(10_000, seed=1)


_TIMERS = Modem._timers


def test_a_packet_that_changes_is_seen(fuzz: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    encode = StatusPacket.encode
    monkeypatch.setattr(StatusPacket, "encode", lambda packet: encode(packet)[:-1] + b"\0")
    with pytest.raises(fuzz.Broken, match="does not decode"):
        fuzz.measure(1_000, seed=1)
