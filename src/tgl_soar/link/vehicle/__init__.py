"""What is received of one vehicle: its status, its samples, and when they were true.

status               the heartbeats: mode, identity, firmware
position_samples     positions;  sensor_samples: attitude, accelerations, airspeed, surfaces
estimator_status     whether a position is measured;  gnss_accuracy: what its receiver says
autopilot_wind       the wind that its own modes reckon with
sample_times         when a sample was true, by the vehicle's clock
message_rates        which messages are requested, and how often
diagnostics          counters and notices
"""
