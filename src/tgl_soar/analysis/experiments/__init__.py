"""Scenarios, and the paper's experiments flown in simulation."""
