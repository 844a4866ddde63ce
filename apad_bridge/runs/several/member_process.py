"""The parent of one aPad's run among several, a process of its own: python -m apad_bridge.runs.several.member_process RUN

Its standard output is for the parent of all, in the format of a supervisor's: a JSON line a tick, lines for a person, and
at last the summary or the failure. The process continues without a reader of its output.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path

from agents.hosting import interrupts
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import parent
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.progress import ParentDisplay
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.scenario.starts import starts_of
from apad_bridge.vehicle.errors import PeerFailed


def _write_line(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        print(line, flush=True)


def main() -> int:
    directory = RunDirectory(Path(sys.argv[1]))
    scenario, options = load(directory.scenario), RunOptions.load(directory.path)
    try:
        with interrupts.interruptible():
            summary = parent.fly(
                scenario, starts_of(scenario), options, directory, ParentDisplay(_write_line), _write_line
            )
    except PeerFailed as error:
        _write_line(json.dumps({"failed": str(error)}))
        return Exit.PEER_FAILED
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    _write_line(json.dumps({"summary": summary}))
    return Exit.DONE


if __name__ == "__main__":
    sys.exit(main())
