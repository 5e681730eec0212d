"""From measurements to the state of the aircraft: pure, no clock, no I/O.

Position and velocity
  motion               the estimate at the time of the tick;  motion_state: what it remembers
  position_fixes       whether a fix is accepted, and what it changes
  inertial_track       by accelerometers alone;  fix_filter: what the track is wrong by
  accelerometer_bias   the bias of accelerometers
  ground_range         the height by a rangefinder

Attitude and air
  attitude_track       attitude between samples;  body_axes: axes and motion along them
  wind                 airspeed, angle of attack, wind, updraft;  cross_wind: its direction
  pitot_watch          whether the pitot tube tells the truth
  aerodynamics         lift, drag, trim;  polar: the glide polar, fitted and read
  lift_map/            the field of the wind around the aircraft

  health               how old inputs are, and whether they may be flown with
"""
