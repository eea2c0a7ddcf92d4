"""Files of CAD systems, STEP, IGES and BREP, as OpenCASCADE writes them."""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import pairwise
from textwrap import wrap
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cad import foreign
from limitsurf.cad.brep import Made, made
from limitsurf.cad.offset_faces import OffsetFaces
from limitsurf.cad.opencascade import (
    compound_of,
    failures,
    module,
    parts_of,
    sequence_of_labels,
    silence,
)
from limitsurf.cad.spline_faces import SplineFaces
from limitsurf.cage.checks import MeshError, choice
from limitsurf.shell import files
from limitsurf.shell.files import Path
from limitsurf.shell.io.apart import read_apart

Array = NDArray[Any]

STEP, IGES, BREP = (".step", ".stp"), (".iges", ".igs"), (".brep",)
SUFFIXES = (*STEP, *IGES, *BREP)
_MODULES = tuple(
    f"OCP.{name}"
    for name in ("STEPCAFControl", "IGESCAFControl", "BRepTools", "Geom2dConvert", "XCAFApp")
)
# names in files, and metres
UNITS = {
    "mm": ("MM", 1e-3),
    "cm": ("CM", 1e-2),
    "m": ("M", 1.0),
    "km": ("KM", 1e3),
    "um": ("UM", 1e-6),
    "in": ("INCH", 0.0254),
    "ft": ("FT", 0.3048),
}
_BLOCK = 1 << 20  # bytes
_FORMAT, _NUMBER = "%.16E", re.compile(rb"-?\d\.\d{16}E[+-]\d\d+")
_FACE = re.compile(rb"=\s*(?:ADVANCED_FACE|FACE_SURFACE)\s*\(")
_FACES_OF_IGES = (b"143", b"144", b"510")  # bounded and trimmed surfaces, and faces of shells
_MOST = 8  # faces of the cage that a name tells
_SMALL = 1e-4  # millimetres
_COLUMNS = 70  # of a line of IGES
_LINE = 200  # characters of a text in a header
_writing = Lock()  # the parameters of writers are those of the process


def content(
    name: str, kind: str, x: Any, *, unit: str, check: bool, colors: Any, how: dict[str, Any]
) -> Iterator[bytes]:
    """The bytes of a file of a shape or a surface.

    Parameters
    ----------
    name, kind : str
        Of the file.
    x : TopoDS_Shape, or what has one as ``wrapped``; LimitSurface or BSplineFaces
    unit : str
        What numbers of `x` are, one of `UNITS`.
    check : bool
        Whether the file is read again before it is one.
    colors : str or array_like, optional
        Of a surface, see `of_faces`.
    how : dict
        Of a surface, what `to_brep` is told.
    """
    choice(unit, "unit", tuple(UNITS))
    if not isinstance(check, (bool, np.bool_)):
        raise TypeError(f"check must be True or False, got {check!r}")
    if kind in BREP and unit != "mm":
        raise ValueError(f"unit={unit!r}: BREP files state no unit, their numbers are millimetres")
    shape, known = _shape_of(x, how)
    if known is None and colors is not None:
        raise ValueError("colors are of the faces of a surface, got a shape")
    painted = None if known is None else of_faces(known, colors)
    if known is not None:
        _warn_of_size(known, UNITS[unit][1] / 1e-3)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, f"part{kind}")
        with failures("it cannot be written"), _writing, silence():
            if kind in BREP:
                _written(module("BRepTools").BRepTools.Write_s(shape, path))
            else:
                document = _document(shape, known, painted, UNITS[unit][1])
                write = _write_step if kind in STEP else _write_iges
                write(document, path, os.path.basename(name), UNITS[unit][0], _said(known))
        if check:
            _check(path, kind, shape)
        with open(path, "rb") as file:
            while block := file.read(_BLOCK):
                yield block


def _warn_of_size(known: Made, factor: float) -> None:
    """Say that a part is so small, in millimetres, that readers take its points to be one."""
    size = factor * float(np.ptp(known.splines.points, axis=0).max())
    if size < _SMALL:
        text = f"the part is {size:.2g} mm large, and readers take points within 1e-7 mm to be one"
        warnings.warn(f"{text}: scale it, or name its unit, as unit='m'", stacklevel=4)


