"""Plain-array functions that import nothing of the library and may be called from any room."""
