"""Data of faces in USD: subsets of a mesh, materials by name, and uniform primvars."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, UsdGeom, Vt

from limitsurf.cage.checks import MeshError
from limitsurf.cage.mesh import Mesh
from limitsurf.shell.io.parts import LONGEST
from limitsurf.shell.io.usd_values import numbers_of

BINDING = "materialBind"  # the family of subsets that bind materials
MATERIAL = "material"  # what names of materials are called among the data of faces
UNNAMED = "subset"  # of subsets without a family
NOTE = "limitsurf:value"  # the text of a subset whose name, an identifier, is another
_ARRAYS = {  # of numbers a face: USD's type and array, by that of NumPy and how many there are
    (1, "b"): ("BoolArray", Vt.BoolArray, bool),
    (1, "i"): ("Int64Array", Vt.Int64Array, np.int64),
    (1, "f"): ("DoubleArray", Vt.DoubleArray, np.float64),
    (2, "f"): ("Double2Array", Vt.Vec2dArray, np.float64),
    (3, "f"): ("Double3Array", Vt.Vec3dArray, np.float64),
    (4, "f"): ("Double4Array", Vt.Vec4dArray, np.float64),
}


def data_of_faces(
    prim: Any, time: Any, n_faces: int, lost: Callable[[str, str], None]
) -> dict[str, NDArray[Any]]:
    """What a mesh says of each of its faces, by name; `lost` is told a kind and what is wrong."""
    found: dict[str, NDArray[Any]] = {}
    bound = _material(prim)
    if bound:
        found[MATERIAL] = np.full(n_faces, bound)
    families: dict[str, list[tuple[str, NDArray[np.int64]]]] = {}
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
            continue
        family, name = subset.GetFamilyNameAttr().Get() or UNNAMED, subset.GetPrim().GetName()
        try:
            faces = numbers_of(subset.GetPrim(), "indices", time, "i")
            wrong = faces[(faces < 0) | (faces >= n_faces)]
            if len(wrong):
                need = f"need 0 to {n_faces - 1}"
                raise MeshError(f"subset {name!r}: face {wrong[0]} is out of range, {need}")
        except MeshError as error:
            lost("subset", str(error))
            continue
        if family == BINDING:
            family, name = MATERIAL, _material(subset.GetPrim(), own=True) or name
        name = subset.GetPrim().GetCustomDataByKey(NOTE) or name
        families.setdefault(family, []).append((str(name), faces))
    families = {name: [s for s in some if len(s[1])] for name, some in families.items()}
    for family, subsets in families.items():
        if not subsets:
            continue
        found |= _family(family, subsets, found.get(family, np.full(n_faces, "")))
    found |= _uniform(prim, time, n_faces, lost)
    long = [name for name, x in found.items() if x.dtype.kind == "U" and x.itemsize > 4 * LONGEST]
    for name in long:
        lost("long names", f"data of faces {name!r}: names of more than {LONGEST} letters")
        del found[name]
    return found


def _family(
    family: str, subsets: list[tuple[str, NDArray[np.int64]]], names: NDArray[Any]
) -> dict[str, NDArray[Any]]:
    """Subsets as one text a face, or, where they overlap, each as a truth value by its name."""
    n_faces = len(names)
    every = np.concatenate([np.unique(faces) for _, faces in subsets])
    if len(np.unique(every)) == len(every):
        texts = np.array([name for name, _ in subsets])
        found = names.astype(max(names.dtype, texts.dtype, key=lambda kind: kind.itemsize))
        for name, faces in subsets:
            found[faces] = name
        return {family: found}
    flags = {name: np.zeros(n_faces, dtype=bool) for name, _ in subsets}
    for name, faces in subsets:
        flags[name][faces] = True
    return flags


def _material(prim: Any, own: bool = False) -> str:
    """The name of the material that is bound to a prim or one above it; "" if there is none."""
    while prim:
        targets = prim.GetRelationship("material:binding").GetForwardedTargets()
        if targets:
            return str(targets[0].name)
        prim = None if own else prim.GetParent()
    return ""


def _uniform(
    prim: Any, time: Any, n_faces: int, lost: Callable[[str, str], None]
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Primvars of one number, row of numbers or text a face."""
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues():
        if not is_of_faces(primvar):
            continue
        value = primvar.ComputeFlattened(time)
        if value is None:
            continue
        name, array = primvar.GetPrimvarName(), np.array(value)
        if array.dtype.kind == "O":
            array = np.array([str(x) for x in array])
        if array.dtype == np.float16:
            array = array.astype(np.float32)
        if len(array) != n_faces:
            lost("uniform", f"primvar {name!r}: got {len(array)} values, need one for each face")
        elif array.ndim > 2 or array.dtype.kind not in "biufU":
            lost(
                "uniform",
                f"primvar {name!r}: got matrices, need a number, row or text for each face",
            )
        else:
            yield name, array


