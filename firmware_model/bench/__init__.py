"""One board on the bench, with its trace, its diagrams and its runs of Table I."""

from firmware_model.bench.bench import Bench

__all__ = ["Bench"]
