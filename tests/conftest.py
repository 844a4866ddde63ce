"""For every test: a slow machine, or one that does other things too, is no reason to fail; nor is a suite under nohup.

Workers share the files out in an order in which no processor waits at the end.
"""

import builtins
import gc
import signal
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

# Each run of the suite tries the same examples, so that a failure is one of the change at hand; the nightly script searches
# on with `--hypothesis-profile=search`.
settings.register_profile(
    "search", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.register_profile("repeats", settings.get_profile("search"), derandomize=True)
settings.register_profile("quick", settings.get_profile("repeats"), max_examples=15)
# What is loaded to collect the tests stays to the end: Python's garbage collector need not walk through it again and again.
gc.disable()
settings.load_profile("repeats")

# A shell's background job ignores SIGINT, and one under nohup SIGHUP: what is ignored is handed on to every child.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)

HERE = Path(__file__).parent
SUM = builtins.sum
OURS = {"firmware_model", "agents", "apad_bridge"}


def sum_of_whole_numbers(values: Iterable[Any], /, start: Any = 0) -> Any:
    """The built-in `sum`, which our packages may not use for floats.

    Python compensates rounding in it since 3.12, so its last bit follows the release; `math.fsum` is exact on each.
    """
    total = SUM(values, start)
    caller = sys._getframe(1).f_globals.get("__name__", "").partition(".")[0]
    assert not (isinstance(total, float) and caller in OURS), "a sum of floats: use math.fsum"
    return total


setattr(builtins, "sum", sum_of_whole_numbers)  # noqa: B010


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--quick", action="store_true", help="leave out what starts a process")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--quick"):
        settings.load_profile("quick")
        config.addinivalue_line("filterwarnings", "ignore::ResourceWarning")  # a skip cuts our code short
        config.pluginmanager.register(StartsNothing())


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    gc.freeze()
    gc.enable()


class StartsNothing:
    """Leaves out what is marked `system`, and skips any other test at its first process, by the interpreter's audit events.

    The rules of the house may run their tools.
    """

    def __init__(self) -> None:
        self._file: Path | None = None
        sys.addaudithook(self._look)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [it for it in items if not it.get_closest_marker("system")]
        for law in (getattr(it, "obj", None) for it in items):
            # A law's own number of examples is for the whole suite.
            own = getattr(law, "_hypothesis_internal_use_settings", None)
            if own is not None and own.max_examples > settings().max_examples:
                law._hypothesis_internal_use_settings = settings(own, max_examples=settings().max_examples)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._file = item.path
        try:
            return (yield)
        finally:
            self._file = None

    def _look(self, event: str, arguments: tuple[Any, ...]) -> None:
        starts = event in {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system"}
        if starts and self._file not in (None, HERE / "test_house.py"):
            pytest.skip("starts a process")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Spreads the files of system tests over the first half of a suite that several workers run.

    A system test mostly waits, so a worker beside it should compute. The last files are short ones, which all workers end
    together.
    """
    if not hasattr(config, "workerinput"):
        return
    files = list(dict.fromkeys(item.path for item in items))
    # The files beside this one are few and slow: types, pages.
    first, system = ([it for it in files if it.parent == folder] for folder in (HERE, HERE / "system"))
    others = [it for it in files if it not in {*first, *system}]
    rank = {path: (0.0, n) for n, path in enumerate(first)}
    rank |= {path: (0.5 * n / len(system), n) for n, path in enumerate(system, start=1)}
    rank |= {path: (n / len(others), n) for n, path in enumerate(others, start=1)}
    items.sort(key=lambda item: rank[item.path])
