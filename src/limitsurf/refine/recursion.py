"""Recursive refinement: meshes that know what they were refined from."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, Self, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from limitsurf import _kernels, memory, numbers
from limitsurf._kernels import reference as kernels
from limitsurf.caching import cached_property
from limitsurf.cage.checks import checked_integer, users_level
from limitsurf.cage.connectivity import read_only
from limitsurf.cage.faces import IntArray
from limitsurf.cage.mesh import Boundary, Creasing, Mesh, Triangles, kept, valid_mesh
from limitsurf.channels import ChannelMesh, knows_mode
from limitsurf.refine import dual, interpolating, local_steps, turning
from limitsurf.refine.limits import face_normals, limit_normals, limit_points
from limitsurf.refine.masks import all_limit_normals, all_limit_points
from limitsurf.refine.operators import ExactOperator, identity, multiplied, stacked
from limitsurf.refine.stages import refined_values, refinement_stages
from limitsurf.refine.thirds import Thirds
from limitsurf.rules import RuledMesh, Rules, Sharpness
from limitsurf.topology import (
    all_regular,
    at_children,
    child_halves,
    child_mesh,
    children_of,
    first_limit_face,
    without_points,
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.scheme.lattice import Lattice
    from limitsurf.scheme.scheme import Scheme

Array = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]

_LITTLE = 1 << 24  # bytes, for which the system is not asked whether it has them


class RefinedMesh(RuledMesh):
    """A refined mesh that remembers where it came from.

    Attributes
    ----------
    parent_face, parent_u, parent_v : (n_vertices,)
        A limit face of the original mesh and the parameters in it whose limit each vertex
        approaches (float64; exact to 50 levels); -1 and NaN at unused vertices.

    Examples
    --------
    >>> import limitsurf as ls
    >>> fine = ls.refined(ls.Mesh([[0], [8], [8], [0]], [[0, 1, 2, 3]]))
    >>> place = fine.parent_face[8], fine.parent_u[8], fine.parent_v[8]
    >>> [x.item() for x in place], fine.limit_points[8].tolist()
    ([0, 0.5, 0.5], [4.0])
    """

    _lineage: tuple[Mesh, ...]  # from the cage to this mesh, without points
    _cage_rules: Rules  # of a dual scheme, by which the cage was refined
    _steps: tuple[Thirds, ...]  # where edges are turned: two each, of the cage first
    _levels: int
    rounded: bool  # whether the points come from refinement, and not from outside

    @cached_property
    def _parents(self) -> tuple[IntArray, Floats, Floats]:
        """Parent face and parameters, taken in a vertex's first face, one with a limit if any."""
        lattice = self.rules.scheme.lattice
        if lattice.dual:
            return read_only(dual.parents(self._lineage, self._cage_rules, lattice))
        if self.rules.scheme.turns_edges:
            cage = self._lineage[0]
            at = _cage_parameters(cage, lattice)
            lost = self.rules.without_limit(cage)
            return read_only(turning.parents(self._steps, *at, self._levels, lost))
        limit_face, uv = _cage_parameters(self._lineage[0], lattice)
        for mesh in self._lineage[:-1]:
            limit_face, uv = _child_parameters(mesh, limit_face, uv, lattice)
        face = np.full(self.n_vertices, -1)
        u, v = np.full((2, self.n_vertices), np.nan)
        without = self.rules.without_limit(self)[self.corner_face]
        # the last to be written stays
        for corners in (np.flatnonzero(without)[::-1], np.flatnonzero(~without)[::-1]):
            vertex = self.indices[corners]
            face[vertex] = limit_face[corners]
            u[vertex], v[vertex] = uv[corners].T
        return read_only((face, u, v))

    @property
    def parent_face(self) -> IntArray:
        """Limit face of the original mesh that each vertex is on."""
        return self._parents[0]

    @property
    def parent_u(self) -> Floats:
        """First parameter of each vertex in its limit face."""
        return self._parents[1]

    @property
    def parent_v(self) -> Floats:
        """Second parameter of each vertex in its limit face."""
        return self._parents[2]

    def __getstate__(self) -> dict[str, Any]:
        _ = self._parents
        return {name: x for name, x in super().__getstate__().items() if name != "_lineage"}

    @cached_property
    def limit_points(self) -> Array:
        """Limit positions of the vertices by limit masks, the shape of `points`.

        Exact rationals if the points are. NaN at vertices without a limit: unused ones, and those
        on untagged boundaries under boundary="none".
        """
        if self.rules.scheme.lattice.dual:
            return self._dual_limits()
        if self.rules.scheme.turns_edges:
            return self._turning_limits()
        if not self.rules.scheme.has_pieces:
            return interpolating.limit_points(self, self.rules)
        if self._wants_finer:
            finer = refined(self, **vars(self.rules))
            limits = finer._limits()  # noqa: SLF001  (one of these, too)
            return np.asarray(limits[: self.n_vertices])
        return self._limits()

    @property
    def _wants_finer(self) -> bool:
        """Whether limit masks hold after one more step only: amid regular faces and vertices."""
        scheme = self.rules.scheme
        if not scheme.has_pieces:  # cages have neighbourhoods of many kinds, refined ones of few
            return len(vars(self).get("_lineage", ())) < 2
        return callable(scheme.edge) or not all_regular(self, scheme.lattice)

    def _dual_limits(self) -> Array:
        """Limit positions under a dual scheme."""
        points, balance = _balanced(self.points.reshape(self.n_vertices, -1))
        result = dual.limits(self, self.rules, points)
        result = np.ldexp(result, -balance) if balance else result
        return np.asarray(result.reshape(self.points.shape))

    def _whole(self, points: Array) -> tuple[Thirds, Array]:
        """Steps of a mesh whose first vertices these are, and its points."""
        if self._levels % 2 == 0:
            return Thirds.of(self, self.rules), points
        half = self._steps[-1]
        operator = half.second(self.rules, numbers.type_of(points))
        return half.child, np.asarray(operator @ points)

    def _turning_limits(self) -> Array:
        """Limit positions under a scheme that turns edges."""
        points, balance = _balanced(self.points.reshape(self.n_vertices, -1))
        step, points = self._whole(points)
        result = turning.limits(step, self.rules, points)[: self.n_vertices]
        result[self.rules.loose_vertices(self)] = np.nan
        result = np.ldexp(result, -balance) if balance else result
        return np.asarray(result.reshape(self.points.shape))

    def _limits(self) -> Array:
        """Limit positions by the limit masks of what is at each vertex."""
        if self.rules.scheme.local:
            used = (self.vertex_faces > 0).reshape(-1, *(1,) * (self.points.ndim - 1))
            return np.where(used, self.points, np.nan)
        points, balance = _balanced(self.points.reshape(self.n_vertices, -1))
        rules, number = self.rules, numbers.type_of(points)
        if number.exact or not _kernels.compiled(self.n_corners, 20):
            sharpness = Sharpness.of(self, rules, number)
            result = limit_points(sharpness, rules, points, self.vertex_faces > 0)
            result[rules.loose_vertices(self)] = np.nan
        else:
            result = all_limit_points(self, rules, points)
        if balance:
            result = np.ldexp(result, -balance)
        return np.asarray(result.reshape(self.points.shape))

    @cached_property
    def limit_normals(self) -> Floats:
        """Unit limit normals by face corner, (n_corners, 3), by tangent masks.

        At creases the faces on each side have their own. NaN where no limit normal exists: at
        interior vertices and darts of valence 2, boundary and crease vertices with 5 or more faces
        on that side, sharp corners with 3 or more, sharp vertices amid smooth faces, faces at a
        crease that does not bound them; where vectors might be dependent within their rounding
        errors, those of refined points included; faces without a limit. Where the points of
        boundaries and creases coincide they are limits all the same. See `LimitSurface.normal`.

        Raises
        ------
        TypeError
            For points that are not float64 and three-dimensional.
        """
        if numbers.type_of(self.points).exact or self.points.shape[1:] != (3,):
            raise TypeError(
                "limit normals need points of shape (n, 3) in numbers that have square roots, "
                f"float64: got {self.points.dtype} {self.points.shape}"
            )
        if self.rules.scheme.lattice.dual:
            points = np.ldexp(self.points, kernels.balance(self.points))
            return np.asarray(dual.limit_normals(self, self.rules, points, self.rounded))
        if self.rules.scheme.turns_edges:
            return self._turning_normals()
        if self._wants_finer:
            finer = refined(self, **vars(self.rules))
            halves = child_halves(self.connectivity, None, self.rules.scheme.lattice)
            return np.asarray(finer._normals()[halves[0]])  # noqa: SLF001  (one of these, too)
        return self._normals()

    def _turning_normals(self) -> Floats:
        """Limit normals under a scheme that turns edges, at whichever face a corner is."""
        points = np.ldexp(self.points, kernels.balance(self.points))
        step, points = self._whole(points)
        rounded = self.rounded or self._levels % 2 == 1
        found = turning.limit_normals(step, self.rules, points, rounded)
        if self._levels % 2:
            found = found[turning.corners_of_halves(self._steps[-1])]
        found.reshape(-1, 3, 3)[self.rules.without_limit(self)] = np.nan
        return found

    def _normals(self) -> Floats:
        """Limit normals by the tangent masks of what is at each vertex."""
        rules, (points, _) = self.rules, _balanced(self.points)
        local = rules.scheme.local
        pieces = rules.scheme.has_pieces
        if pieces and not local and _kernels.compiled(self.n_corners, 60):
            return all_limit_normals(self, rules, points, self.rounded)
        # what refinement rounded; a cage is exact
        errors = kernels.largest(points)[:, 0] * self.rounded
        if not pieces:
            result = local_steps.limit_normals(self, rules, points, errors)
        elif local:
            result = face_normals(self, points, errors)
        else:
            sharpness = Sharpness.of(self, rules, numbers.FLOAT64)
            result = limit_normals(sharpness, rules, points, errors, self.vertex_faces > 0)
        size = rules.scheme.lattice.face_size
        result.reshape(-1, size, 3)[rules.without_limit(self)] = np.nan
        return result

    def with_points(self, points: numbers.Numbers) -> Self:
        """A copy with other points, (n_vertices, ...); limits are computed afresh."""
        mesh = super().with_points(points)
        for name in ("limit_points", "limit_normals"):
            vars(mesh).pop(name, None)
        vars(mesh)["rounded"] = False
        return mesh


