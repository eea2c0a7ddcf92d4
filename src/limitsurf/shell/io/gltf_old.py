"""Files of glTF 1, whose objects have names instead of numbers, as such of glTF 2."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

_ATTRIBUTES = {"TEXCOORD": "TEXCOORD_0", "COLOR": "COLOR_0"}
_PLACE = ("matrix", "translation", "rotation", "scale", "name")
_BINARY = ("binary_glTF", "KHR_binary_glTF")  # the names of what follows the JSON


def converted(old: Any, rest: bytes) -> tuple[Any, bytes]:
    """The JSON of a file, and what follows it, with all shapes as glTF 2 has them.

    A file of glTF 2 is returned as it is. Of materials the names remain.
    """
    if not isinstance(old, dict) or not isinstance(old.get("meshes"), dict):
        return old, rest
    kinds = ("nodes", "meshes", "accessors", "buffers", "scenes", "materials")
    numbers = {kind: {name: i for i, name in enumerate(old.get(kind) or {})} for kind in kinds}
    found: dict[str, Any] = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
    found["buffers"] = [
        {"byteLength": len(rest), "uri": _data(rest)} if name in _BINARY else buffer
        for name, buffer in (old.get("buffers") or {}).items()
    ]
    for accessor in old["accessors"].values():
        view = old["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        length = view.get("byteLength")
        new = {"buffer": numbers["buffers"][view["buffer"]], "byteOffset": start}
        new["byteLength"] = (length or 0) - accessor.get("byteOffset", 0)
        if accessor.get("byteStride"):
            new["byteStride"] = accessor["byteStride"]
        kept = {name: accessor[name] for name in ("componentType", "count", "type")}
        found["accessors"].append({**kept, "bufferView": len(found["bufferViews"])})
        found["bufferViews"].append(new)
    found["meshes"] = [
        {"primitives": [_primitive(p, numbers["accessors"]) for p in mesh["primitives"]]}
        for mesh in old["meshes"].values()
    ]
    found["materials"] = [{"name": name} for name in numbers["materials"]]
    found["nodes"] = [{name: node[name] for name in _PLACE if name in node}
                      for node in old["nodes"].values()]  # fmt: skip
    for new, node in zip(list(found["nodes"]), old["nodes"].values(), strict=True):
        children = [numbers["nodes"][name] for name in node.get("children", ())]
        meshes = [numbers["meshes"][name] for name in node.get("meshes", ())]
        if len(meshes) == 1:
            new["mesh"] = meshes[0]
        else:
            children += range(len(found["nodes"]), len(found["nodes"]) + len(meshes))
            found["nodes"] += [{"mesh": mesh} for mesh in meshes]
        if children:
            new["children"] = children
    found["scenes"] = [
        {"nodes": [numbers["nodes"][name] for name in scene.get("nodes", ())]}
        for scene in old["scenes"].values()
    ]
    found["scene"] = numbers["scenes"].get(old.get("scene"), 0)
    return found, b""


def _data(content: bytes) -> str:
    return "data:application/octet-stream;base64," + b64encode(content).decode()


def _primitive(old: Any, numbers: dict[str, int]) -> dict[str, Any]:
    """A primitive with numbers of accessors, without its material."""
    attributes = {_ATTRIBUTES.get(x, x): numbers[name] for x, name in old["attributes"].items()}
    found = {"attributes": attributes, "mode": old.get("mode", 4)}
    return {**found, "indices": numbers[old["indices"]]} if "indices" in old else found
