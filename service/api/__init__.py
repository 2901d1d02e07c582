"""Routes: thin, with their parts passed in."""
