"""Stars, bands and apparent positions."""