@overload
def refined(
    mesh: Mesh,
    levels: int = 1,
    *,
    operator: Literal[False] = False,
    scheme: str | Scheme | None = None,
    boundary: Boundary | None = None,
    creasing: Creasing | None = None,
    triangles: Triangles | None = None,
) -> RefinedMesh: ...
@overload
def refined(
    mesh: Mesh,
    levels: int = 1,
    *,
    operator: Literal[True],
    scheme: str | Scheme | None = None,
    boundary: Boundary | None = None,
    creasing: Creasing | None = None,
    triangles: Triangles | None = None,
) -> tuple[RefinedMesh, csr_array[Any] | ExactOperator]: ...
def refined(
    mesh: Mesh,
    levels: int = 1,
    *,
    operator: bool = False,
    scheme: str | Scheme | None = None,
    boundary: Boundary | None = None,
    creasing: Creasing | None = None,
    triangles: Triangles | None = None,
) -> RefinedMesh | tuple[RefinedMesh, csr_array[Any] | ExactOperator]:
    """Refine a mesh recursively by its subdivision rules.

    Parameters
    ----------
    mesh : Mesh
        Points of shape (n_vertices, ...); objects (Fractions) are refined exactly.
    levels : int
        How often, 0 or more. Every level has four times as many faces, under "sqrt3" three times.
    operator : bool
        Whether to return also R with ``R @ mesh.points == fine.points``, of shape
        (fine.n_vertices, mesh.n_vertices): a ``csr_array``, or an `ExactOperator` if the points
        are objects.
    scheme, boundary, creasing, triangles
        As for `LimitSurface`: the argument, else the mesh's, else the default.

    Returns
    -------
    RefinedMesh or (RefinedMesh, operator)
        Its vertices are the vertex points, then the edge points in the order of ``mesh.edges``,
        then the face points; unused vertices are kept. Its faces are the children of each face in
        the order of its corners, with corner 0 at that corner, corner 1 the midpoint of the edge
        to the next one and corner 2 the face point. Schemes of triangles have no face points: child
        0, 1, 2 of a triangle has that corner, the midpoint of the edge to the next one and of that
        to the one before, and child 3 is in the middle, from the midpoint opposite to corner 0 on:
        inner edges of two triangles on the same three vertices join the same midpoints, and
        ``edges`` has them both. Dual schemes make a vertex of each corner of a face, and faces of
        faces, edges and vertices, in this order; the first step also makes points beyond
        boundaries, and the boundary of the refined mesh has no limit; vertices of no face are gone.
        "sqrt3" makes the middles of faces; from each corner on there is the face of it and the
        middles on both sides of the next edge, or at a boundary of that edge and the middle. After
        an even number of steps there are also two points on each edge, near its first end and near
        its second, and nine faces in each two steps before: three at the corners, three amid the
        edges, three between the middle and these. Refine the cage again, not what an odd number of
        steps has left: the boundary of that is due.
        Children of holes are holes, under dual schemes the faces of faces alone, and so are those
        of boundary faces under boundary="none".
        Under the butterfly schemes vertex points are the vertices, which are their own limits.
        Creases and corners carry their sharpness on, and channels are refined with their seams;
        under "sqrt3" those with seams after an even number of steps, else they are left out, with a
        warning. Dual schemes leave all out.
        It also has `parent_face`, `parent_u`, `parent_v`, `limit_points` and `limit_normals`.

    Raises
    ------
    ValueError
        For levels that are not an integer >= 0, or an unknown option.
    MeshError
        For other faces than triangles, if the scheme is of these.
    TypeError
        For exact points where masks are irrational, which need float64.
    MemoryError
        At once, for more faces than there is memory for; it says how many levels fit.

    Notes
    -----
    Rules: Catmull and Clark 1978; boundaries, creases and corners after DeRose, Kass and Truong
    1998. Boundary vertices follow the boundary curve, a cubic B-spline; under "edge_and_corner"
    those of a single face stay fixed. ``exact/creases.py`` has the table of all rules, also of
    non-manifold cages.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0], [4, 0], [4, 4], [0, 4]], [[0, 1, 2, 3]])
    >>> fine, R = ls.refined(square, operator=True)
    >>> fine.n_faces, R.shape
    (4, (9, 4))
    >>> fine.points[4:].tolist()
    [[2.0, 0.0], [0.0, 2.0], [4.0, 2.0], [2.0, 4.0], [2.0, 2.0]]
    """
    levels = checked_integer("levels", levels, 0)
    rules = Rules.resolve(mesh, scheme, boundary, creasing, triangles)
    refuse_levels(mesh, levels, operator, 3 if rules.scheme.turns_edges else 4)
    if rules.scheme.lattice.dual:
        return _dual_refined(mesh, levels, operator, rules, scheme)
    if rules.scheme.turns_edges:
        return _turning_refined(mesh, levels, operator, rules, scheme)
    number = numbers.type_of(mesh.points)
    points, balance = _balanced(mesh.points.reshape(mesh.n_vertices, -1))
    total = identity(mesh.n_vertices, number) if operator else None
    # decided once, so that all of a call is done in one way
    compiled = not number.exact and _kernels.compiled(_corners(mesh, levels), 10 if operator else 5)
    coarse, holes = mesh, np.flatnonzero(rules.without_limit(mesh))
    lattice = rules.scheme.lattice
    if levels:
        mesh.edges  # noqa: B018  (twins come with them, not the other way round)
    sharpness = Sharpness.of(mesh, rules, number)
    lineage = []
    for _ in range(levels):
        if operator:
            faces, vertices = refinement_stages(coarse, rules, sharpness, number, compiled)
            both = stacked([total, multiplied(faces, total, compiled)])
            total = multiplied(vertices, both, compiled)
        points = refined_values(coarse, rules, sharpness, points, compiled)
        holes = children_of(coarse, holes, lattice)
        lineage.append(without_points(coarse))
        finer = child_mesh(coarse, points, lattice)
        if number.exact:
            sharpness = sharpness.children(finer, lattice)
        else:
            later = partial(_later, mesh, sharpness, finer, lattice)
            sharpness = kept(coarse, "finer sharpness", rules, later).typed(finer, number)
            # what is kept of the finer mesh is kept by the cage: as few as there are sharp edges
            vars(finer)["_kept"] = kept(coarse, "finer", rules, dict)
        coarse = finer
    if balance:
        points = np.ldexp(points, -balance)
    channels = {
        name: _refined_channel(ChannelMesh.of(mesh, name, rules), levels, holes)
        for name in mesh.channels
    }
    fine = valid_mesh(
        RefinedMesh,
        points.reshape(len(points), *mesh.points.shape[1:]),
        coarse.connectivity,
        scheme=scheme if scheme is not None else mesh.scheme,
        boundary=boundary if boundary is not None else mesh.boundary,
        creasing=creasing if creasing is not None else mesh.creasing,
        triangles=triangles if triangles is not None else mesh.triangles,
        units=mesh.units,
        up=mesh.up,
    )
    # valid as they are made: no edge is looked for
    tags = partial(_tags, sharpness)
    vars(fine).update(tags() if number.exact else kept(coarse, "tags", rules, tags))
    data = {
        name: np.repeat(values, _descendants(mesh, levels, lattice), axis=0)
        for name, values in mesh.face_data.items()
    }
    own = {
        name: (channel.points, channel.indices, mesh.channels[name][2])
        for name, channel in channels.items()
    }
    holes = holes if levels else mesh.holes
    vars(fine).update(read_only({"holes": holes, "_channels": own, "_face_data": data}))
    bare = without_points(coarse)
    vars(fine).update(
        rules=rules,
        origin=(sharpness.typed(bare, number), False),
        channel_meshes=channels,
        _lineage=(*lineage, bare),
        rounded=levels > 0 or (isinstance(mesh, RefinedMesh) and mesh.rounded),
    )
    return (fine, total) if operator else fine


