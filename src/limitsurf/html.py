"""Tables of HTML, as which notebooks show what the library returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROWS = 10  # of a long table


def facts(title: str, known: Mapping[str, Any]) -> str:
    """What is known of something, one a row, under its title; what is None or "" is left out."""
    rows = [
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(str(value))}</td></tr>'
        for name, value in known.items()
        if value is not None and str(value)
    ]
    return f"<table><caption>{escape(title)}</caption>{''.join(rows)}</table>"


def table(columns: Mapping[str, Sequence[Any] | NDArray[Any]], title: str = "") -> str:
    """Columns of one length, with their names above: the first rows, and how many there are."""
    length = len(next(iter(columns.values())))
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    rows = [
        "<tr>" + "".join(f"<td>{escape(_text(c[k]))}</td>" for c in columns.values()) + "</tr>"
        for k in range(min(length, ROWS))
    ]
    rest = f"<p>{length:,} rows, of which these are the first</p>" if length > ROWS else ""
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    text = f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f"<table>{caption}{text}</table>{rest}"


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return ", ".join(map(_text, value.ravel()))
    return f"{value:.6g}" if isinstance(value, (float, np.floating)) else str(value)


def rows(values: NDArray[Any], axes: int = 0) -> NDArray[Any]:
    """An array (..., and so many axes more) as one of rows."""
    return values.reshape(-1, *values.shape[values.ndim - axes :])


def runs(offsets: NDArray[Any]) -> NDArray[Any]:
    """The number of the run, from ``offsets[k]`` to ``offsets[k + 1]``, that each row is in."""
    return np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))


class Report(np.ndarray[Any, np.dtype[Any]]):
    """A structured array that notebooks show as a table; its columns are plain arrays."""

    def __getitem__(self, key: Any) -> Any:
        found = super().__getitem__(key)
        if isinstance(found, Report) and found.dtype.names is None:
            return found.view(np.ndarray)
        return found

    def __repr__(self) -> str:
        return repr(self.view(np.ndarray))

    def _repr_html_(self) -> str | None:
        if self.dtype.names is None or self.ndim != 1:
            return None
        return table({name: self[name] for name in self.dtype.names})
