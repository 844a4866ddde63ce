"""Child processes in sessions of their own, none the parent of another: each can die alone, and all are ended in order."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import IO


class Child:
    """One child, its standard error kept in `log`. A context is not enough: the order of ending is the caller's."""

    def __init__(
        self, name: str, module: str, arguments: list[str], log: Path, environment: dict[str, str]
    ) -> None:
        self.name = name
        self.log = log
        with log.open("ab") as stderr:
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                start_new_session=True,
                env={**os.environ, **environment},
            )
        assert self._process.stdout is not None
        self.lines: IO[str] = self._process.stdout

    @property
    def pid(self) -> int:
        return self._process.pid

    def ask_to_end(self) -> None:
        """SIGINT: end in order."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative: the signal that ended it); None when it still runs after `timeout_s`."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def end(self, timeout_s: float) -> None:
        """SIGTERM, and SIGKILL for one that does not end in time."""
        if self._process.poll() is None:
            self._process.terminate()
            if self.wait(timeout_s) is None:
                self._process.kill()
                self.wait(timeout_s)
        self.lines.close()

    def last_words(self) -> str:
        """The last line of its log, for an error message."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"
