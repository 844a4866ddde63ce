"""A modem's status and echo, of a modem at the other end of a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import threading
import tty
from pathlib import Path

import pytest
from patient import PATIENCE_S

from apad_bridge.doctor import modem
from apad_bridge.doctor.modem import check_modem


class Modem:
    """Answers each question as told."""

    def __init__(self, answers: dict[bytes, bytes]) -> None:
        self._end, here = pty.openpty()
        tty.setraw(self._end)
        tty.setraw(here)
        self.path, self._here = Path(os.ttyname(here)), here
        self._answers = answers
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        heard = b""
        while True:
            try:
                heard += os.read(self._end, 64)
            except OSError:
                return
            if heard.endswith(b"bye"):
                return
            if heard in self._answers:
                os.write(self._end, self._answers[heard])
                heard = b""

    def close(self) -> None:
        os.write(self._here, b"bye")
        self._thread.join(5)
        os.close(self._end)
        os.close(self._here)


STATUS = b"#A007V53000R1.2.3B2020-01-01T00:00:00\r\n"


def waits_for_an_answer(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    for name in ("_ANSWER_S", "_ECHO_S"):
        monkeypatch.setattr(modem, name, seconds)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A modem's thread may wait for a processor for longer than a modem takes to answer."""
    waits_for_an_answer(monkeypatch, PATIENCE_S)


def found(answers: dict[bytes, bytes], echo_from: int | None) -> list[tuple[str, str]]:
    modem = Modem(answers)
    try:
        return [(it.status.value, it.found) for it in check_modem(modem.path, echo_from)]
    finally:
        modem.close()


def test_the_status_and_the_echo_of_another_are_told() -> None:
    ((status, told), (echo, how_far)) = found({b"$?": STATUS, b"$P012": b"$P012\r\n#R012T01000\r\n"}, 12)
    assert (status, echo) == ("OK", "OK")
    assert "address 7, 12.1 V" in told
    assert how_far == "address 12 answers, 46.9 m away"


def test_no_echo_no_answer_and_no_port_are_red(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lost = found({b"$?": STATUS, b"$P012": b"$P012\r\n#TO\r\n"}, 12)
    assert [it for it, _ in lost] == ["OK", "FAIL"] and "none from address 12" in lost[1][1]
    waits_for_an_answer(monkeypatch, 0.2)
    ((silent, _),) = found({}, None)
    assert silent == "FAIL"
    (no_port,) = check_modem(tmp_path / "tty", None)
    assert no_port.status.value == "FAIL" and str(tmp_path / "tty") in no_port.found
