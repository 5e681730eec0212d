"""Airframe and site files, every parameter declared once, their files and store."""
