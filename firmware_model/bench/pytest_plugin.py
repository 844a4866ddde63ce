"""A pytest plugin for tests of a board: `def test_it(mu): mu.run(hours=6); mu.charge_pin_rises(); ...`

The fixture `mu` is a `Bench`: a board with Table I's loads that wakes every hour for 10 s. `@pytest.mark.mu(...)` makes
another: sleep "never", "hourly" or "field"; primary, secondary in [0, 1]; docked; kept_on, names of rails; last_resort
"wait", "call" or "surface"; metered, for batteries whose voltage sags and lifts; low_level in [0, 1]; secondary_in_use;
drift_ppm of its clock; timeslot, its (frame, length and guard in s, index); boot_s; travel_ms of its body. The fixture
`make_mu` makes a fresh board by the same words with each call, as each example of a property needs. The report of a failed
test shows the last actions of the newest board. Another plugin may put other firmware on these boards, by `MuHooks`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from typing import Any

import pytest

from firmware_model.bench.bench import Bench
from firmware_model.bench.trace import clock, line
from firmware_model.board import MakeFirmware
from firmware_model.config import BoardConfig, LastResort, Timeslots
from firmware_model.power.charge import MS_PER_MIN, grains
from firmware_model.power.rails import Rail, bits
from firmware_model.table_one import CYCLES, METERING, board, power

_SHOWN = 60


class MuHooks:
    """The hook of this plugin."""

    @pytest.hookspec(firstresult=True)
    def pytest_mu_firmware(self, config: pytest.Config, board: BoardConfig) -> MakeFirmware | None:
        """Makes the firmware of the fixture's board; None for ours."""


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    pluginmanager.add_hookspecs(MuHooks)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "mu(sleep, primary, secondary, docked, kept_on, last_resort, metered, low_level, secondary_in_use, drift_ppm, "
        "timeslot, boot_s, travel_ms): the board of `mu`",
    )


def make_bench(
    *,
    sleep: str = "hourly",
    primary: float = 1.0,
    secondary: float = 1.0,
    docked: bool = False,
    kept_on: tuple[str, ...] = (),
    last_resort: str = "wait",
    metered: bool = False,
    low_level: float = 0.0,
    secondary_in_use: bool = False,
    drift_ppm: float = 0.0,
    timeslot: tuple[float, float, float, int] | None = None,
    boot_s: float = 2.0,
    travel_ms: int = MS_PER_MIN,
    firmware: Callable[[BoardConfig], MakeFirmware | None] = lambda board: None,
) -> Bench:
    """The bench for the arguments of a mark. ValueError for an unknown name lists the known ones.

    `firmware` makes another program than ours for its board.
    """
    if sleep not in CYCLES:
        raise ValueError(f"sleep: {sleep!r} is none of {', '.join(CYCLES)}")
    if unknown := [name for name in kept_on if name.upper() not in Rail.__members__]:
        raise ValueError(f"kept_on: {unknown[0]!r} is none of {', '.join(Rail.__members__).lower()}")
    if last_resort.upper() not in LastResort.__members__:
        raise ValueError(
            f"last_resort: {last_resort!r} is none of {', '.join(LastResort.__members__).lower()}"
        )
    rails = bits(*{Rail[name.upper()] for name in kept_on})
    metering = METERING if metered else None
    fed = power(LastResort[last_resort.upper()], rails, metering, grains(low_level), secondary_in_use)
    cycle = CYCLES[sleep]
    if timeslot is not None:
        if cycle is None:
            raise ValueError("timeslot: a board that never sleeps has none")
        frame_s, slot_s, guard_s, index = timeslot
        cycle = replace(cycle, slots=Timeslots(*(round(it * 1000) for it in (frame_s, slot_s, guard_s))))
    config = replace(
        board(cycle, fed),
        slot=0 if timeslot is None else index,
        drift_ppb=round(drift_ppm * 1000),
        boot_ms=round(boot_s * 1000),
    )
    return Bench(
        config,
        primary=primary,
        secondary=secondary,
        docked=docked,
        travel_ms=travel_ms,
        firmware=firmware(config),
    )


class BoardMaker:
    """Makes a fresh board with each call, powered up at 0, by the words of the mark."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self.newest: Bench | None = None

    def __call__(self, **words: Any) -> Bench:
        self.newest = bench = make_bench(**words, firmware=self._firmware)
        return bench

    def _firmware(self, board: BoardConfig) -> MakeFirmware | None:
        made: MakeFirmware | None = self._config.hook.pytest_mu_firmware(config=self._config, board=board)
        return made


@pytest.fixture(scope="session")
def make_mu(request: pytest.FixtureRequest) -> BoardMaker:
    """Makes boards. It lives as long as the session, so a property of hypothesis may use it."""
    return BoardMaker(request.config)


@pytest.fixture
def mu(request: pytest.FixtureRequest, make_mu: BoardMaker) -> Bench:
    """One board, powered up at 0."""
    mark = request.node.get_closest_marker("mu")
    return make_mu(**(mark.kwargs if mark is not None else {}))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    report = yield
    maker = getattr(item, "funcargs", {}).get("make_mu")
    bench = maker.newest if isinstance(maker, BoardMaker) else None
    if report.when == "call" and report.failed and bench is not None:
        lines = [line(action) for action in bench.trace]
        left_out = [f"... {len(lines) - _SHOWN} lines before"] if len(lines) > _SHOWN else []
        now = (
            f"{clock(bench.now_ms)}  now: {bench.state.name}, primary {bench.primary_fraction:.4f}, "
            f"secondary {bench.secondary_fraction:.4f}"
        )
        report.sections.append(("what the MU did", "\n".join([*left_out, *lines[-_SHOWN:], now])))
    return report
