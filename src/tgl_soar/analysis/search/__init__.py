"""The search for lift, flown: random fields, the module's own closed loop, baselines."""
