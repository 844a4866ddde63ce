"""The first process of a simulated machine: starts programs by its standard input, and tells their ends on its output.

    python init.py     (in a pid, mount and network namespace of its own)

A line of input is a JSON object: `name`, `words` and `folder`. What the program says is in FOLDER/NAME.out and NAME.err. A
line of output is [NAME, its exit code]. The kernel ends all processes of the machine with this one, which ends with its
input. Memory in /tmp and /dev/shm ends with it, too.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
from pathlib import Path

_LOOK_S = 0.05


def main() -> None:
    for words in (["mount", "-t", "tmpfs", "none", it] for it in ("/tmp", "/dev/shm")):
        subprocess.run(words, check=True)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    print(json.dumps(["machine", 0]), flush=True)
    started: dict[int, str] = {}
    pending = b""
    while True:
        if select.select([0], [], [], _LOOK_S)[0]:
            piece = os.read(0, 65536)
            if not piece:
                return
            *lines, pending = (pending + piece).split(b"\n")
            for line in lines:
                asked = json.loads(line)
                started[_start(asked)] = asked["name"]
        _reap(started)


def _start(asked: dict[str, str]) -> int:
    folder = Path(asked["folder"])
    out, err = (os.open(folder / f"{asked['name']}.{it}", os.O_WRONLY | os.O_CREAT) for it in ("out", "err"))
    try:
        process = subprocess.Popen(
            asked["words"],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
    finally:
        os.close(out)
        os.close(err)
    process.returncode = 0  # it is reaped here, and not by the module
    return process.pid


def _reap(started: dict[int, str]) -> None:
    """Waits for whatever has ended: the kernel makes every orphan of the machine ours."""
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if pid == 0:
            return
        if pid in started:
            print(json.dumps([started.pop(pid), os.waitstatus_to_exitcode(status)]), flush=True)


if __name__ == "__main__":
    main()
