"""The places of a program in C where one change makes a mutant, in the order of a hash.

The `first` route changes an operator or a constant, or deletes a statement. The `held out` route makes mistakes of other
kinds, each kind in its turn: a negated condition, a bound off by one, a missing `else`, arguments the wrong way round, a
wrong unit or width, a name for another of its kind, and two statements in the wrong order. The `fresh` route takes all
these kinds in another order. Lines that only say something to people are left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from itertools import chain, pairwise, zip_longest
from pathlib import Path

_FOR_PEOPLE = re.compile(
    r"STATES\[\]|TRIGGERS\[\]|_NAMES|[a-z]+_refuse|mu_state|hal_fault|hal_tell_state|snprintf|return \d|, -1}|mu_open"
)
_FIRST = (
    (r"==", "!="),
    (r"!=", "=="),
    (r"&&", "||"),
    (r"\|\|", "&&"),
    (r" < ", " >= "),
    (r"\+=", "-="),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r"\b(?:IN|S|R)\(\w+\) \| ", ""),
    (r"(?<![\w.\"])(\d+)(?=[u ;,)\]}])", None),
    (r"^    .*;$", ""),
)
"""Patterns in a line, and what replaces them; None adds 1 to a number."""
_TERM = r"[^(),;]+(?:\([^()]*\))?"
_NAME = r"\b\w+(?:(?:\.|->)\w+)*"
_HELD_OUT = {
    "negated": ((r"\bif \((.+)\)(?= |$)", r"if (!(\1))"),),
    "bound": (
        (r" < ", " <= "),
        (r" <= ", " < "),
        (r" > ", " >= "),
        (r" >= ", " > "),
        (r" [+-] 1\b", ""),
    ),
    "else": ((r"\belse if\b", "if"), (r"^ +else$", ""), (r"\} else \{", "} {")),
    "swapped": (
        (rf"\(({_TERM}), ({_TERM})\)", r"(\2, \1)"),
        (r"\? ([^:?]+) : ([^;:?)]+)", r"? \2 : \1"),
        (rf"({_NAME}) - ({_NAME})", r"\2 - \1"),
    ),
    "unit": (
        (r"(?<![\w.\"])(\d{2,})(?=u?\b)", r"\g<1>0"),
        (r"\bmu_ticks\(((?:[^()]|\([^()]*\))*)\)", r"(\1)"),
        (r"\bMU_HZ\b", "1000"),
        (r"\bUINT16_MAX\b", "UINT8_MAX"),
        (r"\bINT32_MAX\b", "INT16_MAX"),
        (r"<< 8\b", "<< 4"),
        (r", 8\)", ", 4)"),
        (r", 4\)", ", 2)"),
        (r", 2\)", ", 1)"),
    ),
}
_ALIKE = (
    ("seen", "high", "settling"),
    ("flipped", "unsettled", "counted"),
    ("alarm_ms", "sample_ms", "frame_ms", "slot_ms", "guard_ms"),
    ("processing_ms", "listen_ms", "report_ms", "transmit_ms", "call_ms", "hover_ms"),
    ("boot_ms", "surfacing_timeout_ms", "float_timeout_ms", "release_wait_ms"),
    ("debounce_ms", "chatter_ms", "check_ms"),
    ("turnaround_ms", "answer_ms"),
    ("primary", "secondary"),
    ("primary_short", "secondary_short"),
    ("north_cm", "east_cm"),
    ("next", "acknowledged", "oldest", "torn"),
    ("first", "newest", "end", "known"),
    ("MU_MOTOR_UP", "MU_MOTOR_DOWN"),
    ("MU_CHARGER", "MU_SURFACE", "MU_BOTTOM"),
)
"""Names that can be taken for each other, besides the members of an enumeration."""
_ENUM = re.compile(r"^enum \w+ \{(.*?)\};", re.DOTALL | re.MULTILINE)
_STATEMENT = re.compile(
    r"( +)(?!return|break|case|default|static|const|enum|struct|bool|char|size_t|unsigned|u?int\d+_t)\w.*;"
)


@dataclass(frozen=True, slots=True)
class Change:
    """`count` lines from `line` (from 0) become `new`."""

    path: Path
    line: int
    count: int
    old: str
    new: str

    def __str__(self) -> str:
        """In one line, with lines counted from 1."""
        old, new = (" ".join(it.split()) for it in (self.old, self.new))
        return f"{self.path.name}:{self.line + 1}: {old}  ->  {new or 'nothing'}"

    @property
    def key(self) -> tuple[str, str]:
        """The change without its place, each text in one line."""
        return " ".join(self.old.split()), " ".join(self.new.split())

    def applied(self) -> str:
        """The whole file with this change."""
        lines = self.path.read_text().splitlines()
        return "\n".join([*lines[: self.line], self.new, *lines[self.line + self.count :], ""])


def first_changes(files: Sequence[Path]) -> Iterator[Change]:
    yield from _hashed(_replaced(files, _FIRST), "")


def held_out_changes(files: Sequence[Path], headers: Sequence[Path]) -> Iterator[Change]:
    """One of each kind after the other. `headers` have enumerations whose members the files use, besides their own."""
    first = set(_replaced(files, _FIRST))
    kinds = _held_out_kinds(files, headers)
    yield from _in_turn([(it for it in kind if it not in first) for kind in kinds], "held out")


def fresh_changes(files: Sequence[Path], headers: Sequence[Path]) -> Iterator[Change]:
    """One of each kind of both other routes after the other."""
    yield from dict.fromkeys(_in_turn([*_held_out_kinds(files, headers), _replaced(files, _FIRST)], "fresh"))


def _held_out_kinds(files: Sequence[Path], headers: Sequence[Path]) -> list[Iterator[Change]]:
    kinds = [_replaced(files, patterns) for patterns in _HELD_OUT.values()]
    return [*kinds, _names(files, headers), _orders(files)]


def _in_turn(kinds: Sequence[Iterator[Change]], salt: str) -> Iterator[Change]:
    in_turn = zip_longest(*(_hashed(kind, salt) for kind in kinds))
    yield from (it for it in chain.from_iterable(in_turn) if it is not None)


def _hashed(changes: Iterator[Change], salt: str) -> list[Change]:
    def digest(it: Change) -> bytes:
        text = salt + repr((it.path.name, it.line, it.old, it.new))
        return blake2b(text.encode(), digest_size=8).digest()

    return sorted(changes, key=digest)


def _code(files: Sequence[Path]) -> Iterator[tuple[Path, int, str, str]]:
    """Every (file, line, text, text without a comment) that does something."""
    for path in files:
        for line, text in enumerate(path.read_text().splitlines()):
            code = text.partition("/*")[0].rstrip()
            if code and not text.lstrip().startswith(("*", "#include")) and not _FOR_PEOPLE.search(text):
                yield path, line, text, code


def _replaced(files: Sequence[Path], patterns: Sequence[tuple[str, str | None]]) -> Iterator[Change]:
    for path, line, text, code in _code(files):
        for pattern, new in patterns:
            for found in re.finditer(pattern, code):
                replaced = str(int(found[1]) + 1) if new is None else found.expand(new)
                yield Change(path, line, 1, text, text[: found.start()] + replaced + text[found.end() :])


def _names(files: Sequence[Path], headers: Sequence[Path]) -> Iterator[Change]:
    """Each name becomes the next one of its kind."""
    kinds = list(_ALIKE)
    inside = set()
    for path in (*files, *headers):
        text = path.read_text()
        for found in _ENUM.finditer(text):
            members = re.sub(r"/\*.*?\*/|=[^,]*", "", found[1]).replace(",", " ").split()
            kinds.append(tuple(it for it in members if it not in ("STATES", "TRIGGERS", "TASKS")))
            lines = range(text.count("\n", 0, found.start()), text.count("\n", 0, found.end()) + 1)
            inside |= {(path, line) for line in lines}
    following = {name: kind[(n + 1) % len(kind)] for kind in kinds for n, name in enumerate(kind)}
    for path, line, text, code in _code(files):
        for found in () if (path, line) in inside else re.finditer(r"(?<!\")\b[A-Za-z]\w*\b", code):
            if (new := following.get(found[0])) is not None:
                yield Change(path, line, 1, text, text[: found.start()] + new + text[found.end() :])


def _orders(files: Sequence[Path]) -> Iterator[Change]:
    """Two statements of one block, one after the other, change places."""
    code = list(_code(files))
    for (path, line, text, first), (other, below, under, second) in pairwise(code):
        begun, ended = (_STATEMENT.fullmatch(it) for it in (first, second))
        if path == other and below == line + 1 and begun and ended and begun[1] == ended[1]:
            yield Change(path, line, 2, f"{text}\n{under}", f"{under}\n{text}")
