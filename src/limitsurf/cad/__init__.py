"""To CAD and back: spline faces, solids, interpolation, fitting, fairing, offsets."""
