"""Converts a scenario's currents to the text that agents receive: a CSV as it stands, or a NetCDF file cut to the area.

Ocean models write NetCDF. This module reads it, so that agents stay small.
"""

from __future__ import annotations

from pathlib import Path

from agents.water.water_current import WaterCurrent, parse_water_current
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.text.text_file import read_text

_SUFFIXES = (".nc", ".nc4", ".cdf")


def current_text(path: Path, frame: LocalFrame) -> str:
    """Returns CSV text: north_m, east_m, north_m_s, east_m_s and, from a NetCDF file, time_s and depth_m.

    Time counts from the file's first; the current over a grid's land, and at a dry node, is 0. Raises OSError, or
    ValueError with the problem.
    """
    if path.suffix not in _SUFFIXES:
        return read_text(path)
    try:
        # Imported here: most scenarios have no such file, and their processes no other need of numpy.
        from apad_bridge.scenario.water.netcdf import csv_of
    except ImportError:
        raise ValueError(
            "NetCDF needs the package netCDF4: musselbed python -m pip install netCDF4"
        ) from None
    return csv_of(path, frame)


def steady_text(north_m_s: float, east_m_s: float) -> str:
    """Returns CSV text of a current that is the same everywhere: a grid of one point."""
    return f"north_m,east_m,north_m_s,east_m_s\n0,0,{north_m_s},{east_m_s}\n"


def read_current(path: Path, frame: LocalFrame) -> WaterCurrent:
    """Raises OSError, or ValueError."""
    return parse_water_current(current_text(path, frame))
