"""The names under which a console answers."""

from __future__ import annotations

import pytest

from apad_bridge.console.server import is_own_host, names_of_this_machine

OWN = ["127.0.0.1:8080", "10.0.200.7", "[::1]:80", "LOCALHOST:9000", "boat", "boat.local:1"]
OTHERS = ["evil.org", "127.0.0.1.evil.org:8080", "localhost.evil.org", "boat@evil.org", "[::1", "", "x:y"]


@pytest.mark.parametrize("host", [*OWN, *OTHERS])
def test_an_address_and_a_name_of_this_machine_are_its_own(
    host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "Boat")
    assert is_own_host(host, names_of_this_machine()) is (host in OWN)
    assert is_own_host("evil.org:443", {*names_of_this_machine(), "evil.org"})
