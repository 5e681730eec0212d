"""The field of the wind around the aircraft, from what it has flown through."""
