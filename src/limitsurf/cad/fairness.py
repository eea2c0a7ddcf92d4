"""How fair a surface is, as a quadratic form of the vertices of its cage.

Integrals over the faces themselves, in the parameters in which their patches are polynomials. They
do not depend on where the points are, and are exact: those of polynomials are sums over Gauss
points, and those around a special corner a geometric series of matrices, which is summed as one
(``derivations/fairness.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from itertools import product
from math import comb, factorial, perm
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from limitsurf import memory, rings, tables
from limitsurf.engine.protocol import threads
from limitsurf.fem.elements import Group
from limitsurf.fem.pattern import Pattern, pairs
from limitsurf.integrals.checks import is_exact
from limitsurf.integrals.rules import Rule
from limitsurf.numbers import FLOAT64
from limitsurf.patches import REGULAR, STRIP, PatchTable
from limitsurf.pieces import cover
from limitsurf.pieces.bernstein import Bernstein, is_tensor
from limitsurf.pieces.cover import Cover
from limitsurf.pieces.weights import LocalWeights
from limitsurf.refine import over_values, stacked
from limitsurf.surface import LimitSurface

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from limitsurf.scheme.lattice import Lattice
    from limitsurf.scheme.scheme import Scheme
    from limitsurf.tables import EigenTable

Array = NDArray[Any]
Energy: TypeAlias = Literal["membrane", "thin_plate", "variation"]

ENERGIES: tuple[Energy, ...] = get_args(Energy)
_GAUSS = 14  # points per direction for the rational functions around poles
_SUMMED = 1e-17  # of a series, what is left
_AT_ONCE = 1 << 21  # entries of elements
_RINGS = 48  # where more faces meet than there are eigenbases for: eigenvalues are below 0.67


def fairness(
    surface: LimitSurface,
    energy: Energy | None = None,
    *,
    channel: str | None = None,
    workers: int = 1,
) -> csr_array[Any]:
    """The matrix E of a fairness energy: ``sum(x @ E @ x)`` over the columns x of the points.

    Parameters
    ----------
    surface : LimitSurface
        Its faces and rules count, its points do not: energies are those of parameters, in which
        each regular face is a unit square, or an equilateral triangle of area 1/2.
    energy : {"membrane", "thin_plate", "variation"}, optional
        By default "thin_plate", or in schemes that have not more ("bilinear") "membrane". It is
        the integral of the squares of all first, second, or third derivatives: for f of x and y
        ``f_x^2 + f_y^2``; ``f_xx^2 + 2 f_xy^2 + f_yy^2``;
        ``f_xxx^2 + 3 f_xxy^2 + 3 f_xyy^2 + f_yyy^2``.
    channel : str, optional
        A face-varying channel, whose values take the place of the vertices.
    workers : int
        Threads, as for `LimitSurface.evaluate`; matrices are the same for any number.

    Returns
    -------
    csr_array, (n_vertices, n_vertices)
        float64, symmetric to the last digit, positive semidefinite. Constants have energy 0: each
        row sums to 0. Where the faces form a flat regular grid without a pole, so have functions
        linear in its parameters for "thin_plate", and quadratic ones inside of it for "variation";
        on other cages constants alone, one for each part that hangs together, and vertices that no
        limit face depends on.

    Raises
    ------
    TypeError
        For what is no surface, and for exact points: the matrix is of float64.
    ValueError
        For an unknown energy or channel, and an energy of derivatives that are not square
        integrable: second ones in schemes whose faces meet at angles ("bilinear", "linear"), third
        ones in those of degree 2 ("doo-sabin").
    MemoryError
        At once, for vertices of so many faces that the matrix, dense among all around each of them,
        takes more memory than there is.

    Notes
    -----
    Second derivatives by the parameters (u, v) of faces are not square integrable at smooth
    vertices of more than 4 quads, or 6 triangles. On the patches next to a pole derivatives are
    those by the coordinates of its characteristic map instead, in which the surface is C1, of the
    area that the patches have in the parameters; all functions have finite energies of first and
    second derivatives there. Third ones grow too fast, and "variation" is multiplied by the square
    of the distance from the pole in these coordinates. At special corners where two coordinates of
    one eigenvalue do not exist, as on creases and boundaries, derivatives by (u, v) count on ring n
    times ``4^-n`` (second) and ``16^-n`` (third), by which all are finite.

    Halstead, Kass and DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces",
    SIGGRAPH 1993, sections 5 and 6, who sum the series over rings as is done here.
    ``derivations/fairness.py``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    >>> quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    >>> surface = ls.LimitSurface(ls.Mesh(points, quads))
    >>> E = ls.fairness(surface, "membrane")
    >>> E.shape, bool(abs(E.sum(axis=1)).max() < 1e-14)
    ((8, 8), True)
    >>> x = surface.points[:, 0]
    >>> round(float(x @ E @ x), 12) > 0
    True
    """
    if not isinstance(surface, LimitSurface):
        raise TypeError(f"fairness needs a LimitSurface, got {type(surface).__name__}")
    energy = usual_energy(surface) if energy is None else energy
    scheme, order = surface.topology.rules.scheme, checked_energy(energy)
    refuse_rough(scheme, order, energy)
    if is_exact(surface):
        raise TypeError(
            "fairness needs float64 points, got exact ones: its matrix is of float64; convert the "
            "points of the cage by astype(float)"
        )
    own = surface.of_channel(channel)
    found = _matrix(own.patches, scheme, order, threads(workers))
    if channel is not None:
        values = surface.mesh.channels[channel]
        for _ in range(2):
            found = over_values(found.T, own.mesh, values)
        found = ((found + found.T) / 2).tocsr()
    return _without_constants(found)


def _matrix(patches: PatchTable, scheme: Scheme, order: int, workers: int) -> Any:
    """The sum over all patches, over the vertices of the cage."""
    from scipy.sparse import csr_array

    covered = Cover.of(patches, np.arange(patches.n_limit_faces))
    elements = list(_elements(patches, covered, scheme, order))
    if not elements:  # of holes alone
        return csr_array((patches.n_vertices, patches.n_vertices))
    n = patches.n_vertices + sum(x.shape[0] for x in patches.extras)
    none = np.zeros(0, dtype=np.int64)
    groups = [Group(none, controls.astype(np.int32), False) for controls, _, _ in elements]
    entries = sum(g.controls.size * (g.controls.shape[1] + 1) // 2 for g in groups)
    memory.refuse_beyond(entries, 40, "entries of elements", "have fewer faces meet at a vertex")
    whole = Pattern(n, groups).symmetric(*_parts(elements), workers)
    if not patches.extras:
        return whole
    over_cage = _operator(patches)
    whole = over_cage.T @ whole @ over_cage
    return ((whole + whole.T) / 2).tocsr()


def usual_energy(surface: LimitSurface) -> Energy:
    """That of the plate, where there is one."""
    return "membrane" if surface.topology.rules.scheme.local else "thin_plate"


def checked_energy(energy: str) -> int:
    """The order of the derivatives of an energy."""
    if energy not in ENERGIES:
        raise ValueError(f"energy must be one of {', '.join(ENERGIES)}, got {energy!r}")
    return 1 + ENERGIES.index(energy)


def refuse_rough(scheme: Scheme, order: int, energy: str) -> None:
    """Refuse derivatives that are not square integrable across edges."""
    smooth = 0 if scheme.local else 1 if scheme.spline.degree < 3 else 2
    if order > smooth + 1:
        known = ", ".join(ENERGIES[: smooth + 1])
        raise ValueError(
            f"energy {energy!r} needs derivatives of order {order} that are square integrable, "
            f"which surfaces of scheme {scheme.name!r} have not across edges; it has: {known}"
        )


def _without_constants(matrix: Any) -> Any:
    """Take from the diagonal what rounding has left of the sums of rows, which are 0."""
    from scipy.sparse import diags_array

    found = (matrix - diags_array(np.asarray(matrix.sum(axis=1)).ravel())).tocsr()
    found.sort_indices()
    return found


def _operator(patches: PatchTable) -> Any:
    """From the vertices of the cage to all control points."""
    from scipy.sparse import eye_array

    total = eye_array(patches.n_vertices, format="csr")
    for rows in patches.extras:
        total = stacked([total, rows @ total])
    return total


def _parts(
    elements: list[tuple[Array, Array, Array]],
) -> tuple[int, Callable[[slice], tuple[int, Array, Array]]]:
    """How many parts of elements there are, and what gives upper triangles of their matrices."""
    parts = []
    for number, (controls, _, _) in enumerate(elements):
        each = max(1, _AT_ONCE // len(pairs(controls.shape[1])[0]))
        parts += [
            (number, np.arange(begin, min(begin + each, len(controls))))
            for begin in range(0, len(controls), each)
        ]

    def work(part: slice) -> tuple[int, Array, Array]:
        number, rows = parts[part.start]
        controls, scale, form = elements[number]
        i, j = pairs(controls.shape[1])
        own = form[rows] if form.ndim == 3 else form[None]
        values = scale[rows, None] * own[:, i, j]
        # a vertex that is there twice has both entries of the pair on the diagonal
        values[(controls[rows][:, i] == controls[rows][:, j]) & (i != j)] *= 2
        return number, rows, values

    return len(parts), work


def _elements(
    patches: PatchTable, covered: Cover, scheme: Scheme, order: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Control points (P, K) of patches that are alike, factors (P,), matrices (K, K) or (P, K, K).

    Integrals of squares of derivatives of order m are 4^(m - 1) times as large on half the size.
    """
    number = patches.kind[covered.patch]
    shared = np.where(
        [k in patches.rings for k in range(1 + int(number.max(initial=0)))], _RINGS, 1
    )
    local = LocalWeights(patches, scheme, FLOAT64)
    strips = local.strips
    for g in cover.grouped(patches, covered, shared[number], *strips)[1]:
        scale = np.ldexp(1.0, 2 * (order - 1) * covered.level[g.members])
        if g.kind > STRIP and g.kind not in patches.rings:
            sector = patches.sectors[g.kind]
            assert sector is not None
            table = tables.eigen_table(scheme, sector)
            yield patches.control_points(g.kind, g.rows), scale, around(table, order)
            continue
        size = np.abs(g.size)
        if g.kind > STRIP:  # by (u, v), with less weight on each ring
            size = np.full_like(size, 0.5)
        forms = np.stack([cell_form(scheme, order, tuple(x)) for x in size.tolist()])
        for ids, here, found in _cells(local, g, forms):
            yield ids, scale[here], found


