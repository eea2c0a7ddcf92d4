"""Finite elements on the surface itself: spaces of functions, forms, eigenmodes."""
