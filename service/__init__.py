"""The service: API, store, runs and command line. The only package that sees schemas and solver."""
