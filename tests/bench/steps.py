"""Queries of schemes that are evaluated by steps, by kernels and by NumPy, in processor time.

``python tests/bench/steps.py`` prints microseconds a query, the least of several rounds in turn.
"""

import time
from functools import partial

import numpy as np

import limitsurf as ls
from limitsurf import _kernels, compiling

QUERIES, ROUNDS, SINGLE = 1 << 14, 5, 300


def cage():
    """An octahedron, cut twice, with corners that are moved: 128 triangles, six of valence 4."""
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    upper = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]]
    faces = upper + [[b, a, 5] for a, b, _ in upper]
    fine = ls.refined(ls.Mesh(points, faces), 2, scheme="loop")
    moved = fine.points + np.random.default_rng(0).normal(size=fine.points.shape) / 50
    return ls.Mesh(moved, fine.faces)


def places(n_faces):
    random = np.random.default_rng(1)
    u, v = random.random((2, QUERIES))
    over = u + v > 1
    return (
        random.integers(0, n_faces, QUERIES),
        np.where(over, 1 - u, u),
        np.where(over, 1 - v, v),
    )


def spent(call):
    begin = time.process_time()
    call()
    return time.process_time() - begin


def main():
    _kernels.load()
    print(f"compiling, or loading: {spent(compiling._step):.2f} s")
    _kernels.available.add(_kernels.STEPWISE)
    mesh = cage()
    for scheme in ("butterfly", "modified-butterfly", "sqrt3"):
        surfaces = [ls.LimitSurface(mesh, scheme=scheme, engine=e) for e in ("auto", "reference")]
        measure(scheme, surfaces, *places(mesh.n_faces))
    refine(mesh)


def refine(mesh):
    """What a new face costs by kernels, of each scheme in turn."""
    levels = {"loop": 5, "butterfly": 5, "modified-butterfly": 5, "sqrt3": 6}
    least = dict.fromkeys(levels, np.inf)
    with _kernels.chosen("compiled"):
        for _ in range(2 * ROUNDS):
            for scheme, count in levels.items():
                new = ls.Mesh(mesh.points, mesh.faces)  # nothing is known of it
                faces = mesh.n_faces * (3 if scheme == "sqrt3" else 4) ** count
                seconds = spent(partial(ls.refined, new, count, scheme=scheme))
                least[scheme] = min(least[scheme], seconds / faces)
    for scheme, seconds in least.items():
        print(f"{scheme:20s}refined, a new face {seconds * 1e9:9.0f} ns")


def measure(scheme, surfaces, face, u, v):
    one = list(zip(face.tolist(), u.tolist(), v.tolist(), strict=True))[:SINGLE]
    calls = {
        "positions": lambda s: s.evaluate(face, u, v),
        "jets": lambda s: s.jet(face, u, v, order=1),
        "normals": lambda s: s.normal(face, u, v),
        "single positions": lambda s: [s.evaluate(*place) for place in one],
    }
    for name, call in calls.items():
        count = SINGLE if "single" in name else QUERIES
        rounds = [[spent(partial(call, s)) for s in surfaces] for _ in range(ROUNDS)]
        kernels, numpy = np.min(rounds, axis=0) / count * 1e6
        print(f"{scheme:20s}{name:20s}{kernels:9.2f} us by kernels, {numpy:9.2f} by NumPy")


if __name__ == "__main__":
    main()
