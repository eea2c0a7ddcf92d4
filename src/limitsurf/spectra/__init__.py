"""What spectra say of schemes: eigenbases, eigenfunctions, characteristic maps."""

from limitsurf.spectra.analysis import AnalysedEigenvalue as AnalysedEigenvalue
from limitsurf.spectra.analysis import CurvatureAnalysis as CurvatureAnalysis
from limitsurf.spectra.analysis import SpectralAnalysis as SpectralAnalysis
from limitsurf.spectra.analysis import spectral_analysis as spectral_analysis
from limitsurf.spectra.basis import Eigenbasis as Eigenbasis
from limitsurf.spectra.basis import EigenvalueGroup as EigenvalueGroup
from limitsurf.spectra.basis import eigenbasis as eigenbasis
