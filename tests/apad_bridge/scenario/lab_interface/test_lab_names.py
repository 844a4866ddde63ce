"""A laboratory's names: read as a whole, refused with every mistake, and applied to messages of any type."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from apad_bridge.scenario.lab_interface.fields import read, write
from apad_bridge.scenario.lab_interface.lab_messages import MessageKind
from apad_bridge.scenario.lab_interface.lab_names import DEFAULT, load_names

ROOT = Path(__file__).parents[4]
SHIPPED, DOCS = ROOT / "launch_scripts" / "interfaces", ROOT / "docs" / "apads.md"


@pytest.mark.parametrize(
    ("path", "heard", "told"),
    [
        (DEFAULT, "docked released permission clear", "docked released"),
        (SHIPPED / "modem.yaml", "packet docked released", "packet"),
        (SHIPPED / "strings.yaml", "docked released permission clear", "permission clear wifi docked"),
    ],
    ids=["default", "modem", "strings"],
)
def test_shipped_names_can_be_read(path: Path, heard: str, told: str) -> None:
    names = load_names(path)
    assert [it.what for it in names.hear] == heard.split()
    assert [it.what for it in names.tell] == told.split()


def test_names_in_the_docs_can_be_read(tmp_path: Path) -> None:
    blocks = re.findall(r"^```yaml\n(hear:.*?)^```", DOCS.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        (tmp_path / "names.yaml").write_text(block)
        names = load_names(tmp_path / "names.yaml")
        assert names.hear and names.tell
        if names.hear[0].topic == "/wifi":
            assert names.hear[0].id_of(SimpleNamespace(data="release 12")) == 12


def test_ids_and_slots_come_out_of_texts_and_numbers() -> None:
    docked = next(ear for ear in load_names(SHIPPED / "strings.yaml").hear if ear.what is MessageKind.DOCKED)
    for text, numbers in (("amussel17 closed, dock 3", (17, 2)), ("hello", (None, None))):
        message = SimpleNamespace(data=text)
        assert (docked.id_of(message), docked.dock_index_of(message)) == numbers


def test_a_broadcast_is_for_everyone() -> None:
    (tap,) = [ear for ear in load_names(SHIPPED / "modem.yaml").hear if ear.what is MessageKind.PACKET]
    assert [tap.everyone.is_met(SimpleNamespace(req_type=it)) for it in (1, 2)] == [True, False]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hear: [{what: docked, topic: 1base}]", r"hear\[0\]\.topic: must match"),
        ("hear: [{what: dokced, topic: /base}]", r"hear\[0\]\.what: must be 'docked'"),
        (
            "hear: [{what: docked, topic: /base, idd: data}]",
            r"hear\[0\]\.idd: unknown key: did you mean id\?",
        ),
        ("hear: [{what: permission, topic: /base}]", "needs an addressee"),
        ("hear: [{what: wifi, topic: /base, id: data}]", "sends wifi and does not receive it"),
        ("hear: [{what: packet, topic: /base, id: data}]", "a packet needs bytes"),
        ("hear: [{what: docked, topic: /base, id: 'a b'}]", "is no path to a field"),
        ("hear: [{what: docked, topic: /base, id: {field: data, pattern: 'x'}}]", "must have one group"),
        ("hear: [{what: docked, topic: /base, id: {field: data, pattern: '('}}]", "unterminated"),
        ("tell: [{what: docked, topic: /base, type: Bool}]", r"tell\[0\]\.type: must match"),
        ("hear: {", "expected"),
    ],
)
def test_a_mistake_is_named(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "lab.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint):
        load_names(path)


def test_fields_are_reached_by_their_paths_and_keep_their_kinds() -> None:
    message = SimpleNamespace(
        header=SimpleNamespace(frame_id="x"), msg=[4, 5], flag=False, number=0.0, bytes=b""
    )
    assert read(message, "msg[1]") == 5
    for path, value in (("header.frame_id", 7), ("flag", 1), ("number", 3), ("bytes", b"ab")):
        write(message, path, value)
    assert (message.header.frame_id, message.flag, message.number, message.bytes) == ("7", True, 3.0, b"ab")
    with pytest.raises(AttributeError):
        read(message, "nothing")
    with pytest.raises(TypeError):
        write(message, "msg[0]", 1)
