"""OpenCASCADE's classes, by the names of the version that is installed, and its silence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

# by what is in them: names of version 8, module and name before
_ARRAYS = {
    ("pnt", 1): ("Array1_gp_Pnt", "TColgp", "TColgp_Array1OfPnt"),
    ("pnt", 2): ("Array2_gp_Pnt", "TColgp", "TColgp_Array2OfPnt"),
    ("pnt2d", 1): ("Array1_gp_Pnt2d", "TColgp", "TColgp_Array1OfPnt2d"),
    ("double", 1): ("Array1_double", "TColStd", "TColStd_Array1OfReal"),
    ("double", 2): ("Array2_double", "TColStd", "TColStd_Array2OfReal"),
    ("int", 1): ("Array1_int", "TColStd", "TColStd_Array1OfInteger"),
}


def module(name: str) -> Any:
    """A module of OpenCASCADE's Python bindings.

    Raises
    ------
    ImportError
        If they are not installed: how to install them.
    """
    try:
        return import_module(f"OCP.{name}")
    except ImportError as error:
        raise ImportError(
            f"OpenCASCADE (OCP.{name}) is needed for solids and their files: "
            'pip install "limitsurf[cad]"'
        ) from error


def array_class(what: str, dimensions: int) -> Any:
    """The class of arrays of points or numbers in one or two dimensions."""
    name, before, old = _ARRAYS[what, dimensions]
    gp = module("gp")  # says what is missing, if it is
    try:
        return getattr(import_module("OCP.collections"), name)
    except ImportError:
        assert gp is not None
        return getattr(module(before), old)


def sequence_of_labels() -> Any:
    """An empty sequence of a document's labels."""
    try:
        return import_module("OCP.collections").Sequence_TDF_Label()
    except ImportError:
        return module("TDF").TDF_LabelSequence()


def cast(shape: Any, kind: str) -> Any:
    """A shape as a "Face", "Edge", "Vertex", "Shell" or "Solid"."""
    casts = module("TopoDS").TopoDS
    return (getattr(casts, f"{kind}_s", None) or getattr(casts, kind))(shape)


class Arrays:
    """Makes arrays of OpenCASCADE of those of NumPy."""

    def __init__(self) -> None:
        gp = module("gp")
        self._point, self._place = gp.gp_Pnt, gp.gp_Pnt2d
        self._points, self._net = array_class("pnt", 1), array_class("pnt", 2)
        self._places = array_class("pnt2d", 1)
        self._reals, self._integers = array_class("double", 1), array_class("int", 1)

    def points(self, rows: Array) -> Any:
        """Points (n, 3)."""
        made, point = self._points(1, len(rows)), self._point
        for i, row in enumerate(rows.tolist(), 1):
            made.SetValue(i, point(*row))
        return made

    def places(self, rows: Sequence[tuple[float, float]]) -> Any:
        """Places (n, 2) of a plane."""
        made = self._places(1, len(rows))
        for i, row in enumerate(rows, 1):
            made.SetValue(i, self._place(*row))
        return made

    def net(self, points: Array) -> Any:
        """Points (n, m, 3)."""
        made, point = self._net(1, points.shape[0], 1, points.shape[1]), self._point
        for i, row in enumerate(points.tolist(), 1):
            for j, one in enumerate(row, 1):
                made.SetValue(i, j, point(*one))
        return made

    def knots(self, knots: Array) -> tuple[Any, Any]:
        """Different knots and how often each is there, of all knots (n,)."""
        values, counts = np.unique(knots, return_counts=True)
        made, times = self._reals(1, len(values)), self._integers(1, len(values))
        for i, (value, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True), 1):
            made.SetValue(i, value)
            times.SetValue(i, count)
        return made, times


@contextmanager
def silence() -> Iterator[None]:
    """Keep OpenCASCADE from printing what it does, which is on the standard output."""
    messages = module("Message")
    messenger = messages.Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


@contextmanager
def failures(what: str) -> Iterator[None]:
    """Let errors of OpenCASCADE be a ValueError that begins by saying what failed."""
    failure = module("Standard").Standard_Failure
    try:
        yield
    except Exception as error:
        # (not all of its errors are of that class)
        is_own = isinstance(error, failure) or type(error).__module__.startswith("OCP")
        if not is_own and type(error) not in (Exception, RuntimeError):
            raise
        text = str(error).strip() or type(error).__name__
        raise ValueError(f"{what}: OpenCASCADE says: {text}") from None


def parts_of(shape: Any, kind: str) -> Iterator[Any]:
    """Each "Face", "Edge", "Shell", "Solid" ... of a shape, as often as it occurs."""
    kinds = module("TopAbs").TopAbs_ShapeEnum
    found = module("TopExp").TopExp_Explorer(shape, getattr(kinds, f"TopAbs_{kind.upper()}"))
    while found.More():
        yield cast(found.Current(), kind)
        found.Next()


def compound_of(shapes: Sequence[Any]) -> Any:
    """Several shapes as one."""
    made, tool = module("TopoDS").TopoDS_Compound(), module("BRep").BRep_Builder()
    tool.MakeCompound(made)
    for shape in shapes:
        tool.Add(made, shape)
    return made