def _dual_refined(
    mesh: Mesh, levels: int, operator: bool, rules: Rules, scheme: Any
) -> RefinedMesh | tuple[RefinedMesh, Any]:
    """What `refined` returns under a dual scheme."""
    number = numbers.type_of(mesh.points)
    points, balance = _balanced(mesh.points.reshape(mesh.n_vertices, -1))
    total = identity(mesh.n_vertices, number) if operator else None
    if levels and mesh.channels:
        names = ", ".join(map(repr, mesh.channels))
        warnings.warn(
            f"channels are left out ({names}): scheme {rules.scheme.name!r} makes faces of edges "
            "and vertices, which channels do not go around as the mesh does",
            UserWarning,
            stacklevel=users_level(),
        )
    coarse, lineage, own = mesh, [], rules
    face = np.arange(mesh.n_faces)
    for _ in range(levels):
        step = dual.Step.of(coarse, own)
        face = face[step.parent]
        if total is None:
            points = dual.refined_points(step, own, points)
        else:
            matrix = step.operator(own, number)
            points, total = matrix @ points, matrix @ total
        lineage.append(without_points(coarse))
        # what lies beyond a boundary has no limit of its own
        coarse, own = step.child(points), replace(own, boundary="none")
    points = np.ldexp(points, -balance) if balance else points
    fine = valid_mesh(
        RefinedMesh,
        points.reshape(len(points), *mesh.points.shape[1:]),
        coarse.connectivity,
        scheme=scheme if scheme is not None else mesh.scheme,
        boundary=own.boundary if levels else mesh.boundary,
        holes=mesh.holes,
        channels=None if levels else mesh.channels,
        face_data={name: values[face] for name, values in mesh.face_data.items()},
        units=mesh.units,
        up=mesh.up,
    )
    vars(fine).update(
        rules=own,
        _cage_rules=rules,
        _lineage=(*lineage, without_points(coarse)),
        rounded=levels > 0 or (isinstance(mesh, RefinedMesh) and mesh.rounded),
    )
    return (fine, total) if operator else fine


