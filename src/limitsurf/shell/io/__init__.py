"""Files and the objects of other libraries: cages, tessellations, queries, answers.

`by_suffix` has the calls, `formats` the table of what each format holds. A format of cages is a
module: `obj`, `ply`, `off`, `usd` (with `usd_reader`, `usd_scene`), `vtk` (with `vtk_reader`), or
`by_trimesh` for those that trimesh knows, with `gltf`. What they have in common is in `polygons`
(faces, points, "uv"), `parts` (many meshes as one), `losses` (what is left out), `apart` and
`references` (processes that read broken files). `queries` and `answers` are CSV, NPY, NPZ, Parquet
and Zarr.
"""
