"""Cages from files, cages and tessellations to files: one call for each, by suffix."""

from __future__ import annotations

import math
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from io import TextIOWrapper
from typing import IO, TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell import files
from limitsurf.shell.files import Path, replacing
from limitsurf.shell.io import by_trimesh, extraction, formats, msh, obj, off, ply, vtk
from limitsurf.shell.io.losses import Losses
from limitsurf.shell.io.merge import Merge, checked, joined, warn_if_apart
from limitsurf.shell.io.polygons import (
    float_points,
    no_polygons,
    polygons,
    warn_of_cuts,
    warn_of_loss,
    warn_of_rounding,
    without_gaps,
)

Solid: TypeAlias = Any  # a LimitSurface, BSplineFaces or a shape of OpenCASCADE

if TYPE_CHECKING:
    from limitsurf.query import Tessellation
    from limitsurf.query.extraction import BezierExtraction

_PARSERS = {".obj": obj.parse, ".ply": ply.parse, ".off": off.parse, ".msh": msh.parse}


def read(
    file: Path | IO[bytes],
    *,
    suffix: str | None = None,
    prim: str | None = None,
    time: float | None = None,
    merge: Merge = None,
    strict: bool = False,
) -> Mesh:
    """Read a cage from a file; the suffix of its name says in which format it is.

    ==========================  =====================================================  ==========
    suffix                      what is read                                           needs
    ==========================  =====================================================  ==========
    ``.obj``                    polygons, "uv", names, OpenSubdiv's tags               nothing
    ``.usd .usda .usdc .usdz``  polygons, channels, tags, transforms                   ``[usd]``
    ``.ply``                    polygons, strips, "uv" (of corners or vertices)        nothing
    ``.off``                    polygons, "uv" (STOFF)                                 nothing
    ``.msh``                    triangles, quadrilaterals, names of groups (Gmsh)      nothing
    ``.stl``                    triangles                                              ``[formats]``
    ``.vtp .vtu .vtk``          polygons, strips, "uv" (of points), data of cells      ``[plot]``
    ``.glb .gltf``              triangles, "uv", transforms, names                     ``[formats]``
    ``.dae``                    polygons, "uv", transforms, names of objects           ``[formats]``
    ``.3mf``                    triangles, transforms                                  ``[formats]``
    ``.3dm``                    SubD objects with creases and corners, meshes          ``[rhino]``
    any other of trimesh        triangles, "uv", transforms                            ``[formats]``
    any other of PyVista        polygons, "uv"                                         ``[plot]``
    ==========================  =====================================================  ==========

    "Needs" is the extra to install, as in ``pip install "limitsurf[plot]"``; `from_pyvista` and
    `from_trimesh` take what these libraries have read. All objects of a file become one mesh. The
    last two rows are what the installed libraries read besides, such as ``.xaml`` and ``.zae``, or
    ``.wrl``, ``.3ds``, ``.vtkhdf``, ``.vts`` and ``.case``; those of PyVista need a path, since
    they may have others beside them, and images and volumes are refused. VTK places the objects of
    a scene (``.wrl``, ``.3ds``) by translation, rotation and scale: shear is lost.

    All but OBJ, PLY, OFF and MSH are read by libraries, in a process of its own, which a broken
    file may end. Its memory (300 MiB and 128 times the size of the file, and of those that it
    names) and its time (10 s of a processor and 2 s a megabyte, or twice as long by the clock) are
    limited. The environment variable ``LIMITSURF_READ_LIMITS``, a number, multiplies these limits;
    where the system has none for memory (Windows, macOS) there is that of time. Files that another
    names must be regular ones, no pipes.

    Where a format repeats points along the seams of normals and texture coordinates (scenes and all
    of trimesh; PLY and those of VTK and PyVista if there are texture coordinates), points of
    exactly equal coordinates are joined, and triangles left out that have one of them twice then.
    Elsewhere points stay as they are in the file. Formats of triangles hold no other faces: of a
    cage of quadrilaterals, written by whatever program, they give the triangles that it was cut
    into, which have another limit surface.

    What is damaged costs no more than it must: of an attribute, a tag or a mesh that makes no sense
    the rest is read, and a warning says what was left out, where, and how often; with `strict` that
    is an error. What is sound but has no place in a cage, such as materials, is told in a warning,
    but for normals: the surface has its own.
    Of polygons a corner like the one before it, or a last one like the first, is none, and a face
    of fewer than three is left out; a point that is not finite is put elsewhere if no face has it.
    Where some faces have no texture coordinates, "uv" is NaN on these.

    **PLY, OFF.** Strips (``tristrips``) become triangles; of texture coordinates those of corners
    (``texcoord``) come before ``s``, ``t`` or ``u``, ``v`` of vertices. OFF is text or ``BINARY``,
    with any of the letters ST, C, N, 4 and n before ``OFF``, as far as points have three
    coordinates: a fourth divides the others.

    **OBJ.** Positions ``v`` (three coordinates), faces ``f`` of any size with positive or negative
    indices, and OpenSubdiv's tags ``t`` (crease, corner, hole, interpolateboundary, creasemethod,
    smoothtriangles, facevaryinginterpolateboundary) are read. Texture coordinates ``vt`` become the
    channel "uv", with the interpolation of its tag or "corners_plus1"; a corner at the same vertex
    as the one before it, with other texture coordinates, is another one. Weights and colours of
    vertices, files of materials, lines and free-form statements are left out, with a warning, and
    normals without. Of tags given twice the last one holds. Where there is no tag for the
    boundary it is left open, as None: OpenSubdiv's own readers then take "edge_only".

    **USD** (with ``pip install "limitsurf[usd]"``). All meshes that are shown (visible, neither
    proxy nor guide) become one, disconnected, in the order of the stage, as all objects of an OBJ
    file do. Every mesh stands where its transforms put it in the world, at its earliest time or at
    `time`. ``metersPerUnit`` and ``upAxis`` become the ``units`` and ``up`` of the mesh and change
    nothing else; where a file has none, None does not mean USD's fallback of centimetres and Y.
    Instances are read where they stand, those of point instancers too, in the place of the
    instancer and ordered by prototype; those that it hides are not. Faces of a mesh that is
    left-handed or mirrored are turned around, keeping their first corner. Creases, corners, holes
    and the attributes ``subdivisionScheme``, ``interpolateBoundary`` and
    ``triangleSubdivisionRule`` are read; where a file has none of the latter they are left open, as
    None: USD's defaults are those of ``LimitSurface``. The scheme is kept by name, also "loop",
    "bilinear" and "none" (a mere polygon mesh), and "mixed" where meshes have several; to subdivide
    such a mesh by Catmull-Clark all the same, name that scheme to ``LimitSurface``. Where meshes
    differ in the other choices these are left open, with a warning. Of an edge that is creased
    twice the last sharpness holds.

    Primvars of floats and vectors become channels by the same name, ``primvars:st`` the channel
    "st": "faceVarying" ones with the interpolation of ``faceVaryingLinearInterpolation`` (where
    they are not indexed, every face corner has a value of its own); "vertex" ones with "none",
    which is as smooth as the points; "varying" ones, which are linear, with "all". Where one of
    several meshes has no such primvar, the channel is NaN on its faces; where they differ in
    interpolation, that of most corners holds. Other primvars, materials, skeletons and shapes that
    are no meshes have no place in a cage, which a warning says. Normals are ignored.

    **Data of faces.** Groups, objects and materials of OBJ are the ``face_data`` "group", "object"
    and "material", a name for each face, "" before the first; in files of VTK data of cells are. In
    USD they are "uniform" primvars by their names; subsets of faces, a text by the name of their
    family ("subset" without one), or truth values by their own names where they overlap; and
    "material", names of materials that are bound. Where several meshes become one, those without
    such data have "", 0 or NaN, and "object" is the name of the prim that each face is from, or its
    path where several have that name. COLLADA has objects as well; other formats have no such
    data, or they are left out with a warning.
    `selected` makes a cage of the faces that have some value.

    **Rhino** (``.3dm``). SubD objects and meshes that are shown become one cage, with "object" and
    "layer" of each face; of another scheme than "catmull-clark" are the meshes. Creases and corners
    are infinitely sharp, sharp edges semi-sharp. Blocks and surfaces (NURBS) are left out.

    **Gmsh** (``.msh`` 2.2 and 4.1, text and binary). Of elements the triangles and quadrilaterals
    are read, of higher order their corners; "group" is the name, or else the number, of the first
    physical group of each. Lines and volumes are left out.

    **glTF, DAE, 3MF** say in which units and with which axis up they are (glTF: metres, Y), which
    become the ``units`` and ``up`` of the mesh. Strips and fans of glTF become triangles, morphs
    are at rest, and glTF 1 is read as glTF 2 is.

    Parameters
    ----------
    file : str, os.PathLike or binary file
        A path; or what is open for reading, such as ``sys.stdin.buffer``, together with `suffix`.
    suffix : str, optional
        Such as ".obj", in place of that of the path; upper or lower case.
    prim : str, optional
        Of a USD file, the path of one prim such as "/World/hand": only it, if it is a mesh, or
        else the meshes below it are read.
    time : float, optional
        Of a USD file, the frame to read, as a time code; by default the earliest that each
        attribute has. Between samples USD interpolates.
    merge : bool or float, optional
        Whether vertices at one place become one, as by `merged`: True those of equal coordinates, a
        number those no farther apart than that. By default only where a format repeats vertices
        along seams (STL, glTF, DAE, 3MF, and texture coordinates of PLY, OFF and VTK), and a
        warning says where edges of the cage meet without being joined.
    strict : bool
        Whether damage is an error. Otherwise what can be read is read, and a warning says what was
        left out or mended, and where.

    Returns
    -------
    Mesh

    Raises
    ------
    MeshError
        Anything malformed or truncated that leaves no mesh to read, and with `strict` any damage,
        with the file's name, line or prim where there is one, and what was expected; a USD file
        without a mesh, or with so many instances that they make more than 50 million face corners;
        a file whose reading takes more memory or time than its limits.
    ValueError
        An unknown suffix; a prim that does not exist, or one of a file that is not USD; a time that
        is no number, or one of a file that is not USD; a format that needs a path, from what is
        open; a `merge` that is negative.
    OSError
        A file that cannot be read, or a pipe that nobody opens for writing within 20 s.
    MemoryError
        A pipe or device whose content takes more than a quarter of the memory available.
    ImportError
        A library that is needed and not installed.

    Warns
    -----
    UserWarning
        What is left out or mended, once for each kind, with the first line or prim, and how often;
        a statement or a tag of an OBJ file that is not known, and therefore ignored; meshes that
        differ in their choices or channels; boundary edges that lie on others; faces that lose
        corners as vertices are joined; anything that USD warns of, such as a reference to a
        file that does not exist.

    Examples
    --------
    >>> import limitsurf as ls, pathlib, tempfile
    >>> text = "v 0 0 0\\nv 1 0 0\\nv 1 1 0\\nv 0 1 0\\nf 1 2 3 4\\nt corner 1/1/0 0 2.5"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "square.obj")
    ...     length = path.write_text(text)
    ...     ls.read(path)
    Mesh(4 vertices, 4 edges, 1 face {4: 1}, 4 boundary vertices, 1 corner)
    """
    tolerance = checked(merge)
    name, kind = _named(file, suffix, "<stdin>")
    library = None if kind in formats.READABLE else formats.library(kind)
    if kind not in formats.READABLE and library is None:
        known = ", ".join(formats.READABLE)
        raise ValueError(
            f"{name}: unknown suffix {kind!r}, need one of {known}, "
            f"or another that the installed trimesh or PyVista reads{formats.detour(kind)}"
        )
    is_usd = kind in (*formats.USD, ".usdz")
    if prim is not None and not is_usd:
        raise ValueError(f"{name}: got prim {prim!r}, but only a USD file has some")
    if time is not None and not is_usd:
        raise ValueError(f"{name}: got time {time!r}, but only a USD file has frames that are read")
    if time is not None and not (isinstance(time, (int, float)) and math.isfinite(time)):
        raise ValueError(f"time: got {time!r}, need a finite number, the time code of a frame")
    options = {"prim": prim, "time": time} if is_usd else {}
    try:
        if kind in _PARSERS:
            found = _PARSERS[kind](name, _content(file, name, kind), strict=strict)
        else:
            with _on_disk(file, name, kind, library) as (path, folder):
                call = formats.read_by_library
                found = call(name, kind, path, folder, strict=strict, **options)
        if tolerance is not None:
            losses = Losses(name, strict=False)
            found = joined(found, tolerance, losses)
            losses.warn(2)
        elif merge is None:
            warn_if_apart(name, found)
        return found
    except MeshError as error:
        if str(error).startswith(name):
            raise
        raise MeshError(f"{name}: {error}") from None


