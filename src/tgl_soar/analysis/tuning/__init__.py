"""Gains for an airframe: sought on the linear model, chosen and judged in flight."""
