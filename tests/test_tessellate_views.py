"""Tessellations to an angle and for a camera: what they state holds where it is looked at."""

import math

import numpy as np
import pytest
import zoo
from test_tessellate_tolerance import CASES, CUBE, apart, check_cover, check_edges, made

import limitsurf as ls
from limitsurf.query.adaptive import WHOLE
from limitsurf.query.stitching import stitched
from limitsurf.query.tessellation import _assembled
from limitsurf.query.wanted import Wanted

SMOOTH = ["cube", "bipyramid", "ngons", "semi", "none", "two_sided", "prism_of_doo-sabin",
          "flat_ngons", "loop_dart", *(f"{x}_of_{y}" for x in ("torus", "open")
                                       for y in ls.schemes.with_pieces)]  # fmt: skip


def samples(surface, parts, n):
    """Random triangles (n, 3) of places, of those that the angle is of, and places in them."""
    _, sites, sizes, _, stated = parts
    first, rng = np.cumsum(sizes) - sizes, np.random.default_rng(1)
    triangles = []
    for size, ways in ((3, [[0, 1, 2]]), (4, [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]])):
        which = np.setdiff1d(np.flatnonzero(sizes == size), stated.without)
        triangles += [sites[first[which, None] + np.array(way)] for way in ways]
    triangles = np.concatenate(triangles)
    triangles = triangles[rng.integers(0, len(triangles), n)]
    shares = rng.dirichlet((1, 1, 1), n)
    shares[: n // 3] = 0.99 * np.eye(3)[rng.integers(0, 3, n // 3)] + 0.01 / 3
    return triangles, shares


def placed(surface, parts, triangles, shares):
    """Faces and (u, v) of corners (n, 3) and of places (n,)."""
    stitches = parts[0]
    at = stitches.at[triangles] / WHOLE
    u, v = np.clip(np.einsum("nij,ni->jn", at, shares), 0, 1)
    if surface.patches.lattice.sloped:
        v = np.minimum(v, 1 - u)
    face = stitches.face[stitches.row[triangles[:, 0]]]
    return (face[:, None], *np.moveaxis(at, 2, 0)), (face, u, v)


def degrees(one, other):
    across = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.degrees(np.arctan2(across, (one * other).sum(axis=-1)))


@pytest.mark.parametrize("name", SMOOTH)
def test_normals_turn_no_more_than_is_stated(name):
    surface = CASES[name]()
    parts = stitched(surface, Wanted(angle=math.radians(25)), 1)
    bound = np.degrees(parts[-1].angle)
    corners, places = placed(surface, parts, *(found := samples(surface, parts, 4000)))
    truth = surface.normal(*places)
    points, normals = surface.evaluate(*corners), surface.normal(*corners)
    of_triangles = degrees(
        np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), truth
    )
    between = degrees(np.einsum("ni,nij->nj", found[1], normals), truth)
    most = max(np.nanmax(of_triangles), np.nanmax(between))
    assert most <= bound + 1e-9 <= 25
    assert bound < 1e-3 or bound <= 2 * most
    check_cover(surface, parts)
    check_edges(name, surface, _assembled(surface, parts, False, (), 1))
    assert not len(parts[-1].without)


def test_finer_angles_of_all_kinds():
    surface = made(*CUBE)
    few, many = (ls.tessellate(surface, angle=x) for x in (24, 12))
    assert few.angle_error <= 24
    assert many.angle_error <= 12
    assert 2.5 < len(many.triangles) / len(few.triangles) < 8
    both = ls.tessellate(surface, angle=24, chord=1e-2)
    assert both.chord_error <= 1e-2
    assert both.angle_error <= 24
    assert ls.tessellate(surface, chord=1e-2).angle_error is None
    # angles do not depend on units
    large = surface.with_points(np.ldexp(surface.points, 300))
    assert len(ls.tessellate(large, angle=24).sizes) == len(few.sizes)


def test_a_cone_has_no_angle_at_its_tip():
    points, faces = CUBE
    surface = made(points, faces, {"corners": {0: np.inf}})
    found = ls.tessellate(surface, angle=40, normals=False)
    assert len(found.without_angle)
    tip = surface.mesh.points[0]
    where = found.points[found.indices[found.offsets[found.without_angle, None] + np.arange(3)]]
    assert np.linalg.norm(where - tip, axis=2).max() < 0.02
    assert found.angle_error <= 40


VIEW = ls.View((3, -2, 2), (0.5, 0.5, 0.5), field_of_view=35, width=640, height=480)


def pixels(view, points):
    """Where points (..., 3) are in a picture, and how deep, by matrices of the textbook."""
    eye, target, up = (np.array(x, float) for x in (view.position, view.target, view.up))
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    camera = (points - eye) @ np.stack([right, np.cross(back, right), back]).T
    scale = view.height / (2 * math.tan(math.radians(view.field_of_view) / 2))
    depth = -camera[..., 2:]
    return scale * camera[..., :2] / depth, depth[..., 0]


