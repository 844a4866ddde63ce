"""Draws a fitted log: the rows, the curve with its breakpoints, and the residuals below."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apad_bridge.field.battery_fit.battery_fit import BatteryFit

_ROW, _CURVE = "#4477aa", "#c03030"


def draw(fitted: BatteryFit, path: Path) -> None:
    """Writes the picture in the format of the file's ending: .png, .svg or .pdf. ValueError for another ending."""
    figure_of(fitted).savefig(path, dpi=110)


def figure_of(fitted: BatteryFit) -> Any:
    """Returns the matplotlib figure; its two panels share the axis of minutes."""
    # Imported here because it takes 0.3 s, and most fits are not drawn.
    from matplotlib.figure import Figure

    curve, residuals = fitted.curve, fitted.scaled - fitted.curve.at(fitted.minutes)
    figure = Figure(figsize=(9, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    # A log's name is no mathematics, whatever is in it.
    figure.suptitle(fitted.log, parse_math=False)
    upper.set_title(
        f"{fitted.direction}, RMSE {fitted.rmse:.4f}, largest residual {fitted.max_abs:.4f}, {len(fitted.minutes)} rows",
        fontsize=10,
    )
    # Rows are pixels even in an SVG or PDF, because a log may have a million.
    upper.plot(fitted.minutes, fitted.scaled, ".", color=_ROW, markersize=3, label="rows", rasterized=True)
    upper.plot(curve.knots, curve.values, "o-", color=_CURVE, markerfacecolor="white", label="curve")
    for segment in fitted.segments:
        middle = (segment.from_min + segment.to_min) / 2, (segment.from_scaled + segment.to_scaled) / 2
        side = -1 if segment.per_min > 0 else 1
        upper.annotate(
            f"{segment.per_min:+.6f} / min",
            middle,
            xytext=(10 * side, 6),
            textcoords="offset points",
            ha="left" if side > 0 else "right",
        )
    lower.plot(fitted.minutes, residuals, ".", color=_ROW, markersize=3, label="residuals", rasterized=True)
    for panel in (upper, lower):
        panel.grid(color="#dddddd")
        for knot in curve.knots[1:-1]:
            panel.axvline(knot, color=_CURVE, linestyle=":", alpha=0.6)
    upper.set_ylabel("scaled voltage")
    lower.set_ylabel("residual")
    lower.set_xlabel("minutes")
    return figure
