"""One board on the bench, and what is written of it."""

from firmware_model.bench.bench import Bench

__all__ = ["Bench"]
