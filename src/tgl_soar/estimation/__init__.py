"""From measurements to the state of the aircraft: pure, no clock, no I/O."""
