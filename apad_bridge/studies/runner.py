"""Flies a study's missions in processes of its own, and keeps each finished block in a journal.

`study.yaml` is the study itself, with its scenarios beside it. `trials.jsonl` begins with the study's fingerprint; each
further line is a block: one configuration with every strategy. A study that was ended, by whatever means, goes on from its
lines. A torn last line is cut off and flown again.
"""

from __future__ import annotations

import fcntl
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from subprocess import PIPE, Popen
from typing import IO, Any

import msgpack

from agents.hosting import started
from apad_bridge.mission.policy.plan_checks import StrategyFailed
from apad_bridge.records.line_file import LineFile, read_lines
from apad_bridge.records.run_directory import PRIVATE
from apad_bridge.scenario.errors import UserError
from apad_bridge.studies.models import fly
from apad_bridge.studies.specification import StudyPlan, write_study

JOURNAL = "trials.jsonl"
Row = dict[str, Any]
"""One mission: setting (its index), strategy, seed, and the fields of `Figures`."""
Block = tuple[int, int]
"""(index of the setting, seed)."""
Fly = Callable[[StudyPlan, Sequence[Block]], Iterator[tuple[Block, list[Row]]]]
"""Flies blocks somewhere; yields each when it is done, in any order."""
Worker = Popen[bytes]
_WORKER = "apad_bridge.studies.worker"
_LENGTH = struct.Struct("<I")
"""A message between a study and a worker is msgpack behind its length."""


class StudyFailed(Exception):
    """The study cannot go on; the text is one line with the mend."""


def fly_study(
    plan: StudyPlan,
    directory: Path,
    workers: int | Fly,
    on_flown: Callable[[int], None] = lambda missions: None,
) -> list[Row]:
    """Flies the missions that the directory does not hold yet; returns the rows of all, in the study's order.

    `workers` is the number of processes here, or what flies blocks elsewhere. `on_flown` is told the number of missions of
    each finished block, and first of those that were there. Raises UserError, or StudyFailed for a strategy that fails
    and for a worker that is killed.
    """
    with _opened(directory, plan.fingerprint) as (journal, rows_of):
        plan = write_study(plan, directory)
        wanted = list(plan.blocks)
        on_flown(len(plan.strategies) * sum(block in rows_of for block in wanted))
        # Missions with the same seed share its drift, so a seed's blocks are flown one after the other.
        missing = sorted((block for block in wanted if block not in rows_of), key=lambda it: it[1])
        flown = _fly_blocks(plan, missing, workers) if isinstance(workers, int) else workers(plan, missing)
        for block, rows in flown:
            journal.append({"block": block, "rows": rows})
            journal.flush()
            rows_of[block] = rows
            on_flown(len(rows))
    return [row for block in wanted for row in rows_of[block]]


def is_flying(directory: Path) -> bool:
    """True while a process flies the study of this directory."""
    lock = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
    return False


@contextmanager
def _opened(directory: Path, fingerprint: str) -> Iterator[tuple[LineFile, dict[Block, list[Row]]]]:
    """The journal, for the one process that holds the directory's lock, and the rows in it by block."""
    directory.mkdir(mode=PRIVATE, parents=True, exist_ok=True)
    path = directory / JOURNAL
    lock = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    with ExitStack() as stack:
        stack.callback(os.close, lock)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UserError(
                f"{directory}: another process flies this study: wait for it, or choose another --out"
            ) from error
        lines = [line for line in read_lines(path) if line is not None] if path.exists() else []
        if lines and lines[0].get("study") != fingerprint:
            raise UserError(
                f"{directory}: holds the missions of another study, or of another version of this one: say another --out, "
                f"or remove {path}"
            )
        journal = LineFile(path)
        stack.callback(journal.close)
        if not lines:
            journal.append({"study": fingerprint})
            journal.flush()
        yield journal, {tuple(line["block"]): line["rows"] for line in lines[1:]}


