"""The control laws: pure functions of parameters, state and measurements."""
