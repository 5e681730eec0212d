"""What a flight leaves behind: the log, its declaration, and what reads it on the ground."""