def _shape_of(x: Any, how: dict[str, Any]) -> tuple[Any, Made | None]:
    """A shape, and what is known of it if it was made here."""
    found = getattr(x, "wrapped", x)
    if is_shape(found):
        if how:
            raise TypeError(f"{', '.join(how)}: said of surfaces, not of shapes, which are made")
        if found.IsNull():
            raise ValueError("the shape is null: there is nothing to write")
        return found, None
    solid = how.pop("solid", None)
    options = {"channel": None, "workers": 1, **how}
    found = made(x, solid, "mm", **options)
    found.warn(solid, 4)
    return found.shape, found


def is_shape(x: Any) -> bool:
    """Whether something is a shape of OpenCASCADE, or wraps one."""
    found = getattr(x, "wrapped", x)
    kind = type(found)
    return kind.__module__.endswith("TopoDS") and kind.__name__.startswith("TopoDS_")


def of_faces(known: Made, colors: Any) -> Array | None:
    """A colour (n, 3) in [0, 1] of each face of a shape; None without `colors`.

    Parameters
    ----------
    known : Made
    colors : str or array_like, optional
        Data of the cage's faces or a channel by name, or (n_faces, 3) numbers, one row for each
        face of the cage. Integers are 0 to 255. A channel is averaged over the corners of a face,
        and faces that are merged have the mean of theirs.
    """
    if colors is None:
        return None
    splines = known.splines
    surface, mesh = splines.surface, splines.surface.mesh
    rows = colors
    if isinstance(colors, str):
        if colors in mesh.face_data:
            rows = mesh.face_data[colors]
        elif colors in mesh.channels:
            values, indices, _ = mesh.channels[colors]
            total = np.zeros((mesh.n_faces, *values.shape[1:]))
            np.add.at(total, mesh.corner_face, np.asarray(values, float)[indices])
            rows = total / mesh.sizes.reshape(-1, *[1] * (values.ndim - 1))
        else:
            known_names = ", ".join(map(repr, (*mesh.face_data, *mesh.channels))) or "none"
            raise ValueError(f"colors: no face data or channel {colors!r}, there are {known_names}")
    rows = np.asarray(rows)
    if rows.shape not in ((mesh.n_faces, 3), (mesh.n_faces, 4)) or rows.dtype.kind not in "iuf":
        raise ValueError(
            f"colors must be 3 numbers of each of {mesh.n_faces} faces, got {rows.dtype} of shape "
            f"{rows.shape}"
        )
    rows = rows[:, :3] / (255 if rows.dtype.kind in "iu" else 1)
    bad = np.flatnonzero(~((rows >= 0) & (rows <= 1)).all(axis=1))
    if len(bad):
        raise ValueError(f"colors of face {bad[0]} are {rows[bad[0]]}, not in [0, 1]")
    cells = splines.grid.prod(axis=1)
    owner = np.repeat(np.arange(len(cells)), cells)
    total = np.zeros((len(cells), 3))
    np.add.at(total, owner, rows[surface.limit_faces.face[splines.limit_faces]])
    return np.asarray(total / cells[:, None])


def names(known: Made) -> list[str]:
    """Of each face, which faces of the cage it is."""
    splines = known.splines
    cells = splines.grid.prod(axis=1)
    owner = np.repeat(np.arange(len(cells)), cells)
    face = splines.surface.limit_faces.face[splines.limit_faces]
    order = np.lexsort((face, owner))
    owner, face = owner[order], face[order]
    new = np.append(True, (owner[1:] != owner[:-1]) | (face[1:] != face[:-1]))
    owner, face = owner[new], face[new]
    ends = np.searchsorted(owner, np.arange(len(cells) + 1)).tolist()
    found = []
    for begin, end in pairwise(ends):
        some = " ".join(map(str, face[begin : min(end, begin + _MOST)].tolist()))
        more = f" and {end - begin - _MOST} more" if end - begin > _MOST else ""
        found.append(f"face{'s' * (end - begin > 1)} {some}{more}")
    return found


