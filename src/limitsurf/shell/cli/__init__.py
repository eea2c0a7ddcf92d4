"""The program ``limitsurf``; `commands` holds the commands."""
