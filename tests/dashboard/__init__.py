"""Tests of the page, a package: one browser serves all that a worker runs, and ends with the last of them."""
