"""Speed of rendering: the measured work, the clock, and the tables of `warpsim bench`."""
