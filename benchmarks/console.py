"""The live console: how late a flight's ticks are without a browser, and with 100 that follow it.

One flight of 24 aMussels at real time and theta 30, beside the simulated aPad's node, with a console. The browsers come and
go in pairs of spans, none and all, in turning order; so another load of the machine meets both alike. A tick's lateness is
the time at which a rospy node receives its beliefs, against a grid of seconds through the earliest of them. The first
seconds of a span, in which browsers come or go, do not count. The browsers are connections that read the console's stream.
The interval of the difference holds 95 % of those that the pairs give, drawn anew with replacement.
"""

from __future__ import annotations

import json
import random
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import yaml
from rich.console import Console

from apad_bridge.supervisor.control_protocol import listens
from benchmarks.gateway import NODES, TIMEOUT_S, Node, apad_node, flown, on_master
from benchmarks.rows import told

AGENTS = 24
BROWSERS = (0, 100)
MINUTES, SHORT_MINUTES = 15.0, 0.5
SPAN_S = 11.0
SETTLING_S = 2.0
STARTS_S = 4
DRAWN = 2000
WANTED_MS = 5.0
MUSSELBED = ("-m", "apad_bridge.commands.main")


@dataclass(frozen=True, slots=True)
class Span:
    """A span of the flight, in seconds of the monotonic clock, with so many browsers."""

    pair: int
    browsers: int
    from_s: float
    until_s: float


def measure(minutes: float = MINUTES, short: bool = False) -> dict[str, Any]:
    """The 95th part of a hundred of one-second ticks is rare: few minutes cannot tell 5 ms from chance."""
    pairs = max(1, int(60 * (SHORT_MINUTES if short else minutes) / (2 * SPAN_S)))
    heard, spans, messages = flight(pairs)
    offsets_s = [at_s - mission_s for mission_s, at_s in heard]
    earliest_s = min(offsets_s)
    late_ms: dict[tuple[int, int], list[float]] = {(it.pair, it.browsers): [] for it in spans}
    for (_, at_s), offset_s in zip(heard, offsets_s, strict=True):
        for span in spans:
            if span.from_s <= at_s < span.until_s:
                late_ms[span.pair, span.browsers].append(1000 * (offset_s - earliest_s))
    rng = random.Random(1)
    drawn = sorted(_difference_ms(late_ms, rng.choices(range(pairs), k=pairs)) for _ in range(DRAWN))
    result: dict[str, Any] = {
        "agents": AGENTS,
        "flown_s": _flown_s(pairs),
        "pairs": pairs,
        "messages": messages,
    }
    for browsers in BROWSERS:
        found = _pooled(late_ms, browsers, range(pairs))
        result |= {
            f"ticks_{browsers}": len(found),
            f"lateness_p50_ms_{browsers}": _quantile(found, 0.5),
            f"lateness_p95_ms_{browsers}": _quantile(found, 0.95),
        }
    return {
        **result,
        "difference_ms": _difference_ms(late_ms, range(pairs)),
        "difference_interval_ms": [_quantile(drawn, 0.025), _quantile(drawn, 0.975)],
    }


def show(result: dict[str, Any], console: Console) -> None:
    for browsers in BROWSERS:
        console.print(
            f"{browsers} browsers: ticks {result[f'lateness_p95_ms_{browsers}']:.1f} ms late (p95), "
            f"{result[f'lateness_p50_ms_{browsers}']:.1f} ms (p50), of {result[f'ticks_{browsers}']}"
        )
    low, high = result["difference_interval_ms"]
    console.print(
        f"difference {result['difference_ms']:+.1f} ms ({low:+.1f} to {high:+.1f}, of {result['pairs']} pairs); "
        f"at most {WANTED_MS:g} ms are wanted; {result['messages']} messages to browsers"
    )


def _pooled(
    late_ms: Mapping[tuple[int, int], list[float]], browsers: int, pairs: Iterable[int]
) -> list[float]:
    return sorted(it for pair in pairs for it in late_ms[pair, browsers])


def _quantile(rising: Sequence[float], share: float) -> float:
    return rising[int(share * len(rising))]


def _difference_ms(late_ms: Mapping[tuple[int, int], list[float]], pairs: Sequence[int]) -> float:
    """By how much more the ticks are late with browsers, p95, in these pairs."""
    without, beside = (_quantile(_pooled(late_ms, it, pairs), 0.95) for it in BROWSERS)
    return beside - without