def _cells(
    local: LocalWeights, g: cover.Group, forms: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """Control points of patches of polynomial cells, which they are of a group, and matrices."""

    def of(part: slice) -> Iterator[tuple[Array, Array, Array]]:
        for here, ids, weights in local.of(g, part):
            yield ids, here, (weights.swapaxes(-1, -2) @ forms @ weights).sum(axis=-3)

    patches, n = local.patches, len(g.rows)
    if g.kind == REGULAR:
        yield from of(slice(0, n))
        return
    sector = patches.sectors[g.kind]
    width = patches.control_points(g.kind, g.rows[:1]).shape[1]
    if sector is None or sector.open or sector.kind == "dart":
        each = max(1, _AT_ONCE // (len(forms) * forms.shape[1] * width))
        for begin in range(0, n, each):
            yield from of(slice(begin, min(begin + each, n)))
        return
    # faces around a smooth vertex are alike, but for where their ring begins
    position = patches.rings[g.kind].position[g.rows]
    ids = patches.control_points(g.kind, g.rows)
    ((_, _, found),) = of(slice(0, 1))
    first, _ = rings.columns(sector, int(position[0]))
    found = found[0][np.ix_(first, first)]
    for p in np.unique(position).tolist():
        here = np.flatnonzero(position == p)
        own, _ = rings.columns(sector, p)
        yield ids[here][:, own], here, found


# ---------------------------------------------------------------- polynomials


def metric(lattice: Lattice) -> Array:
    """The inverse metric (2, 2) of determinant 1 that turns of the domain do not change."""
    turns = np.array(lattice.turns, dtype=float)[:, 1:]  # rows along s and t
    mean = np.einsum("kri,krj->ij", turns, turns)
    (a, b), (c, d) = mean
    return np.asarray(mean / np.sqrt(a * d - b * c))


@lru_cache(maxsize=64)
def _terms(lattice: Lattice, order: int) -> dict[tuple[tuple[int, int], tuple[int, int]], float]:
    """Coefficients of products of derivatives by u and v in the sum of squares of all of an order.

    With the inverse metric g it is the sum of ``g[i, j] g[k, l] .. f_ik.. f_jl..``.
    """
    g = metric(lattice)
    found: dict[tuple[tuple[int, int], tuple[int, int]], float] = {}
    for one, other in product(product((0, 1), repeat=order), repeat=2):
        c = float(np.prod([g[i, j] for i, j in zip(one, other, strict=True)]))
        key = (order - sum(one), sum(one)), (order - sum(other), sum(other))
        found[key] = found.get(key, 0.0) + c
    return {key: c for key, c in found.items() if c}


@lru_cache(maxsize=256)
def cell_form(scheme: Scheme, order: int, size: tuple[float, float]) -> Array:
    """The energy (n, n) of Bernstein coefficients on a cell of some size, along s and t."""
    a, b = size
    exponents = np.array(scheme.spline.exponents)
    tensor = is_tensor(exponents)
    total = np.zeros((len(exponents), len(exponents)))
    for (nu, mu), c in _terms(scheme.lattice, order).items():
        scale = c * a * b / (a ** (nu[0] + mu[0]) * b ** (nu[1] + mu[1]))
        total += scale * _products(exponents, nu, mu, tensor)
    inverse = np.linalg.inv(Bernstein.of(scheme, False).from_powers)
    found = inverse.T @ total @ inverse
    found = (found + found.T) / 2
    found.flags.writeable = False
    return np.asarray(found)


def _products(exponents: Array, nu: tuple[int, int], mu: tuple[int, int], tensor: bool) -> Array:
    """Integrals (n, n) over the domain of products of two derivatives of monomials."""
    found = np.zeros((len(exponents), len(exponents)))
    for k, (a, b) in enumerate(exponents.tolist()):
        for m, (c, d) in enumerate(exponents.tolist()):
            factor = perm(a, nu[0]) * perm(b, nu[1]) * perm(c, mu[0]) * perm(d, mu[1])
            if factor:
                i, j = a + c - nu[0] - mu[0], b + d - nu[1] - mu[1]
                if tensor:
                    found[k, m] = factor / ((i + 1) * (j + 1))
                else:
                    found[k, m] = factor * factorial(i) * factorial(j) / factorial(i + j + 2)
    return found


# ---------------------------------------------------------------- around special corners


@lru_cache(maxsize=512)
def around(table: EigenTable, order: int) -> Array:
    """The energy (K, K) of the control points of a patch around a special corner."""
    pair = _coordinates(table)
    step = np.array(table.J)
    if pair is None:
        first = np.zeros((table.size, table.size))
        bernstein = Bernstein.of(table.scheme, False)
        form = cell_form(table.scheme, order, (0.5, 0.5))
        for piece in table.pieces:
            own = bernstein.from_powers @ piece
            first += own.T @ form @ own
        linear = [0]
    else:
        rate = float(table.rates[0, 1])
        first = _first_ring(table, pair, order)
        # of derivatives of order m, and an area; of third ones also the square of the distance
        step *= rate ** (1 - min(order, 2))
        linear = [0, 1, 2] if order > 1 else [0]
    for axis in (0, 1):
        first = np.swapaxes(first, 0, axis)
        first[linear] = 0
        first = np.swapaxes(first, 0, axis)
    step[linear], step[:, linear] = 0, 0
    total = _series(first, step)
    own = table.coefficients(np.eye(table.size)[None])[0]
    found = own.T @ total @ own
    found = (found + found.T) / 2
    found.flags.writeable = False
    return np.asarray(found)


def _series(first: Array, step: Array) -> Array:
    """The sum of ``step.T^n @ first @ step^n``, twice as many terms each time."""
    total = first
    for _ in range(64):
        more = step.T @ total @ step
        total = total + more
        if np.abs(more).max(initial=0) <= _SUMMED * np.abs(total).max(initial=0):
            break
        step = step @ step
    return total


def _coordinates(table: EigenTable) -> Array | None:
    """Factors of eigenfunctions 1 and 2 by which they are the characteristic map; None if not.

    At smooth vertices one is even, one odd about the middle of the face. The ends of the two edges
    of the face are 2 pi / N apart as seen from the vertex, and the patch has as large an image as
    it has in the parameters.
    """
    sector = table.sector
    slow = table.rates[0, 1:3]
    tied = np.isin([1, 2, 3], table.chains).any() or np.isin([1, 2], table.pairs).any()
    if sector.kind != "interior" or tied or slow[0] != slow[1] or slow[0] <= 0:
        return None
    if not np.array_equal(np.sort(table.normal), [1, 2]):
        return None
    origins = [child.origin for child in sector.lattice.pieces]
    exponents = np.array(table.scheme.spline.exponents)
    ends = []
    for way in ((1, 0), (0, 1)):  # powers of (1, 0) or (0, 1), but for 0^0
        at = (np.array(way) ** exponents).prod(axis=1)
        ends.append(at @ table.pieces[origins.index(way)][:, 1:3])
    (x, y), (p, q) = ends
    even, odd = (0, 1) if abs(x - p) < abs(y - q) else (1, 0)
    slope = abs(ends[0][odd] / ends[0][even])
    pair = np.ones(2)
    pair[odd] = np.tan(np.pi / sector.faces) / slope
    rule = Rule.of(table.scheme, _GAUSS)
    det = [np.linalg.det(x) for x in _slopes(table, pair, rule)]
    if not (np.min(det) > 0 or np.max(det) < 0):
        return None
    area = sum(np.abs(x) @ rule.weights for x in det) / (1 - slow[0] ** 2)
    return np.asarray(pair * np.sqrt(rule.weights.sum() / area))


def _slopes(table: EigenTable, pair: Array, rule: Rule) -> Array:
    """First derivatives of the coordinates on the pieces, (3, Q, 2, 2)."""
    found = _jets(table, rule, 1, slice(1, 3)) * pair
    return np.moveaxis(found[:, [2, 1]], 1, 2)


def _jets(table: EigenTable, rule: Rule, order: int, which: Any) -> Array:
    """Taylor coefficients (pieces, terms, Q, modes) of eigenfunctions, of `_multiples`."""
    i, j = np.array(table.scheme.spline.exponents).T
    found = []
    for a, b in _multiples(order):
        factor = np.array([comb(p, a) * comb(q, b) for p, q in zip(i, j, strict=True)])
        powers = rule.s[:, None] ** np.maximum(i - a, 0) * rule.t[:, None] ** np.maximum(j - b, 0)
        found.append((factor * powers) @ table.pieces[:, :, which])
    return np.stack(found, axis=1)


def _multiples(order: int) -> list[tuple[int, int]]:
    """Orders of derivatives up to a total one."""
    return [(a, n - a) for n in range(order + 1) for a in range(n + 1)]


def _first_ring(table: EigenTable, pair: Array, order: int) -> Array:
    """Energies (K, K) of eigenfunctions on ring 0, by the coordinates of the characteristic map.

    With Taylor series X, Y of the coordinates less their values, f is the sum of ``c[a, b] X^a
    Y^b`` up to higher orders: linear equations for its own Taylor coefficients c.
    """
    rule, terms = Rule.of(table.scheme, _GAUSS), _multiples(order)
    jets = _jets(table, rule, order, slice(None))  # (pieces, terms, Q, K)
    total = np.zeros((table.size, table.size))
    top = [k for k, (a, b) in enumerate(terms) if a + b == order]
    for own in jets:
        coordinates = own[:, :, 1:3] * pair  # (terms, Q, 2)
        series = coordinates.copy()
        series[0] = 0
        columns: dict[tuple[int, int], Array] = {(0, 0): np.zeros(series.shape[:2])}
        columns[0, 0][0] = 1
        for a, b in terms[1:]:
            before = columns[(a - 1, b) if a else (a, b - 1)]
            columns[a, b] = _product(before, series[:, :, 0 if a else 1], terms)
        system = np.stack([columns[x] for x in terms[1:]], axis=2)[1:]  # (terms, Q, unknowns)
        c = np.linalg.solve(system.swapaxes(0, 1), own[1:].swapaxes(0, 1))  # (Q, unknowns, K)
        slope = series[[terms.index((1, 0)), terms.index((0, 1))]]  # (2, Q, 2)
        weight = rule.weights * np.abs(np.linalg.det(slope.swapaxes(0, 1)))
        if order > 2:
            weight = weight * (coordinates[0] ** 2).sum(axis=1)
        for k in top:
            a, b = terms[k]
            values = c[:, k - 1]
            factor = comb(order, a) * (factorial(a) * factorial(b)) ** 2
            total += (values * (factor * weight)[:, None]).T @ values
    return total


def _product(one: Array, other: Array, terms: list[tuple[int, int]]) -> Array:
    """Taylor coefficients (terms, Q) of the product of two functions."""
    place = {term: k for k, term in enumerate(terms)}
    found = np.zeros_like(one)
    for (a, b), (c, d) in product(terms, repeat=2):
        if (a + c, b + d) in place:
            found[place[a + c, b + d]] += one[place[a, b]] * other[place[c, d]]
    return found
