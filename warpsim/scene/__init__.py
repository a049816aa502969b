"""Descriptions of what is simulated."""
