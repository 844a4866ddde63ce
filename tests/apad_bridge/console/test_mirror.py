"""A run on another machine as a console sees it: whenever the link fails, the copy is a beginning of the run."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.console.mirror import Mirror
from apad_bridge.events.person_orders import Act
from apad_bridge.supervisor.control_protocol import Request, answer_of, listens

JOURNAL, SUMMARY = "journal.jsonl", "summary.json"


class Unheard(Exception):
    pass


class FarRun:
    """The run's files on the other machine, and a link that can fail."""

    def __init__(self) -> None:
        self.files = {"scenario.yaml": b"name: far", "run.json": b"{}"}
        self.fails = False
        self.requests: list[bytes] = []

    def read(self, file: str, offset: int) -> bytes | None:
        if self.fails:
            raise Unheard("no answer")
        return self.files[file][offset:] if file in self.files else None

    def order(self, request: bytes) -> bytes:
        if self.fails:
            raise Unheard("no answer")
        self.requests.append(request)
        return b'{"accepted": true, "message": "noted"}'


@given(st.lists(st.tuples(st.binary(max_size=40), st.booleans()), max_size=12))
def test_the_copy_is_always_a_beginning_of_the_journal_and_all_of_it_after_an_answer(
    written: list[tuple[bytes, bool]],
) -> None:
    far = FarRun()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        mirror = Mirror(far, folder, Unheard)
        mirror.begin()
        for data, far.fails in written:
            far.files[JOURNAL] = far.files.get(JOURNAL, b"") + data
            answered = mirror.update()
            copy = (folder / JOURNAL).read_bytes() if (folder / JOURNAL).exists() else b""
            assert answered is not far.fails
            assert far.files[JOURNAL].startswith(copy) and (far.fails or copy == far.files[JOURNAL])
            assert listens(folder) is answered
        mirror.close()


def test_an_order_goes_to_the_other_machine_and_is_refused_while_that_does_not_answer(tmp_path: Path) -> None:
    far = FarRun()
    mirror = Mirror(far, tmp_path, Unheard)
    mirror.begin()
    stop = Request(Act.STOP, by="Ana")
    assert not answer_of(tmp_path, stop).accepted, "nothing is known of the supervisor yet"
    mirror.update()
    answer = answer_of(tmp_path, stop)
    assert (answer.accepted, answer.message) == (True, "noted")
    assert [json.loads(it)["act"] for it in far.requests] == ["stop"]
    far.fails = True
    assert answer_of(tmp_path, stop).message == "no answer", "what became of the order is not known"
    mirror.update()
    assert "no supervisor takes orders" in answer_of(tmp_path, stop).message
    far.fails = False
    mirror.update()
    assert answer_of(tmp_path, stop).accepted
    mirror.close()


def test_whoever_sees_the_summary_has_the_whole_journal(tmp_path: Path) -> None:
    class Ending(FarRun):
        """A run that writes its last line and its summary just as its journal is read."""

        def read(self, file: str, offset: int) -> bytes | None:
            found = super().read(file, offset)
            if file == SUMMARY and found is None:
                self.files |= {JOURNAL: b"begin\nend\n", SUMMARY: b"{}"}
            return found

    far = Ending()
    far.files[JOURNAL] = b"begin\n"
    mirror = Mirror(far, tmp_path, Unheard)
    mirror.begin()
    mirror.update()
    assert not (tmp_path / SUMMARY).exists()
    mirror.update()
    assert (tmp_path / SUMMARY).exists() and (tmp_path / JOURNAL).read_bytes() == b"begin\nend\n"
    mirror.close()
