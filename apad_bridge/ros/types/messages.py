"""Finds the generated messages for the running interpreter.

Call `use_generated_messages()` before importing any of them.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

DEFINITIONS = Path(__file__).parents[1] / "definitions"
STAMP = "DEFINITIONS.sha256"
_MEND = "run launch_scripts/install"


class MessagesUnusable(ImportError):
    """The generated messages are missing, old or shadowed. The text is one line with the mend."""


def generated_folder(prefix: Path | None = None) -> Path:
    """The folder of generated messages of an installation in `prefix` (by default the running interpreter's)."""
    return (prefix or Path(sys.prefix)) / "share" / "musselbed" / "ros"


def definitions_digest(definitions: Path = DEFINITIONS) -> str:
    """sha256 over the names and texts of all definitions, in hexadecimal."""
    digest = hashlib.sha256()
    for text in sorted(definitions.glob("*/*/*")):
        digest.update(f"{text.relative_to(definitions)}\n".encode())
        digest.update(text.read_bytes())
    return digest.hexdigest()


def use_generated_messages(folder: Path | None = None) -> Path:
    """Puts the generated messages first on sys.path, and returns their folder. Calling it again changes nothing.

    setup.bash puts the same folder last on PYTHONPATH, so that the user's workspace wins in a user's shell. Here it comes
    first, because musselbed was tested with these definitions, and a workspace may hold Python 2 code or another generation
    of auv_msgs. The md5 of a live aPad, not the order of a path, decides whether the two agree.

    Raises:
        MessagesUnusable: they are missing, made from other definitions than these, or shadowed by an earlier import.
    """
    folder = folder or generated_folder()
    stamp = folder / STAMP
    if not stamp.exists():
        raise MessagesUnusable(f"no generated ROS messages in {folder}: {_MEND}")
    if stamp.read_text().strip() != definitions_digest():
        raise MessagesUnusable(f"the ROS messages in {folder} are older than their definitions: {_MEND}")
    for package in sorted(entry.name for entry in DEFINITIONS.iterdir()):
        loaded = getattr(sys.modules.get(package), "__file__", None)
        if loaded is not None and not Path(loaded).is_relative_to(folder):
            raise MessagesUnusable(
                f"{package} was already imported from {loaded}: call use_generated_messages() first"
            )
    entry = str(folder)
    if entry not in sys.path[:1]:
        sys.path[:] = [entry, *(other for other in sys.path if other != entry)]
    return folder
