"""Over the hill: launches and landings, satellites, a rangefinder, an hour of turning wind."""
