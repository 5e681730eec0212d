"""A point of the line held with a brake, and brakes that jam."""
