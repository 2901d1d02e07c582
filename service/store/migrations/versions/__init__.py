"""Steps from layout to layout."""
