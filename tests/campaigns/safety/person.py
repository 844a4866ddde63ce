"""A person's command: a program that waits, loaded, for its moment, and its answer."""

from __future__ import annotations

import math
import re
import subprocess
import threading
import time
from dataclasses import dataclass, field

from safety.judge import Told

ANSWER_S = 30.0
COMMAND = """
import sys
from apad_bridge.commands.main import main, parser
parser(sys.argv[2:])
print("warm", flush=True)
sys.stdin.readline()
sys.argv[1:] = sys.argv[2:]
sys.exit(main())
"""
"""`musselbed` with all of it loaded before: the time of an order is not that of an interpreter's start."""

PAGE = """
import http.cookiejar, json, sys, urllib.request
base, token, act = sys.argv[1:]
opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(http.cookiejar.CookieJar()))
opener.open(f"{base}/?token={token}", timeout=20).read()
print("warm", flush=True)
sys.stdin.readline()
body = json.dumps({"act": act, "by": "judge on the page"}).encode()
answer = json.load(opener.open(urllib.request.Request(f"{base}/orders", body), timeout=20))
print(answer)
sys.exit(0 if answer["accepted"] else 3)
"""


def says_done(text: str) -> bool:
    """A line of it says that a stop is done."""
    return re.search(r"^(\w+: )?done\b", text, re.M) is not None


@dataclass
class Pressed:
    """A person's command that waits for its moment, and its answer, with the time at which it came."""

    words: tuple[str, ...]
    process: subprocess.Popen[str]
    asked_s: float = math.nan
    _text: str = ""
    _answered_s: float = math.nan
    _reader: threading.Thread = field(init=False)

    def press(self) -> None:
        assert self.process.stdin is not None
        self._reader = threading.Thread(target=self._read, daemon=True)
        self.asked_s = time.monotonic()
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        self._reader.start()

    def _read(self) -> None:
        self._text, _ = self.process.communicate()
        self._answered_s = time.monotonic()

    def answer(self) -> Told:
        self._reader.join(max(0.0, self.asked_s + ANSWER_S - time.monotonic()))
        code = self.process.returncode
        if self._reader.is_alive():
            self.process.kill()
            self._reader.join()
            self._text, code = "no answer", None
        says_taken = self.words[0] != "continue" and (code == 0 or says_done(self._text))
        words = " ".join(self.words)
        return Told(words, self.asked_s, self._answered_s, code, says_taken, self._text)
