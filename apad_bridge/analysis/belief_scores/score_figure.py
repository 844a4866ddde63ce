"""Draws the scores of a run's beliefs: error and coverage by age, mode and aMussel, with the number of samples in a bin."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

from apad_bridge.analysis.belief_scores.scores import Score, Scores

_ERROR, _COVERAGE, _COUNT = "#3b6ea5", "#b5542c", "#666666"
_WANTED = 0.95
_LABEL_WIDE = 9
"""Letters: labels side by side have room for so many."""
_MAX_LABELS = 40
"""More aMussels than this are drawn without their ids, which would be unreadable."""


def draw(scores: Scores, path: Path, title: str) -> None:
    """Writes the picture in the format of the file's ending: .png, .svg or .pdf. ValueError for another ending."""
    figure_of(scores, title).savefig(path, dpi=110)


def figure_of(scores: Scores, title: str, size_inches: tuple[float, float] = (11, 9)) -> Any:
    """Returns the matplotlib figure: a panel by age, by mode and by aMussel, and a second axis for coverage in each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_inches, layout="constrained")
    if title:
        figure.suptitle(title)
    panels: Any = figure.subplots(3, 1)
    for panel, name, bins in zip(
        panels,
        ("age of the last packet, up to (agent time)", "what it was doing", "aMussel"),
        (scores.by_age, scores.by_mode, scores.by_agent),
        strict=True,
    ):
        _panel(panel, name, bins)
    return figure


def _panel(panel: Any, name: str, bins: dict[str, Score]) -> None:
    places = range(len(bins))
    errors = [score.rmse for score in bins.values()]
    panel.bar(places, errors, color=_ERROR, width=0.6)
    panel.set_ylabel("error (rms)", color=_ERROR)
    panel.set_ylim(0, 1.3 * max([*errors, 1e-3]))
    panel.set_xlabel(name)
    many = len(bins) > _MAX_LABELS
    panel.set_xticks([] if many else list(places), [] if many else [fill(it, _LABEL_WIDE) for it in bins])
    if not many:
        for place, score in zip(places, bins.values(), strict=True):
            panel.annotate(
                f"n {score.samples}",
                (place, score.rmse),
                xytext=(0, 3),
                textcoords="offset points",
                ha="center",
                fontsize=7,
                color=_COUNT,
            )
    covered = [(place, score.coverage) for place, score in zip(places, bins.values(), strict=True)]
    if known := [(place, coverage) for place, coverage in covered if coverage is not None]:
        other = panel.twinx()
        other.plot(*zip(*known, strict=True), "o", color=_COVERAGE, markersize=5)
        other.axhline(_WANTED, color=_COVERAGE, linewidth=0.8, linestyle="--")
        other.set_ylim(0, 1.05)
        other.set_ylabel("in 95 % interval", color=_COVERAGE)
