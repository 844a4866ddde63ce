"""Runs an embedded ROS master. `master.py` starts this program by its path; it imports nothing of musselbed.

Use: master_process.py LOG ORPHAN_S. It prints its URI when it is bound, and ends at SIGTERM. When the other end of standard
input closes, the starter is dead: the master ends at once if nothing was written there before, else ORPHAN_S seconds later.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading

from rosmaster.master import Master

_ENDING = (signal.SIGTERM, signal.SIGINT)


def main() -> int:
    log, orphan_s = sys.argv[1], float(sys.argv[2])
    logging.basicConfig(
        filename=log, level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s"
    )
    # Before any thread starts: every thread inherits the mask, so that only sigwait receives these signals.
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    master = Master(0)
    master.start()
    print(master.uri, flush=True)
    # rosmaster prints now and then; the starter has stopped reading by then.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    threading.Thread(target=_end_after_the_starter, args=(orphan_s,), daemon=True).start()
    threading.Thread(target=_end_with_the_master, args=(master,), daemon=True).start()
    # Not sigtimedwait: CPython 3.11 returns garbage, and no signal, when SIGCONT comes after the time is over.
    signal.sigwait(_ENDING)
    master.stop()
    return 0


def _end_with_the_master(master: Master) -> None:
    while master.ok():
        threading.Event().wait(1.0)
    os.kill(os.getpid(), signal.SIGTERM)


def _end_after_the_starter(orphan_s: float) -> None:
    was_taken_over = False
    while os.read(sys.stdin.fileno(), 64):
        was_taken_over = True
    if was_taken_over:
        threading.Event().wait(orphan_s)
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
