"""Records what the library answers on the zoo, on shared cages and with all options, to compare.

``python tests/answers.py record FILE`` writes some hundred thousand answers of the installed
library: positions, derivatives, normals, tangents, curvature, weights, refined points, limits,
channels and Fractions, in both engines. ``python tests/answers.py compare FILE`` asks again and
tells of every kind of answer how many differ and by how many units in the last place at most; its
exit code is 1 if any does. ``--only WORD`` takes the cages with that word in their names.

Floats may differ in their last digits from machine to machine: record and compare on one.
"""

import argparse
import os
import pickle
import sys
import warnings
import zlib
from fractions import Fraction
from pathlib import Path

import numpy as np
import zoo

import limitsurf as ls
from limitsurf._kernels import VARIABLE

SHARED = Path(__file__).resolve().parents[2] / "shared" / "cages"
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (4, 0)]
# as engine: how small calls are answered
ENGINES = ("reference", "compiled")
# parameters: inside, on lines between pieces, at and near corners
PLACES = [0.0, 1.0, 0.5, 0.25, 1 / 3, 0.7, 1e-3, 1e-12, 2.0**-400, 1 - 2.0**-30]


def cages():
    """Names, meshes and the options of their surfaces."""
    for name, (points, faces, *_) in zoo.NONMANIFOLD.items():
        yield f"nonmanifold/{name}", ls.Mesh(points, faces), {}
    for name, make in zoo.ZOO.items():
        points, faces = make()
        mesh = ls.Mesh(points, faces)
        yield f"zoo/{name}", mesh, {}
        if zoo.boundary_vertices(faces):
            yield f"zoo/{name}/edge_only", mesh, {"boundary": "edge_only"}
            yield f"zoo/{name}/none", mesh, {"boundary": "none"}
        if any(len(face) == 3 for face in faces):
            yield f"zoo/{name}/smooth", mesh, {"triangles": "smooth"}
    for name, make in zoo.TAGGED.items():
        points, faces, tags = make()
        mesh = ls.Mesh(points, faces, **tags)
        yield f"tagged/{name}", mesh, {}
        if any(0 < s < 10 for s in tags.get("creases", {}).values()):
            yield f"tagged/{name}/chaikin", mesh, {"creasing": "chaikin"}
    for seed in range(12):
        yield f"random/{seed}", random_cage(seed), {}
    for path in sorted(SHARED.glob("*.obj")):
        if not path.name.startswith("loop"):
            yield f"shared/{path.stem}", ls.read(path), {"scheme": "catmull-clark"}


def random_cage(seed):
    """Polygons with tags and channels."""
    g = np.random.default_rng(seed)
    base = [zoo.cube, zoo.dodecahedron, zoo.octahedron, lambda: zoo.torus(4, 5)][seed % 4]()
    points, faces = zoo.carved(zoo.raw(base), seed) if seed % 3 else base
    points, faces, tags = zoo.randomly_tagged((points, faces), seed)
    corners = [v for face in faces for v in face]
    values = g.normal(size=(len(corners), 2))
    joined = g.random(len(corners)) < 0.7
    index = np.where(joined, np.array(corners) % len(values), np.arange(len(corners)))
    mode = ["none", "corners_only", "corners_plus1", "corners_plus2", "boundaries", "all"][seed % 6]
    channels = {"uv": (values, index, mode)}
    return ls.Mesh(points, faces, channels=channels, **tags)


