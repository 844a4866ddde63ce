"""The parent of one aPad's run among several, a process of its own: python -m apad_bridge.runs.several.member_process RUN

Its standard output is for the parent of all, in the words of a supervisor's: a JSON line a tick, words for a person, and at
last the summary or why there is none. It goes on when nobody reads it.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path

from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import parent
from apad_bridge.runs.children import terminated_as_interrupted
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.status import Status
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.scenario.starts import starts_of
from apad_bridge.vehicle.errors import PeerFailed


class _Relay:
    def say(self, text: str) -> None:
        _tell(json.dumps({"said": text}))

    def show(self, status: Status) -> None:
        _tell(status.to_line())


def _tell(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        print(line, flush=True)


def main() -> int:
    directory = RunDirectory(Path(sys.argv[1]))
    scenario, options = load(directory.scenario), RunOptions.load(directory.path)
    try:
        with terminated_as_interrupted():
            summary = parent.fly(scenario, starts_of(scenario), options, directory, _Relay(), _tell)
    except PeerFailed as error:
        _tell(json.dumps({"failed": str(error)}))
        return Exit.PEER_FAILED
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    _tell(json.dumps({"summary": summary}))
    return Exit.DONE


if __name__ == "__main__":
    sys.exit(main())
