"""What is known in flight: the motion, the angle of attack, the wind, and what they are worth."""
