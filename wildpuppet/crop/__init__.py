"""Windows around the character, the background plate and the matte."""
