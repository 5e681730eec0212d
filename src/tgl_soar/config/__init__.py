"""Airframe and site files, every parameter declared once, their files and store.

Parameters
  parameters           every one, declared: name, unit, range, default, meaning
  parameter_rules      what they mean together: which values contradict each other
  parameter_groups     by topic;  parameter_files: ground stations' files
  parameter_store      changed over the air, kept over a restart
  line_changes         setting the line: presets, staged moves, what is refused

Files
  airframe             the airframe file: surfaces (flaps and spoilers too), channels, firmware
  site                 the site file;  strict: what the tables of both are made of
  files                reading them: strict TOML to validated objects

What follows from an airframe file
  dynamics             what the schedule of pitch knows;  lateral_dynamics: of roll and yaw
  lateral_gains        gains of roll, heading and bank;  flown_gains: whose gains of pitch are flown
  glide_limits         pitch attitudes, slowest airspeed;  stall_limit: largest angle of attack
"""
