"""Exact mathematics: schemes as values, subdivision matrices, spectra; no float, no mesh."""