def _said(known: Made | None) -> list[str]:
    """What a header says of a shape: lines of text."""
    if known is None:
        return []
    splines, scheme = known.splines, known.splines.surface.rules["scheme"]
    name = getattr(scheme, "name", scheme)
    gap = f"gap along shared edges at most {known.gap:.2g} where it was measured"
    if isinstance(splines, OffsetFaces):
        text = [
            f"offset at {splines.distance:.6g} of the limit surface of a cage, scheme {name}",
            f"{len(splines)} faces",
            gap,
            f"deviation from the offset {splines.deviation.max(initial=0):.3g} as measured",
            f"normals within {splines.angle.max(initial=0):.3g} degrees as measured",
        ]
        return [line[:_LINE] for line in text]
    exact = int(splines.exact.sum())
    text = [
        f"limit surface of a control cage, scheme {name}",
        f"{len(splines)} faces, {exact} of them the limit surface to rounding",
        gap,
    ]
    return [line[:_LINE] for line in [*text, *_deviation(known)]]


def _deviation(known: Made) -> list[str]:
    """How far faces are from the limit, at most: proved."""
    _, errors = known.splines.cap_errors
    far, near, turn = (
        float(getattr(errors, name).max(initial=0))
        for name in ("parametric", "along_normal", "angle")
    )
    if not len(errors.parametric):
        return ["deviation from the limit surface: rounding"]
    return [
        f"deviation from the limit surface at most {far:.3g} at the same parameters",
        f"{near:.3g} along its normals",
        f"normals within {np.degrees(turn):.3g} degrees",
    ]


def _document(shape: Any, known: Made | None, painted: Array | None, metres: float) -> Any:
    """A document of a shape, with names and colours of faces."""
    xcaf, text = module("XCAFDoc"), module("TCollection").TCollection_ExtendedString
    document = module("TDocStd").TDocStd_Document(text("BinXCAF"))
    module("XCAFApp").XCAFApp_Application.GetApplication_s().InitDocument(document)
    tools = xcaf.XCAFDoc_DocumentTool
    tools.SetLengthUnit_s(document, metres)
    shapes = tools.ShapeTool_s(document.Main())
    label = shapes.AddShape(shape, False)
    if known is None:
        return document
    name = module("TDataStd").TDataStd_Name.Set_s
    name(label, text("limit surface"))
    colour, kind = module("Quantity"), xcaf.XCAFDoc_ColorType.XCAFDoc_ColorSurf
    paint = tools.ColorTool_s(document.Main())
    for k, (face, said) in enumerate(zip(known.faces, names(known), strict=True)):
        part = shapes.AddSubShape(label, face)
        if part.IsNull():
            continue
        name(part, text(said))
        if painted is not None:
            srgb = colour.Quantity_TypeOfColor.Quantity_TOC_sRGB
            paint.SetColor(part, colour.Quantity_Color(*painted[k].tolist(), srgb), kind)
    return document


