"""First and second forms of the surface at points, from its derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.caching import cached_property
from limitsurf.engine.protocol import Order
from limitsurf.fem.checks import power_of_two
from limitsurf.integrals.sums import cross

Array = NDArray[Any]
Floats = NDArray[np.float64]

_U, _V = (1, 0), (0, 1)
_SECOND: tuple[tuple[Order, Order], tuple[Order, Order]] = (((2, 0), (1, 1)), ((1, 1), (0, 2)))


class Geometry:
    """The surface at the points of a quadrature, made by `Space.geometry`.

    Arrays begin with the n points. Indices a, b, c are 0 for u and 1 for v, the parameters of limit
    faces; units are those of the points of the cage, per parameter for each index. Next to special
    corners second derivatives are differences of large numbers: see `LimitSurface.curvature`.

    Attributes
    ----------
    points : (n, 3)
        x.
    tangents : (n, 2, 3)
        Derivatives ``x_a``.
    second : (n, 2, 2, 3)
        Derivatives ``x_ab``.
    metric : (n, 2, 2)
        ``g_ab = x_a . x_b``.
    inverse : (n, 2, 2)
        The inverse ``g^ab`` of the metric.
    area : (n,)
        The area element ``|x_u x x_v|``, by which weights of the quadrature are multiplied.
    normal : (n, 3)
        The unit normal, along ``x_u x x_v``.
    second_form : (n, 2, 2)
        ``b_ab = x_ab . normal``.
    christoffel : (n, 2, 2, 2)
        ``Gamma^c_ab = g^cd x_d . x_ab`` as ``[:, c, a, b]``.

    Examples
    --------
    >>> import limitsurf as ls
    >>> square = ls.Mesh([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> space = ls.Space(ls.LimitSurface(square), ends="natural")
    >>> at = space.geometry(ls.quadrature(space.surface, points=1))
    >>> at.area.round(12).tolist(), abs(at.inverse).round(12).tolist()
    ([2.0], [[[0.25, 0.0], [0.0, 1.0]]])
    """

    def __init__(self, jet: Mapping[Order, Array]) -> None:
        self._jet = jet

    @property
    def points(self) -> Floats:
        """Positions (n, 3)."""
        return self._jet[0, 0]

    @cached_property
    def tangents(self) -> Floats:
        """First derivatives (n, 2, 3)."""
        return np.stack([self._jet[_U], self._jet[_V]], axis=-2)

    @cached_property
    def second(self) -> Floats:
        """Second derivatives (n, 2, 2, 3)."""
        rows = [np.stack([self._jet[nu] for nu in row], axis=-2) for row in _SECOND]
        return np.stack(rows, axis=-3)

    @cached_property
    def metric(self) -> Floats:
        """The metric (n, 2, 2)."""
        t = self.tangents
        return np.asarray(t @ t.swapaxes(-1, -2))

    @cached_property
    def _cross(self) -> Floats:
        return cross(self._jet[_U], self._jet[_V])

    @cached_property
    def area(self) -> Floats:
        """The area element (n,)."""
        unit = power_of_two(self._cross, (-1,))  # whose squares are within the range of float64
        own = self._cross / unit
        return np.asarray(np.sqrt((own * own).sum(axis=-1)) * unit[..., 0])

    @cached_property
    def normal(self) -> Floats:
        """Unit normals (n, 3)."""
        return np.asarray(self._cross / self.area[..., None])

    @cached_property
    def inverse(self) -> Floats:
        """The inverse metric (n, 2, 2)."""
        g = self.metric
        adjugate = np.stack(
            [
                np.stack([g[..., 1, 1], -g[..., 0, 1]], axis=-1),
                np.stack([-g[..., 0, 1], g[..., 0, 0]], axis=-1),
            ],
            axis=-2,
        )
        area = self.area[..., None, None]
        return np.asarray(adjugate / area / area)

    @cached_property
    def second_form(self) -> Floats:
        """The second fundamental form (n, 2, 2)."""
        return np.asarray(np.einsum("...abk,...k->...ab", self.second, self.normal))

    @cached_property
    def christoffel(self) -> Floats:
        """Christoffel's symbols (n, 2, 2, 2)."""
        lowered = np.einsum("...dk,...abk->...dab", self.tangents, self.second)
        return np.asarray(np.einsum("...cd,...dab->...cab", self.inverse, lowered))


class Components:
    """The same of a block of faces, component by component, as forms want it.

    `jet` has the derivatives {nu: three arrays (F, P)}, in a unit (F, 1) of each face but for
    positions; `weights` (F, P) are those of the quadrature. All but `measure` is in that unit.
    """

    def __init__(self, jet: Mapping[Order, Array], weights: Array, unit: Array) -> None:
        self.jet, self.weights, self.unit = jet, weights, unit

    @cached_property
    def cross(self) -> tuple[Array, Array, Array]:
        """``x_u x x_v``."""
        (a, b, c), (d, e, f) = self.jet[_U], self.jet[_V]
        return b * f - c * e, c * d - a * f, a * e - b * d

    @cached_property
    def area(self) -> Array:
        """The area element."""
        x, y, z = self.cross
        return np.asarray(np.sqrt(x * x + y * y + z * z))

    @cached_property
    def own_measure(self) -> Array:
        """The area element times the weights of the quadrature."""
        return np.asarray(self.area * self.weights)

    @cached_property
    def measure(self) -> Array:
        """The same in the unit of the points of the cage."""
        return np.asarray(self.own_measure * self.unit * self.unit)

    @cached_property
    def metric(self) -> tuple[Array, Array, Array]:
        """``g_uu, g_uv, g_vv``."""
        u, v = self.jet[_U], self.jet[_V]
        return _dot(u, u), _dot(u, v), _dot(v, v)

    @cached_property
    def inverse(self) -> tuple[Array, Array, Array]:
        """``g^uu, g^uv, g^vv``."""
        e, f, g = self.metric
        one = 1 / (self.area * self.area)
        return g * one, -f * one, e * one

    def laplacian(self) -> dict[Order, Array]:
        """Coefficients of the derivatives of a function in its Laplacian on the surface."""
        g, h, k = self.inverse
        found = {(2, 0): g, (1, 1): 2 * h, (0, 2): k}
        traced = [sum(c * self.jet[nu][i] for nu, c in found.items()) for i in range(3)]
        along, across = _dot(traced, self.jet[_U]), _dot(traced, self.jet[_V])
        found[_U], found[_V] = -(g * along + h * across), -(h * along + k * across)
        return found


def _dot(a: Any, b: Any) -> Array:
    """Products of vectors, given by their components."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
