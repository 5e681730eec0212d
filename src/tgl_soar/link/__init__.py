"""Talking to autopilots, ground stations and motion capture."""