@contextmanager
def _parameters(**values: str | int) -> Iterator[None]:
    """Parameters of writers, which are those of the process, for a while."""
    static = module("Interface").Interface_Static
    known = {name.replace("__", "."): value for name, value in values.items()}
    before = {}
    for name, value in known.items():
        before[name] = static.CVal_s(name) if isinstance(value, str) else static.IVal_s(name)
        (static.SetCVal_s if isinstance(value, str) else static.SetIVal_s)(name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            (static.SetCVal_s if isinstance(value, str) else static.SetIVal_s)(name, value)


def _write_step(document: Any, path: str, name: str, unit: str, said: list[str]) -> None:
    text = module("TCollection").TCollection_HAsciiString
    writer = module("STEPCAFControl").STEPCAFControl_Writer()
    with _parameters(write__step__unit=unit, write__stepcaf__subshapes__name=1):
        _written(writer.Transfer(document))
        model = writer.ChangeWriter().Model()
        header = module("APIHeaderSection").APIHeaderSection_MakeHeader(model)
        header.SetName(text(_ascii(name)))
        header.SetAuthorValue(1, text(""))
        header.SetOrganizationValue(1, text(""))
        header.SetAuthorisation(text(""))
        header.SetOriginatingSystem(text("limitsurf"))
        if said:
            header.SetDescriptionValue(1, text(_ascii("; ".join(said))))
        # the writer itself has 13 digits
        numbers = module("StepData").StepData_StepWriter(model)
        numbers.FloatWriter().SetFormat(_FORMAT, True)
        numbers.FloatWriter().SetZeroSuppress(False)
        numbers.FloatWriter().SetFormatForRange("", 0.0, 0.0)
        numbers.SendModel(module("StepAP214").StepAP214.Protocol_s())
        text_of_file = BytesIO()
        _written(numbers.Print(text_of_file))
        with open(path, "wb") as file:
            file.write(_NUMBER.sub(_shortest, text_of_file.getvalue()))


def _shortest(found: re.Match[bytes]) -> bytes:
    """The shortest digits that are the same number, as STEP writes it."""
    mantissa, _, exponent = repr(float(found[0])).partition("e")
    if "." not in mantissa:
        mantissa += "."
    mantissa = mantissa.removesuffix("0") if mantissa.endswith(".0") else mantissa
    return f"{mantissa}E{exponent}".encode() if exponent else mantissa.encode()


def _write_iges(document: Any, path: str, name: str, unit: str, said: list[str]) -> None:
    module("IGESControl").IGESControl_Controller.Init_s()
    with _parameters(write__iges__unit=unit, write__iges__brep__mode=1):
        writer = module("IGESCAFControl").IGESCAFControl_Writer()
        _written(writer.Transfer(document))
        writer.ComputeModel()
        model, data = writer.Model(), module("IGESData")
        for line in said:
            for words in wrap(_ascii(line), _COLUMNS):
                model.AddStartLine(words)
        section = model.GlobalSection()
        section.SetFileName(module("TCollection").TCollection_HAsciiString(_ascii(name)))
        model.SetGlobalSection(section)
        # the writer itself has 10 digits
        numbers, protocol = data.IGESData_IGESWriter(model), data.IGESData_FileProtocol()
        for room in ("IGESAppli", "IGESSolid"):
            protocol.Add(getattr(module(room), room).Protocol_s())
        numbers.FloatWriter().SetFormat(_FORMAT, True)
        numbers.FloatWriter().SetZeroSuppress(False)
        numbers.FloatWriter().SetFormatForRange("", 0.0, 0.0)
        numbers.SendModel(protocol)
        text_of_file = BytesIO()
        _written(numbers.Print(text_of_file))
        with open(path, "wb") as file:
            file.write(text_of_file.getvalue())


def _ascii(text: str) -> str:
    text = "".join(x if x.isprintable() else "?" for x in text)
    return text.encode("ascii", errors="replace").decode()


def _written(status: Any) -> None:
    """Refuse what a writer says if it is not that all is well."""
    if not (status is True or getattr(status, "name", "") == "IFSelect_RetDone"):
        raise ValueError(f"OpenCASCADE could not write the shape: {status}")


def _check(path: str, kind: str, shape: Any) -> None:
    """Read a file again, and refuse it if that is no valid shape of as many faces.

    Raises
    ------
    ValueError
        What is wrong with it.
    """
    again, _ = loaded(path, kind)
    counts = [_counts(x) for x in (shape, again)]
    if counts[0] != counts[1]:
        names = ("faces", "solids")
        had, has = (
            " and ".join(f"{n} {name}" for n, name in zip(count, names, strict=True))
            for count in counts
        )
        raise ValueError(f"check: the file reads back as {has}, the shape has {had}")
    if not is_valid(again):
        bad = [k for k, face in enumerate(parts_of(again, "Face")) if not is_valid(face)]
        where = f"face {bad[0]} (of {len(bad)})" if bad else "how faces are joined"
        raise ValueError(f"check: the file reads back, but OpenCASCADE finds fault with {where}")


def is_valid(shape: Any) -> bool:
    """Whether OpenCASCADE finds no fault with a shape."""
    return bool(module("BRepCheck").BRepCheck_Analyzer(shape).IsValid())


def _counts(shape: Any) -> tuple[int, int]:
    return tuple(sum(1 for _ in parts_of(shape, kind)) for kind in ("Face", "Solid"))  # type: ignore[return-value]


def loaded(path: str, kind: str) -> tuple[Any, Any]:
    """A shape in millimetres, and the document that knows names and colours, if there is one.

    Raises
    ------
    ValueError
        A file that OpenCASCADE cannot read.
    """
    with silence():
        if kind in BREP:
            shape = module("TopoDS").TopoDS_Shape()
            builder = module("BRep").BRep_Builder()
            if not module("BRepTools").BRepTools.Read_s(shape, path, builder):
                raise ValueError("OpenCASCADE cannot read it")
            return shape, None
        text, xcaf = module("TCollection").TCollection_ExtendedString, module("XCAFDoc")
        document = module("TDocStd").TDocStd_Document(text("BinXCAF"))
        module("XCAFApp").XCAFApp_Application.GetApplication_s().InitDocument(document)
        xcaf.XCAFDoc_DocumentTool.SetLengthUnit_s(document, 1e-3)
        name = "STEPCAFControl" if kind in STEP else "IGESCAFControl"
        reader = getattr(module(name), f"{name}_Reader")()
        reader.SetNameMode(True)
        reader.SetColorMode(True)
        with _parameters(**({"read__stepcaf__subshapes__name": 1} if kind in STEP else {})):
            status = reader.ReadFile(path)
            if getattr(status, "name", "") != "IFSelect_RetDone":
                raise ValueError("OpenCASCADE cannot read it: it is broken, or another format")
            if not reader.Transfer(document):
                raise ValueError("OpenCASCADE makes no shape of it")
        shapes = xcaf.XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
        labels = sequence_of_labels()
        shapes.GetFreeShapes(labels)
        found = [shapes.GetShape_s(labels.Value(i)) for i in range(1, labels.Length() + 1)]
        return found[0] if len(found) == 1 else compound_of(found), document


def contents_of(name: str, kind: str, path: str, folder: str | None) -> dict[str, Any]:
    """What is in a file, as arrays: those of `foreign.contents`, names and colours.

    It is called in a process of its own.
    """
    try:
        with failures("it cannot be read"):
            shape, document = loaded(path, kind)
            found = foreign.contents(shape)
            known = [] if document is None else _labels(shape, document)
    except ValueError as error:
        raise MeshError(f"{name}: {error}") from None
    count = found["faces"]
    stated = _stated(path, kind)
    if count < stated:
        text = f"{name}: {stated - count} of {stated} faces are left out"
        warnings.warn(f"{text}: OpenCASCADE makes nothing of them", stacklevel=2)
    names, colors = [""] * count, np.full((count, 3), np.nan)
    for k, (said, color) in enumerate(known[:count]):
        names[k] = said
        colors[k] = color
    return {**found, "names": names, "colors": colors}


def _stated(path: str, kind: str) -> int:
    """How many faces the text of a file has; of BREP 0, which is read as a whole or not at all."""
    if kind in BREP:
        return 0
    with open(path, "rb") as file:
        if kind in STEP:
            return len(_FACE.findall(file.read()))
        # of the directory, which has two lines to an entity
        entries = [line[:8].strip() for line in file if line[72:73] == b"D"]
    return sum(entry in _FACES_OF_IGES for entry in entries[::2])


def _labels(shape: Any, document: Any) -> list[tuple[str, tuple[float, ...]]]:
    """Name and colour of each face."""
    tools = module("XCAFDoc").XCAFDoc_DocumentTool
    shapes, paint = tools.ShapeTool_s(document.Main()), tools.ColorTool_s(document.Main())
    label, name = module("TDF").TDF_Label(), module("TDataStd").TDataStd_Name
    quantity, kinds = module("Quantity"), module("XCAFDoc").XCAFDoc_ColorType
    srgb, none = quantity.Quantity_TypeOfColor.Quantity_TOC_sRGB, (np.nan,) * 3
    found, seen = [], set()
    for face in parts_of(shape, "Face"):
        if hash(face) in seen:
            continue
        seen.add(hash(face))
        said = ""
        if shapes.Search(face, label, True, True, True) and not label.IsNull():
            own = name()
            # (to ask for what is not there, or for the characters of an empty text, is the end)
            there = label.IsAttribute(name.GetID_s()) and label.FindAttribute(name.GetID_s(), own)
            if there and own.Get().Length():
                said = own.Get().ToExtString()
        color = quantity.Quantity_Color()
        ways = (kinds.XCAFDoc_ColorSurf, kinds.XCAFDoc_ColorGen)
        painted = any(paint.GetColor(face, way, color) for way in ways)
        found.append((said, tuple(color.Values(srgb)) if painted else none))
    return found


def read_brep(file: Path, *, unit: str = "mm") -> SplineFaces:
    """The faces of a CAD file as splines with trims, which are evaluated as limit surfaces are.

    Needs the extra ``cad``. The file is read in a process of its own, with the limits of `read`.

    Parameters
    ----------
    file : str or os.PathLike
        STEP (``.step``, ``.stp``), IGES (``.iges``, ``.igs``) or OpenCASCADE's BREP (``.brep``).
    unit : {"mm", "cm", "m", "km", "um", "in", "ft"}
        What numbers are to be in. STEP and IGES say what theirs are; those of BREP are taken to be
        millimetres.

    Returns
    -------
    SplineFaces
        Planes, cylinders and all other surfaces as rational splines. Its ``to_mesh`` makes a cage
        of faces that are regular limit faces.

    Raises
    ------
    MeshError
        A file that is broken or another format, that has no faces, or whose reading takes more
        memory or time than its limits.
    ValueError
        An unknown suffix or unit.
    OSError
        A file that cannot be read.
    ImportError
        OpenCASCADE is not installed.

    Warns
    -----
    UserWarning
        How many faces of a STEP or IGES file are left out, since they are broken.

    Examples
    --------
    >>> import limitsurf as ls, pathlib, tempfile
    >>> square = ls.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "square.step")
    ...     ls.write(path, ls.LimitSurface(square), solid=False)
    ...     faces = ls.read_brep(path)
    >>> faces.names, faces.evaluate(0, 0.25, 0.5).round(12).tolist()
    (('face 0',), [0.25, 0.5, 0.0])
    """
    name = os.fspath(file)
    kind = os.path.splitext(name)[1].lower()
    if kind not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise ValueError(f"{name}: unknown suffix {kind!r}, need one of {known}; cages: ls.read")
    choice(unit, "unit", tuple(UNITS))
    module("gp")
    with files.opened(name) as opened, tempfile.TemporaryDirectory() as folder:
        path, size = os.path.abspath(name), os.fstat(opened.fileno()).st_size
        if not (os.path.isfile(name) and _is_unicode(path)):
            path = os.path.join(folder, f"part{kind}")
            with open(path, "wb") as copy:
                copy.writelines(files.blocks(opened, name))
            size = os.path.getsize(path)
        with open(path, "rb") as begins:
            _check_beginning(name, kind, begins.read(200))
        function = "limitsurf.shell.io.step:contents_of"
        found = read_apart(name, size, function, name, kind, path, None, modules=_MODULES)
    names, colors = found.pop("names"), found.pop("colors")
    scale = UNITS[unit][1] / 1e-3
    return SplineFaces.of(found, names=names, colors=colors, unit=scale)


def _is_unicode(path: str) -> bool:
    """Whether a path is text that OpenCASCADE takes: names of files are any bytes."""
    try:
        path.encode()
    except UnicodeEncodeError:
        return False
    return True


def _check_beginning(name: str, kind: str, data: bytes) -> None:
    """Refuse, by a MeshError, what does not begin as such files do."""
    if kind in STEP:
        right, need = (
            data.lstrip(b"\xef\xbb\xbf \r\n\t").startswith(b"ISO-10303-21"),
            "ISO-10303-21",
        )
    elif kind in IGES:
        right, need = len(data) > 72 and data[72:73] in b"SBC", "'S' in column 73"
    else:
        right, need = b"DBRep_DrawableShape" in data or b"CASCADE" in data, "DBRep_DrawableShape"
    if not right:
        raise MeshError(f"{name}: need {need} at the start: this is no {kind} file")
