"""The global search for the pose: where every part is, before any gradient."""
