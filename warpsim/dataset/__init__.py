"""Data sets: many sampled sequences of a scene, with their labels, on one machine or many."""