def frames(
    file: Path, *, prim: str | None = None, times: Iterable[float] | None = None
) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """The points of a cage in each frame of an animation, one frame after the other.

    Parameters
    ----------
    file : str or os.PathLike
        A USD file, or a glTF file (``.glb``, ``.gltf``) with morph targets or nodes that move: of
        several animations the first. Skeletons are not read.
    prim : str, optional
        As for `read`.
    times : iterable of float, optional
        Frames, as time codes in USD, in seconds in glTF; by default all at which points, weights or
        transforms are given, or 0 where nothing moves. Between them USD interpolates, and glTF
        says how.

    Returns
    -------
    iterator of (time, points (n_vertices, 3))
        As ``read(file, prim=prim, time=time).points`` has them; of glTF, the points of the cage
        ``read(file)``, each moved as the first of those that it joins. A file is read once, or as
        often as frames fill 32 MiB.

    Raises
    ------
    MeshError
        Faces that change from frame to frame, and whatever `read` raises.
    ValueError
        A file of another format, at once; the others when frames are asked for.

    Examples
    --------
    One surface is built, and moved, since nothing but points changes:

    >>> import limitsurf as ls
    >>> def heights(path):
    ...     surface = ls.LimitSurface(ls.read(path))
    ...     for time, points in ls.frames(path):
    ...         yield time, surface.with_points(points).evaluate(0, 0.5, 0.5)[2]
    """
    name, kind = _named(file, None, "")
    if kind not in (*formats.USD, ".usdz", ".glb", ".gltf"):
        raise ValueError(f"{name}: only USD and glTF files have frames that are read")
    return _frames(name, kind, file, prim, None if times is None else [float(x) for x in times])


