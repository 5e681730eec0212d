"""Wind fields, turbulence, and the zero excess updraft contour in them."""
