"""One mesh of UsdGeom as a cage, in its own coordinates; damage costs no more than it must."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from limitsurf.cage.checks import INTERPOLATION, Channel, MeshError
from limitsurf.cage.mesh import CREASING, Mesh, valid_mesh
from limitsurf.shell.io.losses import Losses, finite_points, first_of, tagged
from limitsurf.shell.io.polygons import IntArray
from limitsurf.shell.io.usd_faces import data_of_faces, is_of_faces
from limitsurf.shell.io.usd_values import numbers_of

# For each of our choices USD's attribute, and the meanings of its tokens; first the one that holds
# where a file says nothing.
CHOICES = {
    "scheme": (
        "subdivisionScheme",
        {
            "catmullClark": "catmull-clark",
            "loop": "loop",
            "bilinear": "bilinear",
            "none": "none",
        },
    ),
    "boundary": (
        "interpolateBoundary",
        {"edgeAndCorner": "edge_and_corner", "edgeOnly": "edge_only", "none": "none"},
    ),
    "triangles": (
        "triangleSubdivisionRule",
        {"catmullClark": "catmull-clark", "smooth": "smooth"},
    ),
}
TOKENS = ("none", "cornersOnly", "cornersPlus1", "cornersPlus2", "boundaries", "all")
LINEAR = ("faceVaryingLinearInterpolation", dict(zip(TOKENS, INTERPOLATION, strict=True)))
ORIENTATION = ("orientation", {"rightHanded": "", "leftHanded": "reversed"})
# USD knows one way of creasing, "uniform": ours is a note that other programs pass over.
CREASING_NOTE = "limitsurf:creasing"
# What primvars with a value for each point are as face-varying ones: without seams, "none" is as
# smooth as the points, with their creases and corners.
OF_POINTS = {"vertex": "none", "varying": "all"}
LARGEST = np.iinfo(np.int32).max  # count of what an array of USD describes


class Reader:
    """A mesh of a stage at a time; what is broken raises, other damage goes to the losses."""

    def __init__(self, prim: Any, time: Any, losses: Losses) -> None:
        self.prim, self.time, self.losses = prim, time, losses
        self.path = str(prim.GetPath())
        self.left_out: list[str] = []  # sound primvars and the like, of which a cage has none

    def fail(self, message: str) -> NoReturn:
        """Refuse the mesh, or what `kept` looks for."""
        raise MeshError(message)

    def lost(self, kind: str, message: str, done: str = "left out") -> None:
        """Note damage of this prim, as `Losses.add` does."""
        self.losses.add(kind, self.path, message, done)

    def array(self, attribute: str, kind: str, shape: tuple[int, ...] = ()) -> NDArray[Any]:
        """As `numbers_of`, of this prim."""
        found: NDArray[Any] = numbers_of(self.prim, attribute, self.time, kind, shape)
        return found

    def kept(self, kind: str, find: Callable[[], Any]) -> Any:
        """What is found, or None if that is damaged, which is noted."""
        try:
            return find()
        except MeshError as error:
            self.lost(kind, str(error))
            return None

    def choice(self, attribute: str, meanings: dict[str, str]) -> str | None:
        """What the token of an attribute means, None where the file has none."""
        if not self.prim.GetAttribute(attribute).HasAuthoredValue():
            return None
        token = self.prim.GetAttribute(attribute).Get(self.time)
        if token is None:
            return None
        if not isinstance(token, str) or token not in meanings:
            need = ", ".join(meanings)
            self.lost(attribute, f"{attribute}: got {token!r}, need one of {need}")
            return None
        return meanings[token]

    def is_left_handed(self) -> bool:
        """Whether faces go round the other way."""
        return self.choice(*ORIENTATION) == "reversed"

    def mesh(self) -> Mesh:
        """In the coordinates of the prim, with its faces as they are.

        Raises
        ------
        MeshError
            No faces or points, or such that make no mesh.
        """
        points = self.array("points", "f", (3,))
        sizes, indices = self.faces()
        if len(points) == 0:
            self.fail("need at least one of its points, got none")
        points = finite_points(points, indices, self._unused)
        enclosing = np.repeat(sizes > 2, sizes)  # corners of faces that enclose something
        kept = Mesh(points, (sizes[sizes > 2], indices[enclosing]))
        options: dict[str, Any] = {option: self.choice(*CHOICES[option]) for option in CHOICES}
        creasing = self.prim.GetCustomDataByKey(CREASING_NOTE)
        if creasing not in CREASING[1:]:
            if creasing is not None:
                need = ", ".join(map(repr, CREASING[1:]))
                self.lost("creasing", f"creasing: got {creasing!r}, need one of {need}")
            creasing = None
        channels = dict(self.channels(len(points), indices, enclosing))
        data = data_of_faces(self.prim, self.time, len(sizes), self.lost)
        holes = self.kept("holes", lambda: self.array("holeIndices", "i"))
        self._look_around()
        return tagged(
            kept,
            self._untagged,
            creases=self.kept("creases", self.creases),
            corners=self.kept("corners", self.corners),
            holes=self._renumbered(holes, sizes),
            channels=channels,
            face_data={name: values[sizes > 2] for name, values in data.items()},
            creasing=creasing,
            **options,
        )

    def moved(self, before: Mesh) -> Mesh | None:
        """What `mesh` returns, of its points alone, where faces are what they were before."""
        points = self.array("points", "f", (3,))
        if len(points) != before.n_vertices:
            return None
        if not all(map(np.array_equal, self.faces(), (before.sizes, before.indices))):
            return None
        points = finite_points(points, before.indices, self._unused)
        return valid_mesh(Mesh, points, before.connectivity)

    def _look_around(self) -> None:
        """Note what else there is, of which a cage has none."""
        if self.prim.HasRelationship("skel:skeleton"):
            self.left_out.append("skeletons")
        prim = self.prim
        while prim:
            if prim.GetAuthoredPropertiesInNamespace("material"):
                self.left_out.append("materials")
                break
            prim = prim.GetParent()

    def _unused(self, number: IntArray, reason: str) -> None:
        first, more = first_of(number)
        self.lost("unused points", f"point {first}{reason}{more}", "put elsewhere")

    def _untagged(self, what: str, names: IntArray, reason: str) -> None:
        first, more = first_of(names)
        kind = f"{what} sharpness" if reason.startswith(": sharpness") else what
        self.lost(kind, f"{what} {first}{reason}{more}")

    def _renumbered(self, holes: IntArray | None, sizes: IntArray) -> IntArray | None:
        """Holes by the numbers of the faces that are kept; those out of range stay so."""
        small = np.flatnonzero(sizes < 3)
        if not len(small):
            return holes
        text = f"face {small[0]} has {sizes[small[0]]} corners, which enclose nothing"
        more = f"; {len(small) - 1} more like it" if len(small) > 1 else ""
        self.lost("small faces", text + more)
        if holes is None:
            return None
        holes = holes[~np.isin(holes, small)]
        inside = (holes >= 0) & (holes < len(sizes))
        before = np.cumsum(sizes < 3)[np.where(inside, holes, 0)]
        return np.where(inside, holes - before, holes)

    def faces(self) -> tuple[IntArray, IntArray]:
        """Sizes and indices that fit together."""
        sizes, indices = self.array("faceVertexCounts", "i"), self.array("faceVertexIndices", "i")
        if len(sizes) == 0:
            self.fail("need at least one of its faceVertexCounts, got none")
        wrong = np.flatnonzero((sizes < 0) | (sizes > LARGEST))
        if len(wrong):
            self.fail(f"face {wrong[0]} has {sizes[wrong[0]]} corners, need three or more")
        if sizes.sum() != len(indices):
            self.fail(
                f"faceVertexCounts add up to {sizes.sum()}, but there are {len(indices)} "
                "faceVertexIndices"
            )
        if sizes.max() < 3:
            self.fail(f"face 0 has {sizes[0]} corners, need three or more, and so have all others")
        return sizes, indices

    def creases(self) -> tuple[IntArray, NDArray[np.float64]]:
        """Edges (c, 2) and sharpness (c,)."""
        indices, lengths = self.array("creaseIndices", "i"), self.array("creaseLengths", "i")
        sharpness = self.array("creaseSharpnesses", "f")
        wrong = np.flatnonzero((lengths < 2) | (lengths > LARGEST))
        if len(wrong):
            self.fail(f"creaseLengths: crease {wrong[0]} has {lengths[wrong[0]]}, need two or more")
        if lengths.sum() != len(indices):
            self.fail(
                f"creaseLengths add up to {lengths.sum()}, but there are {len(indices)} "
                "creaseIndices"
            )
        n_edges = len(indices) - len(lengths)
        if len(sharpness) == len(lengths):
            sharpness = np.repeat(sharpness, lengths - 1)
        elif len(sharpness) != n_edges:
            self.fail(
                f"creaseSharpnesses: got {len(sharpness)}, need {len(lengths)}, one for each "
                f"crease, or {n_edges}, one for each edge"
            )
        is_start = np.ones(len(indices), dtype=bool)
        is_start[np.cumsum(lengths) - 1] = False
        start = np.flatnonzero(is_start)
        return np.stack([indices[start], indices[start + 1]], axis=1), sharpness

    def corners(self) -> tuple[IntArray, NDArray[np.float64]]:
        """Vertices and sharpness (c,)."""
        vertices = self.array("cornerIndices", "i")
        sharpness = self.array("cornerSharpnesses", "f")
        if len(vertices) != len(sharpness):
            self.fail(
                f"cornerSharpnesses: got {len(sharpness)}, need {len(vertices)}, one for each of "
                "cornerIndices"
            )
        return vertices, sharpness

    def channels(
        self, n_vertices: int, indices: IntArray, kept: NDArray[np.bool_]
    ) -> Iterator[tuple[str, Channel]]:
        """The primvars that vary on faces and are made of floats, on the corners that are kept."""
        seams = self.choice(*LINEAR) or "corners_plus1"
        for primvar in UsdGeom.PrimvarsAPI(self.prim).GetPrimvarsWithAuthoredValues():
            name, interpolation = primvar.GetName(), primvar.GetInterpolation()
            value = primvar.Get(self.time)
            if value is None or is_of_faces(primvar):  # nothing at this time, or data of faces
                continue
            values = np.array(value)
            if (
                interpolation not in ("faceVarying", *OF_POINTS)
                or primvar.GetElementSize() != 1
                or not primvar.GetTypeName().isArray
                or values.dtype.kind != "f"
                or values.ndim not in (1, 2)
            ):
                self.left_out.append(name)
                continue
            place = indices if interpolation in OF_POINTS else np.arange(len(indices))
            n = n_vertices if interpolation in OF_POINTS else len(indices)
            each = "point" if interpolation in OF_POINTS else "corner of a face"
            rows = self.kept(name, partial(self._rows, primvar, len(values), n, each))
            if rows is None:
                continue
            infinite = np.isinf(values)
            if infinite.any():
                row = np.flatnonzero(infinite.reshape(len(values), -1).any(axis=1))[0]
                self.lost(f"{name} infinite", f"{name}: value {row} is infinite", "NaN")
                values = np.where(infinite, np.nan, values)
            mode = OF_POINTS.get(interpolation, seams)
            if interpolation in OF_POINTS:
                values, rows = values[rows], np.arange(n_vertices)
            yield primvar.GetPrimvarName(), (values, rows[place][kept], mode)

    def _rows(self, primvar: Any, count: int, n: int, each: str) -> IntArray:
        """The row of its values, so many, that a primvar has for each of n points or corners."""
        name, what = primvar.GetName(), "values"
        rows = np.arange(count)
        if primvar.IsIndexed():
            rows, what = self.array(primvar.GetIndicesAttr().GetName(), "i"), "indices"
        if len(rows) != n:
            self.fail(f"{name}: got {len(rows)} {what}, need {n}, one for each {each}")
        wrong = np.flatnonzero((rows < 0) | (rows >= count))
        if len(wrong):
            self.fail(f"{name}: got index {rows[wrong[0]]}, need 0 to {count - 1}")
        return rows
