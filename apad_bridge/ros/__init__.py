"""All that knows ROS. Debian's is used, whatever ROS a shell has sourced: that on PYTHONPATH may be of Python 2."""

import sys
from pathlib import Path

_DEBIAN = str(Path(sys.prefix) / "share" / "musselbed" / "debian")
if _DEBIAN in sys.path:
    sys.path[:] = [_DEBIAN, *(entry for entry in sys.path if entry != _DEBIAN)]
