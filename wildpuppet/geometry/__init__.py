"""Affine maps, mesh topology, triangulation, as-rigid-as-possible energies."""
