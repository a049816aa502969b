"""How fast frames are made: the work that is measured, the clock, and the tables of `warpsim bench`."""
