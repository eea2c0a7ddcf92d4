"""Questions asked of a surface: what is found on it, at a place that nobody names.

One module a question. Those that are asked often stand here as well.
"""

from limitsurf.query.tessellation import POLYGON as POLYGON
from limitsurf.query.tessellation import Polygons as Polygons
from limitsurf.query.tessellation import Tessellation as Tessellation
from limitsurf.query.tessellation import levels_of_detail as levels_of_detail
from limitsurf.query.tessellation import tessellate as tessellate
from limitsurf.query.validation import agrees as agrees
from limitsurf.query.validation import on_refined as on_refined
from limitsurf.query.validation import refinement_gap as refinement_gap
from limitsurf.query.validation import validate as validate