@pytest.mark.parametrize("name", ["cube", "torus_of_loop", "open_of_doo-sabin", "bipyramid"])
def test_pictures_are_as_near_as_is_stated(name):
    surface = CASES[name]()
    middle, size = surface.points.mean(axis=0), np.ptp(surface.points, axis=0).max()
    view = ls.View(middle + size * np.array([1.5, -1, 1]), middle, width=400, height=300)
    parts = stitched(surface, Wanted(chord=1.0, view=view), 1)
    assert parts[-1].chord <= 1
    check_cover(surface, parts)
    corners, places = placed(surface, parts, *samples(surface, parts, 3000))
    there, depth = pixels(view, surface.evaluate(*places))
    seen = (np.abs(there) <= (200, 150)).all(axis=1) & (depth > view.near if view.near else True)
    flat, _ = pixels(view, surface.evaluate(*corners))
    lifted = [np.concatenate([x, 0 * x[..., :1]], axis=-1) for x in (there, flat)]
    far = apart(lifted[0], *lifted[1].swapaxes(0, 1))[seen]
    assert 0.1 < far.max() <= parts[-1].chord


def test_coarse_where_nobody_looks_and_fine_at_silhouettes():
    surface = made(*CUBE)
    coarsest = ls.tessellate(surface, chord=9)
    away = ls.View(VIEW.position, (9, -9, 4), field_of_view=20)
    found = ls.tessellate(surface, chord=0.5, view=away, angle=3, edge=0.1)
    assert len(found.sizes) == len(coarsest.sizes)
    assert (found.chord_error, found.angle_error) == (0, 0)
    # nearer cameras see less, and more of it
    side = ls.View(VIEW.position, (0.5, 0.5, 0.85), field_of_view=4, width=640, height=480)
    zoomed = ls.tessellate(surface, chord=0.5, view=side, normals=False)
    there, _ = pixels(side, zoomed.points)
    assert 0.5 < (np.abs(there) <= (320, 240)).all(axis=1).mean() < 1
    # what faces the camera is coarser than distance alone would make it
    view = ls.View((0.5, 0.5, 9), (0.5, 0.5, 0.5), up=(0, 1, 0), field_of_view=8)
    seen = ls.tessellate(surface, chord=0.5, view=view)
    pixel = 1 / pixels(view, np.array([[0.5, 0.5, 0.5], [0.5, 1.5, 0.5]]))[0][1, 1]
    near = ls.tessellate(surface, chord=0.5 * pixel)
    facing = [(degrees(x.normals, np.array([0, 0, 1])) < 30).sum() for x in (seen, near)]
    rim = [(abs(degrees(x.normals, np.array([0, 0, 1])) - 90) < 15).sum() for x in (seen, near)]
    assert 2 * facing[0] < facing[1]
    assert 2 * rim[0] > rim[1]


def test_what_is_refused():
    surface = made(*CUBE)
    for bad in (0, -3, 1e-9, 91, math.nan):
        with pytest.raises(ValueError, match="angle must be"):
            ls.tessellate(surface, angle=bad)
    with pytest.raises(ValueError, match=r"got n=4 and angle=5: give one of them"):
        ls.tessellate(surface, 4, angle=5)
    with pytest.raises(ValueError, match="a view needs chord, in pixels"):
        ls.tessellate(surface, angle=5, view=VIEW)
    with pytest.raises(TypeError, match="view must be a View, got tuple"):
        ls.tessellate(surface, chord=5, view=((0, 0, 0), (1, 1, 1)))
    for name in ("chord", "edge", "angle"):
        with pytest.raises(ValueError, match=f"{name} must be a number that float64 holds, got an"):
            ls.tessellate(surface, **{name: 10**400})
    with pytest.raises(ValueError, match="tolerance must be a number that float64 holds"):
        ls.bounds(surface, tolerance=10**400)
    with pytest.raises(ValueError, match="max_distance must be 0 or more, got -1"):
        ls.closest_point(surface, (0, 0, 0), max_distance=-1)


@pytest.mark.parametrize(("bad", "message"), [
    ({"target": (3, -2, 2)}, "position and target must differ"),
    ({"up": (-2.5, 2.5, -1.5)}, "up must not be along the line of sight"),
    ({"up": (0, 0, 0)}, "up must not be along"),
    ({"position": (0, 0)}, "position must be three numbers"),
    ({"position": (0, 0, -math.inf)}, "position must be finite"),
    ({"field_of_view": 180}, "field_of_view must be above 0 and below 180, got 180"),
    ({"width": 0}, "width must be an integer >= 1"),
    ({"near": 0}, "near must be above 0 and finite, got 0"),
])  # fmt: skip
def test_what_views_refuse(bad, message):
    given = {"position": (3, -2, 2), "target": (0.5, 0.5, 0.5)} | bad
    with pytest.raises(ValueError, match=message):
        ls.View(**given)


@pytest.mark.parametrize("scheme", ls.schemes.with_pieces)
def test_what_has_no_normals_is_not_divided_for_their_angles(scheme):
    """Of a cage that is squeezed into a line."""
    points, faces = zoo.octahedron() if "loop" in scheme or scheme == "linear" else zoo.cube()
    surface = made(np.asarray(points) * [1, 0, 0], faces, scheme=scheme)
    assert len(ls.tessellate(surface, angle=10).faces) < 5000
