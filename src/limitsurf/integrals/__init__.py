"""Rules on the surface and sums over it: quadrature, area, volume, centroid, inertia."""
