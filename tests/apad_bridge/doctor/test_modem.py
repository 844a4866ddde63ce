"""A modem's status and echo, of a modem at the other end of a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import threading
import tty
from contextlib import closing, suppress
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
        with suppress(OSError):
            while not heard.endswith(b"bye"):
                heard += os.read(self._end, 64)
                if answer := self._answers.get(heard):
                    os.write(self._end, answer)
                    heard = b""

    def close(self) -> None:
        os.write(self._here, b"bye")
        self._thread.join(5)
        os.close(self._end)
        os.close(self._here)


STATUS = b"#A007V53000R1.2.3B2020-01-01T00:00:00\r\n"


@pytest.mark.parametrize(
    ("answers", "echo_from", "told"),
    [
        pytest.param(
            {b"$?": STATUS, b"$P012": b"$P012\r\n#R012T01000\r\n"},
            12,
            [("OK", "address 7, 12.1 V"), ("OK", "address 12 answers, 46.9 m away")],
            id="a status, and the echo of another",
        ),
        pytest.param(
            {b"$?": STATUS, b"$P012": b"$P012\r\n#TO\r\n"},
            12,
            [("OK", ""), ("FAIL", "none from address 12")],
            id="no echo",
        ),
        pytest.param({}, None, [("FAIL", "")], id="no answer"),
    ],
)
def test_a_modems_status_and_echo_are_told(
    monkeypatch: pytest.MonkeyPatch,
    answers: dict[bytes, bytes],
    echo_from: int | None,
    told: list[tuple[str, str]],
) -> None:
    """A modem's thread may wait for a processor for longer than a modem takes to answer."""
    for name in ("_ANSWER_S", "_ECHO_S"):
        monkeypatch.setattr(modem, name, PATIENCE_S if answers else 0.2)
    with closing(Modem(answers)) as there:
        found = list(check_modem(there.path, echo_from))
    assert [it.status.value for it in found] == [status for status, _ in told]
    assert all(words in it.found for it, (_, words) in zip(found, told, strict=True))


def test_no_port_is_red(tmp_path: Path) -> None:
    (no_port,) = check_modem(tmp_path / "tty", None)
    assert no_port.status.value == "FAIL" and str(tmp_path / "tty") in no_port.found
