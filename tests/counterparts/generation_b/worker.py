"""The vehicle's clock and its one worker thread, which serves all callbacks one after another."""

from __future__ import annotations

import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

After = Callable[[], None] | None


class Stopped(Exception):
    """The vehicle is being switched off."""


class Clock:
    """Vehicle time in seconds since start: the wall clock times a speed factor (no /clock, see OPEN.md)."""

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.stopping = threading.Event()
        self._start = time.monotonic()

    def now(self) -> float:
        """Vehicle seconds since the start."""
        return (time.monotonic() - self._start) * self.speed

    def sleep(self, seconds: float) -> None:
        """Wait so many vehicle seconds; raise Stopped when the vehicle is switched off meanwhile."""
        if self.stopping.wait(max(0.0, seconds) / self.speed):
            raise Stopped


@dataclass
class Job:
    """A callback waiting for its turn: `work` returns the answer and what has to follow once it is sent."""

    work: Callable[[], tuple[Any, After]]
    done: threading.Event = field(default_factory=threading.Event)
    answer: Any = None
    error: BaseException | None = None


class Worker(threading.Thread):
    """Takes jobs first come, first served; between them runs `tick` once every `period` vehicle seconds.

    A job that blocks (the docking servo, facts B: "blocks about 27 s inside its callback") delays every
    later job and every tick, as a single-threaded spinner does.
    """

    def __init__(self, clock: Clock, tick: Callable[[], None], period: float, service_time: float) -> None:
        super().__init__(name="worker", daemon=True)
        self.clock, self.tick, self.period, self.service_time = clock, tick, period, service_time
        self.jobs: queue.Queue[Job] = queue.Queue()

    def post(self, work: Callable[[], tuple[Any, After]]) -> Job:
        """Queue a callback and return without waiting."""
        job = Job(work)
        self.jobs.put(job)
        return job

    def call(self, work: Callable[[], tuple[Any, After]]) -> Any:
        """Queue a callback and wait for its answer, however long that takes."""
        job = self.post(work)
        while not job.done.wait(0.2):
            if self.clock.stopping.is_set():
                raise Stopped("the vehicle is being switched off")
        if job.error is not None:
            raise job.error
        return job.answer

    def run(self) -> None:
        """The loop of the one thread."""
        next_tick = 0.0
        while not self.clock.stopping.is_set():
            try:
                wait = (next_tick - self.clock.now()) / self.clock.speed
                if wait <= 0:
                    next_tick = max(next_tick + self.period, self.clock.now())
                    self.tick()
                    wait = 0.0
                self.serve(self.jobs.get(timeout=wait) if wait else self.jobs.get_nowait())
            except queue.Empty:
                continue
            except Stopped:
                return
            except Exception:
                traceback.print_exc(file=sys.stderr)

    def serve(self, job: Job) -> None:
        """Do one job: work, answer, and then whatever follows the answer."""
        after: After = None
        try:
            self.clock.sleep(self.service_time)
            job.answer, after = job.work()
        except BaseException as error:  # the caller is told; Stopped ends the loop too
            job.error = error
            if isinstance(error, Stopped):
                raise
        finally:
            job.done.set()
        if after is not None:
            time.sleep(0.01)  # let the answer leave first
            after()
