"""Where bytes, pixels and arguments come in and go out."""
