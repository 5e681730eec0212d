"""One file for each autopilot firmware: how it wants its surfaces commanded."""