def flight(pairs: int) -> tuple[list[tuple[float, float]], list[Span], int]:
    """The ticks as (mission second, monotonic second), the spans, and the number of messages to browsers."""
    with ExitStack() as stack:
        flight = Flight(stack, _flown_s(pairs))
        spans, messages = [], 0
        for pair in range(pairs):
            for browsers in BROWSERS if pair % 2 == 0 else BROWSERS[::-1]:
                clients = Clients(flight.url, browsers)
                try:
                    begun_s = time.monotonic()
                    with suppress(subprocess.TimeoutExpired):
                        flight.command.wait(SPAN_S)
                    spans.append(Span(pair, browsers, begun_s + SETTLING_S, time.monotonic()))
                finally:
                    clients.close()
                messages += clients.messages
                told({"pair": pair, "browsers": browsers, "messages": clients.messages})
                if bool(clients.messages) is not bool(browsers):
                    raise RuntimeError(f"{browsers} browsers got {clients.messages} messages")
        return flight.ticks(), spans, messages


def _flown_s(pairs: int) -> int:
    return int(2 * pairs * SPAN_S) + STARTS_S


class Flight:
    """A mission at real time and theta 30, beside the simulated aPad's node, a console and a rospy node."""

    def __init__(self, stack: ExitStack, duration_s: int, agents: int = AGENTS) -> None:
        home, environment = on_master(stack)
        scenario, self.run = home / "flown.yaml", home / "run"
        scenario.write_text(yaml.safe_dump(flown(duration_s, agents)))
        self._duration_s, self._stack, self._environment = duration_s, stack, environment
        self.apad = apad_node(stack, environment, scenario)
        self.reader = Node(stack, environment, str(NODES / "tick_reader.py"))
        assert self.reader.line() == "reading"
        self.command = self._begun("run", scenario, "--apad", "ros", "--time", "wall", "--out", self.run)
        self.console = Node(stack, environment, *MUSSELBED, "console", str(self.run), "--json")
        self.url = json.loads(self.console.line())["url"]

    def resume(self) -> None:
        """Continues a flight that was killed; a simulated aPad needs a person's word, too, as it has a node of its own."""
        self.command = self._begun("resume", "--confirm-motion", self.run)

    def _begun(self, *words: str | Path) -> subprocess.Popen[bytes]:
        command = subprocess.Popen(
            [sys.executable, *MUSSELBED, *words, "--json"], env=self._environment, stdout=subprocess.DEVNULL
        )
        self._stack.callback(end_program, command)
        while not (self.run.is_dir() and listens(self.run)):
            if command.poll() is not None:
                raise RuntimeError("the flight did not begin")
            select.select([], [], [], 0.1)
        return command

    def ticks(self) -> list[tuple[float, float]]:
        """Waits for the flight's end; returns each tick as (mission second, monotonic second of its beliefs)."""
        self.command.wait(self._duration_s + TIMEOUT_S)
        return [(mission_s, at_s) for mission_s, at_s in json.loads(self.reader.end())]


def end_program(flying: subprocess.Popen[bytes]) -> None:
    """Ends a flight that still flies, with its aMussels; a kill would leave them to a resume."""
    flying.terminate()
    flying.wait(TIMEOUT_S)


class Clients:
    """Connections that read the stream of a console, as browsers do that are left open."""

    def __init__(self, url: str, count: int) -> None:
        address = urlsplit(url)
        assert address.hostname is not None and address.port is not None
        token = parse_qs(address.query)["token"][0]
        request = (
            f"GET /live?token={token}&counts=0,0,0,0,0 HTTP/1.1\r\nHost: {address.netloc}\r\n\r\n"
        ).encode()
        self.messages = 0
        self._links = [socket.create_connection((address.hostname, address.port)) for _ in range(count)]
        for link in self._links:
            link.sendall(request)
        self._ended, self._end = socket.socketpair()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def close(self) -> None:
        self._end.close()
        self._thread.join()
        for link in (*self._links, self._ended):
            link.close()

    def _read(self) -> None:
        left = {self._ended, *self._links}
        while True:
            for link in select.select(list(left), [], [])[0]:
                if link is self._ended:
                    return
                data = link.recv(1 << 20)
                self.messages += data.count(b"data: ")
                if not data:
                    left.discard(link)
