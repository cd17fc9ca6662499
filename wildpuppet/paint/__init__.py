"""Paint once: the puppet's texture is edited, and every frame of a run is drawn again with it.

``reading`` finds what was changed in the person's pictures, ``compose`` lays it into one frame (``edges``: along the
outlines, ``covered``: not over what stands in front of the character), ``paint`` goes through all frames.
"""
