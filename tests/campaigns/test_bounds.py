"""The search for missions that beat a printed bound."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from bounds import campaign as bounds


def test_a_search_for_missions_that_beat_a_bound_goes_on_where_it_was_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its first two flights are short, with a refused try between them.
    monkeypatch.setattr(bounds, "SEED", 38)
    whole = bounds.measure(tries=2)
    bounds.measure(tries=1, resume=tmp_path)
    assert bounds.measure(tries=2, resume=tmp_path) == whole
    flown = [it for it in (tmp_path / "tries.jsonl").read_text().splitlines() if json.loads(it)["held"]]
    assert len(flown) == whole["tries"] == 2
