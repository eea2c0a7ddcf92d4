"""``python -m limitsurf.tables [DIRECTORY]``: write the tables that ship with the package."""

import sys
from pathlib import Path

from limitsurf.tables.cache import SHIPPED, write_shipped

if __name__ == "__main__":
    for written in write_shipped(Path(sys.argv[1]) if len(sys.argv) > 1 else SHIPPED):
        print(written)
