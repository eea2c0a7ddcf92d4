"""What there is in glTF files that trimesh passes over: fans, which are read, and all else."""

from __future__ import annotations

import json
import re
from base64 import b64decode, b64encode
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

# modes of primitives that have no triangles, or none that could be read
_MODES = {0: "points", 1: "lines", 2: "lines", 3: "lines", 6: "triangle fans"}
_TRIANGLES, _FAN = 4, 6
_INTEGERS = {5121: "<u1", 5123: "<u2", 5125: "<u4"}  # types of components that indices have
_HEAD = 20  # bytes of a binary file before its JSON
_BROKEN = (ValueError, LookupError, TypeError, AttributeError, OSError)


def _opened(data: bytes) -> tuple[Any, bytes]:
    """The JSON in a file, and what follows it in a binary one."""
    if data[:4] != b"glTF":
        return json.loads(data), b""
    end = _HEAD + int.from_bytes(data[12:16], "little")
    return json.loads(data[_HEAD:end]), data[end:]


def with_triangles(data: bytes, resolved: Callable[[str], bytes] | None) -> bytes:
    """A file with triangles in place of fans; those that are broken stay fans.

    `resolved` gives the content of files that this one names.
    """
    if not re.search(rb'"mode"\s*:\s*6', data):
        return data
    try:
        found, rest = _opened(data)
        fans = [p for mesh in found["meshes"] for p in mesh["primitives"] if p.get("mode") == _FAN]
    except _BROKEN:
        return data  # trimesh says what is wrong
    for primitive in fans:
        with suppress(*_BROKEN):
            corners = _indices(found, primitive, rest, resolved)
            first = np.broadcast_to(corners[:1], max(len(corners) - 2, 0))
            faces = np.stack([first, corners[1:-1], corners[2:]], axis=1)
            a, b, c = faces.T
            _add_indices(found, primitive, faces[(a != b) & (b != c) & (c != a)].astype("<u4"))
    head = json.dumps(found).encode()
    if data[:4] != b"glTF":
        return head
    head += b" " * (-len(head) % 4)
    total, length = (n.to_bytes(4, "little") for n in (_HEAD + len(head) + len(rest), len(head)))
    return data[:8] + total + length + data[16:_HEAD] + head + rest


def _indices(
    found: Any, primitive: Any, rest: bytes, resolved: Callable[[str], bytes] | None
) -> Any:
    """The vertices (n,) of a primitive, in their order."""
    if "indices" not in primitive:
        return np.arange(found["accessors"][primitive["attributes"]["POSITION"]]["count"])
    accessor = found["accessors"][primitive["indices"]]
    view = found["bufferViews"][accessor["bufferView"]]
    uri = found["buffers"][view["buffer"]].get("uri")
    if uri is None:
        content = rest[8:]  # behind the head of the one chunk of bytes that there is
    elif "base64," in uri:
        content = b64decode(uri.partition("base64,")[2])
    elif resolved is not None:
        content = resolved(uri)
    else:
        raise LookupError(uri)
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.frombuffer(
        content, _INTEGERS[accessor["componentType"]], accessor["count"], start
    ).astype(np.int64)


def _add_indices(found: Any, primitive: Any, faces: Any) -> None:
    """Make triangles of a primitive, (t, 3) vertices, which a buffer of their own holds."""
    content = faces.tobytes()
    uri = "data:application/octet-stream;base64," + b64encode(content).decode()
    for name, value in (
        ("buffers", {"uri": uri, "byteLength": len(content)}),
        ("bufferViews", {"buffer": len(found.get("buffers", ())), "byteLength": len(content)}),
        (
            "accessors",
            {
                "bufferView": len(found.get("bufferViews", ())),
                "componentType": 5125,
                "count": faces.size,
                "type": "SCALAR",
            },
        ),
    ):
        found.setdefault(name, []).append(value)
    primitive |= {"mode": _TRIANGLES, "indices": len(found["accessors"]) - 1}


def others(data: bytes) -> tuple[list[str], list[str]]:
    """What a glTF file has besides triangles and texture coordinates, and what is wrong there."""
    try:
        found, _ = _opened(data)
        primitives = [p for mesh in found["meshes"] for p in mesh["primitives"]]
        names = {name for p in primitives for name in p["attributes"]}
        others = sorted(names - {"POSITION", "NORMAL", "TEXCOORD_0"})
        others += sorted({_MODES[m] for p in primitives if (m := p.get("mode", 4)) in _MODES})
        others += ["targets"] if any("targets" in p for p in primitives) else []
        others += [name for name in ("animations", "skins", "cameras") if found.get(name)]
        plain = [{"pbrMetallicRoughness": {}}, {}, {"name": "material_0"}]
        others += ["materials"] if any(x not in plain for x in found.get("materials", ())) else []
        others += ["names of objects"] if len(found["meshes"]) > 1 else []
        damage = {}
        for p in primitives:
            count = {name: found["accessors"][i]["count"] for name, i in p["attributes"].items()}
            for name, number in count.items():
                if number != count["POSITION"]:
                    damage[name] = f"got {number} of {name}, need {count['POSITION']}, one a point"
        return others, list(damage.values())
    except _BROKEN:
        return [], []  # trimesh has read it all the same
