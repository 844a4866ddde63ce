"""Loads the machine as a vehicle's control process does: ten times a second it works for 20 ms.

Use: control.py; at the end of stdin it prints a line of JSON: the lateness of each period's begin, in milliseconds.
"""

from __future__ import annotations

import json
import select
import sys
import time

PERIOD_S = 0.1
WORK_S = 0.02


def main() -> None:
    late_ms = []
    due_s = time.monotonic() + PERIOD_S
    while not select.select([sys.stdin], [], [], max(0.0, due_s - time.monotonic()))[0]:
        now_s = time.monotonic()
        late_ms.append(1000 * (now_s - due_s))
        while time.monotonic() < now_s + WORK_S:
            pass
        due_s = max(due_s + PERIOD_S, time.monotonic())
    print(json.dumps(late_ms), flush=True)


if __name__ == "__main__":
    main()
