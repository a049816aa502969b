"""Cameras and point spread functions."""
