"""Reading flights back on the ground: our logs and those of others, as one `FlightData`."""
