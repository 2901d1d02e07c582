"""Limits of tables in files, which are hostile until parsed; imports nothing of ours, for small processes."""

from __future__ import annotations

from typing import Final

MAX_ROWS: Final = 320_000
"""Rows of a table: 10,000 observations of 16 targets in two states."""
MAX_COLUMNS: Final = 256
MAX_CELLS: Final = 1_000_000
MAX_CELL_LENGTH: Final = 256
"""Characters of a cell; also of the name and of the unit of an array."""
MAX_UNPACKED_BYTES: Final = 64 * 1024 * 1024
"""All parts of an Excel file, or all arrays of a file, together."""
MAX_OBJECTS: Final = 2_000
"""Groups and arrays of an HDF5 file."""
MAX_MEMORY: Final = 384 * 1024 * 1024
"""Memory of the process that reads arrays, in addition to that of numpy [bytes]."""
MAX_SECONDS: Final = 60
"""Processor time of the process that reads arrays [s]."""