def _turning_refined(
    mesh: Mesh, levels: int, operator: bool, rules: Rules, scheme: Any
) -> RefinedMesh | tuple[RefinedMesh, Any]:
    """What `refined` returns under a scheme that turns edges."""
    number = numbers.type_of(mesh.points)
    points, balance = _balanced(mesh.points.reshape(mesh.n_vertices, -1))
    total = identity(mesh.n_vertices, number) if operator else None
    steps = turning.steps(mesh, rules, levels)
    points, total = turning.refined(steps, levels, rules, points, total)
    known = turning.faces_after(steps, levels)
    points = np.ldexp(points, -balance) if balance else points
    hole = np.zeros(mesh.n_faces, dtype=bool)
    hole[np.flatnonzero(rules.without_limit(mesh)) if levels else mesh.holes] = True
    face = np.repeat(np.arange(mesh.n_faces), 3**levels)
    holes = np.flatnonzero(hole[face])
    channels = _turning_channels(mesh, levels, rules, holes) if levels else {}
    fine = valid_mesh(
        RefinedMesh,
        points.reshape(len(points), *mesh.points.shape[1:]),
        known,
        scheme=scheme if scheme is not None else mesh.scheme,
        boundary=mesh.boundary,
        holes=holes,
        channels=None if levels else mesh.channels,
        face_data={name: values[face] for name, values in mesh.face_data.items()},
        units=mesh.units,
        up=mesh.up,
    )
    if levels:
        own = {
            name: (channel.points, channel.indices, mesh.channels[name][2])
            for name, channel in channels.items()
        }
        vars(fine).update(read_only({"_channels": own}), channel_meshes=channels)
    vars(fine).update(
        rules=rules,
        _lineage=(without_points(mesh),),
        _steps=tuple(steps),
        _levels=levels,
        rounded=levels > 0 or (isinstance(mesh, RefinedMesh) and mesh.rounded),
    )
    return (fine, total) if operator else fine


