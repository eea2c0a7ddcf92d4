"""Masks as they are given: names, functions and mappings, and what a spline asks of them.

A mask is a function of a valence. What others give as a mapping becomes one here; and so does a
function that cannot be sent to another process, where it goes as its values.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from numbers import Integral
from typing import Any, TypeAlias

from limitsurf.scheme.lattice import Lattice
from limitsurf.scheme.spline import Spline

# a Fraction, or an algebraic number of sympy
Weight: TypeAlias = Any
Weights: TypeAlias = tuple[Weight, ...]

_LARGEST = 10**100  # a weight beyond has no limit, and products of such leave float64

_SHOWN = 16  # most weights of a mask in an error

_reserved: set[str] = set()


def reserve(names: Iterable[str]) -> None:
    """Let no scheme that is made from now on have one of these names."""
    _reserved.update(names)


def checked_name(name: Any) -> str:
    """The name of a new scheme, if it may have it; else a ValueError."""
    if not isinstance(name, str) or not name.strip():
        raise ValueError(f"the name of a scheme must be a text, got {name!r}")
    if name in _reserved:
        raise ValueError(
            f"scheme {name!r}: there is one of this name in limitsurf.schemes; take another name"
        )
    return name


def mean_of_corners(n: int) -> tuple[Fraction, ...]:
    """The mask of a face: its corners count alike."""
    return (Fraction(1, n),) * n


@dataclass(frozen=True)
class MaskValues:
    """A mask as its values: a function that knows some valences.

    Attributes
    ----------
    values : tuple of (valences, weights)
        An edge has two valences, all else one.
    travelled : bool
        Whether they are of a function, which could not be sent with them.
    """

    values: tuple[tuple[tuple[int, ...], Weights], ...]
    travelled: bool = False

    def __call__(self, *at: int) -> Weights:
        """Weights there; LookupError if they are not known."""
        for known, weights in self.values:
            if known == at:
                return weights
        raise LookupError(at)

    def missing(self, at: tuple[int, ...]) -> str:
        """What to say where there is no value."""
        known = [k[0] if len(k) == 1 else k for k, _ in self.values]
        if not self.travelled:
            return f"is not given: the mapping has {', '.join(map(str, known))}; add {at[0]}"
        return (
            "is not known here: the scheme came from another process, with the values of its "
            "function to valence 32; define the function in a module that both can import, or give "
            "a mapping"
        )


@dataclass(frozen=True)
class Still:
    """A mask that is the same at every valence."""

    weights: Weights

    def __call__(self, valence: int) -> Weights:
        """The weights."""
        return self.weights


def as_mask(name: str, mask: Any, regular: int, own: Weights) -> Any:
    """A function, of a mapping; which knows what is regular, if nothing else is said of that."""
    if mask is not None and not callable(mask) and not isinstance(mask, Mapping):
        raise ValueError(
            f"scheme {name!r}: a mask must be a function of the valence, or a mapping "
            f"{{valence: weights}}, got {shown(mask)}"
        )
    if not isinstance(mask, Mapping):
        return mask
    for n in mask:
        if isinstance(n, bool) or not isinstance(n, Integral):
            raise ValueError(
                f"scheme {name!r}: keys of a mapping are valences, which are integers, got {n!r}"
            )
    every: Mapping[int, Any] = {regular: own, **{int(n): w for n, w in mask.items()}}
    return MaskValues(tuple(((n,), as_tuple(w)) for n, w in every.items()))


def as_tuple(weights: Any) -> Any:
    """A list of weights as a tuple; all else as it is."""
    return tuple(weights) if isinstance(weights, list) else weights


def is_iterable(value: Any) -> bool:
    """Whether it is a sequence or an iterator, of which the weights can be taken."""
    return isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping))


def alike(one: Any, other: Any) -> bool:
    """Whether two values of a mask are the same; NaN is like itself."""
    try:
        return bool(one == other) or repr(one) == repr(other)
    except Exception:  # values that cannot be compared: arrays, say
        return repr(one) == repr(other)


def shown(weights: Any) -> str:
    """Weights in words, not too many of them."""
    if not isinstance(weights, tuple):
        return f"{weights!r:.200}"
    more = f", ... {len(weights)} in all" if len(weights) > _SHOWN else ""
    texts = (text if len(text) < 100 else f"{text[:97]}..." for text in map(str, weights[:_SHOWN]))
    return f"({', '.join(texts)}{more})"


def advice_on(weight: Any, algebraic: bool) -> str:
    """What is wrong with a weight that is no exact number, and what to write instead."""
    need = "a Fraction" + (" or a real algebraic number of sympy" if algebraic else "")
    if isinstance(weight, float) or getattr(weight, "is_Float", False):
        if weight != weight or weight in (float("inf"), -float("inf")):
            return f"{float(weight)}, need {need}"
        near = Fraction(float(weight)).limit_denominator(1000)
        like = f"Fraction({near.numerator}, {near.denominator})"
        return f"the float {float(weight)!r}, need {need}, such as {like}"
    if isinstance(weight, (Fraction, int)) and too_large(weight):
        return "larger than 1e100; with such weights nothing converges"
    return f"of type {type(weight).__name__}, need {need}"


@lru_cache(maxsize=4096)
def too_large(weight: Any) -> bool:
    """Whether an exact number is one that no weight can be."""
    return bool(abs(weight) > _LARGEST)


def travels(function: Any) -> bool:
    """Whether a function can be sent to another process as it is: by the name of its module."""
    home = getattr(function, "__module__", None) or type(function).__module__
    if home in ("__main__", "__mp_main__") or type(function).__module__ == "__main__":
        return False  # of scripts and notebooks, which others do not import
    name = getattr(function, "__qualname__", None)
    if name is not None:
        found: Any = sys.modules.get(home)
        for part in name.split("."):
            found = getattr(found, part, None)
        return found is function
    try:
        pickle.dumps(function)
    except Exception:
        return False
    return True


def regular_shape(
    name: Any,
    lattice: Lattice | str | None,
    spline: Spline | str | None,
    known: dict[str, tuple[Lattice, Spline]],
) -> tuple[Lattice, Spline]:
    """The lattice and the spline that are meant, of those that are known by name."""
    lattices = {found.name: found for found, _ in known.values()}
    for what, value, kind, names in (
        ("lattice", lattice, Lattice, lattices),
        ("spline", spline, Spline, known),
    ):
        if value is not None and not isinstance(value, (str, kind)):
            raise ValueError(
                f"scheme {name!r}: {what} must be one of {', '.join(names)}, got {value!r}"
            )
    if isinstance(spline, str):
        if spline not in known:
            raise ValueError(
                f"scheme {name!r}: spline must be one of {', '.join(known)}, got {spline!r}"
            )
        own, spline = known[spline]
        lattice = own if lattice is None else lattice
    if isinstance(lattice, str):
        if lattice not in lattices:
            raise ValueError(
                f"scheme {name!r}: lattice must be one of {', '.join(lattices)}, got {lattice!r}"
            )
        lattice = lattices[lattice]
    pairs = [*known.values()]
    if lattice is None:
        lattice = next((a for a, b in pairs if spline is None or b == spline), pairs[0][0])
    if spline is None:
        spline = next(b for a, b in pairs if a is lattice)
    if (lattice, spline) not in pairs:
        raise ValueError(f"scheme {name!r}: there is no {spline.name} of {lattice.name}")
    return lattice, spline


@lru_cache(maxsize=16)
def regular_masks(lattice: Lattice, spline: Spline) -> tuple[tuple[Fraction, ...], ...]:
    """Those of a spline: of a face, an edge, a vertex, a boundary edge and a boundary vertex.

    Derived in ``derivations/masks_bicubic.py`` and ``derivations/masks_box_spline.py``.
    """
    star, stride = lattice.star, len(lattice.orbits)
    vertex, edge = spline.stencil((0, 0)), spline.stencil((1, 0))
    face = spline.stencil((1, 1)) if lattice.face_points else {}
    zero = Fraction(0)
    unit = face.get((0, 0), Fraction(1))  # of a corner in what stands for its face
    across, near = edge.get(star[stride], zero) / unit, vertex.get(star[0], zero)
    # corners beyond the neighbours come with face points, which bring neighbours too
    around = [vertex.get(place, zero) / unit for place in star[1:stride]]
    near -= 2 * unit * sum(around)
    own = 1 - lattice.valence * (near + sum(around))
    curve, middle = spline.curve_stencil(0), spline.curve_stencil(1)
    return (
        tuple(face.values()),
        ((1 - 2 * across) / 2, across),
        (own, near, *around),
        (middle[0],),
        (curve[0], curve.get(1, zero)),
    )
