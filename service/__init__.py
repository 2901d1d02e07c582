"""The service: API, store, runs and command line. It uses solver and schemas."""
