"""What lies behind stars and targets: zodiacal light, the Earth and its limb, stray light, maps of the user's."""
