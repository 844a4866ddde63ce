"""Draws a fitted log as one SVG picture: the rows, the curve with its breakpoints, and the residuals below."""

from __future__ import annotations

from html import escape
from math import floor, log10

import numpy as np

from apad_bridge.analysis.battery_fit.battery_fit import BatteryFit
from apad_bridge.analysis.battery_fit.battery_log import Floats

_WIDTH, _LEFT, _RIGHT = 860, 70, 20
_TOP, _CURVE, _BETWEEN, _RESIDUALS, _BOTTOM = 46, 330, 34, 110, 50
_SHOWN_ROWS = 1500
_STYLE = (
    "text{font:13px sans-serif;fill:#222}.title{font-weight:bold;font-size:15px}.small{font-size:12px;fill:#555}"
    ".grid{stroke:#ddd}.axis{stroke:#444;fill:none}.row{fill:#4477aa;fill-opacity:.45}"
    ".curve{stroke:#c03030;stroke-width:2;fill:none}.knot{fill:#fff;stroke:#c03030;stroke-width:2}"
    ".cut{stroke:#c03030;stroke-dasharray:3 4;stroke-opacity:.6}"
)


class _Panel:
    """A rectangle of the picture, which shows [x0, x1] by [y0, y1]."""

    def __init__(self, top: float, height: float, x: tuple[float, float], y: tuple[float, float]) -> None:
        self.top, self.bottom = top, top + height
        self._x, self._y = x, y

    def at(self, x: float, y: float) -> tuple[float, float]:
        across = (x - self._x[0]) / (self._x[1] - self._x[0])
        up = (y - self._y[0]) / (self._y[1] - self._y[0])
        return _LEFT + across * (_WIDTH - _LEFT - _RIGHT), self.bottom - up * (self.bottom - self.top)

    def frame(self, unit: str, x_labels: bool) -> list[str]:
        lines = []
        for y in ticks(*self._y, 6 if self.bottom - self.top > 200 else 4):
            _, at = self.at(self._x[0], y)
            lines.append(
                f'<line class="grid" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
            )
            lines.append(f'<text x="{_LEFT - 8}" y="{at + 4:.1f}" text-anchor="end">{y:g}</text>')
        for x in ticks(*self._x, 8):
            at, _ = self.at(x, self._y[0])
            lines.append(
                f'<line class="grid" x1="{at:.1f}" x2="{at:.1f}" y1="{self.top}" y2="{self.bottom}"/>'
            )
            if x_labels:
                lines.append(f'<text x="{at:.1f}" y="{self.bottom + 18}" text-anchor="middle">{x:g}</text>')
        box = (
            f'x="{_LEFT}" y="{self.top}" width="{_WIDTH - _LEFT - _RIGHT}" height="{self.bottom - self.top}"'
        )
        middle = (self.top + self.bottom) / 2
        turned = f'transform="rotate(-90 18 {middle})"'
        lines.append(f'<rect class="axis" {box}/>')
        lines.append(f'<text x="18" y="{middle}" text-anchor="middle" {turned}>{unit}</text>')
        return lines


def svg(fitted: BatteryFit) -> str:
    """The picture, as the text of a file that any browser shows."""
    residuals = fitted.scaled - fitted.curve.at(fitted.minutes)
    span = (float(fitted.minutes[0]), float(fitted.minutes[-1]))
    values = np.concatenate((fitted.scaled, fitted.curve.values))
    low, high = min(0.0, float(values.min())), max(1.0, float(values.max()))
    worst = max(fitted.max_abs, 1e-6) * 1.1
    upper = _Panel(_TOP, _CURVE, span, (low - 0.02, high + 0.02))
    lower = _Panel(upper.bottom + _BETWEEN, _RESIDUALS, span, (-worst, worst))
    indices = _thinned(fitted.minutes, np.abs(residuals))
    height = lower.bottom + _BOTTOM
    curve = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(upper.at, fitted.curve.knots, fitted.curve.values))
    box = f"0 0 {_WIDTH} {height}"
    subtitle = f"{fitted.direction}, RMSE {fitted.rmse:.4f}, largest residual {fitted.max_abs:.4f}"
    return (
        "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" width="{_WIDTH}" height="{height}">',
                f"<style>{_STYLE}</style>",
                f'<rect width="{_WIDTH}" height="{height}" fill="#fff"/>',
                f'<text class="title" x="{_LEFT}" y="20">{escape(fitted.log)}</text>',
                f'<text class="small" x="{_LEFT}" y="38">{subtitle}, {len(fitted.minutes)} rows</text>',
                *upper.frame("scaled voltage", x_labels=False),
                *lower.frame("residual", x_labels=True),
                f'<text x="{_WIDTH / 2}" y="{height - 10}" text-anchor="middle">minutes</text>',
                *_dots(upper, fitted.minutes[indices], fitted.scaled[indices]),
                *_dots(lower, fitted.minutes[indices], residuals[indices]),
                *_cuts(fitted, upper, lower),
                f'<polyline class="curve" points="{curve}"/>',
                *_knots(fitted, upper),
                "</svg>",
            ]
        )
        + "\n"
    )


def ticks(low: float, high: float, about: int) -> list[float]:
    """About so many round numbers within [low, high]."""
    raw = (high - low) / about
    power = 10.0 ** floor(log10(raw))
    step = next(step for step in (1, 2, 5, 10) if step * power >= raw) * power
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return [round(n * step, 12) for n in range(first, last + 1)]


def _thinned(minutes: Floats, weight: Floats) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """The indices of the drawn rows: in each span of time the row farthest from the curve, so that no outlier is hidden."""
    if len(minutes) <= _SHOWN_ROWS:
        return np.arange(len(minutes))
    parts = np.array_split(np.arange(len(minutes)), _SHOWN_ROWS)
    return np.array([part[int(np.argmax(weight[part]))] for part in parts])


def _dots(panel: _Panel, x: Floats, y: Floats) -> list[str]:
    places = [panel.at(float(a), float(b)) for a, b in zip(x, y, strict=True)]
    return [f'<circle class="row" cx="{a:.1f}" cy="{b:.1f}" r="1.8"/>' for a, b in places]


def _cuts(fitted: BatteryFit, *panels: _Panel) -> list[str]:
    lines = []
    for knot in fitted.curve.knots[1:-1]:
        for panel in panels:
            x, _ = panel.at(knot, 0)
            lines.append(
                f'<line class="cut" x1="{x:.1f}" x2="{x:.1f}" y1="{panel.top}" y2="{panel.bottom}"/>'
            )
    return lines


def _knots(fitted: BatteryFit, panel: _Panel) -> list[str]:
    lines = []
    for x, y in map(panel.at, fitted.curve.knots, fitted.curve.values):
        lines.append(f'<circle class="knot" cx="{x:.1f}" cy="{y:.1f}" r="4"/>')
    for segment in fitted.segments:
        x, y = panel.at(
            (segment.from_min + segment.to_min) / 2, (segment.from_scaled + segment.to_scaled) / 2
        )
        down = segment.per_min < 0
        anchor, aside = ("start", 10) if down else ("end", -10)
        lines.append(
            f'<text x="{x + aside:.1f}" y="{y - 8:.1f}" text-anchor="{anchor}">{segment.per_min:+.6f} / min</text>'
        )
    return lines
