"""Answers: weights times points, of one request, by one of two implementations.

`reference` is NumPy on any number type, `compiled` float64 by kernels; both have the functions of
`protocol.Engine`. `choice` decides which of them answers. What depends on the cage's topology alone
is in `topology`, shared by all that have other points.
"""
