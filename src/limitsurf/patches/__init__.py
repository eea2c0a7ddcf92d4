"""Patches of limit faces, as integers: which patch covers what, and its control points."""

from limitsurf.patches.dual import patch_table as patch_table
from limitsurf.patches.table import NO_LIMIT as NO_LIMIT
from limitsurf.patches.table import REGULAR as REGULAR
from limitsurf.patches.table import STRIP as STRIP
from limitsurf.patches.table import PatchTable as PatchTable
from limitsurf.patches.table import SharedRings as SharedRings
