"""What a flight leaves behind: the log, its topics, and what reads it on the ground."""
