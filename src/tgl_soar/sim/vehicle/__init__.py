"""The simulated Pixhawk: an ArduPlane as a companion computer and ground stations meet it.

pixhawk              the autopilot: what arrives, mode, arming, one step
vehicle_links        links, what is queued on them, and the ways between them
commands             COMMAND_LONG and COMMAND_INT, and their results
parameter_service    the parameter protocol;  firmware_parameters: the values and ranges
surface_outputs      receiver, overrides, servos;  level_flight: the law of FBWA
modes                its modes, by their numbers;  vehicle_clock: time as it counts it
onlooker_events      what happens to it, in words
external_pose        how it takes a pose that a companion measures
message_streams      which messages are due;  reports: what is in them;  sensed: of what
"""
