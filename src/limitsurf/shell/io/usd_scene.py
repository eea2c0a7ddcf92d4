"""Which meshes of a USD stage are shown, and where, those of point instancers included."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Tf, Usd, UsdGeom

from limitsurf.cage.checks import MeshError
from limitsurf.shell.io.apart import MEMORY_PER_BYTE, allow
from limitsurf.shell.io.losses import LocatedError, Losses, first_of
from limitsurf.shell.io.usd_values import numbers_of, one_line

Array: TypeAlias = NDArray[np.float64]

MOST_CORNERS = 5 * 10**7  # of faces, that point instancers may make
BYTES_A_CORNER = 1024  # what it takes to make a mesh of them, in memory of this process
# prototypes may stand below what is a mere "over", where nothing is shown in place
PROTOTYPES = Usd.TraverseInstanceProxies(
    Usd.PrimIsActive & Usd.PrimIsLoaded & Usd.PrimHasDefiningSpecifier & ~Usd.PrimIsAbstract
)
HIDDEN = (UsdGeom.Tokens.proxy, UsdGeom.Tokens.guide)


@dataclass
class Traversal:
    """What a traversal of a stage, or of what is at or below a prim, finds.

    Attributes
    ----------
    placed : list of (prim, (n, 4, 4) float64)
        Each mesh that is shown, with the matrices that put its points, as rows, into the world: one
        of its own, or several by point instancers.
    others : {str: list of path}
        What is shown besides, by type.
    """

    time: Any
    losses: Losses
    placed: list[tuple[Any, Array]] = field(default_factory=list)
    others: dict[str, list[str]] = field(default_factory=dict)
    corners: int = 0

    @cached_property
    def _transforms(self) -> Any:
        return UsdGeom.XformCache(self.time)

    def _local(self, prim: Any) -> tuple[Any, bool]:
        """The transform of a prim in its parent, and whether it is in the world instead."""
        try:
            matrix, resets = self._transforms.GetLocalTransformation(prim)
        except Tf.ErrorException as error:
            self.losses.add("transform", str(prim.GetPath()), one_line(error.args[0]))
            return Gf.Matrix4d(1), False
        return matrix, resets

    def _place(self, prim: Any, root: Any) -> Any:
        """The transform of a prim in another one above it."""
        chain = []
        while prim != root:
            matrix, resets = self._local(prim)
            chain.append(matrix)
            if resets:
                break
            prim = prim.GetParent()
        place = Gf.Matrix4d(1)
        for matrix in reversed(chain):
            place = matrix * place
        return place

    def add(self, root: Any) -> None:
        """All that is shown at or below a prim, which itself is shown in any case."""
        prims = Usd.PrimRange(root, Usd.TraverseInstanceProxies())
        for prim, is_instancer in self._found(prims):
            if prim == root or self._is_shown(prim):
                world = np.array(self._place(prim, prim.GetStage().GetPseudoRoot()))[None]
                if is_instancer:
                    self._instances(prim, world, ())
                else:
                    self.placed.append((prim, world))

    def reserve_memory(self) -> None:
        """Let this process make a mesh of all that is placed, however small the file is."""
        corners = sum(
            _length(prim, "faceVertexIndices", self.time) * len(places)
            for prim, places in self.placed
        )
        if corners <= MOST_CORNERS:
            allow(corners * BYTES_A_CORNER // MEMORY_PER_BYTE)

    def _found(self, prims: Any) -> Iterator[tuple[Any, bool]]:
        """Meshes and point instancers, and whether it is one of the latter; others are noted."""
        prims = iter(prims)
        for prim in prims:
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()  # its prototypes, which are nowhere themselves
                yield prim, True
            elif prim.IsA(UsdGeom.Mesh):
                yield prim, False
            elif prim.IsA(UsdGeom.Gprim) and self._is_shown(prim):
                self.others.setdefault(prim.GetTypeName(), []).append(str(prim.GetPath()))

    def _is_shown(self, prim: Any) -> bool:
        image = UsdGeom.Imageable(prim)
        visible = image.ComputeVisibility(self.time) != UsdGeom.Tokens.invisible
        return visible and image.ComputePurpose() not in HIDDEN

    def _is_shown_below(self, prim: Any, root: Any) -> bool:
        """Whether nothing from a prim up to the root of its prototype hides it."""
        if UsdGeom.Imageable(prim).ComputePurpose() in HIDDEN:
            return False
        while True:
            image = UsdGeom.Imageable(prim)
            if image and image.GetVisibilityAttr().Get(self.time) == UsdGeom.Tokens.invisible:
                return False
            if prim == root:
                return True
            prim = prim.GetParent()

    def _instances(self, instancer: Any, outer: Array, around: tuple[str, ...]) -> None:
        """What a point instancer shows, which itself stands at some matrices (m, 4, 4).

        `around` are the instancers that it is a prototype of.
        """
        path = str(instancer.GetPath())
        if path in around:
            self.losses.add("cycle", path, "the point instancer is its own prototype")
            return
        targets = UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetTargets()
        roots = [instancer.GetStage().GetPrimAtPath(target) for target in targets]
        below = [self._below(root) if root else [] for root in roots]
        try:
            prototype, shown = self._chosen(instancer, path, len(roots))
            chosen = np.bincount(prototype[shown], minlength=len(roots))
            corners = [
                sum(
                    _length(prim, "faceVertexIndices", self.time)
                    for prim, other in prims
                    if not other
                )
                for prims in below
            ]
            self._reserve(path, int(chosen.sum()), int(chosen @ corners), len(outer))
            matrices = self._matrices(instancer, path, prototype, shown)
        except LocatedError:
            raise
        except MeshError as error:
            self.losses.add("instancer", path, str(error), "the point instancer is left out")
            return
        for number, root in enumerate(roots):
            some = matrices[prototype[shown] == number]
            if not root:
                text = f"there is no prim {targets[number]} for prototype {number}"
                self.losses.add("prototype", path, text, f"{len(some)} instances are left out")
                continue
            if not len(some):
                continue
            with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
                own = np.array(self._local(root)[0])
                placed = (own @ some @ outer[:, None]).reshape(-1, 4, 4)
                for prim, is_instancer in below[number]:
                    world = np.array(self._place(prim, root)) @ placed
                    if is_instancer:
                        self._instances(prim, world, (*around, path))
                    else:
                        self.placed.append((prim, world))

    def _below(self, root: Any) -> list[tuple[Any, bool]]:
        """Meshes and point instancers of a prototype, as `_found` has them, that are shown."""
        found = self._found(Usd.PrimRange(root, PROTOTYPES))
        return [(prim, other) for prim, other in found if self._is_shown_below(prim, root)]

    def _reserve(self, path: str, instances: int, corners: int, times: int) -> None:
        """Count instances, and the corners of faces that they make, and refuse too many."""
        number = times * max(instances, corners)
        if self.corners + number > MOST_CORNERS:
            before = f", after {self.corners} of others" if self.corners else ""
            raise LocatedError(
                f"{self.losses.name}, {path}: {times * instances} instances make {times * corners} "
                f"corners of faces{before}, which is more than {MOST_CORNERS} and too much for one "
                'cage: read a part of the stage, prim="PATH"'
            )
        self.corners += number

    def _chosen(
        self, instancer: Any, path: str, n_prototypes: int
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The prototype of each instance, and whether it is shown, both (n,).

        Raises
        ------
        MeshError
            Indices of prototypes that are none.
        """
        prototype = numbers_of(instancer, "protoIndices", self.time, "i")
        ids = self._of_instances(instancer, path, "ids", len(prototype), "i")
        shown = ~np.isin(
            np.arange(len(prototype)) if ids is None else ids, self._hidden_ids(instancer, path)
        )
        wrong = shown & ((prototype < 0) | (prototype >= n_prototypes))
        if wrong.any():
            first, more = first_of(np.flatnonzero(wrong))
            need = f"need 0 to {n_prototypes - 1}" if n_prototypes else "and there is none"
            text = f"instance {first} is of prototype {prototype[wrong][0]}, {need}{more}"
            self.losses.add("prototype index", path, text)
        return prototype, shown & ~wrong

    def _matrices(
        self, instancer: Any, path: str, prototype: NDArray[np.int64], shown: NDArray[np.bool_]
    ) -> Array:
        """The matrices of the instances that are shown, (n, 4, 4); `shown` loses some.

        Raises
        ------
        MeshError
            Positions that do not fit the prototypes.
        """
        n = len(prototype)
        positions = numbers_of(instancer, "positions", self.time, "f", (3,))
        if len(positions) != n:
            raise MeshError(f"positions: got {len(positions)}, need {n}, one for each protoIndices")
        turns = self._of_instances(instancer, path, "orientationsf", n, "f", (4,))
        if turns is None:
            turns = self._of_instances(instancer, path, "orientations", n, "f", (4,))
        scales = self._of_instances(instancer, path, "scales", n, "f", (3,))
        turns = np.array([[0.0, 0, 0, 1]]) if turns is None else turns[shown]
        scales = np.ones((1, 3)) if scales is None else scales[shown]
        matrices = np.zeros((int(shown.sum()), 4, 4))
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is left out
            matrices[:, :3, :3] = scales[:, :, None] * _rotations(turns)
        matrices[:, 3, :3] = positions[shown]
        matrices[:, 3, 3] = 1
        finite = np.isfinite(matrices).all(axis=(1, 2))
        if not finite.all():
            number = np.flatnonzero(shown)[~finite]
            first, more = first_of(number)
            self.losses.add("place", path, f"instance {first} stands at no finite place{more}")
            shown[number] = False
        return matrices[finite]

    def _of_instances(
        self, instancer: Any, path: str, name: str, n: int, kind: str, shape: tuple[int, ...] = ()
    ) -> Any:
        """What an attribute says of each instance (n, *shape), None where it says nothing."""
        if not instancer.GetAttribute(name):
            return None
        try:
            found = numbers_of(instancer, name, self.time, kind, shape)
            if len(found) not in (0, n):
                raise MeshError(f"{name}: got {len(found)}, need {n}, one for each instance")
        except MeshError as error:
            self.losses.add(name, path, str(error))
            return None
        return found if len(found) else None

    def _hidden_ids(self, instancer: Any, path: str) -> NDArray[np.int64]:
        """The ids of instances that are not shown."""
        inactive = instancer.GetMetadata("inactiveIds")
        listed_ids = inactive.ApplyOperations([]) if inactive is not None else []
        hidden = np.array(listed_ids, dtype=np.int64)
        try:
            invisible = numbers_of(instancer, "invisibleIds", self.time, "i")
        except MeshError as error:
            self.losses.add("invisibleIds", path, str(error))
            return hidden
        return np.concatenate([hidden, invisible])


def _length(prim: Any, attribute: str, time: Any) -> int:
    """How many numbers an attribute has."""
    value = prim.GetAttribute(attribute).Get(time)
    return len(value) if hasattr(value, "__len__") else 0


def _rotations(turns: Array) -> Array:
    """Rotations of rows, (n, 3, 3), by quaternions (n, 4) with their real part last.

    Those of length zero turn nothing.
    """
    length = np.linalg.norm(turns, axis=1, keepdims=True)
    x, y, z, w = (turns / np.where(length == 0, 1, length)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
