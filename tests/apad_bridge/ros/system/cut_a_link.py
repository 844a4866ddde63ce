"""Two machines with a cable that is cut and mended, in network namespaces; to be run by `unshare -rn`. Prints JSON.

The far machine drops its address and takes it again: packets then arrive, and nobody acknowledges them. The near machine
sends on two connections that the far one had opened, as a subscriber does: one is bounded, one is as TCP has it.
"""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
import time
from typing import Any

from apad_bridge.ros.system.lost_links import end_when_unacknowledged

NEAR, FAR, PORT = "10.99.0.1", "10.99.0.2", 47_111
PATIENCE_S = 60.0
FAR_PROGRAM = f"""
import select, socket, sys
socks = {{}}
for name in ("bounded", "plain"):
    socks[name] = socket.create_connection(("{NEAR}", {PORT}), {PATIENCE_S})
    socks[name].sendall(name.ljust(7).encode())
for line in sys.stdin:
    name, wait_s = line.split()
    ready, _, _ = select.select([socks[name]], [], [], float(wait_s))
    try:
        print(socks[name].recv(64).decode() if ready else "", flush=True)
    except OSError:
        print("", flush=True)
"""


def ip(*words: str, inside: int | None = None) -> None:
    enter = [] if inside is None else ["nsenter", "-t", str(inside), "-n"]
    subprocess.run([*enter, "ip", *words], check=True)


def mac(name: str, inside: int | None = None) -> str:
    enter = [] if inside is None else ["nsenter", "-t", str(inside), "-n"]
    told = subprocess.run([*enter, "ip", "-j", "link", "show", name], check=True, capture_output=True)
    return str(json.loads(told.stdout)[0]["address"])


def main() -> None:
    keeper = subprocess.Popen(["unshare", "-n", "sh", "-c", "echo; exec sleep 300"], stdout=subprocess.PIPE)
    try:
        assert keeper.stdout is not None and keeper.stdout.readline()
        far = keeper.pid
        ip("link", "add", "va", "type", "veth", "peer", "name", "vb")
        ip("link", "set", "vb", "netns", str(far))
        ip("addr", "add", f"{NEAR}/24", "dev", "va")
        ip("link", "set", "va", "up")
        ip("addr", "add", f"{FAR}/24", "dev", "vb", inside=far)
        ip("link", "set", "vb", "up", inside=far)
        # Known for good: a cut is then seen by no neighbour that does not answer.
        ip("neigh", "replace", FAR, "lladdr", mac("vb", far), "nud", "permanent", "dev", "va")
        print(json.dumps(trial(far)))
    finally:
        keeper.terminate()
        keeper.wait()


def trial(far: int) -> dict[str, Any]:
    with socket.create_server((NEAR, PORT)) as server:
        command = ["nsenter", "-t", str(far), "-n", sys.executable, "-c", FAR_PROGRAM]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as program:
            socks: dict[str, socket.socket] = {}
            for _ in range(2):
                sock, _ = server.accept()
                socks[sock.recv(7, socket.MSG_WAITALL).decode().strip()] = sock
            end_when_unacknowledged(socks["bounded"])
            told: dict[str, Any] = {"before": {}, "after": {}}
            for name, sock in socks.items():
                sock.sendall(b"before")
                told["before"][name] = heard(program, name, PATIENCE_S)
            ip("addr", "flush", "dev", "vb", inside=far)
            begun_s = time.monotonic()
            for sock in socks.values():
                sock.sendall(b"late")
            ready, _, _ = select.select([socks["bounded"]], [], [], PATIENCE_S)
            told["ended_after_s"] = time.monotonic() - begun_s
            try:
                socks["bounded"].recv(1) if ready else None
            except OSError as error:
                told["ended_by"] = type(error).__name__
            socks["bounded"].close()
            ip("addr", "add", f"{FAR}/24", "dev", "vb", inside=far)
            told["after"]["plain"] = heard(program, "plain", PATIENCE_S)
            told["after"]["bounded"] = heard(program, "bounded", 1.0)
            program.stdin.close()
            for sock in socks.values():
                sock.close()
            return told


def heard(program: subprocess.Popen[str], name: str, wait_s: float) -> str:
    """What arrives at the far end of this connection; empty for nothing within `wait_s`."""
    assert program.stdin is not None and program.stdout is not None
    program.stdin.write(f"{name} {wait_s}\n")
    program.stdin.flush()
    return program.stdout.readline().strip()


if __name__ == "__main__":
    main()
