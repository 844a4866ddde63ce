"""Rows of benchmarks, printed as they come: a benchmark of hours shows each result when it has it."""

from __future__ import annotations

import json
import sys
from typing import Any, TypeVar

Row = TypeVar("Row", bound=dict[str, Any])


def told(row: Row) -> Row:
    """Prints a row as a line of JSON on standard error, and returns it."""
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row
