"""A study's worker: reads the study and then blocks from its input, and answers each block with its rows.

Both ways it is pickled, between processes of one study. Whatever a strategy prints goes to stderr.
"""

from __future__ import annotations

import os
import pickle
import sys

from apad_bridge.runs.studies.runner import Row, StudyFailed, fly_block


def main() -> None:
    answers, orders = os.fdopen(os.dup(1), "wb"), sys.stdin.buffer
    os.dup2(2, 1)
    plan = pickle.load(orders)
    while True:
        try:
            block = pickle.load(orders)
        except EOFError:
            return
        try:
            answer: list[Row] | StudyFailed = fly_block(plan, *block)
        except StudyFailed as failed:
            answer = failed
        pickle.dump(answer, answers)
        answers.flush()


if __name__ == "__main__":
    main()
