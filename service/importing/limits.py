"""Limits of files, which are hostile until parsed."""

from __future__ import annotations

from typing import Final

MAX_FILE_BYTES: Final = 8 * 1024 * 1024
"""All files of an import together, as they are sent: as much as a measurement set that is posted."""
MAX_FILES: Final = 64
"""Files of an import: a table, and one for each of 16 targets in each state."""
MAX_ROWS: Final = 320_000
"""Rows of a file: 10,000 observations of 16 targets in two states."""
MAX_LINES: Final = 400_000
"""Lines of all files together: rows, comments, empty lines. Each takes 200 bytes until it is understood."""
MAX_COLUMNS: Final = 256
MAX_CELLS: Final = 1_000_000
MAX_CELL_LENGTH: Final = 256
MAX_LINE_LENGTH: Final = MAX_COLUMNS * MAX_CELL_LENGTH
MAX_NUMBER_LENGTH: Final = 40
MAX_UNPACKED_BYTES: Final = 64 * 1024 * 1024
"""All parts of an Excel file together, unpacked."""
MAX_SHEET_CELLS: Final = 500_000
"""Cells of a sheet, which take longer to read than those of a text."""
MAX_XML_TAGS: Final = 2_500_000
"""Tags in the parts of an Excel file that are read: four for each number, six for each text, and rows."""
