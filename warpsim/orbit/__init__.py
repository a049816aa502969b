"""Where satellites, targets, the Earth and the Sun are: host side, NumPy float64, metres, GCRS axes."""
