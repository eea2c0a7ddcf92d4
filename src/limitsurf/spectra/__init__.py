"""What spectra say of schemes: eigenbases, eigenfunctions, characteristic maps."""

from limitsurf.spectra.basis import Eigenbasis as Eigenbasis
from limitsurf.spectra.basis import EigenvalueGroup as EigenvalueGroup
from limitsurf.spectra.basis import eigenbasis as eigenbasis
