"""Video files: frame table with exact times, decoding, encoding, shots, held drawings, folders of drawings."""
