"""The silence watch reports a silence and its end once each."""

from __future__ import annotations

from apad_bridge.vehicle.telemetry import Silence, SilenceWatch


def test_silence_and_its_end_are_told_once_each() -> None:
    watch = SilenceWatch()
    assert watch.look(1_000, 5_900) is None and watch.look(1_000, 6_000) == Silence(True, 1_000)
    assert watch.look(1_000, 9_000) is None
    assert watch.look(9_500, 10_000) == Silence(False, 1_000)
    assert watch.look(10_500, 11_000) is None
