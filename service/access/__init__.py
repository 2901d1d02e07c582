"""Keys: made, known and recognised; wrong ones slow down."""
