"""Makes the reference pictures in tests/images, one of each kind, with which test_plot.py compares.

They are a quarter as large as the pictures themselves, which makes small files. The picture in the
README is made here too.

Run it after pictures have changed on purpose, look at what it wrote, and commit that::

    python tests/make_images.py

It needs OpenGL. Only those that differ by more than their tolerance are written anew.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import make_demo_cage
import numpy as np
import zoo
from numpy.typing import NDArray
from PIL import Image

import limitsurf as ls
from limitsurf.shell.plot import render

FOLDER = Path(__file__).parent / "images"
README = Path(__file__).parents[1] / "notebooks" / "site" / "images" / "readme.jpg"
SIZE = {"window_size": (640, 480), "off_screen": True}
WORST = 0.02  # part of the boxes

Options = dict[str, object]


def tower() -> ls.LimitSurface:
    """A pentagonal prism with a sharp edge around its top: valences 3 and 5, and a crease."""
    points, faces = zoo.prism(5)
    top = max(faces, key=lambda f: (len(f), sum(points[v][2] for v in f)))
    rim = dict.fromkeys(zip(top, [*top[1:], top[0]], strict=True), math.inf)
    return ls.LimitSurface(ls.Mesh(np.array(points, dtype=float), faces, creases=rim))


def scene(**options: object) -> Callable[..., ls.Picture]:
    return lambda **others: ls.plot(tower(), **{"n": 16, **SIZE, **options, **others})


def tilted(face: NDArray[np.int64], u: NDArray[np.float64], v: NDArray[np.float64]) -> object:
    """A scalar of one sign, with a gap."""
    return np.where((face % 5 == 2) & (u > 0.6), np.nan, 1 + u * v)


# Each picture, the difference that is tolerated, and what may be left out, which must make a larger
# one. Tolerances are more than what came of smoothing lines and dots in another way, as drivers do
# (no multisampling, 3 x 3 or 4 x 4 pixels drawn per pixel): most, 12, where there are many thin
# lines. Diagrams do not depend on a driver, but on the letters of Matplotlib.
PICTURES: dict[str, tuple[Callable[..., ls.Picture], float, list[Options]]] = {
    "cage": (scene(), 9, [{"cage": False}, {"poles": False}]),
    "isolines": (scene(isolines=3, cage=False), 6, [{"isolines": 0}, {"isolines": 2}]),
    "normals": (scene(normals=True, cage=False), 20, [{"normals": False}]),
    "curvature": (
        scene(scalars="mean"),
        6,
        [{"scalars": None}, {"scalars": "gaussian"}, {"limits": (-9, 9)}, {"cmap": "viridis"}],
    ),
    "zebra": (scene(scalars="zebra"), 10, [{"scalars": None}]),
    "scalars": (
        scene(scalars=tilted, label="$1 + u v$", view="top", poles=True),
        8,
        [{"poles": False}, {"scalars": lambda face, u, v: 1 + u * v}],
    ),
    "characteristic_map": (
        lambda **others: ls.plot_characteristic_map(**{"valence": 5, **SIZE, **others}),
        15,
        [{"valence": 6}, {"isolines": 0}, {"rings": 0}],
    ),
    "crease_map": (
        lambda **others: ls.plot_characteristic_map(
            **{"kind": "crease", "faces": 3, **SIZE, **others}
        ),
        15,
        [{"faces": 2}, {"kind": "dart"}],
    ),
    "eigenfunctions": (
        lambda **others: ls.plot_eigenfunctions(**{"valence": 5, **SIZE, **others}),
        20,
        [{"valence": 3}],
    ),
    "eigenfunction": (
        lambda **others: ls.plot_eigenfunctions(**{"valence": 5, "which": 3, **SIZE, **others}),
        12,
        [{"which": 4}],
    ),
    "convergence": (
        lambda **others: ls.plot_convergence({"tower": tower()}, **{"levels": 3, **SIZE, **others}),
        15,
        [{"levels": 2}],
    ),
}
FLAT = ["characteristic_map", "crease_map", "convergence"]
# The same scenes without OpenGL.
PAINTED = ["cage", "isolines", "curvature", "zebra"]
PAINTED_ALIKE = 5
OF_README = 15  # many thin lines


def painted(draw: Callable[..., ls.Picture]) -> NDArray[np.uint8]:
    """The picture as it comes out without OpenGL."""
    with patch.object(render, "opengl", lambda: False), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return draw().image


def of_readme() -> NDArray[np.uint8]:
    """The bundled octopus in its cage, its mean curvature, and reflections on it."""
    surface = ls.LimitSurface(ls.read(make_demo_cage.FILE))
    panels: list[Options] = [
        {},
        {"scalars": "mean", "window_size": (760, 600)},
        {"scalars": "zebra"},
    ]
    size: Options = {"window_size": (620, 600), "off_screen": True}
    return np.concatenate([ls.plot(surface, **{**size, **k}).image for k in panels], axis=1)


def difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """How unlike two pictures are, in steps of 8-bit colour: the mean difference in the worst 2
    percent of boxes of 4 x 4 pixels.

    Drivers smooth edges each in its own way, which moves some colour from a pixel to the next:
    means of boxes feel little of it. What is small and missing is all of a few boxes: the worst of
    them tell.
    """
    gaps = np.abs(shrunk(one) - shrunk(other)).max(axis=2).ravel()
    return float(np.sort(gaps)[-round(WORST * len(gaps)) :].mean())


def shrunk(image: NDArray[np.uint8], rows: int = 60) -> NDArray[np.float64]:
    """Means of boxes of pixels, so many rows of them, (rows, columns, 3)."""
    box = len(image) // rows
    tiles = image.astype(float).reshape(rows, box, -1, box, 3)
    return np.asarray(tiles.mean(axis=(1, 3)))


def reference(name: str) -> NDArray[np.uint8]:
    return np.asarray(Image.open(FOLDER / f"{name}.png").convert("RGB"))


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    made = [(name, draw().image, tolerance) for name, (draw, tolerance, _) in PICTURES.items()]
    made += [(f"{name}_painted", painted(PICTURES[name][0]), PAINTED_ALIKE) for name in PAINTED]
    for name, image, tolerance in made:
        path = FOLDER / f"{name}.png"
        if not path.exists() or difference(image, reference(name)) > tolerance:
            small = Image.fromarray(np.rint(shrunk(image, 120)).astype(np.uint8))
            small.save(path, format="PNG", optimize=True)
            print(path)
    image = of_readme()
    if not README.exists() or difference(image, np.asarray(Image.open(README))) > OF_README:
        README.parent.mkdir(exist_ok=True)
        Image.fromarray(image).save(README, quality=88, optimize=True)
        print(README)


if __name__ == "__main__":
    main()
