"""What is received of one vehicle: its status, its samples, and when they were true."""
