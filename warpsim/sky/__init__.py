"""Stars, bands and apparent places."""
