"""A link between two network namespaces that loses and delays packets: two TUN devices, with this process between them.

    python lossy_link.py PEER_PID LOSS DELAY_S SEED     (in a namespace of its own, as its root)

The namespace of the process PEER_PID is the far end. Each packet, either way, is lost with probability LOSS, and arrives
DELAY_S later otherwise. It prints `ready`. A line of standard input is LOSS and DELAY_S from then on: a LOSS of 1 cuts the
link, with what is under way in it. It ends with its starter, at the end of its standard input. Kernels without netem have
no such link by themselves.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import sys
import time

NEAR, FAR = "10.99.0.1", "10.99.0.2"
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_LONGEST = 65_536
_RESTS_S = 5.0


def opened(name: str) -> int:
    """A new TUN device's descriptor: what is read from it was sent into the device, and the other way round."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH", name.encode(), _IFF_TUN | _IFF_NO_PI))
    return device


def ip(*words: str, inside: int | None = None) -> None:
    enter = [] if inside is None else ["nsenter", "-t", str(inside), "-n"]
    subprocess.run([*enter, "ip", *words], check=True)


def relay(near: int, far: int, loss: float, delay_s: float, chance: random.Random) -> None:
    """Carries packets until standard input ends."""
    other = {near: far, far: near}
    under_way: list[tuple[float, int, int, bytes]] = []
    number = 0
    while True:
        wait_s = max(0.0, under_way[0][0] - time.monotonic()) if under_way else _RESTS_S
        ready, _, _ = select.select([near, far, sys.stdin], [], [], wait_s)
        if sys.stdin in ready:
            lines = os.read(sys.stdin.fileno(), _LONGEST).splitlines()
            if not lines:
                return
            loss, delay_s = map(float, lines[-1].split())
            if loss == 1:
                under_way.clear()
        now_s = time.monotonic()
        for device in other.keys() & ready:
            packet = os.read(device, _LONGEST)
            if chance.random() >= loss:
                number += 1
                heapq.heappush(under_way, (now_s + delay_s, number, other[device], packet))
        while under_way and under_way[0][0] <= now_s:
            _, _, device, packet = heapq.heappop(under_way)
            os.write(device, packet)


def main() -> None:
    peer, loss, delay_s, seed = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
    near, far = opened("near"), opened("far")
    ip("link", "set", "far", "netns", str(peer))
    for device, address, inside in (("near", NEAR, None), ("far", FAR, peer)):
        ip("addr", "add", f"{address}/24", "dev", device, inside=inside)
        ip("link", "set", device, "up", inside=inside)
        ip("link", "set", "lo", "up", inside=inside)
    print("ready", flush=True)
    relay(near, far, loss, delay_s, random.Random(seed))


if __name__ == "__main__":
    main()
