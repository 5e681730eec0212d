"""Where to put the line: candidates flown ahead in the fields that the lift map holds likely."""