def _turning_channels(
    mesh: Mesh, levels: int, rules: Rules, holes: Array
) -> dict[str, ChannelMesh]:
    """Channels after so many turns, as meshes of their own; a warning names those left out."""
    found, across, unknown = dict[str, ChannelMesh](), [], []
    for name, (_, _, mode) in mesh.channels.items():
        if not knows_mode(rules, mode):
            unknown.append(name)
            continue
        channel = ChannelMesh.of(mesh, name, rules)
        if levels % 2 and not np.array_equal(channel.twin, mesh.twin):
            across.append(name)
            continue
        values, balance = _balanced(channel.points.reshape(channel.n_vertices, -1))
        steps = turning.steps(channel, channel.rules, levels)
        try:
            values, _ = turning.refined(steps, levels, channel.rules, values)
        except TypeError:
            raise TypeError(
                f"channel {name!r} has exact values, and a valence at which masks of scheme "
                f"{rules.scheme.name!r} are irrational, on its boundaries or inside: there are no "
                "exact ones; give the channel in float64"
            ) from None
        values = np.ldexp(values, -balance) if balance else values
        values = values.reshape(len(values), *channel.points.shape[1:])
        fine = valid_mesh(Mesh, values, turning.faces_after(steps, levels))
        sharpness = Sharpness.of(without_points(fine), channel.rules, numbers.FLOAT64)
        found[name] = channel.refined(fine, values, sharpness, False, holes)
    what = f"scheme {rules.scheme.name!r} "
    for names, why in (
        (across, "makes faces across edges, on both sides of seams; take an even number of steps"),
        (unknown, "has no rule for how they are interpolated; 'none' and 'corners_only' it knows"),
    ):
        if names:
            warnings.warn(
                f"channels are left out ({', '.join(map(repr, names))}): {what}{why}",
                UserWarning,
                stacklevel=users_level(),
            )
    return found


