"""A VCD file against an independent reader, written from the standard only."""

import re

import pytest

from firmware_model.bench import Bench
from firmware_model.bench.trace import line, vcd
from firmware_model.power.rails import Rail
from firmware_model.table_one import HOURLY, board, power
from tests.firmware_model.conftest import lives


def read_vcd(text: str) -> dict[str, list[tuple[int, str]]]:
    """(time, value) by variable's name."""
    names: dict[str, str] = {}
    found: dict[str, list[tuple[int, str]]] = {}
    head, body = text.split("$enddefinitions $end\n")
    for kind, _, code, name in re.findall(r"\$var (\w+) (\d+) (\S+) (\w+) \$end", head):
        assert kind in ("wire", "real", "string") and code not in names
        names[code] = name
        found[name] = []
    now = -1
    for row in body.splitlines():
        if row.startswith("#"):
            assert int(row[1:]) > now
            now = int(row[1:])
        elif not row.startswith("$"):
            value, code = row[1:].split(" ") if row[0] in "sr" else (row[0], row[1:])
            found[names[code]].append((now, value))
    return found


def test_a_vcd_tells_states_rails_and_batteries() -> None:
    bench = Bench(board(HOURLY, power()), primary=0.5)
    lives(bench, "90min permission 2min")
    waves = read_vcd(vcd(bench.trace, bench.courses, bench.config.charge, bench.now_ms, told=bench.told))
    others = ("state", "feed", "primary", "secondary", "charger", "surface", "motors", "sent", "received")
    assert {rail.name for rail in Rail} | set(others) == set(waves)
    assert waves["state"][-4:] == [
        (3_600_000, "SAMPLING"),
        (3_610_000, "SLEEPING"),
        (5_400_000, "SURFACING"),
        (5_460_000, "FLOATING"),
    ]
    assert waves["OXYGEN"] == [(-1, "0"), (3_600_000, "1"), (3_610_000, "0")]
    assert waves["MOTORS"] == [(-1, "0"), (5_400_000, "1"), (5_460_000, "0")]
    assert waves["primary"][0] == (0, "0.5")
    charges = [float(value) for _, value in waves["primary"]]
    assert charges == sorted(charges, reverse=True) and len(charges) > 90
    assert charges[-1] == pytest.approx(bench.primary_fraction, abs=1e-8)


def test_a_vcd_tells_pins_motors_and_packets() -> None:
    """By hand: up at 3 s, there at 63 s, docked at 73 s, a report at the whole hour, released and sinking an hour later."""
    bench = Bench(board(HOURLY, power()))
    lives(bench, "3s permission 70s rises 1h falls 1s release")
    waves = read_vcd(vcd(bench.trace, bench.courses, bench.config.charge, bench.now_ms, told=bench.told))
    assert waves["charger"] == [(-1, "0"), (0, "0"), (73_000, "1"), (3_673_000, "0")]
    assert waves["surface"] == [(-1, "0"), (0, "0"), (63_000, "1")]
    assert waves["motors"] == [(3000, "FLOAT"), (3_674_000, "SINK")]
    assert waves["received"] == [(3000, "MODEM:0102010025af"), (3_674_000, "WIFI:010301001598")]
    assert waves["sent"] == [(3_600_000, "WIFI:status"), (3_600_000, "WIFI:log")]


def test_lines_for_people() -> None:
    bench = Bench(board(HOURLY, power()))
    bench.run(hours=1.1)
    assert {line(action) for action in bench.trace} >= {
        "  1:00:00.000  SLEEPING -ALARM_RANG-> SAMPLING",
        "  1:00:00.000      OXYGEN on",
        "  1:00:10.000      sample logged",
    }
