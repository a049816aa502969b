"""Bands and their responses, Planck's law, the Sun, magnitudes."""
