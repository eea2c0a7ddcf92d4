"""Frozen tables with provenance, in memory and on disk: the only door from `exact` to the rest.

Records are what is handed out; the cache finds or derives them; masks come out as arrays of the
number type that is asked for. ``python -m limitsurf.tables [DIRECTORY]`` writes the shipped tables.
"""

from limitsurf.exact.creases import INFINITE as INFINITE
from limitsurf.exact.matrices import grid_index as grid_index
from limitsurf.exact.wide import MOST_FACES as MOST_FACES
from limitsurf.scheme import SCHEMES as SCHEMES
from limitsurf.scheme import SHIPPED_SCHEMES as SHIPPED_SCHEMES
from limitsurf.scheme import find_scheme as find_scheme
from limitsurf.scheme.sector import KINDS as KINDS
from limitsurf.scheme.sector import Sector as Sector
from limitsurf.tables.cache import FORMAT as FORMAT
from limitsurf.tables.cache import SHIPPED_SECTORS as SHIPPED_SECTORS
from limitsurf.tables.cache import eigen_table as eigen_table
from limitsurf.tables.cache import rational_table as rational_table
from limitsurf.tables.cache import write_shipped as write_shipped
from limitsurf.tables.masks import chaikin_weights as chaikin_weights
from limitsurf.tables.masks import collapsed_masks as collapsed_masks
from limitsurf.tables.masks import corner_weights as corner_weights
from limitsurf.tables.masks import curve_weights as curve_weights
from limitsurf.tables.masks import edge_face_weights as edge_face_weights
from limitsurf.tables.masks import edge_weights as edge_weights
from limitsurf.tables.masks import has_spokes as has_spokes
from limitsurf.tables.masks import interpolating_weights as interpolating_weights
from limitsurf.tables.masks import is_infinite as is_infinite
from limitsurf.tables.masks import is_shared as is_shared
from limitsurf.tables.masks import limit_mask as limit_mask
from limitsurf.tables.masks import normal_masks as normal_masks
from limitsurf.tables.masks import orbits as orbits
from limitsurf.tables.masks import ring_masks as ring_masks
from limitsurf.tables.masks import rule_weights as rule_weights
from limitsurf.tables.masks import shares as shares
from limitsurf.tables.masks import spoke_weights as spoke_weights
from limitsurf.tables.masks import strip_tables as strip_tables
from limitsurf.tables.masks import strips_of as strips_of
from limitsurf.tables.masks import vertex_weights as vertex_weights
from limitsurf.tables.records import DenseRing as DenseRing
from limitsurf.tables.records import EigenNumbers as EigenNumbers
from limitsurf.tables.records import EigenTable as EigenTable
from limitsurf.tables.records import FourierRing as FourierRing
from limitsurf.tables.records import RationalTable as RationalTable
from limitsurf.tables.records import RingMasks as RingMasks
from limitsurf.tables.records import StripTables as StripTables
from limitsurf.tables.records import eigen_numbers as eigen_numbers
from limitsurf.tables.verdicts import CurvatureMode as CurvatureMode
from limitsurf.tables.verdicts import Verdicts as Verdicts
from limitsurf.tables.verdicts import verdicts_of as verdicts_of
