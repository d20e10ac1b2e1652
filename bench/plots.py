"""Bar charts of the table as SVG, generated without a library."""

import math
from collections.abc import Iterator, Sequence
from html import escape

from bench.table import Row, number

_ROW, _LABEL, _BARS, _SIDE = 22, 420, 360, 150
_FONT = 'font-family="system-ui, sans-serif" font-size="12"'
_COLOURS = {True: "#2e7d4f", False: "#c0392b", None: "#5b7083"}


def bars(title: str, rows: Sequence[Row], values: Sequence[float | None]) -> str:
    """Return a bar per row on a logarithmic scale, on which a tenth is as far away as ten times."""
    least, most = _decades([value for value in values if value])
    height = (len(rows) + 3) * _ROW
    width = _LABEL + _BARS + _SIDE
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" {_FONT}>',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="8" y="{_ROW - 5}" font-weight="bold">{escape(title)}</text>',
        *_scale(least, most, height),
    ]
    for place, (row, value) in enumerate(zip(rows, values, strict=True), 1):
        lines += _bar(place, row, value, least, most)
    return "\n".join((*lines, "</svg>")) + "\n"


def _decades(values: Sequence[float]) -> tuple[int, int]:
    """Return the powers of ten around all values."""
    if not values:
        return -1, 1
    least, most = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    return least, max(most, least + 1)


def _along(value: float, least: int, most: int) -> float:
    share = (math.log10(value) - least) / (most - least)
    return _LABEL + _BARS * min(1.0, max(0.0, share))


def _scale(least: int, most: int, height: int) -> Iterator[str]:
    for decade in range(least, most + 1):
        x = _along(10.0**decade, least, most)
        yield f'<path d="M{x:.1f} {_ROW}V{height - _ROW}" stroke="#d5dbe0"/>'
        yield f'<text x="{x:.1f}" y="{height - 6}" text-anchor="middle" fill="#5b7083">{10.0**decade:g}</text>'


def _bar(place: int, row: Row, value: float | None, least: int, most: int) -> Iterator[str]:
    y = place * _ROW + 8
    yield f'<text x="{_LABEL - 8}" y="{y + 12}" text-anchor="end">{escape(row.name)}</text>'
    if not value:
        yield f'<text x="{_LABEL + 4}" y="{y + 12}">{"" if value is None else "0"}</text>'
        return
    end = _along(value, least, most)
    colour = _COLOURS[row.holds]
    yield f'<rect x="{_LABEL}" y="{y + 2}" width="{max(1.0, end - _LABEL):.1f}" height="{_ROW - 8}" fill="{colour}"/>'
    yield f'<text x="{end + 5:.1f}" y="{y + 12}">{number(value)}</text>'
