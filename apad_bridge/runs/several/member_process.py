"""The parent of one aPad's run among several, a process of its own: python -m apad_bridge.runs.several.member_process RUN

Its standard output is for the parent of all: the messages of `parent_protocol`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from agents.hosting import interrupts
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import parent
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.parent_protocol import Failed, Summary, write
from apad_bridge.runs.progress import ParentDisplay
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.scenario.starts import starts_of
from apad_bridge.vehicle.errors import PeerFailed


def main() -> int:
    directory = RunDirectory(Path(sys.argv[1]))
    scenario, options = load(directory.scenario), RunOptions.load(directory.path)
    try:
        with interrupts.interruptible():
            summary = parent.fly(scenario, starts_of(scenario), options, directory, ParentDisplay(), write)
    except PeerFailed as error:
        write(Failed(str(error)))
        return Exit.PEER_FAILED
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    write(Summary(summary))
    return Exit.DONE


if __name__ == "__main__":
    sys.exit(main())
