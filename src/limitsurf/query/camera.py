"""Cameras: how far apart things are in a picture, at most."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limitsurf.cage.checks import checked_integer, checked_number

Array = NDArray[Any]


@dataclass(frozen=True)
class View:
    """A camera that draws in perspective, for `tessellate`.

    Attributes
    ----------
    position : (float, float, float)
        Where it is, in the coordinates of the points.
    target : (float, float, float)
        What it looks at: it is in the middle of the picture.
    up : (float, float, float)
        What is upwards in the picture; not along the line of sight.
    field_of_view : float
        Angle between the lower and the upper side of the picture, in degrees, above 0, below 180.
    width, height : int
        Of the picture, in pixels.
    near : float, optional
        What is less deep than this in front of the camera is not drawn; by default a thousandth of
        the distance of the target.

    Raises
    ------
    ValueError, TypeError
        For values that are not such numbers, and directions that are none.

    Examples
    --------
    >>> import limitsurf as ls
    >>> ls.View((4, 0, 1), (0, 0, 0), field_of_view=30).height
    1080
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    field_of_view: float = 40.0
    width: int = 1920
    height: int = 1080
    near: float | None = None

    def __post_init__(self) -> None:
        for name in ("position", "target", "up"):
            object.__setattr__(self, name, _vector(name, getattr(self, name)))
        for name in ("width", "height"):
            object.__setattr__(self, name, checked_integer(name, getattr(self, name), 1))
        checked_number("field_of_view", self.field_of_view, above=0, below=180)
        if self.near is not None:
            checked_number("near", self.near, above=0, below=math.inf)
        sight, size = self._sight()
        if not 0 < size < math.inf:
            raise ValueError(f"position and target must differ, got {self.position} twice")
        up = np.array(self.up)
        with np.errstate(invalid="ignore"):
            across = np.cross(sight, up / np.abs(up).max())
        if not np.abs(across).max() > 1e-9:
            raise ValueError(f"up must not be along the line of sight, got {self.up}")

    def _sight(self) -> tuple[Array, float]:
        """The unit vector of the line of sight, and how far the target is."""
        step = np.array(self.target) / 2 - np.array(self.position) / 2
        size = float(np.abs(step).max())
        if not 0 < size < math.inf:
            return step, size
        unit = step / size
        length = float(np.sqrt((unit * unit).sum()))
        return unit / length, 2 * size * length

    def scaled(self, power: int) -> Sight:
        """The same where all is multiplied by a power of 2."""
        forward, far = self._sight()
        up = np.array(self.up)
        right = np.cross(forward, up / np.abs(up).max())
        right = right / np.sqrt((right * right).sum())
        half = math.tan(math.radians(self.field_of_view) / 2)
        near = far / 1000 if self.near is None else self.near
        return Sight(
            np.ldexp(np.array(self.position), power),
            np.stack([right, np.cross(right, forward), forward]),
            self.height / 2 / half,
            (half * self.width / self.height, half),
            float(np.ldexp(near, power)),
        )


@dataclass(frozen=True, eq=False)
class Sight:
    """What a `View` sees, in the unit of cells.

    Attributes
    ----------
    position : (3,)
    axes : (3, 3)
        Rightwards, upwards and forwards in the picture.
    focal : float
        Pixels to a unit at depth 1.
    half : (float, float)
        Half the width and height of the picture at depth 1.
    near : float
    """

    position: Array
    axes: Array
    focal: float
    half: tuple[float, float]
    near: float

    def seen(self, corners: Array, error: Array, beside: Callable[[Array], Array] | None) -> Array:
        """How far, in pixels, surfaces are from polygons in the picture, at most; -1 out of it.

        ``derivations/tessellation.py`` has the bounds.

        Parameters
        ----------
        corners : (L, c, 3)
        error : (L,)
            How far the surface is from polygons of these corners.
        beside : callable, optional
            How far it is from these across directions (L, 3).
        """
        placed = (corners - self.position) @ self.axes.T
        x, y, z = np.moveaxis(placed, 2, 0)
        outside = z.max(axis=1) + error <= self.near
        for along, half in ((x, self.half[0]), (y, self.half[1])):
            reach = error * math.hypot(1, half)
            for sign in (1, -1):
                outside |= (sign * along - half * z).min(axis=1) > reach
        least = np.maximum(z.min(axis=1), self.near - error)
        with np.errstate(divide="ignore", invalid="ignore"):
            spot = placed[:, :, :2] / z[:, :, None]
            middle = placed.mean(axis=1)
            aim = middle[:, :2] / middle[:, 2:]
            slant = 1 + math.hypot(*self.half) ** 2
            wide = np.sqrt(((spot - aim[:, None]) ** 2).sum(axis=2)).max(axis=1)
            wide = wide + error * math.sqrt(slant) / least
            found = error * math.sqrt(slant)
            if beside is not None:
                ray = middle / np.sqrt((middle * middle).sum(axis=1))[:, None]
                across = math.sqrt(slant) * beside(ray @ self.axes) + error * wide
                ahead = z.min(axis=1) > 0
                found = np.where(ahead, np.fmin(found, across), found)
            found = np.where(least > 0, self.focal * found / least, np.inf)
        return np.where(outside, -1.0, np.where(error > 0, found, 0.0))


def _vector(name: str, value: Any) -> tuple[float, float, float]:
    """Three finite numbers."""
    try:
        given = list(value)
    except TypeError:
        given = []
    if len(given) != 3:
        raise ValueError(f"{name} must be three numbers, got {value!r}")
    x, y, z = (checked_number(name, number, below=math.inf) for number in given)
    return x, y, z
