"""The message and service types that Debian lacks, made by genpy from ./definitions at each start.

Every type whose md5 the facts state is checked against it when the module is loaded: a vehicle that
speaks another definition than the facts' must not come up.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
from pathlib import Path

import genpy.generator
from genpy.generate_initpy import write_modules

HERE = Path(__file__).resolve().parent
DEFINITIONS = HERE / "definitions"
FACTS_MD5 = {  # facts, sections A and B
    "auv_msgs.msg.NED": "4a16ce817ea5a7912b32dfb04540797b",
    "auv_msgs.msg.NavSts": "d1c2e3fd518b63978e72fa7409f4ba71",
    "misc_msgs.srv.Go2pointPrimitiveService": "4a0312be411e8ffc59f768d30e967664",
    "misc_msgs.srv.DynamicPositioningPrimitiveService": "b012ae796923d5321c7c678ac0cc7797",
    "misc_msgs.srv.DockingPrimitiveService": "2f37c62380c61eaf8bf8692a9128c0fd",
    "navcon_msgs.msg.GoToPointGoal": "8156373f227e0e6c1ef30a6945ce353a",
    "navcon_msgs.msg.GoToPointResult": "d65ced8ada943f29d726e71ce5dd7e80",
    "navcon_msgs.msg.GoToPointFeedback": "a85492da5f0b70ed123ffefd6b539114",
}


def action_messages(name: str, text: str) -> dict[str, str]:
    """The seven messages of an action, as genaction writes them, by message name."""
    goal, result, feedback = text.split("---\n")
    action = "".join(f"{name}Action{part} action_{part.lower()}\n" for part in ("Goal", "Result", "Feedback"))
    status = "Header header\nactionlib_msgs/GoalStatus status\n"
    return {
        f"{name}Goal": goal,
        f"{name}Result": result,
        f"{name}Feedback": feedback,
        f"{name}Action": action,
        f"{name}ActionGoal": f"Header header\nactionlib_msgs/GoalID goal_id\n{name}Goal goal\n",
        f"{name}ActionResult": f"{status}{name}Result result\n",
        f"{name}ActionFeedback": f"{status}{name}Feedback feedback\n",
    }


def generate(target: Path) -> None:
    """Write the Python packages of all definitions into `target`."""
    share = Path("/usr/share")
    search = {p: [str(share / p / "msg")] for p in ("std_msgs", "geometry_msgs", "actionlib_msgs")}
    search["auv_msgs"] = [str(DEFINITIONS / "auv_msgs/msg")]
    action_dir = target / "from_actions"
    action_dir.mkdir(parents=True, exist_ok=True)
    for source in DEFINITIONS.glob("navcon_msgs/action/*.action"):
        for name, text in action_messages(source.stem, source.read_text()).items():
            (action_dir / f"{name}.msg").write_text(text)
    search["navcon_msgs"] = [str(action_dir)]
    message, service = genpy.generator.MsgGenerator(), genpy.generator.SrvGenerator()
    for package, kind, maker, files in (
        ("auv_msgs", "msg", message, sorted((DEFINITIONS / "auv_msgs/msg").glob("*.msg"))),
        ("navcon_msgs", "msg", message, sorted(action_dir.glob("*.msg"))),
        ("misc_msgs", "srv", service, sorted((DEFINITIONS / "misc_msgs/srv").glob("*.srv"))),
    ):
        out = target / package / kind
        out.mkdir(parents=True, exist_ok=True)
        if maker.generate_messages(package, [str(f) for f in files], str(out), search):
            raise RuntimeError(f"genpy could not generate {package}")
        write_modules(str(out))
        write_modules(str(out.parent))


def load() -> None:
    """Make `auv_msgs`, `misc_msgs` and `navcon_msgs` importable and check their md5s."""
    # A folder of this process's own, which ends here: two vehicles that start at once share nothing.
    with tempfile.TemporaryDirectory(prefix="generation-b-") as folder:
        generate(Path(folder))
        sys.path.insert(0, folder)
        importlib.invalidate_caches()
        for package in ("auv_msgs.msg", "misc_msgs.srv", "navcon_msgs.msg"):
            importlib.import_module(package)  # it imports each type of the package
        sys.path.remove(folder)
    for name, expected in FACTS_MD5.items():
        module, _, kind = name.rpartition(".")
        found = getattr(importlib.import_module(module), kind)._md5sum
        if found != expected:
            raise RuntimeError(f"{name}: md5 {found}, the facts say {expected}")


load()
