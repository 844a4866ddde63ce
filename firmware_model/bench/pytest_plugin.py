"""A pytest plugin for tests of a board: `def test_it(mu): mu.run(hours=6); mu.charge_pin_rises(); ...`

The fixture `mu` is a `Bench`: a board with Table I's loads that wakes every hour for 10 s. `@pytest.mark.mu(...)` makes
another: sleep "never", "hourly" or "field"; primary, secondary in [0, 1]; docked; kept_on, names of rails; last_resort
"wait", "call" or "surface"; metered, for batteries whose voltage sags and lifts; low_level in [0, 1]. The report of a
failed test shows the last actions of the board. Another plugin may put other firmware on these boards, by `MuHooks`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import pytest

from firmware_model.bench.bench import Bench
from firmware_model.bench.trace import clock, line
from firmware_model.board import MakeFirmware
from firmware_model.config import BoardConfig, LastResort
from firmware_model.power.charge import grains
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
        "mu(sleep, primary, secondary, docked, kept_on, last_resort, metered, low_level): the board of `mu`",
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
    firmware: Callable[[BoardConfig], MakeFirmware | None] = lambda board: None,
) -> Bench:
    """The bench for the arguments of a mark. ValueError for an unknown name lists the known ones.

    `firmware` makes another program than ours for its board.
    """
    if sleep not in CYCLES:
        raise ValueError(f"sleep: {sleep!r} is none of {', '.join(CYCLES)}")
    unknown = [name for name in kept_on if name.upper() not in Rail.__members__]
    if unknown:
        raise ValueError(f"kept_on: {unknown[0]!r} is none of {', '.join(Rail.__members__).lower()}")
    if last_resort.upper() not in LastResort.__members__:
        raise ValueError(
            f"last_resort: {last_resort!r} is none of {', '.join(LastResort.__members__).lower()}"
        )
    rails = bits(*{Rail[name.upper()] for name in kept_on})
    metering = METERING if metered else None
    config = board(CYCLES[sleep], power(LastResort[last_resort.upper()], rails, metering, grains(low_level)))
    return Bench(config, primary=primary, secondary=secondary, docked=docked, firmware=firmware(config))


@pytest.fixture
def mu(request: pytest.FixtureRequest) -> Bench:
    """One board, powered up at 0."""
    mark = request.node.get_closest_marker("mu")
    config = request.config

    def firmware(board: BoardConfig) -> MakeFirmware | None:
        made: MakeFirmware | None = config.hook.pytest_mu_firmware(config=config, board=board)
        return made

    return make_bench(**(mark.kwargs if mark is not None else {}), firmware=firmware)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    report = yield
    bench = getattr(item, "funcargs", {}).get("mu")
    if report.when == "call" and report.failed and isinstance(bench, Bench):
        lines = [line(action) for action in bench.trace]
        left_out = [f"... {len(lines) - _SHOWN} lines before"] if len(lines) > _SHOWN else []
        now = (
            f"{clock(bench.now_ms)}  now: {bench.state.name}, primary {bench.primary_fraction:.4f}, "
            f"secondary {bench.secondary_fraction:.4f}"
        )
        report.sections.append(("what the MU did", "\n".join([*left_out, *lines[-_SHOWN:], now])))
    return report