def _frames(
    name: str, kind: str, file: Path, prim: str | None, left: list[float] | None
) -> Iterator[tuple[float, NDArray[np.float64]]]:
    """Frames of a file as they are asked for; of all times if none are `left`."""
    first: dict[str, Any] | None = None
    while left is None or left:
        with warnings.catch_warnings(), _on_disk(file, name, kind, None) as (path, folder):
            if first is not None:  # what is said of a file is said once
                warnings.simplefilter("ignore")
            found = formats.read_by_library(
                name, kind, path, folder, call="frames", prim=prim, times=left
            )
        first = first or found
        same = (np.array_equal(found[x], first[x]) for x in ("sizes", "indices"))
        if not all(same) or found["points"][0].shape != first["points"][0].shape:
            text = f"{name}: at time {found['times'][0]:g} its faces are others than before"
            raise MeshError(text)
        yield from zip(found["times"], found["points"], strict=False)
        left = found["times"][len(found["points"]) :]


def schemes(
    file: Path | IO[bytes],
    *,
    suffix: str | None = None,
    prim: str | None = None,
    time: float | None = None,
) -> dict[str, str]:
    """The scheme of each mesh of a USD file by its path; arguments are those of `read`."""
    name, kind = _named(file, suffix, "<stdin>")
    with _on_disk(file, name, kind, None) as (path, folder):
        found: dict[str, str] = formats.read_by_library(
            name, kind, path, folder, call="schemes", prim=prim, time=time
        )
        return found


