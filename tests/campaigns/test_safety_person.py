"""A person's command in a flight: its answer, and the time at which the answer came, however late somebody asks for it."""

from __future__ import annotations

import subprocess
import sys
import time

from safety.person import Pressed


def pressed(program: str) -> Pressed:
    process = subprocess.Popen(
        [sys.executable, "-c", f"input(); {program}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    return Pressed(("stop",), process)


def test_the_time_of_an_answer_is_that_of_the_commands_end() -> None:
    one = pressed("print('done: it rests')")
    one.press()
    one._reader.join(60)
    ended_s = time.monotonic()
    told = one.answer()
    assert told.asked_s < told.answered_s <= ended_s
    assert (told.code, told.says_taken, told.text.strip()) == (0, True, "done: it rests")


def test_an_answer_of_no_is_none_that_it_is_done() -> None:
    one = pressed("print('NOT DONE'); raise SystemExit(3)")
    one.press()
    told = one.answer()
    assert (told.code, told.says_taken) == (3, False)
