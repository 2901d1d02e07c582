"""Types of files, each read from bytes to grids of uninterpreted cells within limits."""