def _content(file: Path | IO[bytes], name: str, kind: str) -> bytes:
    """The bytes of a file."""
    with ExitStack() as stack:
        if isinstance(file, (str, bytes, os.PathLike)):
            file = stack.enter_context(files.opened(name))
        data = b"".join(files.blocks(file, name))
    if not data and kind != ".obj":
        raise MeshError(f"{name}: the file is empty")
    return data


@contextmanager
def _on_disk(
    file: Path | IO[bytes], name: str, kind: str, library: str | None
) -> Iterator[tuple[str, str | None]]:
    """The path of a regular file with the same content, and the folder of those that it names."""
    is_usd = kind in (*formats.USD, ".usdz")
    with ExitStack() as stack:
        path, folder = os.path.abspath(name), None
        if isinstance(file, (str, bytes, os.PathLike)):
            folder = os.path.dirname(path)
            file = stack.enter_context(files.opened(name))
        # USD takes the format from the name of a path
        suited = not is_usd or os.path.splitext(name)[1].lower() == kind
        if folder is None or not (suited and os.path.isfile(name)):
            if library == "pyvista":
                text = f"{name}: files of type {kind} are read from a path, not from a pipe"
                raise ValueError(text)
            path = os.path.join(stack.enter_context(tempfile.TemporaryDirectory()), f"mesh{kind}")
            with open(path, "wb") as copy:
                copy.writelines(files.blocks(file, name))
        if not os.path.getsize(path) and not is_usd:
            raise MeshError(f"{name}: the file is empty")
        yield path, folder


