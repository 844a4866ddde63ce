"""CITATION.cff against the keys that the Citation File Format 1.2.0 requires, and against the package."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import yaml

CITATION = yaml.safe_load((Path(__file__).parents[1] / "CITATION.cff").read_text())
PAPER = "Vehicle-in-the-loop framework for testing long-term autonomy in a heterogeneous marine robot swarm"


def test_it_names_this_version_and_the_paper() -> None:
    assert {"cff-version", "message", "title", "authors"} <= CITATION.keys()
    assert CITATION["cff-version"] == "1.2.0" and str(CITATION["version"]) == version("musselbed")
    (paper,) = CITATION["references"]
    assert {"authors", "title", "type"} <= paper.keys() and paper["title"] == PAPER
    for author in (*CITATION["authors"], *paper["authors"]):
        assert author.keys() <= {"name"}  # an entity has a name; a person would have given-names
