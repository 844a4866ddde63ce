"""A node of our own: its board, its battery and its bytes (layout.txt). It talks by a nanomodem's line, by UDP, or both.

It knows nothing of musselbed. Lines on stdin act on it as people and chargers do: `dock`, `undock`, `place LAT LON`,
`quit`. Each packet, word and change is a JSON line on stdout, with the true charge.
"""

import argparse
import contextlib
import json
import select
import socket
import struct
import sys
import time

HEAD = struct.Struct(">BBHiiBI")
MAGIC = 0xA7
EMPTY_MV, FULL_MV = 3600, 4200
RISE_S = 10.0
SINK_S = 10.0


def fletcher16(data: bytes) -> int:
    low = high = 0
    for byte in data:
        low = (low + byte) % 255
        high = (high + low) % 255
    return high << 8 | low


class Board:
    """Time is the board's own, in seconds since it was switched on. Charge is the share of the battery that is left."""

    def __init__(
        self, number: int, charge: float, latitude: float, longitude: float, drain: float, load: float
    ) -> None:
        self.number, self.charge = number, charge
        self.latitude, self.longitude = latitude, longitude
        self.drain_per_s, self.load_per_s = drain, load
        self.letter, self.now_s = "B", 0.0
        self._docked = self._free = False
        self._moves_at: tuple[float, str] | None = None

    def advance(self, now_s: float) -> bool:
        """True if the letter has changed."""
        before = self.letter
        span = now_s - self.now_s
        self.now_s = now_s
        rate = self.load_per_s if self._docked else -self.drain_per_s
        self.charge = min(1.0, max(0.0, self.charge + rate * span))
        if self._moves_at is not None and now_s >= self._moves_at[0]:
            self.letter, self._moves_at = self._moves_at[1], None
        if self._docked:
            self.letter = "L"
        elif self.charge == 0.0:
            self.letter = "X"
        return self.letter != before

    def take(self, word: str) -> bool:
        """True if the word asks for a report."""
        match word:
            case "RISE" if self.letter == "B":
                self._moves_at = self.now_s + RISE_S, "T"
            case "FREE" if self._docked:
                self._free = True
            case "FREE" if self.letter == "T":
                self._moves_at = self.now_s + SINK_S, "B"
        return word == "TELL"

    def put_down(self, latitude: float, longitude: float) -> None:
        """People carry it to another place, on the bottom."""
        self.latitude, self.longitude = latitude, longitude
        if not self._docked:
            self.letter, self._moves_at = "B", None

    def dock(self) -> None:
        self._docked, self._free, self._moves_at = True, False, None

    def undock(self) -> None:
        """It floats when the dock opens, and sinks once it is free."""
        self._docked, self.letter = False, "T"
        self._moves_at = (self.now_s + SINK_S, "B") if self._free else None
        self._free = False

    def report(self) -> bytes:
        millivolts = round(EMPTY_MV + self.charge * (FULL_MV - EMPTY_MV))
        place = round(self.latitude * 1e7), round(self.longitude * 1e7)
        body = HEAD.pack(MAGIC, self.number, millivolts, *place, ord(self.letter), int(self.now_s * 10))
        return body + struct.pack(">H", fletcher16(body))


class Wifi:
    def __init__(self, address: str) -> None:
        host, port = address.rsplit(":", 1)
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.connect((host, int(port)))
        self._line.setblocking(False)

    def send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):  # where nobody listens at the moment
            self._line.send(data)

    def receive(self) -> list[bytes]:
        got = []
        while True:
            try:
                got.append(self._line.recv(2048))
            except OSError:
                return got


class Nanomodem:
    """$Bnn sends; #Baaannd... is received from address aaa."""

    def __init__(self, port: str) -> None:
        import serial

        self._line = serial.Serial(port, 9600, timeout=0)
        self._bytes = b""

    def send(self, data: bytes) -> None:
        self._line.write(b"$B%02d" % len(data) + data)

    def receive(self) -> list[bytes]:
        self._bytes += self._line.read(4096)
        got = []
        while (begin := self._bytes.find(b"#B")) >= 0:
            head = self._bytes[begin + 2 : begin + 7]
            if len(head) < 5:
                break
            if not head.isdigit():
                self._bytes = self._bytes[begin + 2 :]
                continue
            end = begin + 7 + int(head[3:])
            if len(self._bytes) < end:
                break
            got.append(self._bytes[begin + 7 : end])
            self._bytes = self._bytes[end:]
        return got


def say(**facts: object) -> None:
    print(json.dumps({"wall": round(time.time(), 3), **facts}), flush=True)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--serial", metavar="PORT", help="a nanomodem's; with --udp reports take turns")
    parser.add_argument("--udp", metavar="HOST:PORT")
    parser.add_argument("--number", type=int, default=207)
    parser.add_argument("--charge", type=float, default=0.5)
    parser.add_argument("--place", type=float, nargs=2, default=(43.9332, 15.4444), metavar=("LAT", "LON"))
    parser.add_argument("--every", type=float, default=10.0, help="own seconds between reports")
    parser.add_argument("--rate", type=float, default=1.0, help="own seconds in a second of the wall")
    parser.add_argument("--drain", type=float, default=1.74e-5, help="share of the battery in an own second")
    parser.add_argument("--load", type=float, default=1.0e-4)
    given = parser.parse_args()
    if not (given.serial or given.udp):
        parser.error("give --serial, --udp or both")
    return given


def main() -> None:
    given = arguments()
    board = Board(given.number, given.charge, given.place[0], given.place[1], given.drain, given.load)
    lines: list[Wifi | Nanomodem] = []
    if given.udp:
        lines.append(Wifi(given.udp))
    if given.serial:
        lines.append(Nanomodem(given.serial))
    begin, due_s, sent = time.monotonic(), 0.0, 0
    while True:
        changed = board.advance((time.monotonic() - begin) * given.rate)
        if changed:
            say(letter=board.letter, charge=board.charge)
        for data in [data for line in lines for data in line.receive()]:
            word, _, number = data.decode("ascii", "replace").strip().partition(" ")
            if number in ("0", str(board.number)):
                say(word=word)
                changed |= board.take(word)
        if changed or board.now_s >= due_s:
            lines[sent % len(lines)].send(board.report())
            sent += 1
            due_s = board.now_s + given.every
            say(sent=sent, charge=board.charge, letter=board.letter, own_s=round(board.now_s, 1))
        if select.select([sys.stdin], [], [], 0.02)[0]:
            match sys.stdin.readline().split():
                case ["dock"]:
                    board.dock()
                case ["undock"]:
                    board.undock()
                case ["place", latitude, longitude]:
                    board.put_down(float(latitude), float(longitude))
                case ["quit"]:
                    return
                case []:
                    time.sleep(0.02)  # stdin is closed, or an empty line


if __name__ == "__main__":
    main()
