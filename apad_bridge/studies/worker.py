"""A study's worker: reads the study and then blocks from its input, and answers each block with its rows.

Whatever a strategy prints goes to stderr.
"""

from __future__ import annotations

import os
import sys

from apad_bridge.studies.runner import StudyFailed, fly_block, receive, send
from apad_bridge.studies.specification import StudyPlan


def main() -> None:
    answers, orders = os.fdopen(os.dup(1), "wb"), sys.stdin.buffer
    os.dup2(2, 1)
    plan = StudyPlan.from_wire(receive(orders))
    while True:
        try:
            setting, seed = receive(orders)
        except EOFError:
            return
        try:
            send(answers, {"rows": fly_block(plan, setting, seed)})
        except StudyFailed as failed:
            send(answers, {"failed": str(failed)})


if __name__ == "__main__":
    main()
