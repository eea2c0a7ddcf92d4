"""What OpenCASCADE does with solids of limit surfaces: cuts, fuses, sections and fillets.

    python tests/bench/booleans.py cages/*.obj

One line for each closed cage: faces; whether the solid, what a box keeps of it and what it takes
away, and the union with a cylinder are valid; how far the volumes of both parts are from the whole,
and the union from inclusion and exclusion, as shares of the whole; edges of a plane section, and
whether they close; whether the rim of a plane cut takes a fillet; seconds of the processor.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np

import limitsurf as ls
from limitsurf.cad.opencascade import failures, module, parts_of

HEAD = ("cage", "faces", "solid", "cut", "sum", "fuse", "sum", "section", "fillet", "s")


def is_valid(shape):
    return bool(module("BRepCheck").BRepCheck_Analyzer(shape).IsValid())


def volume(shape):
    found = module("GProp").GProp_GProps()
    module("BRepGProp").BRepGProp.VolumeProperties_s(shape, found, 1e-8)
    return found.Mass()


def boolean(kind, one, two):
    """The shape of a boolean operation, or None."""
    made = getattr(module("BRepAlgoAPI"), f"BRepAlgoAPI_{kind}")(one, two)
    return made.Shape() if made.IsDone() else None


def box(low, high):
    point = module("gp").gp_Pnt
    return module("BRepPrimAPI").BRepPrimAPI_MakeBox(point(*low), point(*high)).Shape()


def cylinder(at, radius, height):
    gp = module("gp")
    axis = gp.gp_Ax2(gp.gp_Pnt(*at), gp.gp_Dir(0, 0, 1))
    return module("BRepPrimAPI").BRepPrimAPI_MakeCylinder(axis, radius, height).Shape()


def section(shape, at, normal):
    """How many edges a plane section has, and whether they are closed curves."""
    gp = module("gp")
    found = boolean("Section", shape, gp.gp_Pln(gp.gp_Pnt(*at), gp.gp_Dir(*normal)))
    if found is None:
        return 0, False
    tool = module("TopExp").TopExp
    ends = {}
    edges = list(parts_of(found, "Edge"))
    for edge in edges:
        for vertex in (tool.FirstVertex_s(edge), tool.LastVertex_s(edge)):
            ends[hash(vertex)] = ends.get(hash(vertex), 0) + 1
    return len(edges), all(n % 2 == 0 for n in ends.values())


def fillet(shape, at, radius):
    """Whether the edges in the plane x = at take a fillet, and leave a valid solid."""
    made = module("BRepFilletAPI").BRepFilletAPI_MakeFillet(shape)
    tool = module("BRep").BRep_Tool
    seen = set()
    for face in parts_of(shape, "Face"):
        if type(tool.Surface_s(face)).__name__ != "Geom_Plane":
            continue
        for edge in parts_of(face, "Edge"):
            if hash(edge) not in seen:
                seen.add(hash(edge))
                made.Add(radius, edge)
    made.Build()
    return made.IsDone() and is_valid(made.Shape())


def judged(surface, **how):
    """What comes of a surface: a row of the table."""
    solid = ls.to_brep(surface, solid=True, **how)
    whole = volume(solid)
    points = surface.limit_faces.face * 0
    points = surface.evaluate(np.arange(len(points)), 0.5, 0.5)
    low, high = points.min(axis=0), points.max(axis=0)
    size = high - low
    middle = low + size * [0.4872, 0.4653, 0.5211]
    far = low - 2 * size.max(), high + 2 * size.max()
    half = box(far[0], [middle[0], far[1][1], far[1][2]])
    cut, common = boolean("Cut", solid, half), boolean("Common", solid, half)
    both = [x is not None and is_valid(x) for x in (cut, common)]
    added = (volume(cut) + volume(common)) / whole - 1 if all(both) else np.nan
    post = cylinder([*middle[:2], middle[2]], size.min() / 7, 2 * size.max())
    fuse, shared = boolean("Fuse", solid, post), boolean("Common", solid, post)
    fused = [x is not None and is_valid(x) for x in (fuse, shared)]
    union = np.nan
    if all(fused):
        union = (volume(fuse) + volume(shared) - volume(post)) / whole - 1
    edges, closed = section(solid, middle, (0.13, 0.21, 1))
    rounded = "-"
    if both[0]:
        try:
            with failures("fillet"):
                rounded = "yes" if fillet(cut, middle[0], 0.01 * size.min()) else "no"
        except ValueError:
            rounded = "refused"
    return {
        "faces": sum(1 for _ in parts_of(solid, "Face")), "solid": is_valid(solid),
        "cut": all(both), "sum": added, "fuse": all(fused), "union": union,
        "section": f"{edges}{'' if closed else ' open'}", "fillet": rounded,
    }  # fmt: skip


def main(paths):
    print(" | ".join(HEAD))
    for path in paths:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = ls.read(path)
        if not mesh.is_closed:
            continue
        begin = time.process_time()
        try:
            row = judged(ls.LimitSurface(mesh)).values()
        except ValueError as error:
            row = [str(error)[:90]]
        said = [f"{x:.1e}" if isinstance(x, float) else str(x) for x in row]
        print(
            " | ".join([Path(path).stem, *said, f"{time.process_time() - begin:.1f}"]), flush=True
        )


if __name__ == "__main__":
    main(sys.argv[1:])
