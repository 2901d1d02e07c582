"""Messages of the API and of campaign files: frozen, closed, finite, each number with its unit.

Nothing here computes. The package imports pydantic and the standard library only, so that a client
may install it alone, and the solver may fill its results.
"""
