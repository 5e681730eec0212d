"""Figures and pages from flights and simulations."""
