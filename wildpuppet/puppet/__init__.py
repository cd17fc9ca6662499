"""Puppets: ``folder`` reads and writes them, ``build`` meshes them, ``check`` and ``overlay`` judge them.

``automatic`` makes one from a frame and a box, ``outlines`` cuts one out of a frame along outlines that a person drew.
"""
