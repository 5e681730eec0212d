"""Losses that are rare: their probability by splitting, by plain flights and by theory."""