def fly_block(plan: StudyPlan, setting: int, seed: int) -> list[Row]:
    """Flies every strategy on one configuration."""
    rows = []
    for index, strategy in enumerate(plan.strategies):
        try:
            figures = fly(plan.scenario(setting, index, seed), plan.study.model, plan.trust)
        except StrategyFailed as failed:
            where = f"{plan.settings[setting].label}, seed {seed}"
            raise StudyFailed(
                f"{failed} ({strategy} in {where}): mend the strategy; the same command continues from there"
            ) from failed
        rows.append({"setting": setting, "strategy": strategy, "seed": seed, **asdict(figures)})
    return rows


def _fly_blocks(plan: StudyPlan, blocks: list[Block], workers: int) -> Iterator[tuple[Block, list[Row]]]:
    """Flies blocks as processes become free; yields each when it is done."""
    if workers == 1 or len(blocks) == 1:
        for block in blocks:
            yield block, fly_block(plan, *block)
        return
    waiting: dict[int, list[Block]] = {}
    for block in blocks:
        waiting.setdefault(block[1], []).append(block)
    with _started_workers(plan, min(workers, len(blocks))) as processes, DefaultSelector() as selector:
        flying: dict[int, Block] = {}
        for process in processes:
            selector.register(process.stdout, EVENT_READ, process)  # type: ignore[arg-type]
            flying[process.pid] = _order(process, _take(waiting, None))
        while flying:
            for key, _ in selector.select():
                process = key.data
                block, rows = flying.pop(process.pid), _answer(process)
                if waiting:
                    flying[process.pid] = _order(process, _take(waiting, block))
                yield block, rows


def _take(waiting: dict[int, list[Block]], last: Block | None) -> Block:
    """Takes the next block for a worker: with the seed that it flew last, or else with the seed that has most left."""
    seed = (
        last[1] if last is not None and last[1] in waiting else max(waiting, key=lambda it: len(waiting[it]))
    )
    block = waiting[seed].pop(0)
    if not waiting[seed]:
        del waiting[seed]
    return block


def send(stream: IO[bytes], message: Any) -> None:
    """Sends plain values. BrokenPipeError when the other end is gone."""
    data: bytes = msgpack.packb(message)
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Waits for a message; its arrays are lists. EOFError when the other end is gone before the message is whole."""
    head = stream.read(_LENGTH.size)
    data = stream.read(*_LENGTH.unpack(head)) if len(head) == _LENGTH.size else b""
    if not data or len(data) < _LENGTH.unpack(head)[0]:
        raise EOFError
    return msgpack.unpackb(data)


def _order(process: Worker, block: Block) -> Block:
    assert process.stdin is not None
    with suppress(BrokenPipeError):  # its missing answer tells of its end
        send(process.stdin, block)
    return block


def _answer(process: Worker) -> list[Row]:
    assert process.stdout is not None
    try:
        answer = receive(process.stdout)
    except EOFError as error:  # none, or a part of one
        raise StudyFailed(
            f"a worker ended with status {process.wait()}, perhaps for lack of memory; the same command continues"
        ) from error
    if "failed" in answer:
        raise StudyFailed(answer["failed"])
    rows: list[Row] = answer["rows"]
    return rows


@contextmanager
def _started_workers(plan: StudyPlan, count: int) -> Iterator[list[Worker]]:
    """Workers that end with this process, whatever ends it."""
    command = [*started.PYTHON, "-m", started.__name__, _WORKER]
    processes: list[Worker] = []
    try:
        for _ in range(count):
            process = Popen(command, stdin=PIPE, stdout=PIPE, env={**os.environ, **started.environment()})
            processes.append(process)
            assert process.stdin is not None
            with suppress(BrokenPipeError):  # its missing answer tells of its end
                send(process.stdin, plan.to_wire())
        yield processes
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with suppress(BrokenPipeError):
                        pipe.close()
