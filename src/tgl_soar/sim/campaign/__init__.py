"""Many flights: one runner for one process, for all processors of a machine, and for several."""
