"""A text file in statements, these in words, and words in numbers, all at once."""

from __future__ import annotations

import codecs
import re
import warnings
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.shell.io import digits
from limitsurf.shell.io.polygons import IntArray

# kinds of statements, of OBJ files
VERTEX, TEXTURE, FACE, TAG, OTHER = range(5)
_PART = 1 << 18  # bytes
_WORDS = 1 << 14  # words whose arrays stay in a cache of the processor


class Statements:
    """The bytes of a text file, cut by vectorised scans into statements, and these into words.

    A statement is a line that is not empty, with all lines that continue it.
    """

    def __init__(self, name: str, data: bytes) -> None:
        self.name = name
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            data = data.decode("utf-16", errors="replace").encode()
        data = data.removeprefix(codecs.BOM_UTF8)
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        if b"#" in data:
            data = re.sub(rb"#[^\n]*", b"", data)
        if b"\\" in data:  # white space that still counts as a line
            data = re.sub(rb"\\[ \t]*\n", b"\v", data)
        data = b"".join([b" " * digits.PADDING, data, b"\n" * digits.PADDING])
        self.text = np.frombuffer(data, dtype=np.uint8)
        words = _changes(self.text).reshape(-1, 2)
        self.start = np.full(len(words) + 1, len(self.text))  # (W + 1,) first byte of each word
        self.start[:-1] = words[:, 0]
        self.end, starts = words[:, 1].copy(), self.start[:-1]  # (W,) of each word
        del words
        first = np.flatnonzero(self._begins_line(starts))
        self.first = np.append(first, len(starts))  # (S + 1,) first word of each statement
        self.n_words = np.diff(self.first)  # (S,)
        self.head = starts[first]  # (S,) first byte of each keyword
        a, b, c = (self.text[self.head + i] for i in range(3))
        kind = np.full(len(first), OTHER, dtype=np.int8)
        for letter, known in ("v", VERTEX), ("f", FACE), ("t", TAG):
            kind[(a == ord(letter)) & is_space(b)] = known
        kind[(a == ord("v")) & (b == ord("t")) & is_space(c)] = TEXTURE
        kind[(a == ord("f")) & (b == ord("o")) & is_space(c)] = FACE  # as faces were called once
        self.kind = kind  # (S,)

    def _begins_line(self, starts: IntArray) -> NDArray[np.bool_]:
        """Which words have the end of a line between them and the word before."""
        newline = np.uint8(ord("\n"))
        found, apart = np.ones(len(starts), dtype=bool), []
        for i in range(1, len(starts), _WORDS):  # of the first word it is known
            start = starts[i : i + _WORDS]
            end = self.end[i - 1 : i - 1 + len(start)]
            begins = self.text.take(start - 1) == newline
            begins |= self.text.take(end) == newline
            found[i : i + _WORDS] = begins
            apart.append(np.flatnonzero((start - end > 2) & ~begins) + i)
        # the end of a line may have white space on both sides
        wide = np.concatenate(apart) if apart else np.zeros(0, np.int64)
        if len(wide):
            lines = np.flatnonzero(self.text == newline)
            before, after = (np.searchsorted(lines, x) for x in (self.end[wide - 1], starts[wide]))
            found[wide] = before < after
        return found

    def of(self, kind: int) -> IntArray:
        """The statements of a kind, in order."""
        return np.flatnonzero(self.kind == kind)

    def arguments(self, statements: IntArray) -> IntArray:
        """The words of the statements but for their keywords, in order."""
        counts = self.n_words[statements] - 1
        shift = self.first[statements] + 1 - (np.cumsum(counts) - counts)
        words: IntArray = np.arange(counts.sum()) + np.repeat(shift, counts)
        return words

    def words(self, statement: int) -> list[str]:
        """The words of a statement, keyword first, as text."""
        return [word.decode(errors="backslashreplace") for word in self._bytes(statement)]

    def label(self, statement: int) -> str:
        """What follows the keyword of a statement, in UTF-8 or else Latin-1."""
        text = b" ".join(self._bytes(statement)[1:])
        try:
            return text.decode()
        except UnicodeDecodeError:
            return text.decode("latin-1")

    def _bytes(self, statement: int) -> list[bytes]:
        low, high = self.start[self.first[[statement, statement + 1]]]
        return self.text[low:high].tobytes().split()

    def line(self, statement: int) -> int:
        """The line of the file, from 1, on which a statement starts."""
        before = self.text[: self.head[statement]]
        return int(np.isin(before, list(b"\n\v")).sum()) + 1

    def place(self, statement: int) -> str:
        """The line on which a statement starts, for messages."""
        return f"line {self.line(statement)}"

    def fail(self, statement: int, message: str) -> NoReturn:
        """Refuse the file, for a statement."""
        raise MeshError(f"{self.name}, {self.place(statement)}: {message}")

    def numbers(self, words: IntArray, need: str = "a finite number") -> NDArray[np.float64]:
        """The number of every word (n,), which may be NaN or infinite.

        A word that is not one raises an error with what the file needs.
        """
        values, bad = self._numbers(words)
        if bad is not None:
            self.fail_at(bad, need)
        return values

    def numbers_or_none(self, words: IntArray) -> NDArray[np.float64] | None:
        """As ``numbers``, but None for a bad word."""
        values, bad = self._numbers(words)
        return values if bad is None else None

    def integers(self, words: IntArray, need: str) -> IntArray:
        """The integer of every word (n,), as ``numbers``."""
        return self.integers_between(words, self.start[words], self.end[words], need)

    def integers_between(
        self, words: IntArray, low: IntArray, high: IntArray, need: str
    ) -> IntArray:
        """The integers between places (n,) within words, as ``numbers``."""
        values, right = digits.integers(self.text, low, high)
        for i in np.flatnonzero(~right).tolist():  # long or wrong
            text = self.text[low[i] : high[i]].tobytes()
            if not re.fullmatch(rb"[+-]?[0-9]+", text):
                self.fail_at(int(words[i]), need)
            # as the largest of its type, which is out of range anyway
            values[i] = min(max(int(text[:99]), -(2**63)), 2**63 - 1)
        return values

    def fail_at(self, word: int, need: str) -> NoReturn:
        """Raise an error about a word, with what the file needs."""
        statement = int(np.searchsorted(self.first, word, side="right")) - 1
        bad = self.words(statement)[word - self.first[statement]]
        self.fail(statement, f"got {shortened(bad)}, need {need}")

    def _numbers(self, words: IntArray) -> tuple[NDArray[np.float64], int | None]:
        """The numbers of words (n,), and the first word that is none."""
        values, right = digits.decimals(self.text, self.start[words], self.end[words])
        others = words[~right]
        found = self._floats(others)
        if found is not None:
            values[~right] = found
            return values, None
        while len(others) > 1:  # bisection
            half = others[: len(others) // 2]
            others = half if self._floats(half) is None else others[len(half) :]
        return values, int(others[0])

    def _floats(self, words: IntArray) -> NDArray[np.float64] | None:
        """The numbers of words in whatever form, such as ``1e-9``; None if one is none."""
        if len(words) == 0:
            return np.zeros(0)
        low, length = self.start[words], self.end[words] + 1 - self.start[words]
        shift = low - (np.cumsum(length) - length)
        text = self.text[np.repeat(shift, length) + np.arange(length.sum())]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # bad text, in numpy 1
                values = np.fromstring(text.tobytes(), np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
        return values if len(values) == len(words) else None


def _changes(text: NDArray[np.uint8]) -> IntArray:
    """The places (2 W,) at which words begin and end, in parts that a cache of the processor holds.

    The text begins and ends with white space.
    """
    found = []
    for start in range(0, len(text) - 1, _PART):
        space = is_space(text[start : start + _PART + 1])
        found.append(np.flatnonzero(space[1:] != space[:-1]) + (start + 1))
    return np.concatenate(found)


def is_space(text: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which bytes are white space: blanks, and what is from a tab to a form feed."""
    found: NDArray[np.bool_] = (text == ord(" ")) | (text - np.uint8(ord("\t")) <= 3)
    return found


def shortened(text: str) -> str:
    """A text as messages quote it."""
    return repr(text if len(text) <= 40 else text[:40] + "...")
