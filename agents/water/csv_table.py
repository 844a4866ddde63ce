"""Tables in the files that a scenario names: CSV with a header, `#` for comments."""

from __future__ import annotations

from collections.abc import Callable


def number_of(cell: str) -> float:
    """The number in a cell. ValueError for any other text, and for one that Python alone reads as a number, as 24_0."""
    if "_" in cell or not cell.isascii():
        raise ValueError(f"no number: {cell!r}")
    return float(cell)


def read_rows(
    text: str, check_header: Callable[[list[str]], None], take: Callable[[dict[str, str]], None]
) -> bool:
    """Gives each row to `take`, as texts by column; False if there is not even a header.

    A ValueError of `check_header` or of `take`, or for a row of another length, is raised as `line N: ...`.
    """
    columns: list[str] = []
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        cells = [cell.strip() for cell in content.split(",")]
        try:
            if not columns:
                check_header(cells)
                columns = cells
            elif len(cells) != len(columns):
                raise ValueError(f"{len(cells)} values for {len(columns)} columns")
            else:
                take(dict(zip(columns, cells, strict=True)))
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
    return bool(columns)