def _later(mesh: Mesh, sharpness: Sharpness, finer: Mesh, lattice: Lattice) -> Sharpness:
    """The sharpness of the next refinement of a mesh; it does not hold on to the finer faces."""
    return sharpness.children(finer, lattice).typed(without_points(mesh), numbers.FLOAT64)


def _tags(sharpness: Sharpness) -> dict[str, Any]:
    """Creases and corners of a refined mesh."""
    return read_only(sharpness.tags())


def _corners(mesh: Mesh, levels: int) -> int:
    """Of all faces that are refined."""
    return int(mesh.n_corners * sum(4**level for level in range(levels)))


def _balanced(points: Array) -> tuple[Array, int]:
    """Points times a power of two, where their sums might overflow, and its exponent; or exact."""
    if numbers.type_of(points).exact:
        return numbers.RATIONAL.array(points), 0
    balance = kernels.balance(points)
    return (np.ldexp(points, balance) if balance else points), balance


def refuse_levels(mesh: Mesh, levels: int, operator: bool = False, split: int = 4) -> None:
    """Refuse, by a MemoryError, so many refinements into `split` if their faces have no room.

    What a face takes is the least that has been measured: a vertex, four corners with their
    neighbours, and with an operator some 16 entries twice.
    """
    columns = max(math.prod(mesh.points.shape[1:]), 1)
    each = 100 + (100 if numbers.type_of(mesh.points).exact else 8) * columns
    each += 32 * len(mesh.channels) + 400 * operator
    faces = mesh.n_corners * split ** max(min(levels, 400) - 1, 0)  # more than any machine holds
    if not levels or faces * each < _LITTLE:
        return
    fit = memory.available() / (each * mesh.n_corners)
    most = 0 if fit < 1 else int(math.log(fit, split)) + 1 if math.isfinite(fit) else levels
    advice = f"up to {most} levels fit" if most else "no level fits"
    memory.refuse_beyond(faces, each, f"faces of {levels} levels", advice)


