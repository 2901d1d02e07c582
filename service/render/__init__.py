"""Terminal tables and reports."""