def write(
    file: Path | IO[bytes],
    x: Mesh | Tessellation | BezierExtraction | Solid,
    *,
    suffix: str | None = None,
    unit: str = "mm",
    check: bool = False,
    colors: Any = None,
    **how: Any,
) -> None:
    """Write a cage, a tessellation, or a surface as a solid to a file, in the format of its suffix.

    The file appears whole or not at all. For precision and what it keeps of a cage:

    =====================  =========  ========================================  ============
    suffix                 numbers    of a cage                                 needs
    =====================  =========  ========================================  ============
    ``.obj``               float64    all but channels beside "uv"              nothing
    ``.usd .usda .usdc``   float32    everything                                ``[usd]``
    ``.ply``               float64    polygons, "uv"                            nothing
    ``.off``               float64    polygons                                  nothing
    ``.stl``               float32    triangles                                 ``[formats]``
    ``.vtp .vtu .vtk``     float64    polygons, "uv" (float32)                  ``[plot]``
    ``.glb .gltf``         float32    triangles, "uv"                           ``[formats]``
    ``.dae``               7 digits   triangles, "uv"                           ``[formats]``
    ``.3mf``               decimal    triangles                                 ``[formats]``
    =====================  =========  ========================================  ============

    ``.step``, ``.stp``, ``.iges``, ``.igs`` and ``.brep`` hold surfaces, see **CAD** below.

    Data of faces (``mesh.face_data``) are in files of VTK; in USD texts are subsets, in a family by
    the name of the data, numbers uniform primvars; in OBJ there are those called "object", "group"
    and "material", if they are texts of one line. "Triangles" means that larger faces are cut, as
    those of `Tessellation.triangles` are. To cut those of a cage changes its limit surface, which a
    warning says. In float32 and in 7 digits, points of a mesh that is small or far from the origin
    may become equal, which a warning says too.

    Of a tessellation all but OFF, STL and 3MF hold the normals and texture coordinates as well. OBJ
    has them by corner, USD too; the other formats by point, of which there are then several at
    creases and seams, as in `Tessellation.split`. Normals that do not exist (NaN) are those of the
    polygons around in a file. Texture coordinates are the channel "uv", or "st" if there is none,
    or else the only one of two numbers; USD has all channels, and so have files of VTK, as data of
    points. What a format has no place for, such as other channels, normals, creases or units, is
    left out with a warning. The places of points on the surface (`face`, `u`, `v`) and the parents
    of a refined mesh are in no file.

    USD states the ``units`` and ``up`` of a mesh. glTF and DAE are in metres with Y up, 3MF in
    millimetres with Z up: points are scaled and turned to be so, as far as the mesh says what it
    is in. The other formats have no place for either.

    **OBJ.** Coordinates are written as the shortest decimals that give the same float64; exact ones
    (Fractions and their like) are rounded to float64 first. Tags are written as OpenSubdiv's, the
    channel "uv" as texture coordinates, a scheme's name as a tag of our own, ``t scheme 0/0/1``.

    **USD.** The mesh is the prim ``/mesh``; ``.usda`` is text, ``.usdc`` and ``.usd`` are binary.
    Points, sharpness and the values of channels are rounded to float32, which is what USD keeps
    them in: the mesh read back is equal up to that. Channels become primvars by the same name.
    USD knows "uniform" creasing alone: another one is kept in custom data, where ``read`` finds it
    but other programs do not.

    **CAD** (with ``pip install "limitsurf[cad]"``). Surfaces, `BSplineFaces` and shapes of
    OpenCASCADE (or of cadquery and build123d, which have one as ``wrapped``) are written as they
    are: numbers unchanged, in millimetres if `unit` says nothing else. Of a surface all options of
    `to_brep` are taken, faces are named by those of the cage, and in STEP the header tells how far
    the file may be from the limit.

    **NPZ.** Operators of Bezier extraction are arrays by the names of `BezierExtraction`, those of
    what remains with ``rest_`` before, and version, degree and tensor.

    Parameters
    ----------
    file : str, os.PathLike or binary file
        A path; or what is open for writing, such as ``sys.stdout.buffer``, together with `suffix`.
    x : Mesh, Tessellation, BezierExtraction, LimitSurface, BSplineFaces or TopoDS_Shape
        Points of shape (n_vertices, 3). Operators of float64, to ".npz"; the last three to files of
        CAD systems.
    suffix : str, optional
        Such as ".obj", in place of that of the path; upper or lower case.
    unit : {"mm", "cm", "m", "km", "um", "in", "ft"}
        Of files of CAD systems, what their numbers are said to be.
    check : bool
        Whether such a file is read again first, and is an error if that is no valid shape.
    colors : str or array_like, optional
        Of a surface, colours in STEP and IGES: data of its faces or a channel by name, or
        (n_faces, 3) numbers, in [0, 1] or integers up to 255.
    **how
        Of a surface, what `to_brep` takes: ``solid``, ``tolerance``, ``depth`` and others.

    Raises
    ------
    ValueError
        An unknown suffix; a file that `check` finds fault with; points that are not of shape
        (n_vertices, 3) or too large for the format; a tessellation without polygons; in OBJ a
        name of a scheme of several words; in USD a scheme other than "catmull-clark", "loop",
        "bilinear" and "none", channels with a name that is no identifier, or of shapes other than
        (k,), (k, 2), (k, 3) and (k, 4).
    OSError
        A file that cannot be written.
    ImportError
        A library that is needed and not installed.

    Warns
    -----
    UserWarning
        What of a cage or tessellation the format cannot hold, as a scheme of your own; in USD seams
        of several interpolations, or several schemes; faces of a cage that are cut into triangles;
        how many distinct points become equal as they are rounded for the file.

    Examples
    --------
    >>> import limitsurf as ls, pathlib, tempfile
    >>> triangle = ls.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], boundary="edge_only")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ls.write(pathlib.Path(folder, "triangle.obj"), triangle)
    ...     ls.read(pathlib.Path(folder, "triangle.obj")) == triangle
    True
    """
    name, kind = _named(file, suffix, "<stdout>")
    _check(name, kind, x, {"unit": unit, "check": check, "colors": colors, **how})
    try:
        if kind in formats.CAD:
            from limitsurf.shell.io import step

            options: Any = {"unit": unit, "check": check, "colors": colors, "how": how}
            content: Any = step.content(name, kind, x, **options)
        else:
            content = _cage_content(name, kind, x)
        if not isinstance(file, (str, bytes, os.PathLike)):
            _write(file, content, kind == ".obj")
            return
        with replacing(name) as opened:
            _write(opened, content, kind == ".obj")
    except OSError as error:
        if error.filename is not None:
            raise
        if error.errno is None:
            raise OSError(f"{name}: {error}") from None
        raise type(error)(error.errno, error.strerror, name) from None
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _check(name: str, kind: str, x: Any, how: dict[str, Any]) -> None:
    """Refuse a format, or what it cannot hold, by its suffix."""
    if kind in formats.CAD:
        return
    usual = {"unit": "mm", "check": False, "colors": None}
    if said := sorted(key for key in how if key not in usual or how[key] is not usual[key]):
        known = ", ".join(formats.CAD)
        raise TypeError(f"{name}: {', '.join(said)}: of files of CAD systems alone, {known}")
    arrays = kind == ".npz" and hasattr(x, "operators")
    if kind not in formats.WRITABLE and not arrays:
        known = ", ".join((*formats.WRITABLE, *formats.CAD))
        raise ValueError(f"{name}: unknown suffix {kind!r}, need one of {known}")
    if not isinstance(x, Mesh) and not hasattr(x, "normal_indices") and not arrays:
        raise no_polygons(x)


