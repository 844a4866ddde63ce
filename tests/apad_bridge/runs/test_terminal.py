"""Control characters in others' texts never reach a terminal; the console's own do."""

from __future__ import annotations

import io

import pytest
from rich.table import Table

from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.rich_console import Console
from apad_bridge.runs.terminal import PlainStream
from firmware_model.control_characters import shown

EVIL = "home\x1b]0;title\x07 \x1b[2J\r\x9b1A\x7fend"
SHOWN = r"home\x1b]0;title\x07 \x1b[2J\x0d\x9b1A\x7fend"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_each_is_shown_but_the_end_of_a_line_and_the_tab() -> None:
    assert shown(EVIL) == SHOWN
    assert shown("Šibenik 7 °C\n\tnorth") == "Šibenik 7 °C\n\tnorth"


def test_a_stream_is_otherwise_the_one_behind_it() -> None:
    terminal = Terminal()
    stream = PlainStream(terminal)
    print(EVIL, file=stream)  # type: ignore[call-overload]
    stream.writelines(["\x1b", "\n"])
    assert terminal.getvalue() == SHOWN + "\n\\x1b\n"
    assert stream.isatty()


def test_a_console_writes_its_own_styles_and_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stdout", PlainStream(terminal))
    monkeypatch.setenv("TERM", "xterm")
    console = Console(markup=False, highlight=False, width=200)
    table = Table(EVIL)
    table.add_row(EVIL, style="bold")
    console.print(EVIL, table, style="red", soft_wrap=True)
    written = terminal.getvalue()
    assert written.count(SHOWN) == 3
    assert "\x1b[31m" in written and "\x1b]" not in written and "\x1b[2J" not in written


def test_a_flight_s_lines_stand_above_its_bar_without_others_control(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", PlainStream(terminal))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "200")
    with FlightProgress("evil\x1b[9A", 1000) as progress:
        progress.print_message(EVIL)
        print(EVIL)
    written = terminal.getvalue()
    assert SHOWN in written and r"evil\x1" in written
    assert "\x1b]" not in written and "\x1b[9A" not in written and "\x1b[?25h" in written
