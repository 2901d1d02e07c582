"""Tables of numbers whose columns have no known meaning yet, with their rows in one order."""
