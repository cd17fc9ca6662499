"""Points and dense maps between frames through the puppet; visibility, confidence, and the accuracy measures."""
