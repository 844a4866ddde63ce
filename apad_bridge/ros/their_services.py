"""Classes of services whose server speaks another definition than ours: from the text in the user's workspace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import genmsg
import genpy.dynamic
from genmsg.gentools import compute_full_text, compute_md5
from genmsg.msg_loader import load_depends, load_srv_from_file

from apad_bridge.ros.user_texts import text_folders


def service_by_text(kind: str, md5: str) -> Any | None:
    """A service class of `kind` (as misc_msgs/GetDockingInfo) with this md5, if a text on ROS_PACKAGE_PATH has it."""
    package, name = kind.split("/")
    messages = text_folders("msg")
    for folder in text_folders("srv").get(package, []):
        text = Path(folder) / f"{name}.srv"
        if not text.is_file():
            continue
        try:
            made = _service(kind, text, messages)
        except (genmsg.MsgNotFound, genmsg.InvalidMsgSpec, genmsg.MsgGenerationException, OSError):
            continue  # it cannot be the one that is spoken
        if made._md5sum == md5:
            return made
    return None


def _service(kind: str, text: Path, messages: dict[str, list[str]]) -> Any:
    context = genmsg.MsgContext.create_default()
    specification = load_srv_from_file(context, str(text), kind)
    load_depends(context, specification, messages)
    classes = [
        genpy.dynamic.generate_dynamic(part.full_name, compute_full_text(context, part))[part.full_name]
        for part in (specification.request, specification.response)
    ]
    name = kind.split("/")[1]
    members = {
        "_type": kind,
        "_md5sum": compute_md5(context, specification),
        "_request_class": classes[0],
        "_response_class": classes[1],
    }
    return type(name, (), members)
