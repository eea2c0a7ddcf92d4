"""Limit faces as polynomial pieces: cells, their Bernstein coefficients, hulls of what remains."""
