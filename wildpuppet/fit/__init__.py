"""The energy of a puppet in a picture, and its minimisers."""