def is_of_faces(primvar: Any) -> bool:
    """Whether a primvar has a value for each face."""
    return bool(
        primvar.GetInterpolation() == UsdGeom.Tokens.uniform
        and primvar.GetElementSize() == 1
        and primvar.GetTypeName().isArray
    )


def write_data(geom: Any, mesh: Mesh) -> None:
    """Data of faces of a mesh: texts as subsets, each a family, and numbers as uniform primvars."""
    prim, left_out = geom.GetPrim(), []
    for name, values in mesh.face_data.items():
        valid = Tf.IsValidIdentifier(name)
        if values.dtype.kind == "U" and valid:
            _write_texts(geom, BINDING if name == MATERIAL else name, values)
            continue
        width = 1 if values.ndim == 1 else values.shape[1]
        kind = "i" if values.dtype.kind in "iu" else values.dtype.kind
        known = _ARRAYS.get((width, kind)) or _ARRAYS.get((width, "f"))
        if known is None or name in mesh.channels or not _fit(values, known[2]) or not valid:
            left_out.append(name)
            continue
        declared, array, dtype = known
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
            name, getattr(Sdf.ValueTypeNames, declared), UsdGeom.Tokens.uniform
        )
        flat = values if values.ndim == 1 or width > 1 else values[:, 0]
        primvar.Set(array.FromNumpy(np.ascontiguousarray(flat, dtype=dtype)))
    if left_out:
        names = ", ".join(map(repr, left_out))
        text = f"data of faces are left out, of no form, size or name that USD has: {names}"
        warnings.warn(text, stacklevel=5)


def _fit(values: NDArray[Any], dtype: Any) -> bool:
    """Whether numbers keep all digits in another type."""
    if values.dtype.kind not in "iu":
        return True
    most = 2**63 if np.dtype(dtype).kind == "i" else 2**53
    return -most <= int(values.min()) and int(values.max()) < most


def _write_texts(geom: Any, family: str, values: NDArray[Any]) -> None:
    """A subset for each text but the empty one."""
    texts, place = np.unique(values, return_inverse=True)
    order = np.argsort(place.reshape(-1), kind="stable")
    ends = np.cumsum(np.bincount(place.reshape(-1), minlength=len(texts)))
    taken = {child.GetName() for child in geom.GetPrim().GetChildren()}
    for text, faces in zip(texts.tolist(), np.split(order, ends[:-1]), strict=True):
        if not text:
            continue
        base = name = Tf.MakeValidIdentifier(text)
        numbers = count(1)
        while name in taken:
            name = f"{base}_{next(numbers)}"
        taken.add(name)
        indices = Vt.IntArray.FromNumpy(np.sort(faces).astype(np.int32))
        subset = UsdGeom.Subset.Define(geom.GetPrim().GetStage(), geom.GetPath().AppendChild(name))
        subset.CreateElementTypeAttr(UsdGeom.Tokens.face)
        subset.CreateFamilyNameAttr(family)
        subset.CreateIndicesAttr(indices)
        if name != text:
            subset.GetPrim().SetCustomDataByKey(NOTE, text)
    UsdGeom.Subset.SetFamilyType(geom, family, UsdGeom.Tokens.nonOverlapping)
