"""Recursive refinement: mesh and masks to refined mesh and sparse refinement operator."""

from limitsurf.refine.masks import tangent_rows as tangent_rows
from limitsurf.refine.operators import ExactOperator as ExactOperator
from limitsurf.refine.operators import eliminated as eliminated
from limitsurf.refine.operators import merged as merged
from limitsurf.refine.operators import on_one_pattern as on_one_pattern
from limitsurf.refine.operators import over_values as over_values
from limitsurf.refine.operators import sharing as sharing
from limitsurf.refine.operators import sparse_operator as sparse_operator
from limitsurf.refine.operators import stacked as stacked
from limitsurf.refine.recursion import RefinedMesh as RefinedMesh
from limitsurf.refine.recursion import refined as refined
from limitsurf.refine.recursion import refuse_levels as refuse_levels
from limitsurf.refine.stages import refinement_stages as refinement_stages
from limitsurf.refine.stages import stage_rows as stage_rows
