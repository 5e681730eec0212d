"""Surveys: a contour drawn from a slide there and back, and how well."""
