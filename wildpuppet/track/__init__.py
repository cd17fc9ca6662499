"""Following the character's box through the clip."""
