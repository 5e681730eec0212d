"""What is asked of a vehicle before a flight: its set-up, and each surface."""
