"""The simulated world: aircraft, sensors, servos, a Pixhawk that speaks MAVLink, scenarios."""