def _refined_channel(channel: ChannelMesh, levels: int, holes: Array) -> ChannelMesh:
    """The values of a channel, refined."""
    number = numbers.type_of(channel.points)
    values, balance = _balanced(channel.points.reshape(channel.n_vertices, -1))
    mesh: Mesh = channel
    lattice = channel.rules.scheme.lattice
    sharpness = Sharpness.of(channel, channel.rules, number)
    compiled = not number.exact and _kernels.compiled(_corners(mesh, levels), 5)
    coarser = None
    for _ in range(levels):
        sharpness = sharpness if coarser is None else coarser.children(mesh, lattice)
        values = refined_values(mesh, channel.rules, sharpness, values, compiled)
        mesh, coarser = child_mesh(mesh, values, lattice), sharpness
    if balance:
        values = np.ldexp(values, -balance)
    values = values.reshape(len(values), *channel.points.shape[1:])
    return channel.refined(mesh, values, sharpness, coarser is not None, holes)


def _cage_parameters(mesh: Mesh, lattice: Lattice) -> tuple[Array, Array]:
    """Limit face (n_corners,) and parameters (n_corners, 2) of every corner of a cage."""
    corner = np.arange(mesh.n_corners) - mesh.offsets[mesh.corner_face]
    regular = mesh.sizes[mesh.corner_face] == lattice.face_size
    first = first_limit_face(mesh, lattice)[mesh.corner_face]
    domain = np.array(lattice.corners, dtype=float)
    return first + np.where(regular, 0, corner), domain[np.where(regular, corner, 0)]


def _child_parameters(
    mesh: Mesh, limit_face: Array, uv: Array, lattice: Lattice
) -> tuple[Array, Array]:
    """Limit face and parameters of every corner of the children, from those of `mesh`."""
    after = mesh.next_corner
    middle = (uv + uv[after]) / 2
    opposite = (uv + uv[after[after]]) / 2
    children = at_children(mesh.connectivity, uv, middle, opposite, lattice)
    if not all_regular(mesh, lattice):
        children[mesh.sizes[mesh.corner_face] != lattice.face_size] = lattice.corners
    return np.repeat(limit_face, children.size // uv.size), children.reshape(-1, 2)


def _descendants(mesh: Mesh, levels: int, lattice: Lattice) -> IntArray:
    """How many faces each face has become after some steps: (n_faces,)."""
    if not levels:
        return np.ones(mesh.n_faces, dtype=np.int64)
    children = len(lattice.children)
    first = mesh.sizes if lattice.face_points else np.full(mesh.n_faces, children)
    return np.asarray(first * children ** (levels - 1))
