"""Motion of satellites, targets, the Earth and the Sun: host side, NumPy float64, metres, GCRS axes."""