def _cage_content(name: str, kind: str, x: Any) -> Any:
    """The bytes, or for OBJ the text, of a file of a cage, a tessellation or operators."""
    if kind == ".npz":
        return extraction.content(x)
    if kind == ".obj":
        content = obj.statements(x)
        warn_of_loss(name, kind, x, uv=True, tags=True, data=obj.named(x))
        return content
    if kind in formats.USD:
        found = _usd().content(x, kind)
        points = float_points(x) if isinstance(x, Mesh) else x.points
        warn_of_rounding(name, kind, x, points, points.astype(np.float32))
        return found
    return _content_of(name, kind, x)


def _content_of(name: str, kind: str, x: Mesh | Tessellation) -> Iterator[bytes]:
    """The bytes of a file that holds polygons only."""
    every = kind in formats.WITH_CHANNELS and not isinstance(x, Mesh)
    kept = polygons(x, uv=kind in formats.WITH_UV, every=every)
    shape = formats.placed(kept, kind, x)
    if kind in formats.TRIMESH and np.abs(shape.points).max() > np.finfo(np.float32).max:
        raise ValueError(f"a coordinate is beyond float32, in which a file of type {kind} keeps it")
    held = {"uv": kind in formats.WITH_UV, "normals": kind in formats.WITH_NORMALS}
    held |= {"every": every}
    data = x.face_data if kind in formats.VTK else ()
    warn_of_loss(name, kind, x, **held, loose=kind not in (".stl", ".dae"), data=data)
    if kind in formats.TRIMESH:
        shape = without_gaps(name, kind, shape)
        warn_of_cuts(name, kind, x)
        warn_of_rounding(name, kind, x, shape.points, by_trimesh.rounded(kind, shape.points))
    if kind in (".off", ".ply"):
        return off.content(shape) if kind == ".off" else ply.content(shape.split())
    return vtk.content(shape, kind) if kind in formats.VTK else by_trimesh.content(shape, kind)


def _write(file: IO[bytes], content: Any, text: bool) -> None:
    if not text:
        file.writelines(content)
        return
    wrapped = TextIOWrapper(file, encoding="utf-8", newline="", write_through=False)
    try:
        wrapped.writelines(content)
        wrapped.flush()
    finally:
        wrapped.detach()


def _usd() -> Any:
    from limitsurf.shell.io import usd

    return usd


def _named(file: Path | IO[bytes], suffix: str | None, unnamed: str) -> tuple[str, str]:
    """The name of a file, for messages, and its suffix."""
    if isinstance(file, (str, bytes, os.PathLike)):
        name = os.fsdecode(file)
    elif hasattr(file, "read") or hasattr(file, "write"):
        given = getattr(file, "name", None)
        name = given if isinstance(given, str) else unnamed
    else:
        raise TypeError(f"need a path or an open binary file, got {type(file).__name__}")
    kind = os.path.splitext(name)[1] if suffix is None else suffix
    return name, kind.lower()
