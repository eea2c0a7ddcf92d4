"""Files and the objects of other libraries: cages, tessellations, queries, answers.

`by_suffix` holds the calls, `formats` the table of what each format can hold. A format has a module
of its own name (`obj`, `ply`, `off`, `usd`) or is one of those that a library knows
(`vtk_objects`, `trimesh_objects`). To add one is to add a module and its row in `formats`.
"""
