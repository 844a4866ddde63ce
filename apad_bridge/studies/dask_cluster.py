"""Flies a study's blocks on an existing Dask cluster. Its scheduler gives the blocks of a worker that is killed to others.

Only this module needs Dask, and imports it when a study asks for a cluster.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import version

from apad_bridge.studies.runner import Block, Row, StudyFailed, fly_block
from apad_bridge.studies.specification import StudyPlan
from firmware_model.entry_points import in_one_line

_CONNECT_S = 30
"""Wall seconds until a scheduler has to answer."""


def fly_on_dask(plan: StudyPlan, blocks: Sequence[Block], address: str) -> Iterator[tuple[Block, list[Row]]]:
    """Flies blocks on the cluster whose scheduler is at `address`, as tcp://host:8786; yields each when it is done.

    StudyFailed for a cluster that cannot be reached, that breaks down, or whose workers have another musselbed.
    """
    from distributed import Client, as_completed

    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise StudyFailed(f"--dask {address}: no scheduler answers there: {error}") from error
    with client:
        # Each task has the plan with it: a plan that is kept on the cluster would be lost with the worker that has it.
        tasks = [client.submit(fly_there, plan, plan.fingerprint, block, pure=False) for block in blocks]
        block_of = {task.key: block for task, block in zip(tasks, blocks, strict=True)}
        for task in as_completed(tasks):
            try:
                rows = task.result()
            except StudyFailed:
                raise
            except Exception as error:  # whatever a cluster or its workers raise
                raise StudyFailed(
                    f"--dask {address}: {in_one_line(error)}; the same command continues"
                ) from error
            yield block_of[task.key], rows


def fly_there(plan: StudyPlan, fingerprint: str, block: Block) -> list[Row]:
    """Flies a block in a worker of the cluster; StudyFailed when the worker's musselbed is another version."""
    if plan.fingerprint != fingerprint:
        raise StudyFailed(
            f"a worker of the cluster has musselbed {version('musselbed')}, another than here: install the same there"
        )
    return fly_block(plan, *block)
