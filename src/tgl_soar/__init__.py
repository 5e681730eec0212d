"""An autopilot module that holds a soaring UAV on a target gradient line, over MAVLink."""

__version__ = "0.1.0"
