"""Definitions of others, in a workspace or sent by a publisher: they are read without an import."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
import rospy

from apad_bridge.ros.types.any_message import AnyMessages, UnknownType, class_of
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros.types.workspace_services import service_by_text, service_to_offer, text_folders
from apad_bridge.world.generation_b.simulated_messages import docking, go_to

use_generated_messages()

from misc_msgs.srv import DockingPrimitiveService, Go2pointPrimitiveService  # noqa: E402

XML = "<package><name>{}</name><version>1.0.0</version></package>"
WIDER = """\
bool fully_actuated_enable
geometry_msgs/Point point
float32 speed
float32 victory_radius
bool north_enable
bool east_enable
float32 acceleration
---
bool status
"""


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    package = tmp_path / "misc_msgs"
    (package / "srv").mkdir(parents=True)
    (package / "msg").mkdir()
    (package / "package.xml").write_text(XML.format("misc_msgs"))
    (package / "srv" / "Go2pointPrimitiveService.srv").write_text(WIDER)
    (package / "msg" / "Pair.msg").write_text("# a pair\nfloat64 left\ngeometry_msgs/Point right\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    return tmp_path


def test_the_users_text_of_a_service_is_found_by_the_md5_that_its_server_speaks(workspace: Path) -> None:
    # The md5 as rossrv prints it: of the texts of request and response without comments, with the Point's own md5.
    import hashlib

    point_md5 = "4a842b65f413084dc2b10fb484ea7f17"
    request, response = WIDER.split("---\n")
    text = request.replace("geometry_msgs/Point", point_md5).strip() + response.strip()
    md5 = hashlib.md5(text.encode()).hexdigest()
    theirs = service_by_text("misc_msgs/Go2pointPrimitiveService", md5)
    assert theirs is not None and theirs._md5sum == md5 != Go2pointPrimitiveService._md5sum
    request_class = theirs._request_class()
    request_class.point.x, request_class.acceleration = 3.0, 0.5
    buffer = io.BytesIO()
    request_class.serialize(buffer)
    assert theirs._request_class().deserialize(buffer.getvalue()).point.x == 3.0


@pytest.mark.parametrize(
    ("path", "md5", "found"),
    [
        (None, "0" * 32, None),  # a md5 that no text has is not made up
        ("/nowhere", Go2pointPrimitiveService._md5sum, Go2pointPrimitiveService._md5sum),  # ours
    ],
)
def test_a_service_is_found_by_its_md5_or_not_at_all(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, path: str | None, md5: str, found: str | None
) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", path or str(workspace))
    assert getattr(service_by_text(Go2pointPrimitiveService._type, md5), "_md5sum", None) == found


def test_a_service_is_offered_by_the_users_text_where_that_has_what_is_read(workspace: Path) -> None:
    offered = service_to_offer(Go2pointPrimitiveService, go_to)
    assert hasattr(offered._request_class(), "acceleration") and offered._response_class(status=True).status
    narrower = WIDER.replace("float32 victory_radius\n", "")
    (workspace / "misc_msgs" / "srv" / "Go2pointPrimitiveService.srv").write_text(narrower)
    assert service_to_offer(Go2pointPrimitiveService, go_to) is Go2pointPrimitiveService
    assert service_to_offer(DockingPrimitiveService, docking) is DockingPrimitiveService


def test_a_type_to_tell_is_made_from_the_users_text(workspace: Path) -> None:
    pair = class_of("misc_msgs/Pair", text_folders())()
    pair.right.z = 2.0
    assert (pair.left, pair.right.z) == (0.0, 2.0)
    with pytest.raises(UnknownType, match="misc_msgs/Nothing is neither installed nor"):
        class_of("misc_msgs/Nothing", text_folders())


def test_a_message_is_read_by_the_text_that_comes_with_it(workspace: Path) -> None:
    pair = class_of("misc_msgs/Pair", text_folders())
    buffer = io.BytesIO()
    pair(left=4.0).serialize(buffer)
    header = {"type": "misc_msgs/Pair", "md5sum": pair._md5sum, "message_definition": pair._full_text}
    raw = rospy.AnyMsg()
    raw._connection_header, raw._buff = header, buffer.getvalue()
    assert AnyMessages().decode(raw).left == 4.0
    for spoilt, md5, why in (
        (raw._buff[:5], pair._md5sum, "misc_msgs/Pair"),
        (raw._buff, "0" * 32, "sends md5 0000"),
    ):
        raw._buff, header["md5sum"] = spoilt, md5
        with pytest.raises(ValueError, match=why):
            AnyMessages().decode(raw)
