"""Shapes, motion and surfaces of targets."""