def queries(surface, name, most=240):
    """Faces and parameters, the same each time."""
    g = np.random.default_rng(zlib.crc32(name.encode()))
    n = len(surface.limit_faces)
    faces = np.arange(n) if n <= 40 else np.sort(g.choice(n, 40, replace=False))
    each = max(2, most // len(faces))
    face = np.repeat(faces, each)
    u, v = (g.choice(PLACES + g.random(10).tolist(), len(face)) for _ in range(2))
    return face, u, v


def answered(function, *arguments, **options):
    """What a function returns, or the text of its error."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return function(*arguments, **options)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def dense(matrix):
    """A sparse matrix of weights, exact ones as texts."""
    found = matrix.toarray()
    return texts(found) if found.dtype == object else found


def texts(array):
    return np.array([str(x) for x in np.ravel(array)]).reshape(np.shape(array))


def stacked(answer):
    return np.stack([*answer.values()] if isinstance(answer, dict) else answer)


def of_surface(surface, name):
    """Answers of one engine by what was asked."""
    at = queries(surface, name)
    for nu in ORDERS:
        yield f"evaluate{nu}", answered(surface.evaluate, *at, nu=nu)
    yield "jet", answered(lambda: stacked(surface.jet(*at, order=3)))
    for nu in ((0, 0), (1, 0), (0, 2)):
        weights = answered(surface.weights, *at, nu=nu)
        yield f"weights{nu}", weights if isinstance(weights, str) else dense(weights)
    yield "limit faces", np.stack([surface.limit_faces.face, surface.limit_faces.corner])
    if surface.points.shape[1:] == (3,):
        yield "normal", answered(surface.normal, *at)
        yield "tangents", answered(lambda: stacked(surface.tangents(*at)))
        curvature = answered(surface.curvature, *at)
        for field in ("k1", "k2", "mean", "gaussian"):
            known = isinstance(curvature, str)
            yield f"curvature {field}", curvature if known else getattr(curvature, field)
    for channel in surface.mesh.channels:
        yield f"channel {channel}", answered(surface.evaluate, *at, channel=channel)


def of_fractions(surface, name):
    """Exact answers, as texts."""
    face, u, v = (x[::6] for x in queries(surface, name, 60))
    at = face, *([Fraction(round(64 * float(x)), 64) for x in y] for y in (u, v))
    for nu in ((0, 0), (1, 0), (1, 1)):
        yield f"exact{nu}", answered(lambda nu: texts(surface.evaluate(*at, nu=nu)), nu)
    yield "exact weights", answered(lambda: dense(surface.weights(*at)))


def of_refinement(mesh, options):
    """Refined meshes, limits and a tessellation."""
    for level in (1,) if mesh.n_faces > 3000 else (1, 2):
        made = answered(ls.refined, mesh, level, operator=True, **options)
        if isinstance(made, str):
            yield f"refined {level}", made
            continue
        fine, operator = made
        yield f"refined {level}", fine.points
        yield f"faces {level}", np.concatenate([fine.sizes, fine.indices])
        if mesh.n_vertices < 3000:
            yield f"operator {level}", dense(operator)
        yield f"limits {level}", answered(getattr, fine, "limit_points")
        yield f"normals {level}", answered(getattr, fine, "limit_normals")
        for what in ("parent_face", "parent_u", "parent_v"):
            yield f"{what} {level}", getattr(fine, what)
        for name, (values, index, _) in fine.channels.items():
            yield f"channel {name} {level}", np.asarray(values)
            yield f"channel {name} of corners {level}", np.asarray(index)
    made = answered(lambda: ls.tessellate(ls.LimitSurface(mesh, **options), 3))
    known = isinstance(made, str)
    yield "tessellation", made if known else np.concatenate([made.points, made.normals])


def record(only=""):
    """All answers, by (cage, engine, what was asked)."""
    found = {}
    for engine in ENGINES:
        os.environ[VARIABLE] = engine
        for name, mesh, options in cages():
            if only not in name:
                continue
            surface = answered(ls.LimitSurface, mesh, **options)
            if isinstance(surface, str):
                found[name, engine, "surface"] = surface
                continue
            asked = [of_surface(surface, name), of_refinement(mesh, options)]
            if engine == "reference" and mesh.n_faces < 300:
                asked.append(of_fractions(surface, name))
            for each in asked:
                for what, answer in each:
                    found[name, engine, what] = answer
            print(".", end="", flush=True, file=sys.stderr)
    print(file=sys.stderr)
    return found


def apart(before, after):
    """Numbers that differ, of how many, by how many units in the last place at most."""
    if isinstance(before, str) or isinstance(after, str):
        same = isinstance(before, str) and isinstance(after, str) and before == after
        return int(not same), 1, 0.0 if same else np.inf
    before, after = np.asarray(before), np.asarray(after)
    if before.shape != after.shape or before.dtype.kind != after.dtype.kind:
        return 1, 1, np.inf
    if before.dtype.kind != "f":
        different = int((before != after).sum())
        return different, before.size, np.inf if different else 0.0
    equal = (before == after) | (np.isnan(before) & np.isnan(after))
    if equal.all():
        return 0, before.size, 0.0
    with np.errstate(all="ignore"):
        steps = np.abs(before - after) / np.spacing(np.maximum(np.abs(before), np.abs(after)))
    steps = np.where(np.isnan(steps), np.inf, steps)[~equal]
    return int((~equal).sum()), before.size, float(steps.max())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("file", type=Path)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    found = record(options.only)
    if options.what == "record":
        options.file.write_bytes(zlib.compress(pickle.dumps(found), 1))
        total = sum(apart(x, x)[1] for x in found.values())
        print(f"{len(found)} answers of {total} numbers")
        return 0
    before = pickle.loads(zlib.decompress(options.file.read_bytes()))
    before = {key: value for key, value in before.items() if options.only in key[0]}
    lost = [key for key in before if key not in found]
    counts = {}
    for key in before.keys() & found.keys():
        different, total, steps = apart(before[key], found[key])
        kind = key[1:]
        a, b, c, names = counts.get(kind, (0, 0, 0.0, []))
        counts[kind] = a + different, b + total, max(c, steps), names + [key[0]] * bool(different)
    for kind, (different, total, steps, names) in sorted(counts.items()):
        if different:
            print(*kind, f"{different} of {total} differ, by {steps:.3g} ulp:", *sorted(names)[:5])
    for key in lost:
        print(*key, "is not answered")
    print(f"{sum(x[1] for x in counts.values())} numbers compared")
    return int(any(x[0] for x in counts.values()) or bool(lost))


if __name__ == "__main__":
    sys.exit(main())
