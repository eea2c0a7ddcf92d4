"""Exact mathematics: schemes as values, subdivision matrices, spectra. No float and no mesh in this room."""
