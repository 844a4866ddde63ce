"""The silence watch reports a silence and its end once each."""

from __future__ import annotations

from apad_bridge.vehicle.telemetry import SilenceWatch


def test_silence_and_its_end_are_told_once_each() -> None:
    watch = SilenceWatch()
    assert not watch.look(1_000, 5_900) and watch.look(1_000, 6_000)
    assert (watch.is_silent, watch.since_ms) == (True, 1_000)
    assert not watch.look(1_000, 9_000)
    assert watch.look(9_500, 10_000)
    assert (watch.is_silent, watch.since_ms) == (False, 1_000)
    assert not watch.look(10_500, 11_000)
